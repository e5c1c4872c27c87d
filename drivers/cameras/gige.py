"""GigE Vision and USB3 Vision cameras, through libaravis: options, connection, settings, frames, finding.

Each setting that is written when the camera is opened is read back. Counts, growing numbers and times of exposure are
derived from each picture as it comes in.
"""

import ipaddress
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from drivers.cameras.aravis import (
    AravisError,
    AravisLibrary,
    CameraClock,
    GigeFeatures,
    GigeStream,
    Received,
    device_error,
    load_aravis,
    loss_text,
)
from drivers.cameras.bounded_camera import (
    Asked,
    BoundedCamera,
    asked_now,
    one_of,
    positive,
    split_place,
    whole,
    yes_or_no,
)
from drivers.cameras.samples import (
    GENICAM,
    PLANES,
    ByteOrder,
    Justified,
    PixelFormat,
    Plane,
    counts_of_picture,
    polarized_format,
    size_of_counts,
    unpack,
)
from drivers.errors import DeviceError, DeviceTimeoutError, LimitError, NotConnectedError, ProtocolError
from drivers.interfaces import CameraFacts, CameraSettings, DeviceIdentity, Frame, FrameTally, StartSource
from drivers.network_path import path_mtu

Trigger = Literal["software", "free"]
Link = Literal["gige", "usb3", "any"]
"""How the camera is reached; "any" is any camera that libaravis finds under the name."""
_PACKET_BYTES = (576, 16384)
_NAMES: dict[Link, str] = {"gige": "GigE camera", "usb3": "USB3 camera", "any": "camera"}
_AUTOMATIC = ("ExposureAuto", "GainAuto", "BlackLevelAuto", "BalanceWhiteAuto", "ContrastAuto")
_PROCESSING = ("GammaEnable", "LUTEnable", "SharpnessEnable", "NoiseReductionEnable")
_GAMMA = "Gamma"
_EXPOSURE = ("ExposureTime", "ExposureTimeAbs", "ExposureTimeRaw")
_EXPOSURE_RAW, _EXPOSURE_UNIT = "ExposureTimeRaw", "ExposureTimeBaseAbs"
# Payload with data behind the pixels.
_CHUNKS = "ChunkModeActive"
_GAIN, _GAIN_RAW = "Gain", "GainRaw"
# Makers whose GainRaw counts dB.
_RAW_IS_DB = ("prosilica", "allied", "avt", "aravis")
_BEST_FIRST = ("Mono14", "Mono12", "Mono12p", "Mono12Packed", "Mono10", "Mono10p", "Mono10Packed", "Mono16", "Mono8")
_RATE = ("AcquisitionFrameRate", "AcquisitionFrameRateAbs")
_RATE_TOLERANCE = 0.01
_ETHERNET_MTU = 1500
# Features that limit the data rate [bytes/s]: the standard's, and Prosilica's.
_BANDWIDTH, _BANDWIDTH_MODE = ("DeviceLinkThroughputLimit", "StreamBytesPerSecond"), "DeviceLinkThroughputLimitMode"
_GIGABIT_NS_PER_BYTE, _PAUSE_TOLERANCE = 8.0, 0.05
_PROTOCOLS: dict[Link, tuple[bytes, ...]] = {
    "gige": (b"GigEVision",),
    "usb3": (b"USB3Vision",),
    "any": (b"GigEVision", b"USB3Vision", b"Fake"),
}
_NETWORK = "GigEVision"
_IN_LIBRARY = "Fake"  # cameras simulated by the library, which lists them on request
_EXPOSURE_TOLERANCE = 0.01
_PACKET_SIZES = (9000, 8192, 4096, 1500)  # sizes tried by "probe"
_US_PER_S = 1e6
_LARGEST_SHORT_ID = 65535
_TRIGGER: StartSource = "trigger"
_ARRIVAL: StartSource = "arrival"
_FIRST_EXPOSURE_S = 0.01
_PROBE_TIMEOUT_S = 5.0
_PROBE_PICTURE_S, _PROBE_PICTURES = 1.5, 2  # per size; the first picture may be damaged
_REOPENINGS = 3  # in one picture
_LOOK_S = 0.2  # period of checks for a lost camera
_DELIVERY_S = 1.0  # beyond exposure (and frame period); later pictures do not come
# Cell of Sony's sensors with polarizers (IMX250MZR, IMX253MZR), for formats with this word in their names.
_SENSOR_CELL_DEG = (90.0, 45.0, 135.0, 0.0)
_THERMOMETERS = ("SensorTemperature", "DeviceTemperature")
_NO_PICTURES = (
    "If no picture ever comes, a firewall may block the stream (UDP), or packets are too large for the network: "
    "`rigctl doctor` checks this"
)


@dataclass(frozen=True, kw_only=True)
class GigeOptions:
    """Content of an address. None: the camera's largest picture, its best format, its own black level."""

    place: str  #: IP address, serial number, or name.
    link: Link = "gige"  #: How it is reached.
    pixel_format: str | None = None  #: As PFNC names it.
    plane: Plane | None = None  #: Plane of a Bayer format: see `drivers.cameras.samples`.
    width: int | None = None  #: Size of the region [pixels after binning].
    height: int | None = None
    offset_x: int = 0  #: Its first column and row.
    offset_y: int = 0
    binning: int = 1  #: Pixels that are added, in both directions.
    #: The camera mirrors its pictures, to undo a mirror in the path of light: it changes the sign of polarization
    #: angles.
    reverse_x: bool = False
    reverse_y: bool = False
    black_level_dn: int | None = None  #: The camera's own black level setting.
    #: Each picture is requested, or the camera runs freely and pictures that began too early are dropped.
    trigger: Trigger = "software"
    frame_rate_hz: float = 20.0  #: If it runs freely.
    #: Bytes of a packet with all its headers; at most what the interface sends in one piece. "probe": the largest with
    #: which a whole picture comes.
    packet_size: int | Literal["probe"] | None = None
    #: Data rate of the camera if several share a line [MB/s].
    bandwidth_mb_per_s: float | None = None
    bit_depth: int | None = None  #: True bits of a sample if the format has more, such as Mono16.
    justified: Justified = "right"  #: Position of these bits, and order of the bytes.
    byte_order: ByteOrder = "little"
    #: Step of an exposure that the camera counts without a unit [us].
    exposure_step_us: float | None = None
    #: Step of an integer gain [dB], if the maker is not known.
    gain_step_db: float | None = None
    ptp: bool | None = None  #: Whether the camera's clock follows a PTP master; None: as it was found.
    retakes: int = 20  #: Most retakes of a damaged picture.

    @property
    def camera_name(self) -> str:
        """Name of the camera in messages."""
        return f"{_NAMES[self.link]} {self.place}"


def open_gige(place: str) -> BoundedCamera:
    """Return a GigE Vision camera by ``PLACE?key=value&...``; the place is its IP address, serial number or name.

    See `drivers.cameras.gige.GigeOptions` for the keys.

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
    """Return the camera that libaravis knows by a name, such as its simulation ``Fake_1``.

    Raises as `open_gige`.
    """
    return _open(place, link="any")


def read_gige_place(text: str, *, link: Link = "gige") -> GigeOptions:
    """Return the options in ``PLACE?key=value&...``; see `GigeOptions` for the keys."""
    place, values = split_place(text, _READERS)
    return GigeOptions(place=place, link=link, **values)


def find_gige() -> Iterator[tuple[str, DeviceIdentity]]:
    """Yield address and identity of each GigE Vision camera that answers a broadcast; none is opened.

    Raises
    ------
    NotConnectedError
        libaravis is not installed.
    """
    for camera in _find_cameras(load_aravis()):
        yield (
            f"gige:{camera.address}",
            # The firmware is known only after opening.
            DeviceIdentity(model=camera.name, serial_number=camera.serial_number, firmware="not asked"),
        )


def find_usb3() -> Iterator[tuple[str, DeviceIdentity]]:
    """Yield address and identity of each connected USB3 Vision camera; none is opened.

    Raises
    ------
    NotConnectedError
        libaravis is not installed.
    """
    for camera in _find_cameras(load_aravis(), link="usb3"):
        yield (
            f"u3v:{camera.serial_number or camera.name}",
            DeviceIdentity(model=camera.name, serial_number=camera.serial_number, firmware="not asked"),
        )


def network_address(place: str) -> str:
    """Return the IP address of a camera, by its place as `open_gige` takes it; the camera is not opened."""
    return _address_of(load_aravis(wanted_for=f"GigE camera {place}"), place.partition("?")[0])


def _packet_size(text: str) -> int | str:
    return text if text == "probe" else whole(*_PACKET_BYTES)(text)


_READERS: dict[str, Callable[[str], Any]] = {
    "pixel_format": str,
    "plane": one_of(*PLANES),
    "width": whole(1, 65535),
    "height": whole(1, 65535),
    "offset_x": whole(0, 65535),
    "offset_y": whole(0, 65535),
    "binning": whole(1, 16),
    "reverse_x": yes_or_no,
    "reverse_y": yes_or_no,
    "black_level_dn": whole(0, 65535),
    "trigger": one_of("software", "free"),
    "frame_rate_hz": positive,
    "packet_size": _packet_size,
    "bandwidth_mb_per_s": positive,
    "bit_depth": whole(8, 16),
    "justified": one_of("right", "left"),
    "byte_order": one_of("little", "big"),
    "exposure_step_us": positive,
    "gain_step_db": positive,
    "ptp": yes_or_no,
    "retakes": whole(0, 1000),
}


def _open(place: str, *, link: Link) -> BoundedCamera:
    options = read_gige_place(place, link=link)
    library = load_aravis(wanted_for=options.camera_name)
    return BoundedCamera(lambda: GigeCamera(library, options), name=options.camera_name)


@dataclass(frozen=True, kw_only=True)
class _FoundCamera:
    """A camera that answered a broadcast."""

    address: str
    serial_number: str
    name: str
    protocol: str = _NETWORK


def _find_cameras(library: AravisLibrary, *, link: Link = "gige") -> list[_FoundCamera]:
    """Return the cameras of a kind that answer a broadcast, in about a second."""
    library.call("update_device_list")
    return [
        _FoundCamera(
            address=_text(library, "get_device_address", index),
            serial_number=_text(library, "get_device_serial_nbr", index),
            name=_text(library, "get_device_id", index),
            protocol=_text(library, "get_device_protocol", index),
        )
        for index in range(library.call("get_n_devices"))
        if library.call("get_device_protocol", index) in _PROTOCOLS[link]
    ]


def _device_of(library: AravisLibrary, options: GigeOptions) -> str:
    """Return the name for the library: the IP address of a camera on the network, else the library's own name."""
    if options.link == "gige":
        return _address_of(library, options.place)
    if options.link == "any" and options.place.startswith(_IN_LIBRARY):
        library.call("enable_interface", _IN_LIBRARY.encode())
        return options.place
    found = _find_cameras(library, link=options.link)
    for camera in found:
        if options.place in (camera.serial_number, camera.name, camera.address):
            return camera.address if camera.protocol == _NETWORK else camera.name
    there = ", ".join(f"{c.name} (serial {c.serial_number}, {c.protocol})" for c in found) or "none"
    advice = " A USB camera needs power, a USB 3 port, and the right to use it (docs/cameras.md)" * (not found)
    raise NotConnectedError(
        f"{options.camera_name}: no camera of this serial number or name answers; found: {there}.{advice}"
    )


def _address_of(library: AravisLibrary, place: str) -> str:
    """Return the IP address of a camera that is given by address, serial number or name.

    A camera is always opened by its address: opened by name, it may be reached through another interface than its
    pictures, and then none come.
    """
    try:
        return str(ipaddress.ip_address(place))
    except ValueError:
        found = _find_cameras(library)
    for camera in found:
        if place in (camera.serial_number, camera.name):
            return camera.address
    there = ", ".join(f"{c.name} (serial {c.serial_number}) at {c.address}" for c in found) or "none"
    raise NotConnectedError(f"GigE camera {place}: no camera of this serial number or name answers; found: {there}")


@dataclass(frozen=True, kw_only=True)
class GigeSetup:
    """Settings written when a camera was opened."""

    pixel_format: PixelFormat  #: Of its samples.
    pixel_format_code: int  #: Number of each picture.
    sent_width: int  #: Size of the pictures that it sends.
    sent_height: int
    width: int  #: Of counts: half as large, and of more bits, where several colours are summed.
    height: int
    bit_depth: int
    plane: Plane | None  #: Plane of a mosaic of colours.
    linear: bool | None  #: True if all nonlinear processing is off; None if the camera reports none.
    exposure_feature: str  #: The camera's own name of the exposure.
    exposure_step_us: float  #: Its step [us]; 1 if it is in microseconds.
    gain_feature: str | None  #: The camera's own name of the gain; None for a camera that has none.
    gain_step_db: float | None  #: Its step [dB]; None if it is a floating-point number in dB.


class GigeLink:
    """An open camera with all of its settings written and its acquisition running."""

    def __init__(self, library: AravisLibrary, options: GigeOptions) -> None:
        self.name = options.camera_name
        self._library = library
        self._stream: GigeStream | None = None
        self._packets = FrameTally()
        place = _device_of(library, options)
        self._camera: int | None = _open_device(library, place, name=self.name)
        try:
            self._is_network = bool(library.call("camera_is_gv_device", self._camera))
            self.packet_size: int | None = None
            self._device: int = library.call("camera_get_device", self._camera)
            if not self.is_controlled():
                raise NotConnectedError(f"{self.name}: another program controls it: close that one first")
            self.features = GigeFeatures(library, self._device, name=self.name)
            self.identity = _identity(self.features)
            self.setup: GigeSetup = _set_up(self.features, options)
            self.clock = CameraClock(self.features, ptp=options.ptp)
            self._place = place
            if self._is_network:
                self.set_packet_size(None if options.packet_size == "probe" else options.packet_size)
            if options.bandwidth_mb_per_s is not None:
                _set_bandwidth(
                    library,
                    self._camera,
                    self.features,
                    asked_mb_per_s=options.bandwidth_mb_per_s,
                    packet_size=self.packet_size,
                )
        except BaseException:
            self.close(answers=False)
            raise

    @property
    def stream(self) -> GigeStream:
        """The running stream; made anew by `restart`."""
        if self._stream is None:
            raise NotConnectedError(f"{self.name}: nothing was started")
        return self._stream

    def is_controlled(self) -> bool:
        """Return whether the camera still answers us; a loss is noticed after about 5 s."""
        if self._is_network:
            return bool(self._library.call("gv_device_is_controller", self._device))
        try:
            GigeFeatures(self._library, self._device, name=self.name).whole("Width")
        except DeviceError:
            return False
        return True

    def set_packet_size(self, asked: int | None) -> None:
        """Set the size of packets before the stream starts; None: the size that every Ethernet carries."""
        self.packet_size = _set_packet_size(
            self._library, self._opened(), self.features, address=self._place, asked=asked
        )

    def packet_sizes(self) -> tuple[int, ...]:
        """Return packet sizes that the interface to the camera sends unfragmented, largest first."""
        mtu = path_mtu(self._place)
        return tuple(size for size in _PACKET_SIZES if size <= mtu)

    def packets(self) -> FrameTally:
        """Return the fate of the packets of all pictures since the camera was opened."""
        return self._packets if self._stream is None else self._packets + self._stream.packets()

    def configure(self, *, exposure_s: float, gain_db: float) -> CameraSettings:
        """Set exposure and gain; return the settings read back. A refusal changes nothing."""
        setup = self.setup
        # Rounded to a picosecond: cameras truncate to a step, and 29.999... would become 29.
        exposure = self._exposure_steps(exposure_s)
        gain = self._gain_steps(gain_db)
        self.features.set_number(setup.exposure_feature, exposure, relative=_EXPOSURE_TOLERANCE)
        if isinstance(gain, int):
            self.features.set_whole(str(setup.gain_feature), gain)
        elif gain is not None:
            self.features.set_number(str(setup.gain_feature), gain, relative=_EXPOSURE_TOLERANCE)
        return self.settings()

    def settings(self) -> CameraSettings:
        """Read the camera's settings."""
        setup = self.setup
        return CameraSettings(
            exposure_s=self.features.number(setup.exposure_feature) * setup.exposure_step_us / _US_PER_S,
            gain_db=self._gain_db(),
            width=setup.width,
            height=setup.height,
            bit_depth=setup.bit_depth,
        )

    def restart(self) -> None:
        """Stop the acquisition, drop the stream with all waiting pictures, and start a new one."""
        if self._stream is not None:
            self._stream.stop()
            self._give_up_stream()
        self._stream = GigeStream(self._library, self._opened(), name=self.name, packet_size=self.packet_size)
        self._stream.start()

    def close(self, *, answers: bool) -> None:
        """Release the camera; stop its acquisition first if it answers. May be called twice."""
        try:
            if answers and self._stream is not None and self._camera is not None:
                self._stream.stop()
        finally:
            self._give_up_stream()
            if self._camera is not None:
                self._library.release(self._camera)
                self._camera = None

    def _give_up_stream(self) -> None:
        if self._stream is not None:
            self._packets = self.packets()
            self._stream.close()
            self._stream = None

    def _opened(self) -> int:
        if self._camera is None:
            raise NotConnectedError(f"{self.name}: it was closed")
        return self._camera

    def _exposure_steps(self, exposure_s: float) -> float:
        """Return the value for the camera's exposure, in its own steps."""
        setup = self.setup
        steps = round(exposure_s * _US_PER_S / setup.exposure_step_us, 6)
        if setup.exposure_step_us == 1.0:
            return self._within_limits(setup.exposure_feature, steps, "us")
        low, high = self.features.number_limits(setup.exposure_feature)
        if not low <= steps <= high:
            step_us = setup.exposure_step_us
            raise LimitError(
                f"{self.name}: the exposure is {exposure_s * _US_PER_S:g} us; it takes {low * step_us:g} to "
                f"{high * step_us:g} us, in steps of {step_us:g} us"
            )
        return steps

    def _gain_db(self) -> float:
        setup = self.setup
        if setup.gain_feature is None:
            return 0.0
        if setup.gain_step_db is None:
            return self.features.number(setup.gain_feature)
        return self.features.whole(setup.gain_feature) * setup.gain_step_db

    def _gain_steps(self, gain_db: float) -> float | int | None:
        """Return the value for the camera's gain, whole if it counts steps."""
        setup = self.setup
        if setup.gain_feature is None:
            if gain_db != 0.0:
                raise LimitError(f"{self.name}: gain_db is {gain_db} dB; it has no gain setting; use 0")
            return None
        if setup.gain_step_db is None:
            return self._within_limits(setup.gain_feature, gain_db, "dB")
        low, high = self.features.whole_limits(setup.gain_feature)
        steps = gain_db / setup.gain_step_db
        if not low <= steps <= high or steps != round(steps):
            raise LimitError(
                f"{self.name}: gain_db is {gain_db} dB; it takes {low * setup.gain_step_db:g} to "
                f"{high * setup.gain_step_db:g} dB in steps of {setup.gain_step_db:g} dB"
            )
        return round(steps)

    def _within_limits(self, feature: str, value: float, unit: str) -> float:
        low, high = self.features.number_limits(feature)
        if not low <= value <= high:
            raise LimitError(f"{self.name}: {feature} is {value:g} {unit}; it takes {low:g} to {high:g} {unit}")
        return value


class _FrameNumbers:
    """Growing numbers of pictures, although the camera's own go from 65535 to 1 and restart with it."""

    def __init__(self) -> None:
        self.last_id: int | None = None
        self._sequence = 0

    def forget(self) -> None:
        """Accept any next number, because the camera may have lost pictures or restarted."""
        self.last_id = None

    def of(self, frame_id: int) -> int:
        """Return the growing number of a picture for the camera's own."""
        last, self.last_id = self.last_id, frame_id
        advance = 1 if last is None else frame_id - last
        self._sequence += advance if advance > 0 else advance + _LARGEST_SHORT_ID
        return self._sequence


class GigeCamera:
    """An open camera; `open_gige`, `open_usb3` and `open_aravis` make one and enforce its deadlines.

    A picture is taken at a software trigger after the call. If the camera runs freely, a picture is accepted only if
    its first packet came at least one exposure and one frame period after the call; pictures delayed in the camera's
    own memory cannot be recognised in this mode.

    Damaged pictures are taken again. If the camera is lost, restarted or has other settings, it is connected again with
    all settings, within the time that the caller allows. A call to a silent camera takes 2.5 s and releasing it five,
    by which a deadline may be exceeded here; `BoundedCamera` does not wait for it.
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
        self._packets_before = FrameTally()
        self._numbers = _FrameNumbers()
        self._link: GigeLink | None = GigeLink(library, options)
        self._identity = self._link.identity
        try:
            self._settings = self._link.configure(exposure_s=_FIRST_EXPOSURE_S, gain_db=0.0)
            if options.packet_size == "probe" and self._link.packet_size is not None:
                self._options = replace(options, packet_size=self._largest_packets(self._link))
            self._link.restart()
            self.take_frame(timeout_s=_PROBE_TIMEOUT_S)  # the first one is often damaged; this also reveals a firewall
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> "GigeCamera":
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()

    def identify(self) -> DeviceIdentity:
        """Return the identity that the camera reported when it was opened."""
        self._opened()
        return self._identity

    def configure(self, *, exposure_s: float, gain_db: float) -> CameraSettings:
        """Set exposure and gain; return what was read back."""
        self._settings = self._opened().configure(exposure_s=exposure_s, gain_db=gain_db)
        return self._settings

    def tally(self) -> FrameTally:
        """Return the fate of the pictures and their packets so far."""
        return self._tally + self._packets()

    def facts(self) -> CameraFacts:
        """Return the format of its samples, and whether all nonlinear processing is off."""
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
        """Return the camera's settings under its own names, and its temperature if it reports one."""
        link = self._opened()
        used = dict(link.features.used) | ({} if link.setup.plane is None else {"plane": link.setup.plane})
        for feature in filter(link.features.has, _THERMOMETERS):
            used[feature] = f"{link.features.number(feature):g}"
        clock = link.clock.description()
        return used if clock is None else used | {"clock": clock}

    def take_frame(self, *, timeout_s: float) -> Frame:
        """Return a complete picture whose exposure began after this call, with its settings."""
        self._opened()
        if self._settings.exposure_s > timeout_s:
            raise DeviceTimeoutError(
                f"{self._name}: no picture within {timeout_s} s at an exposure of {self._settings.exposure_s} s; allow "
                "more time or expose shorter"
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
                self._tally += FrameTally(accepted=1)
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
                link.close(answers=False)  # already closing; nothing is left to stop

    def _largest_packets(self, link: GigeLink) -> int:
        """Set and return the largest packet size with which a whole picture comes."""
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

    def _packets(self) -> FrameTally:
        return self._packets_before if self._link is None else self._packets_before + self._link.packets()

    def _opened(self) -> GigeLink:
        if self._link is None:
            raise NotConnectedError(f"{self._name}: it was closed; open it again")
        return self._link

    def _attempt(self, deadline_s: float) -> Frame | None:
        """Take one picture; return None if it was damaged or did not come."""
        link = self._opened()
        link.stream.drain()
        asked = asked_now()
        if self._options.trigger == "software":
            link.features.execute("TriggerSoftware")
        received = self._await_picture(asked, deadline_s)
        if received is None:
            # It may still come. A new stream cannot mistake it for the answer to the next trigger.
            self._tally += FrameTally(never_came=1)
            self._numbers.forget()
            link.restart()
            return None
        if asked.was_clock_set(asked_now()):
            return None  # then its time of arrival is meaningless
        if received.damage is not None:
            self._tally += FrameTally(damaged=1)
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
        """Return the first picture that began after the request; None if none comes."""
        link = self._opened()
        oldest_utc_ns = asked.utc_ns + self._earliest_arrival_ns()
        patience_s = self._settings.exposure_s + _DELIVERY_S + self._earliest_arrival_ns() / 1e9
        give_up_s = min(deadline_s, self._now_s() + patience_s)
        while (left_s := give_up_s - self._now_s()) > 0.0:
            received = link.stream.receive(timeout_s=min(left_s, _LOOK_S))
            if received is None:
                if not link.is_controlled():
                    raise NotConnectedError(
                        f"{self._name}: control was lost: the camera is off, restarted, or unplugged"
                    )
                continue
            if received.first_packet_utc_ns >= oldest_utc_ns:
                return received
            self._tally += FrameTally(too_old=1)
        return None

    def _earliest_arrival_ns(self) -> int:
        """Return the least delay of arrival for a picture exposed after the request."""
        if self._options.trigger == "software":
            return 0
        return round((self._settings.exposure_s + 1.0 / self._options.frame_rate_hz) * 1e9)

    def _require_settings(self, link: GigeLink) -> None:
        found = link.settings()
        if found != self._settings:
            raise NotConnectedError(
                f"{self._name}: it has {found} instead of {self._settings}: it restarted, or another program changed it"
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
        """Return the measured loss on the way to the camera, and advice."""
        packet_size = self._opened().packet_size
        if packet_size is None:
            return "Check the cable and the USB hub, and keep other devices off this bus"
        return loss_text(
            self._packets(), address=_address_of(self._library, self._options.place), packet_size=packet_size
        )

    def _reopen(self, cause: DeviceError, *, deadline_s: float, may: bool) -> None:
        """Connect again, with all settings as they were."""
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
            self._tally += FrameTally(reopened=1)
            return
        raise cause

    def _give_up(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            link.close(answers=False)
            self._packets_before += link.packets()

    def _restore(self, link: GigeLink) -> None:
        if link.identity != self._identity:
            raise NotConnectedError(
                f"{self._name}: after connecting again it is {link.identity}; it was {self._identity}"
            )
        restored = link.configure(exposure_s=self._settings.exposure_s, gain_db=self._settings.gain_db)
        if restored != self._settings:
            raise LimitError(f"{self._name}: after connecting again it has {restored} instead of {self._settings}")
        link.restart()


def _open_device(library: AravisLibrary, address: str, *, name: str) -> int:
    try:
        return int(library.call("camera_new", address.encode()))
    except AravisError as error:
        told: DeviceError = device_error(error, name=name, what="opening")
        raise told from error


def _identity(features: GigeFeatures) -> DeviceIdentity:
    serial = features.first_of("DeviceSerialNumber", "DeviceID")
    firmware = features.first_of("DeviceFirmwareVersion", "DeviceVersion")
    return DeviceIdentity(
        model=f"{features.text('DeviceVendorName')} {features.text('DeviceModelName')}".strip(),
        serial_number=features.text(serial) if serial else "unknown",
        firmware=features.text(firmware) if firmware else "unknown",
    )


def _text(library: AravisLibrary, name: str, index: int) -> str:
    text = library.call(name, index)
    return str(text.decode(errors="replace")) if text is not None else ""


def _set_up(features: GigeFeatures, options: GigeOptions) -> GigeSetup:
    """Write all settings except exposure and gain; return the resulting setup."""
    linear = _switch_off(features)
    sent = _set_region(features, options)
    pixel_format, code = _set_pixel_format(features, options)
    if options.plane is not None or pixel_format.is_polarized:
        _refuse_moved_mosaic(options)
    width, height, bit_depth = size_of_counts(pixel_format, plane=options.plane, width=sent[0], height=sent[1])
    _set_black_level(features, options)
    _set_trigger(features, options)
    exposure_feature = features.first_of(*_EXPOSURE)
    if exposure_feature is None:
        raise LimitError(f"{options.place}: it has no known exposure feature ({', '.join(_EXPOSURE)})")
    gain_feature = features.first_of(_GAIN, _GAIN_RAW)
    return GigeSetup(
        pixel_format=pixel_format,
        pixel_format_code=code,
        sent_width=sent[0],
        sent_height=sent[1],
        width=width,
        height=height,
        bit_depth=bit_depth,
        plane=options.plane,
        linear=linear,
        exposure_feature=exposure_feature,
        exposure_step_us=_exposure_step_us(features, options) if exposure_feature == _EXPOSURE_RAW else 1.0,
        gain_feature=gain_feature,
        gain_step_db=_gain_step_db(features, options) if gain_feature == _GAIN_RAW else None,
    )


def _switch_off(features: GigeFeatures) -> bool | None:
    """Switch off automatic functions and processing; return whether it has nonlinear processing."""
    for feature in filter(features.has, _AUTOMATIC):
        features.set_text(feature, "Off")
    processing = [feature for feature in _PROCESSING if features.has(feature)]
    if features.has(_CHUNKS):
        features.set_truth(_CHUNKS, False)
    for feature in processing:
        features.set_truth(feature, False)
    if features.has(_GAMMA) and "GammaEnable" not in processing:
        features.set_number(_GAMMA, 1.0, relative=0.0)
        processing.append(_GAMMA)
    return True if processing else None


def _set_region(features: GigeFeatures, options: GigeOptions) -> tuple[int, int]:
    """Set binning, mirroring, size and place of the region; return width and height."""
    _set_or_need(features, "ReverseX", options.reverse_x, wanted=options.reverse_x)
    _set_or_need(features, "ReverseY", options.reverse_y, wanted=options.reverse_y)
    for feature in ("BinningHorizontal", "BinningVertical"):
        if features.has(feature):
            features.set_whole(feature, options.binning)
        elif options.binning != 1:
            raise LimitError(f"{options.place}: it cannot bin ({feature})")
    # A region can only grow if it begins at the corner.
    for feature in ("OffsetX", "OffsetY"):
        features.set_whole(feature, 0)
    size = [
        _set_length(features, "Width", options.width, options.offset_x),
        _set_length(features, "Height", options.height, options.offset_y),
    ]
    features.set_whole("OffsetX", options.offset_x)
    features.set_whole("OffsetY", options.offset_y)
    return size[0], size[1]


def _set_or_need(features: GigeFeatures, feature: str, value: bool, *, wanted: bool) -> None:
    if features.has(feature):
        features.set_truth(feature, value)
    elif wanted:
        raise LimitError(f"the camera cannot mirror its pictures ({feature})")


def _set_length(features: GigeFeatures, feature: str, asked: int | None, offset: int) -> int:
    _, most = features.whole_limits(feature)
    length = most - offset if asked is None else asked
    if length + offset > most:
        raise LimitError(f"{feature} {length} and offset {offset} together exceed the camera's {most}")
    features.set_whole(feature, length)
    return length


def _set_pixel_format(features: GigeFeatures, options: GigeOptions) -> tuple[PixelFormat, int]:
    offered = features.entries("PixelFormat")
    name = options.pixel_format or next((name for name in _BEST_FIRST if name in offered), None)
    if name is None or name not in offered:
        raise LimitError(f"{options.place}: pixel format {name}: the camera offers {', '.join(offered)}")
    features.set_text("PixelFormat", name)
    code = features.whole("PixelFormat") & 0xFFFFFFFF
    # Not all numbers of makers are known, but their names are.
    known = polarized_format(name) or GENICAM.get(code)
    if known is None:
        names = ", ".join(fmt.name for fmt in GENICAM.values())
        raise LimitError(f"{options.place}: pixel format {name} ({code:#010x}) cannot be read; known are {names}")
    depth = options.bit_depth or known.bit_depth
    if depth != known.bit_depth and known.bit_depth != 16:
        raise LimitError(f"{options.place}: bit_depth {depth}: samples of {name} have {known.bit_depth}")
    return replace(known, bit_depth=depth, justified=options.justified, byte_order=options.byte_order), code


def _refuse_moved_mosaic(options: GigeOptions) -> None:
    """Refuse settings that move the mosaic's cell, after which makers name the format differently."""
    if options.offset_x % 2 or options.offset_y % 2 or options.reverse_x or options.reverse_y or options.binning != 1:
        raise LimitError(f"{options.place}: the cell of a mosaic needs even offsets, no mirroring and no binning")


def _set_black_level(features: GigeFeatures, options: GigeOptions) -> None:
    """Set the black level if requested, and record it."""
    feature = features.first_of("BlackLevelRaw", "BlackLevel")
    if options.black_level_dn is not None:
        if feature is None:
            raise LimitError(f"{options.place}: its black level cannot be set")
        if feature == "BlackLevelRaw":
            features.set_whole(feature, options.black_level_dn)
        else:
            features.set_number(feature, options.black_level_dn, relative=0.0)
    elif feature is not None:
        value = features.whole(feature) if feature == "BlackLevelRaw" else features.number(feature)
        features.used[feature] = f"{value} (as found)"


def _set_trigger(features: GigeFeatures, options: GigeOptions) -> None:
    features.set_text("AcquisitionMode", "Continuous")
    selectors = features.entries("TriggerSelector") if features.has("TriggerSelector") else []
    for selector in selectors:
        features.set_text("TriggerSelector", selector)
        features.set_text("TriggerMode", "Off")
    if "FrameStart" in selectors:
        features.set_text("TriggerSelector", "FrameStart")
    if options.trigger == "software":
        features.set_text("TriggerSource", "Software")
        features.set_text("TriggerMode", "On")
        return
    if features.has("AcquisitionFrameRateEnable"):
        features.set_truth("AcquisitionFrameRateEnable", True)
    rate = features.first_of(*_RATE)
    if rate is None:
        raise LimitError(f"{options.place}: its frame rate cannot be set ({', '.join(_RATE)}); use trigger=software")
    features.set_number(rate, options.frame_rate_hz, relative=_RATE_TOLERANCE)


def _exposure_step_us(features: GigeFeatures, options: GigeOptions) -> float:
    """Return the unit of the camera's exposure."""
    if options.exposure_step_us is not None:
        return options.exposure_step_us
    if features.has(_EXPOSURE_UNIT):
        return features.number(_EXPOSURE_UNIT)
    raise LimitError(
        f"{options.place}: it counts its exposure in steps ({_EXPOSURE_RAW}) without a unit; add exposure_step_us=X to "
        "its address"
    )


def _gain_step_db(features: GigeFeatures, options: GigeOptions) -> float:
    if options.gain_step_db is not None:
        return options.gain_step_db
    maker = features.text("DeviceVendorName")
    if maker.lower().startswith(_RAW_IS_DB):
        return 1.0
    raise LimitError(
        f"{options.place}: the step of GainRaw is not known for cameras of {maker}; add gain_step_db=X to its address"
    )


def _set_packet_size(
    library: AravisLibrary, camera: int, features: GigeFeatures, *, address: str, asked: int | None
) -> int:
    """Set the size of packets as requested, or as every Ethernet carries them; return it [bytes]."""
    mtu = path_mtu(address)
    size = asked or min(mtu, _ETHERNET_MTU)
    if size > mtu:
        raise LimitError(
            f"{address}: packet_size is {size} bytes, and the interface to the camera carries {mtu}. Use less, or  "
            "raise the MTU of the interface and of every switch between"
        )
    with features.errors_translated("packet size"):
        library.call("camera_gv_set_packet_size", camera, size)
        taken = int(library.call("camera_gv_get_packet_size", camera))
    features.used["GevSCPSPacketSize"] = str(taken)
    return taken


def _set_bandwidth(
    library: AravisLibrary, camera: int, features: GigeFeatures, *, asked_mb_per_s: float, packet_size: int | None
) -> None:
    """Limit the camera's share of its line, by its own limit or by pauses between packets."""
    limit = features.first_of(*_BANDWIDTH)
    if limit is not None:
        if features.has(_BANDWIDTH_MODE):
            features.set_text(_BANDWIDTH_MODE, "On")
        features.set_whole(limit, round(asked_mb_per_s * 1e6))
        return
    if packet_size is None:
        raise LimitError(f"its bandwidth cannot be set ({', '.join(_BANDWIDTH)})")
    pause_ns = max(0, round(packet_size * 1e3 / asked_mb_per_s - packet_size * _GIGABIT_NS_PER_BYTE))
    with features.errors_translated("packet delay"):
        library.call("camera_gv_set_packet_delay", camera, pause_ns)
        taken_ns = int(library.call("camera_gv_get_packet_delay", camera))
    if abs(taken_ns - pause_ns) > _PAUSE_TOLERANCE * pause_ns:
        raise LimitError(
            f"its packets are {taken_ns} ns apart instead of {pause_ns} ns, for {asked_mb_per_s:g} MB/s: it cannot "
            "share its line; leave out bandwidth_mb_per_s"
        )
    features.used["GevSCPD"] = f"{taken_ns} ns"


@dataclass(frozen=True, kw_only=True)
class _Start:
    """Start of an exposure by the host's clocks, its error and its source [ns]."""

    monotonic_ns: int
    utc_ns: int
    error_ns: int
    source: StartSource


def frame_of(
    received: Received,
    *,
    setup: GigeSetup,
    settings: CameraSettings,
    sequence: int,
    asked: Asked,
    clock: CameraClock,
    free_period_s: float | None,
) -> Frame:
    """Return a whole picture as a frame.

    The exposure begins at the picture's time stamp if the camera's clock can be compared with the host's. Otherwise
    that of a triggered camera begins at the trigger, at the latest an exposure before the first packet; that of a
    freely running one begins an exposure before its first packet, at the earliest a period before that.
    """
    exposure_ns = round(settings.exposure_s * 1e9)
    start = _start_of(received, exposure_ns, asked, None if free_period_s is None else round(free_period_s * 1e9))
    start = _by_stamp(received, start, exposure_ns, asked, clock)
    return Frame(
        counts=_counts(received, setup),
        settings=settings,
        sequence=sequence,
        start_utc_ns=start.utc_ns,
        end_utc_ns=start.utc_ns + exposure_ns,
        start_monotonic_ns=start.monotonic_ns,
        start_uncertainty_s=start.error_ns / 1e9,
        start_source=start.source,
    )


def _start_of(received: Received, exposure_ns: int, asked: Asked, free_period_ns: int | None) -> _Start:
    """Return the start of an exposure from the host's clocks alone."""
    latest_ns = received.first_packet_utc_ns - asked.utc_ns - exposure_ns
    if free_period_ns is None:
        delay_ns, error_ns, source = 0, max(0, latest_ns), _TRIGGER
    else:
        delay_ns, error_ns, source = latest_ns, free_period_ns, _ARRIVAL
    return _Start(
        monotonic_ns=asked.monotonic_ns + delay_ns,
        utc_ns=asked.utc_ns + delay_ns,
        error_ns=error_ns + asked.error_ns,
        source=source,
    )


def _by_stamp(received: Received, start: _Start, exposure_ns: int, asked: Asked, clock: CameraClock) -> _Start:
    """Return a start by the camera's clock, if the picture's stamp lies within the possible time.

    Cameras stamp the beginning of an exposure, some its end. If a stamp can be either, the start is taken half-way
    between, with half an exposure more of error.
    """
    moment = None if received.stamp_ns is None else clock.moment_of(received.stamp_ns)
    if moment is None:
        return start
    stamp_ns, stamp_error_ns = moment
    earliest_ns = start.monotonic_ns - (start.error_ns if start.source == _ARRIVAL else 0)
    latest_ns = start.monotonic_ns + (start.error_ns if start.source == _TRIGGER else 0)
    slack_ns = stamp_error_ns + asked.error_ns
    back_ns = [
        before_ns
        for before_ns in (0, exposure_ns)
        if earliest_ns - slack_ns <= stamp_ns - before_ns <= latest_ns + slack_ns
    ]
    if not back_ns:
        return start
    middle_ns, unsure_ns = sum(back_ns) // len(back_ns), (back_ns[-1] - back_ns[0] + 1) // 2
    begin_ns = stamp_ns - middle_ns
    if clock.ptp is not None and received.stamp_ns is not None:
        return _Start(
            monotonic_ns=begin_ns,
            utc_ns=received.stamp_ns - middle_ns - clock.ptp.ahead_s * 10**9,
            error_ns=clock.ptp.offset_ns + unsure_ns,
            source="ptp",
        )
    return _Start(
        monotonic_ns=begin_ns,
        utc_ns=begin_ns - asked.monotonic_ns + asked.utc_ns,
        error_ns=stamp_error_ns + asked.error_ns + unsure_ns,
        source="camera clock",
    )


def _counts(received: Received, setup: GigeSetup) -> NDArray[np.uint16]:
    sent = (received.width, received.height, received.pixel_format_code)
    if sent != (setup.sent_width, setup.sent_height, setup.pixel_format_code):
        raise ProtocolError(
            f"the camera sent a picture of {sent[0]} x {sent[1]} pixels in format {sent[2]:#010x} instead of "
            f"{setup.sent_width} x {setup.sent_height} in {setup.pixel_format.name}"
        )
    counts = unpack(received.data, pixel_format=setup.pixel_format, width=sent[0], height=sent[1])
    return counts_of_picture(counts, pixel_format=setup.pixel_format, plane=setup.plane)
