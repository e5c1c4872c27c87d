"""A GigE or USB3 Vision camera, through libaravis."""

import time
from collections.abc import Callable
from dataclasses import replace

from drivers.cameras.aravis_library import AravisLibrary, load_aravis
from drivers.cameras.bounded_camera import BoundedCamera
from drivers.cameras.gige_frame import Asked, FrameNumbers, asked_now, frame_of
from drivers.cameras.gige_link import GigeLink, address_of
from drivers.cameras.gige_options import GigeOptions, Link, read_gige_place
from drivers.cameras.gige_stream import PacketCounts, Received, loss_told
from drivers.errors import DeviceError, DeviceTimeoutError, LimitError, NotConnectedError, ProtocolError
from drivers.interfaces import CameraFacts, CameraSettings, DeviceIdentity, Frame, FrameTally

_FIRST_EXPOSURE_S = 0.01
_PROBE_TIMEOUT_S = 5.0
_PROBE_PICTURE_S, _PROBE_PICTURES = 1.5, 2  # for each size of packets that is tried; the first picture may be damaged
_REOPENINGS = 3  # in one picture
_LOOK_S = 0.2  # how often a wait looks whether the camera is still there
_DELIVERY_S = 1.0  # beyond exposure (and frame period): a picture that takes longer does not come any more
# Cell of Sony's sensors with polarizers (IMX250MZR, IMX253MZR), which the formats with this word in their names are of.
_SENSOR_CELL_DEG = (90.0, 45.0, 135.0, 0.0)
_THERMOMETERS = ("SensorTemperature", "DeviceTemperature")
_NO_PICTURES = (
    "If no picture ever comes, a firewall may hold back the stream (UDP), or packets are larger than the network "
    "carries: `rigctl doctor` tells"
)


class GigeCamera:
    """A camera that is open; `open_gige`, `open_usb3` and `open_aravis` make one, and see to its deadlines.

    Parameters
    ----------
    library : AravisLibrary
        The library.
    options : GigeOptions
        Where the camera is and how it is to be used.

    Notes
    -----
    A picture is taken at a software trigger after the call, or, where the camera runs by itself, accepted only if the
    host received its first packet so late that its exposure began after the call: by one exposure and one frame
    period at least. What a camera with a memory of its own sends late cannot be known in that mode.

    Damaged pictures are taken again. If the camera is lost, or was restarted, or has other settings than it was given,
    the connection is made anew with all settings, within the time that the caller allows. Each call of the
    library to a camera that is silent takes 2.5 s, and giving it up takes five: by so much a deadline may be passed
    here; `BoundedCamera` does not wait for it.
    """

    def __init__(
        self,
        library: AravisLibrary,
        options: GigeOptions,
        *,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._library, self._options, self._now_s = library, options, now_s
        self._tally = FrameTally()
        self._packets_before = PacketCounts()
        self._numbers = FrameNumbers()
        self._link: GigeLink | None = GigeLink(library, options)
        self._identity = self._link.identity
        try:
            self._settings = self._link.configure(exposure_s=_FIRST_EXPOSURE_S, gain_db=0.0)
            if options.packet_size == "probe" and self._link.packet_size is not None:
                self._options = replace(options, packet_size=self._largest_packets(self._link))
            self._link.restart()
            self.take_frame(timeout_s=_PROBE_TIMEOUT_S)  # the first one is often damaged, and a firewall shows here
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> "GigeCamera":
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()

    def identify(self) -> DeviceIdentity:
        """Return what the camera said of itself when it was opened."""
        self._opened()
        return self._identity

    def configure(self, *, exposure_s: float, gain_db: float) -> CameraSettings:
        """Set exposure and gain; return what was read back.

        Raises
        ------
        LimitError
            A value is outside of what the camera allows; then nothing is changed.
        NotConnectedError, DeviceTimeoutError
            The camera does not answer.
        """
        self._settings = self._opened().configure(exposure_s=exposure_s, gain_db=gain_db)
        return self._settings

    def tally(self) -> FrameTally:
        """Return what became of the pictures and of their packets so far."""
        packets = self._packets()
        return replace(self._tally, packets=packets.seen, packets_lost=packets.lost, packets_resent=packets.resent)

    def facts(self) -> CameraFacts:
        """Return how its samples come, and whether all that bends them is off."""
        setup = self._opened().setup
        pixel_format = setup.pixel_format
        return CameraFacts(
            sample_format=pixel_format.name,
            justified=pixel_format.justified,
            linear=setup.linear,
            triggered=self._options.trigger == "software",
            mosaic_deg=_SENSOR_CELL_DEG if pixel_format.is_polarized else None,
        )

    def features(self) -> dict[str, str]:
        """Return what was written to the camera, under its own names, and its temperature where it tells it."""
        link = self._opened()
        used = dict(link.features.used) | ({} if link.setup.plane is None else {"plane": link.setup.plane})
        for feature in filter(link.features.has, _THERMOMETERS):
            used[feature] = f"{link.features.number(feature):g}"
        clock = link.clock.told()
        return used if clock is None else used | {"clock": clock}

    def take_frame(self, *, timeout_s: float) -> Frame:
        """Return a picture whose exposure began after this call, complete and with the settings that it names.

        Raises
        ------
        DeviceTimeoutError
            No picture came in time.
        ProtocolError
            Picture after picture comes in damaged.
        NotConnectedError
            The camera is gone, or belongs to another program now.
        LimitError
            It came back and cannot be set as it was.
        """
        self._opened()
        if self._settings.exposure_s > timeout_s:
            raise DeviceTimeoutError(
                f"{self._name}: no picture within {timeout_s} s, since the exposure is {self._settings.exposure_s} s; "
                "allow more time or expose shorter"
            )
        deadline_s = self._now_s() + timeout_s
        reopenings, damaged = 0, 0
        while True:
            try:
                frame = self._attempt(deadline_s)
            except (NotConnectedError, DeviceTimeoutError) as error:
                reopenings += 1
                self._reopen(error, deadline_s=deadline_s, may=reopenings <= _REOPENINGS)
                continue
            if frame is not None:
                self._tally = replace(self._tally, accepted=self._tally.accepted + 1)
                return frame
            damaged += 1
            self._refuse_too_many(damaged, deadline_s=deadline_s)

    def close(self) -> None:
        """Release the camera. May be called twice."""
        link, self._link = self._link, None
        if link is not None:
            try:
                link.close(answers=link.is_controlled())
            except DeviceError:
                link.close(answers=False)  # it was already going away; there is nothing left to stop

    def _largest_packets(self, link: GigeLink) -> int:
        """Return the largest size of packets with which a whole picture comes; the camera has it then."""
        sizes = link.packet_sizes()
        for size in sizes[:-1]:
            link.set_packet_size(size)
            link.restart()
            deadline_s = self._now_s() + _PROBE_PICTURE_S
            if any(self._attempt(deadline_s) is not None for _ in range(_PROBE_PICTURES)):
                return size
        link.set_packet_size(sizes[-1])
        return sizes[-1]

    @property
    def _name(self) -> str:
        return self._options.camera_name

    def _packets(self) -> PacketCounts:
        return self._packets_before if self._link is None else self._packets_before + self._link.packets()

    def _opened(self) -> GigeLink:
        if self._link is None:
            raise NotConnectedError(f"{self._name}: it was closed; open it again")
        return self._link

    def _attempt(self, deadline_s: float) -> Frame | None:
        """Take one picture; return None if it was damaged or did not come, after which another may be asked for."""
        link = self._opened()
        link.stream.drain()
        asked = asked_now()
        if self._options.trigger == "software":
            link.features.execute("TriggerSoftware")
        received = self._await_picture(asked, deadline_s)
        if received is None:
            # It may come yet. A new stream cannot take it for an answer to the next trigger.
            self._tally = replace(self._tally, never_came=self._tally.never_came + 1)
            self._numbers.forget()
            link.restart()
            return None
        if asked.was_clock_set():
            return None  # then its time of arrival says nothing
        if received.damage is not None:
            self._tally = replace(self._tally, damaged=self._tally.damaged + 1)
            return None
        self._require_settings(link)
        link.clock.look()
        return frame_of(
            received,
            setup=link.setup,
            settings=self._settings,
            sequence=self._numbers.of(received.frame_id),
            asked=asked,
            clock=link.clock,
            free_period_s=None if self._options.trigger == "software" else 1.0 / self._options.frame_rate_hz,
        )

    def _await_picture(self, asked: Asked, deadline_s: float) -> Received | None:
        """Return the first picture that began after it was asked for; None if none comes."""
        link = self._opened()
        oldest_utc_ns = asked.utc_ns + self._earliest_arrival_ns()
        patience_s = self._settings.exposure_s + _DELIVERY_S + self._earliest_arrival_ns() / 1e9
        give_up_s = min(deadline_s, self._now_s() + patience_s)
        while (left_s := give_up_s - self._now_s()) > 0.0:
            received = link.stream.receive(timeout_s=min(left_s, _LOOK_S))
            if received is None:
                if not link.is_controlled():
                    raise NotConnectedError(f"{self._name}: control of it was lost: it is off, restarted, or unplugged")
                continue
            if received.first_packet_utc_ns >= oldest_utc_ns:
                return received
            self._tally = replace(self._tally, too_old=self._tally.too_old + 1)
        return None

    def _earliest_arrival_ns(self) -> int:
        """Return how long after it was asked for a picture must have come in, for its exposure to have begun after."""
        if self._options.trigger == "software":
            return 0
        return round((self._settings.exposure_s + 1.0 / self._options.frame_rate_hz) * 1e9)

    def _require_settings(self, link: GigeLink) -> None:
        found = link.settings()
        if found != self._settings:
            raise NotConnectedError(
                f"{self._name}: it is set to {found}, not to {self._settings}: it was restarted, or another program "
                "has changed it"
            )

    def _refuse_too_many(self, damaged: int, *, deadline_s: float) -> None:
        if self._now_s() >= deadline_s:
            raise DeviceTimeoutError(
                f"{self._name}: no complete picture came in time ({damaged} were damaged or did not come). "
                f"{_NO_PICTURES}"
            )
        if damaged > self._options.retakes:
            raise ProtocolError(
                f"{self._name}: {damaged} pictures in a row were damaged or did not come. {self._loss()}"
            )

    def _loss(self) -> str:
        """Return what was measured of the way to the camera, and what to try."""
        packet_size = self._opened().packet_size
        if packet_size is None:
            return "Check the cable and the USB hub, and let nothing else use this bus"
        return loss_told(
            self._packets(), address=address_of(self._library, self._options.place), packet_size=packet_size
        )

    def _reopen(self, cause: DeviceError, *, deadline_s: float, may: bool) -> None:
        """Make the connection anew, with all settings as they were."""
        self._give_up()
        while may and self._now_s() < deadline_s:
            try:
                link = GigeLink(self._library, self._options)
            except (NotConnectedError, DeviceTimeoutError) as error:
                cause = error
                continue
            try:
                self._restore(link)
            except BaseException:
                link.close(answers=False)
                raise
            self._link = link
            self._numbers.forget()
            self._tally = replace(self._tally, reopened=self._tally.reopened + 1)
            return
        raise cause

    def _give_up(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            link.close(answers=False)
            self._packets_before += link.packets()

    def _restore(self, link: GigeLink) -> None:
        if link.identity != self._identity:
            raise NotConnectedError(f"{self._name}: what came back is {link.identity}, and it was {self._identity}")
        restored = link.configure(exposure_s=self._settings.exposure_s, gain_db=self._settings.gain_db)
        if restored != self._settings:
            raise LimitError(f"{self._name}: it came back, and is now {restored} instead of {self._settings}")
        link.restart()


def open_gige(place: str) -> BoundedCamera:
    """Return a GigE Vision camera by ``PLACE?key=value&...``; the place is its IP address, serial number or name.

    See `drivers.cameras.gige_options.GigeOptions` for the keys.

    Raises
    ------
    NotConnectedError, DeviceTimeoutError
        It is not there, belongs to another program, sends no picture, or libaravis is not installed.
    LimitError
        The address is wrong, or the camera cannot be set to it.
    """
    return _open(place, link="gige")


def open_usb3(place: str) -> BoundedCamera:
    """Return a USB3 Vision camera by ``PLACE?key=value&...``; the place is its serial number or name.

    Raises as `open_gige`.
    """
    return _open(place, link="usb3")


def open_aravis(place: str) -> BoundedCamera:
    """Return whatever camera libaravis knows by a name, such as ``Fake_1``, which it simulates.

    Raises as `open_gige`.
    """
    return _open(place, link="any")


def _open(place: str, *, link: Link) -> BoundedCamera:
    options = read_gige_place(place, link=link)
    library = load_aravis()
    return BoundedCamera(lambda: GigeCamera(library, options), name=options.camera_name)


def network_address(place: str) -> str:
    """Return the IP address of a camera, by its place as `open_gige` takes it; the camera is not opened.

    Raises
    ------
    NotConnectedError
        It is not there, or libaravis is not installed.
    """
    return address_of(load_aravis(), place.partition("?")[0])
