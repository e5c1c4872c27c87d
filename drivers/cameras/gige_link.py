"""One connection to a GigE or USB3 Vision camera, from finding it to giving it up."""

import ipaddress
from dataclasses import dataclass

from drivers.cameras.aravis_library import AravisError, AravisLibrary
from drivers.cameras.gige_clock import CameraClock
from drivers.cameras.gige_features import GigeFeatures, device_error
from drivers.cameras.gige_options import GigeOptions, Link
from drivers.cameras.gige_setup import GigeSetup, set_bandwidth, set_packet_size, set_up
from drivers.cameras.gige_stream import GigeStream, PacketCounts
from drivers.errors import DeviceError, LimitError, NotConnectedError
from drivers.interfaces import CameraSettings, DeviceIdentity
from drivers.network_path import path_mtu

_PROTOCOLS: dict[Link, tuple[bytes, ...]] = {
    "gige": (b"GigEVision",),
    "usb3": (b"USB3Vision",),
    "any": (b"GigEVision", b"USB3Vision", b"Fake"),
}
_NETWORK = "GigEVision"
_IN_LIBRARY = "Fake"  # cameras that the library simulates within this program, and lists only when told to
_EXPOSURE_TOLERANCE = 0.01
_PACKET_SIZES = (9000, 8192, 4096, 1500)  # that are tried where the largest is asked for
_US_PER_S = 1e6


@dataclass(frozen=True, kw_only=True)
class FoundCamera:
    """A camera that answered a call to all."""

    address: str
    serial_number: str
    name: str
    protocol: str = _NETWORK


def find_cameras(library: AravisLibrary, *, link: Link = "gige") -> list[FoundCamera]:
    """Return the cameras of a kind that answer a call to all; it takes about a second."""
    library.call("update_device_list")
    return [
        FoundCamera(
            address=_text(library, "get_device_address", index),
            serial_number=_text(library, "get_device_serial_nbr", index),
            name=_text(library, "get_device_id", index),
            protocol=_text(library, "get_device_protocol", index),
        )
        for index in range(library.call("get_n_devices"))
        if library.call("get_device_protocol", index) in _PROTOCOLS[link]
    ]


class GigeLink:
    """An open camera with all of its settings written and its acquisition running.

    Raises
    ------
    NotConnectedError, DeviceTimeoutError
        It is not there, or belongs to another program.
    LimitError
        It cannot be set to what was asked for.
    """

    def __init__(self, library: AravisLibrary, options: GigeOptions) -> None:
        self.name = options.camera_name
        self._library = library
        self._stream: GigeStream | None = None
        self._packets = PacketCounts()
        place = device_of(library, options)
        self._camera: int | None = _open(library, place, name=self.name)
        try:
            self._is_network = bool(library.call("camera_is_gv_device", self._camera))
            self.packet_size: int | None = None
            self._device: int = library.call("camera_get_device", self._camera)
            if not self.is_controlled():
                raise NotConnectedError(f"{self.name}: another program controls it: close that one first")
            self.features = GigeFeatures(library, self._device, name=self.name)
            self.identity = _identity(self.features)
            self.setup: GigeSetup = set_up(self.features, options)
            self.clock = CameraClock(self.features, ptp=options.ptp)
            self._place = place
            if self._is_network:
                self.set_packet_size(None if options.packet_size == "probe" else options.packet_size)
            if options.bandwidth_mb_per_s is not None:
                set_bandwidth(
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
        """Return whether the camera still answers, and to us; after a loss this takes about 5 s to be seen."""
        if self._is_network:
            return bool(self._library.call("gv_device_is_controller", self._device))
        try:
            GigeFeatures(self._library, self._device, name=self.name).whole("Width")
        except DeviceError:
            return False
        return True

    def set_packet_size(self, asked: int | None) -> None:
        """Set how large packets are, before the stream is started; None: as every Ethernet carries them."""
        self.packet_size = set_packet_size(
            self._library, self._opened(), self.features, address=self._place, asked=asked
        )

    def packet_sizes(self) -> tuple[int, ...]:
        """Return sizes that the interface to the camera sends in one piece, the largest first."""
        mtu = path_mtu(self._place)
        return tuple(size for size in _PACKET_SIZES if size <= mtu)

    def packets(self) -> PacketCounts:
        """Return what became of the packets of all pictures since the camera was opened."""
        return self._packets if self._stream is None else self._packets + self._stream.packets()

    def configure(self, *, exposure_s: float, gain_db: float) -> CameraSettings:
        """Set exposure and gain; return what was read back. A refusal changes nothing."""
        setup = self.setup
        # Rounded to a picosecond: cameras cut off what is less than a step, and 29.999... would become 29.
        exposure = self._exposure_steps(exposure_s)
        gain = self._gain_steps(gain_db)
        self.features.set_number(setup.exposure_feature, exposure, relative=_EXPOSURE_TOLERANCE)
        if isinstance(gain, int):
            self.features.set_whole(str(setup.gain_feature), gain)
        elif gain is not None:
            self.features.set_number(str(setup.gain_feature), gain, relative=_EXPOSURE_TOLERANCE)
        return self.settings()

    def settings(self) -> CameraSettings:
        """Read what the camera is set to."""
        setup = self.setup
        return CameraSettings(
            exposure_s=self.features.number(setup.exposure_feature) * setup.exposure_step_us / _US_PER_S,
            gain_db=self._gain_db(),
            width=setup.width,
            height=setup.height,
            bit_depth=setup.bit_depth,
        )

    def restart(self) -> None:
        """Stop what runs, give up the stream with all that waits in it, and start a new one."""
        if self._stream is not None:
            self._stream.stop()
            self._give_up_stream()
        self._stream = GigeStream(self._library, self._opened(), name=self.name, packet_size=self.packet_size)
        self._stream.start()

    def close(self, *, answers: bool) -> None:
        """Give up the camera; stop its acquisition first if it answers. May be called twice."""
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
        """Return the value that the camera's exposure is to be set to, in steps of its own."""
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
        """Return the value that the camera's gain is to be set to: whole where it counts steps."""
        setup = self.setup
        if setup.gain_feature is None:
            if gain_db != 0.0:
                raise LimitError(f"{self.name}: gain_db is {gain_db} dB; it has no gain to set, ask for 0")
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


def device_of(library: AravisLibrary, options: GigeOptions) -> str:
    """Return what the library is to open: an IP address of a camera on the network, else the library's name of it."""
    if options.link == "gige":
        return address_of(library, options.place)
    if options.link == "any" and options.place.startswith(_IN_LIBRARY):
        library.call("enable_interface", _IN_LIBRARY.encode())
        return options.place
    found = find_cameras(library, link=options.link)
    for camera in found:
        if options.place in (camera.serial_number, camera.name, camera.address):
            return camera.address if camera.protocol == _NETWORK else camera.name
    there = ", ".join(f"{c.name} (serial {c.serial_number}, {c.protocol})" for c in found) or "none"
    advice = " A USB camera needs power, a USB 3 port, and to be yours to use (docs/cameras.md)" * (not found)
    raise NotConnectedError(
        f"{options.camera_name}: no camera of this serial number or name answers; found: {there}.{advice}"
    )


def address_of(library: AravisLibrary, place: str) -> str:
    """Return the IP address of a camera that is given by address, serial number or name.

    Notes
    -----
    A camera is always opened by its address: opened by name, it may be reached through another interface than the
    one that its pictures come through, and then none come.
    """
    try:
        return str(ipaddress.ip_address(place))
    except ValueError:
        found = find_cameras(library)
    for camera in found:
        if place in (camera.serial_number, camera.name):
            return camera.address
    there = ", ".join(f"{c.name} (serial {c.serial_number}) at {c.address}" for c in found) or "none"
    raise NotConnectedError(f"GigE camera {place}: no camera of this serial number or name answers; found: {there}")


def _open(library: AravisLibrary, address: str, *, name: str) -> int:
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
