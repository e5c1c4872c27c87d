"""libaravis 0.8 as the driver of GigE and USB3 cameras uses it: functions, features, stream and clock.

The functions are called through ctypes, so no compiler is needed. Features of GenICam are written, read back and noted.
Buffers of the stream are lent to libaravis and come back filled.

The camera's clock is latched between two readings of the host's: its offset is known to half the time between these.
Two such measurements give the rate. A camera whose clock follows a PTP master is trusted to the offset that it reports,
if its clock shows UTC or TAI.
"""

import ctypes
import ctypes.util
import os
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from drivers.errors import DeviceError, DeviceTimeoutError, LimitError, NotConnectedError, ProtocolError
from drivers.interfaces import FrameTally
from drivers.network_path import interface_of, largest_receive_buffer, path_mtu

_POINTER, _TEXT = ctypes.c_void_p, ctypes.c_char_p
_INT, _UINT, _FLOAT = ctypes.c_int, ctypes.c_uint, ctypes.c_double
_INT64, _UINT64, _SIZE = ctypes.c_int64, ctypes.c_uint64, ctypes.c_size_t
_MISSING = (
    "GigE and USB3 Vision cameras need libaravis 0.8, which is not installed: `apt install libaravis-0.8-0` (Debian, "
    "Ubuntu), or set ARAVIS_LIBRARY to its path"
)


class AravisError(Exception):
    """Error message of libaravis for a failed call."""

    def __init__(self, message: str, *, is_of_device: bool, code: int) -> None:
        super().__init__(message)
        self.is_of_device = is_of_device
        self.code = code


class _GError(ctypes.Structure):
    _fields_ = (("domain", ctypes.c_uint32), ("code", _INT), ("message", _TEXT))


_ERROR = ctypes.POINTER(_GError)
_DEVICE_ERRORS = b"arv-device-error-quark"

# Name -> type of the result and types of the arguments. These report failures through a GError.
_FALLIBLE: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "camera_new": (_POINTER, (_TEXT,)),
    "camera_create_stream": (_POINTER, (_POINTER, _POINTER, _POINTER)),
    "camera_get_payload": (_UINT, (_POINTER,)),
    "camera_start_acquisition": (None, (_POINTER,)),
    "camera_stop_acquisition": (None, (_POINTER,)),
    "camera_gv_set_packet_size": (None, (_POINTER, _INT)),
    "camera_gv_get_packet_size": (_UINT, (_POINTER,)),
    "camera_gv_set_packet_delay": (None, (_POINTER, _INT64)),
    "camera_gv_get_packet_delay": (_INT64, (_POINTER,)),
    "device_is_feature_available": (_INT, (_POINTER, _TEXT)),
    "device_execute_command": (None, (_POINTER, _TEXT)),
    "device_get_boolean_feature_value": (_INT, (_POINTER, _TEXT)),
    "device_set_boolean_feature_value": (None, (_POINTER, _TEXT, _INT)),
    "device_get_integer_feature_value": (_INT64, (_POINTER, _TEXT)),
    "device_set_integer_feature_value": (None, (_POINTER, _TEXT, _INT64)),
    "device_get_integer_feature_bounds": (
        None,
        (_POINTER, _TEXT, ctypes.POINTER(_INT64), ctypes.POINTER(_INT64)),
    ),
    "device_get_float_feature_value": (_FLOAT, (_POINTER, _TEXT)),
    "device_set_float_feature_value": (None, (_POINTER, _TEXT, _FLOAT)),
    "device_get_float_feature_bounds": (
        None,
        (_POINTER, _TEXT, ctypes.POINTER(_FLOAT), ctypes.POINTER(_FLOAT)),
    ),
    "device_get_string_feature_value": (_TEXT, (_POINTER, _TEXT)),
    "device_set_string_feature_value": (None, (_POINTER, _TEXT, _TEXT)),
    "device_dup_available_enumeration_feature_values_as_strings": (
        _POINTER,
        (_POINTER, _TEXT, ctypes.POINTER(_UINT)),
    ),
}
# These cannot fail.
_SURE: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "enable_interface": (None, (_TEXT,)),
    "update_device_list": (None, ()),
    "get_n_devices": (_UINT, ()),
    "get_device_id": (_TEXT, (_UINT,)),
    "get_device_model": (_TEXT, (_UINT,)),
    "get_device_serial_nbr": (_TEXT, (_UINT,)),
    "get_device_address": (_TEXT, (_UINT,)),
    "get_device_protocol": (_TEXT, (_UINT,)),
    "camera_get_device": (_POINTER, (_POINTER,)),
    "camera_is_gv_device": (_INT, (_POINTER,)),
    "camera_gv_set_stream_options": (None, (_POINTER, _INT)),
    "device_set_range_check_policy": (None, (_POINTER, _INT)),
    "device_set_access_check_policy": (None, (_POINTER, _INT)),
    "gv_device_is_controller": (_INT, (_POINTER,)),
    "buffer_new": (_POINTER, (_SIZE, _POINTER)),
    "buffer_get_status": (_INT, (_POINTER,)),
    "buffer_get_data": (_POINTER, (_POINTER, ctypes.POINTER(_SIZE))),
    "buffer_get_image_width": (_INT, (_POINTER,)),
    "buffer_get_image_height": (_INT, (_POINTER,)),
    "buffer_get_image_pixel_format": (ctypes.c_uint32, (_POINTER,)),
    "buffer_get_frame_id": (_UINT64, (_POINTER,)),
    "buffer_get_system_timestamp": (_UINT64, (_POINTER,)),
    "buffer_get_timestamp": (_UINT64, (_POINTER,)),
    "stream_push_buffer": (None, (_POINTER, _POINTER)),
    "stream_try_pop_buffer": (_POINTER, (_POINTER,)),
    "stream_timeout_pop_buffer": (_POINTER, (_POINTER, _UINT64)),
    "stream_get_info_uint64_by_name": (_UINT64, (_POINTER, _TEXT)),
}


class AravisLibrary:
    """The loaded library; `load_aravis` makes one."""

    def __init__(self, aravis: ctypes.CDLL, gobject: ctypes.CDLL, glib: ctypes.CDLL) -> None:
        self._gobject, self._glib = gobject, glib
        gobject.g_object_unref.argtypes = [_POINTER]
        glib.g_error_free.argtypes = [_POINTER]
        glib.g_free.argtypes = [_POINTER]
        glib.g_quark_to_string.argtypes, glib.g_quark_to_string.restype = [ctypes.c_uint32], _TEXT
        self._functions: dict[str, Any] = {}
        for name, (result, arguments) in _SURE.items():
            self._functions[name] = _declared(aravis, name, result, arguments)
        for name, (result, arguments) in _FALLIBLE.items():
            self._functions[name] = _declared(aravis, name, result, (*arguments, ctypes.POINTER(_ERROR)))

    def call(self, name: str, *arguments: Any) -> Any:
        """Return what the function ``arv_<name>`` returns."""
        if name in _SURE:
            return self._functions[name](*arguments)
        error = _ERROR()
        result = self._functions[name](*arguments, ctypes.byref(error))
        if error:  # type: ignore[truthy-bool]  # false while it is NULL
            raise self._taken(error)
        return result

    def set_integer_property(self, instance: int, name: bytes, value: int) -> None:
        """Set an integer property of an object of the library."""
        self._gobject.g_object_set(_POINTER(instance), name, _INT(value), None)

    def release(self, instance: int) -> None:
        """Give up a reference to an object of the library."""
        self._gobject.g_object_unref(instance)

    def texts_of(self, array: int, count: int) -> list[str]:
        """Return an array of texts that belong to the library, and free the array."""
        texts = ctypes.cast(array, ctypes.POINTER(_TEXT))[:count]
        self._glib.g_free(array)
        return [text.decode() for text in texts if text is not None]

    def _taken(self, error: Any) -> AravisError:
        content = error.contents
        taken = AravisError(
            (content.message or b"no message").decode(errors="replace"),
            is_of_device=self._glib.g_quark_to_string(content.domain) == _DEVICE_ERRORS,
            code=content.code,
        )
        self._glib.g_error_free(error)
        return taken


def load_aravis(*, wanted_for: str = "") -> AravisLibrary:
    """Return libaravis from ARAVIS_LIBRARY or from the system; the camera's name is for the message."""
    stated = os.environ.get("ARAVIS_LIBRARY")
    name = stated or "libaravis-0.8.so.0"
    try:
        aravis = ctypes.CDLL(name)
    except OSError as error:
        found = None if stated else ctypes.util.find_library("aravis-0.8")
        if found is None:
            name = f"{wanted_for}: " if wanted_for else ""
            raise NotConnectedError(f"{name}{_MISSING}" + (f" ({error})" if stated else "")) from error
        aravis = ctypes.CDLL(found)
    return AravisLibrary(aravis, ctypes.CDLL("libgobject-2.0.so.0"), ctypes.CDLL("libglib-2.0.so.0"))


def _declared(aravis: ctypes.CDLL, name: str, result: Any, arguments: tuple[Any, ...]) -> Any:
    function = getattr(aravis, f"arv_{name}")
    function.restype, function.argtypes = result, list(arguments)
    return function


_ON = 1
_TIMEOUT, _NOT_CONNECTED, _NOT_FOUND, _NOT_CONTROLLER = 5, 2, 6, 10
_OF_THE_LINK = (_TIMEOUT, _NOT_CONNECTED, _NOT_FOUND, _NOT_CONTROLLER)


class GigeFeatures:
    """The features of one open camera."""

    def __init__(self, library: AravisLibrary, device: int, *, name: str) -> None:
        self._library, self._device, self._name = library, device, name
        self.used: dict[str, str] = {}
        self._numbers: dict[str, bool] = {}
        # Without these, values out of range seem to be accepted.
        library.call("device_set_range_check_policy", device, _ON)
        library.call("device_set_access_check_policy", device, _ON)

    def has(self, feature: str) -> bool:
        """Return whether the camera has this feature and it is available now."""
        with self.errors_translated(feature):
            return bool(self._library.call("device_is_feature_available", self._device, feature.encode()))

    def first_of(self, *features: str) -> str | None:
        """Return the first of these features that the camera has."""
        return next((feature for feature in features if self.has(feature)), None)

    def text(self, feature: str) -> str:
        """Read a text or an enumeration."""
        with self.errors_translated(feature):
            found = self._library.call("device_get_string_feature_value", self._device, feature.encode())
        return str(found.decode(errors="replace")) if found is not None else ""

    def number(self, feature: str) -> float:
        """Read a floating-point number, which some cameras have as an integer."""
        if self._is_counted(feature):
            return float(self.whole(feature))
        with self.errors_translated(feature):
            return float(self._library.call("device_get_float_feature_value", self._device, feature.encode()))

    def whole(self, feature: str) -> int:
        """Read an integer, or the number of an enumeration's entry."""
        with self.errors_translated(feature):
            return int(self._library.call("device_get_integer_feature_value", self._device, feature.encode()))

    def truth(self, feature: str) -> bool:
        """Read a boolean."""
        with self.errors_translated(feature):
            return bool(self._library.call("device_get_boolean_feature_value", self._device, feature.encode()))

    def entries(self, feature: str) -> list[str]:
        """Return the entries of an enumeration."""
        count = ctypes.c_uint()
        with self.errors_translated(feature):
            array = self._library.call(
                "device_dup_available_enumeration_feature_values_as_strings",
                self._device,
                feature.encode(),
                ctypes.byref(count),
            )
        return self._library.texts_of(array, count.value)

    def whole_limits(self, feature: str) -> tuple[int, int]:
        """Return the smallest and largest value of a whole number."""
        low, high = ctypes.c_int64(), ctypes.c_int64()
        with self.errors_translated(feature):
            self._library.call(
                "device_get_integer_feature_bounds",
                self._device,
                feature.encode(),
                ctypes.byref(low),
                ctypes.byref(high),
            )
        return low.value, high.value

    def number_limits(self, feature: str) -> tuple[float, float]:
        """Return the smallest and largest value of a number."""
        if self._is_counted(feature):
            least, most = self.whole_limits(feature)
            return float(least), float(most)
        low, high = ctypes.c_double(), ctypes.c_double()
        with self.errors_translated(feature):
            self._library.call(
                "device_get_float_feature_bounds",
                self._device,
                feature.encode(),
                ctypes.byref(low),
                ctypes.byref(high),
            )
        return low.value, high.value

    def set_text(self, feature: str, value: str) -> None:
        """Set an enumeration; raise an error if the camera reads back another entry."""
        with self.errors_translated(feature):
            self._library.call("device_set_string_feature_value", self._device, feature.encode(), value.encode())
        self._require(feature, asked=value, found=self.text(feature))

    def set_whole(self, feature: str, value: int) -> None:
        """Set an integer; raise an error if the camera reads back another one."""
        with self.errors_translated(feature):
            self._library.call("device_set_integer_feature_value", self._device, feature.encode(), value)
        self._require(feature, asked=value, found=self.whole(feature))

    def set_truth(self, feature: str, value: bool) -> None:
        """Set a boolean; raise an error if the camera reads back the other value."""
        with self.errors_translated(feature):
            self._library.call("device_set_boolean_feature_value", self._device, feature.encode(), int(value))
        self._require(feature, asked=value, found=self.truth(feature))

    def set_number(self, feature: str, value: float, *, relative: float) -> float:
        """Set a number; return the value read back, which may differ by a tolerance because cameras count in steps."""
        with self.errors_translated(feature):
            if self._is_counted(feature):
                self._library.call("device_set_integer_feature_value", self._device, feature.encode(), round(value))
            else:
                self._library.call("device_set_float_feature_value", self._device, feature.encode(), value)
        found = self.number(feature)
        if abs(found - value) > relative * abs(value):
            self._require(feature, asked=value, found=found)
        self.used[feature] = f"{found:.10g}"
        return found

    def execute(self, feature: str) -> None:
        """Run a command of the camera."""
        with self.errors_translated(feature):
            self._library.call("device_execute_command", self._device, feature.encode())

    @contextmanager
    def errors_translated(self, what: str) -> Iterator[None]:
        """Turn an error of the library into one of the drivers."""
        try:
            yield
        except AravisError as error:
            raise device_error(error, name=self._name, what=what) from error

    def _is_counted(self, feature: str) -> bool:
        """Return whether a feature is an integer: the library has one function for each kind."""
        if feature in self._numbers:
            return self._numbers[feature]
        try:
            self._library.call("device_get_float_feature_value", self._device, feature.encode())
            self._numbers[feature] = False
        except AravisError as error:
            if error.is_of_device and error.code in _OF_THE_LINK:
                raise device_error(error, name=self._name, what=feature) from error
            self._numbers[feature] = self._reads_whole(feature)
        return self._numbers[feature]

    def _reads_whole(self, feature: str) -> bool:
        try:
            self._library.call("device_get_integer_feature_value", self._device, feature.encode())
        except AravisError:
            return False
        return True

    def _require(self, feature: str, *, asked: object, found: object) -> None:
        if asked != found:
            raise LimitError(f"{self._name}: {feature} was set to {asked} and reads back {found}; set that instead")
        self.used[feature] = str(found)


def device_error(error: AravisError, *, name: str, what: str) -> DeviceError:
    """Return the error of the drivers for an error of the library."""
    text = f"{name}: {what}: {error}"
    if not error.is_of_device:
        return LimitError(text)
    if error.code == _TIMEOUT:
        return DeviceTimeoutError(f"{text}. The camera is off, hangs, or another program controls it")
    if error.code == _NOT_CONTROLLER:
        return NotConnectedError(f"{text}. Another program controls the camera: close that one first")
    if error.code in (_NOT_CONNECTED, _NOT_FOUND):
        return NotConnectedError(
            f"{text}. Check power, cable and address: `rigctl devices` lists the cameras that answer, `rigctl doctor` "
            "checks the network"
        )
    return ProtocolError(text)


_BUFFERS = 8
_NO_PACKET_SOCKET = 1
_SOCKET_BUFFER_FIXED = 0
_PICTURES_IN_SOCKET = 2
_LEAST_SOCKET_BYTES = 2**20
_HEADER_BYTES, _FIRST_AND_LAST = 36, 2  # of a packet: IP, UDP, GVSP; packets of a picture without pixels
_COUNTED = (b"n_completed_buffers", b"n_failures", b"n_missing_packets", b"n_resent_packets")
_SUCCESS = 0
_STATUS = {
    1: "cleared",
    2: "timeout",
    3: "missing packets",
    4: "wrong packet number",
    5: "size mismatch",
    7: "aborted",
    8: "kind of payload not supported",
}


@dataclass(frozen=True, kw_only=True)
class Received:
    """A received picture."""

    first_packet_utc_ns: int  #: Arrival of its first packet by the host's clock [ns since 1970, UTC].
    #: The fault of a damaged picture, which has no other content; None for a complete one.
    damage: str | None = None
    data: bytes = b""  #: Its bytes.
    width: int = 0  #: Its own description.
    height: int = 0
    pixel_format_code: int = 0
    frame_id: int = 0  #: Its number from the camera.
    stamp_ns: int | None = None  #: Its time by the camera's own clock; None without a time stamp [ns].


class GigeStream:
    """A stream of one camera, which is started and stopped with the camera's acquisition."""

    def __init__(self, library: AravisLibrary, camera: int, *, name: str, packet_size: int | None) -> None:
        self._library, self._camera, self._name = library, camera, name
        if packet_size is not None:
            # The ordinary socket: the packet socket needs root and receives nothing on some interfaces.
            library.call("camera_gv_set_stream_options", camera, _NO_PACKET_SOCKET)
        try:
            self._stream: int | None = library.call("camera_create_stream", camera, None, None)
            payload_bytes = library.call("camera_get_payload", camera)
        except AravisError as error:
            raise device_error(error, name=name, what="stream") from error
        if not self._stream:
            raise NotConnectedError(
                f"{name}: no stream of pictures could be opened; close other programs that use the camera"
            )
        self._packets_a_picture = 0
        if packet_size is not None:
            # The system's own size holds half a picture, and the library's automatic one is too small for small
            # pictures. The system grants up to net.core.rmem_max.
            size_bytes = max(_PICTURES_IN_SOCKET * payload_bytes, _LEAST_SOCKET_BYTES)
            library.set_integer_property(self._opened(), b"socket-buffer", _SOCKET_BUFFER_FIXED)
            library.set_integer_property(self._opened(), b"socket-buffer-size", size_bytes)
            self._packets_a_picture = -(-payload_bytes // (packet_size - _HEADER_BYTES)) + _FIRST_AND_LAST
        for _ in range(_BUFFERS):
            library.call("stream_push_buffer", self._stream, library.call("buffer_new", payload_bytes, None))

    def start(self) -> None:
        """Start the camera's acquisition."""
        self._call("camera_start_acquisition")

    def stop(self) -> None:
        """Stop the camera's acquisition."""
        self._call("camera_stop_acquisition")

    def drain(self) -> int:
        """Return all waiting pictures to the library, and their number to the caller."""
        drained = 0
        while buffer := self._library.call("stream_try_pop_buffer", self._opened()):
            self._library.call("stream_push_buffer", self._opened(), buffer)
            drained += 1
        return drained

    def receive(self, *, timeout_s: float) -> Received | None:
        """Return the next picture, damaged or not; None if none came in time."""
        stream = self._opened()
        buffer = self._library.call("stream_timeout_pop_buffer", stream, int(max(0.0, timeout_s) * 1e6))
        if not buffer:
            return None
        try:
            return self._read(buffer)
        finally:
            self._library.call("stream_push_buffer", stream, buffer)

    def packets(self) -> FrameTally:
        """Return the fate of the packets since the stream was opened; all 0 for a camera without packets.

        libaravis counts all packets behind the first gap of an incomplete picture as missing, so each such picture is
        read up to its gap and counts as one loss.
        """
        if not self._packets_a_picture or self._stream is None:
            return FrameTally()
        complete, incomplete, behind_gap, resent = (
            int(self._library.call("stream_get_info_uint64_by_name", self._stream, name)) for name in _COUNTED
        )
        seen = (complete + incomplete) * self._packets_a_picture - behind_gap + incomplete
        return FrameTally(packets=max(0, seen), packets_lost=incomplete + resent, packets_resent=resent)

    def close(self) -> None:
        """Release the stream. May be called twice."""
        if self._stream is not None:
            self._library.release(self._stream)
            self._stream = None

    def _read(self, buffer: int) -> Received:
        status = self._library.call("buffer_get_status", buffer)
        if status != _SUCCESS:
            return Received(
                damage=_STATUS.get(status, f"status {status}"),
                first_packet_utc_ns=self._library.call("buffer_get_system_timestamp", buffer),
            )
        size = ctypes.c_size_t()
        data = self._library.call("buffer_get_data", buffer, ctypes.byref(size))
        arrived_ns = self._library.call("buffer_get_system_timestamp", buffer)
        stamp_ns = self._library.call("buffer_get_timestamp", buffer)
        return Received(
            data=ctypes.string_at(data, size.value) if data else b"",
            width=self._library.call("buffer_get_image_width", buffer),
            height=self._library.call("buffer_get_image_height", buffer),
            pixel_format_code=self._library.call("buffer_get_image_pixel_format", buffer),
            frame_id=self._library.call("buffer_get_frame_id", buffer),
            first_packet_utc_ns=arrived_ns,
            # If the camera does not report the frequency of its clock, the library gives the time of arrival for both.
            stamp_ns=None if stamp_ns in (0, arrived_ns) else stamp_ns,
        )

    def _call(self, name: str) -> None:
        try:
            self._library.call(name, self._camera)
        except AravisError as error:
            raise device_error(error, name=self._name, what=name.removeprefix("camera_")) from error

    def _opened(self) -> int:
        if self._stream is None:
            raise ValueError(f"{self._name}: the stream was closed")
        return self._stream


def loss_text(tally: FrameTally, *, address: str, packet_size: int) -> str:
    """Return the measured loss of packets and advice, in one or two sentences."""
    share = tally.packets_lost / tally.packets if tally.packets else 0.0
    again = (
        f"{tally.packets_resent} of them came when requested again"
        if tally.packets_resent
        else "the camera sends none of them again"
    )
    facts = (
        f"packets of {packet_size} bytes, MTU {path_mtu(address)}, interface {interface_of(address)}, receive buffers "
        f"up to {largest_receive_buffer()} bytes"
    )
    return (
        f"The network loses {100 * share:.2g} %: {tally.packets_lost} of {tally.packets} packets, {again} ({facts}). "
        "Raise the receive buffer, check cable and switch, keep other traffic off the interface; `rigctl doctor` "
        "measures it"
    )


# Commands that latch the clock and features with its value, in several editions of the standard.
_LATCHES = (
    ("TimestampLatch", "TimestampLatchValue"),
    ("GevTimestampControlLatch", "GevTimestampValue"),
    ("PtpDataSetLatch", "PtpDataSetLatchValue"),
)
_TICK_FREQUENCY = "GevTimestampTickFrequency"
_PTP_SWITCHES = ("PtpEnable", "GevIEEE1588")
_PTP_LATCHES = ("PtpDataSetLatch", "GevIEEE1588DataSetLatch")
_PTP_STATES = ("PtpStatus", "GevIEEE1588StatusLatched", "GevIEEE1588Status")
_PTP_OFFSETS = ("PtpOffsetFromMaster", "GevIEEE1588OffsetFromMaster")
_FOLLOWS = "Slave"
_TAI_AHEAD_S = 37  # TAI - UTC since 2017; masters give TAI, some of them UTC
_HALF_SECOND_NS = 500_000_000

_NS_HZ = 1_000_000_000
# Time between readings: this long, or until the error of the rate exceeds that of a reading.
_EACH_NS, _GROWN_NS = 10 * 10**9, 50_000
_REMEMBERED_NS = 600 * 10**9  # a clock's rate may change after this time
_TRIES = 3  # per reading; the shortest counts
_QUARTZ = 1e-4  # error of a rate before its measurement
_WANDER = 1e-6  # of a rate that was measured
_UNIT_BASE_NS = 20_000_000  # time between readings that determines the unit of the clock
_UNIT_TOLERANCE = 0.01


@dataclass(frozen=True, kw_only=True)
class PtpState:
    """State of a camera's clock that follows a master."""

    offset_ns: int  #: Reported offset from its master [ns].
    ahead_s: int  #: Whole seconds ahead of UTC: those of TAI, or 0.
    host_behind_ns: int  #: Delay of the host's UTC behind the master's [ns].


@dataclass(frozen=True, kw_only=True)
class _Look:
    ticks: int
    monotonic_ns: int
    error_ns: int


class CameraClock:
    """The clock of one open camera."""

    def __init__(
        self,
        features: GigeFeatures,
        *,
        ptp: bool | None = None,
        now_ns: Callable[[], int] = time.monotonic_ns,
        utc_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._features, self._now_ns, self._utc_ns = features, now_ns, utc_ns
        self._latch = next((pair for pair in _LATCHES if all(map(features.has, pair))), None)
        self._looks: deque[_Look] = deque()
        self._hz: int | None = None
        self.ptp: PtpState | None = None
        self._ptp_text = "off"
        self._switch = features.first_of(*_PTP_SWITCHES)
        if ptp is not None and self._switch is not None:
            features.set_truth(self._switch, ptp)
        elif ptp:
            raise LimitError(f"ptp=1: it cannot follow a PTP master ({', '.join(_PTP_SWITCHES)})")
        self.look()

    def look(self) -> None:
        """Compare the camera's clock with the host's, unless this was done recently."""
        if self._latch is None or not self._is_due():
            return
        try:
            self._remember(min((self._look_once(*self._latch) for _ in range(_TRIES)), key=lambda one: one.error_ns))
            self.ptp = self._ptp_state()
        except (LimitError, ProtocolError):
            self._latch = None  # it has these features but refuses them

    def moment_of(self, stamp_ns: int) -> tuple[int, int] | None:
        """Return the host's monotonic time of a camera's time stamp, and its error [ns].

        None where it is not known.
        """
        if self._hz is None:
            return None
        last = self._looks[-1]
        rate, rate_error = self._rate()
        since_ns = stamp_ns - self._ns(last.ticks)
        host_ns = round(since_ns / (1.0 + rate))
        tick_ns = -(-_NS_HZ // self._hz)
        error_ns = last.error_ns + tick_ns + round(abs(since_ns) * rate_error)
        return last.monotonic_ns + host_ns, error_ns

    def description(self) -> str | None:
        """Describe the clock for people; None if the camera does not report it."""
        if self._latch is None or self._hz is None:
            return None
        rate, rate_error = self._rate()
        ptp = f"; PTP {self._ptp_text}" if self._switch is not None else ""
        measured = f"{rate * 1e6:+.1f} ppm" if rate_error < _QUARTZ else "rate not known yet"
        return f"{self._latch[0]}, read to {self._looks[-1].error_ns / 1e3:.0f} us, {measured}{ptp}"

    def _is_due(self) -> bool:
        if self._hz is None:
            return True
        last = self._looks[-1]
        since_ns = self._now_ns() - last.monotonic_ns
        return since_ns >= _EACH_NS or since_ns * self._rate()[1] >= max(last.error_ns, _GROWN_NS)

    def _look_once(self, command: str, value: str) -> _Look:
        before_ns = self._now_ns()
        self._features.execute(command)
        after_ns = self._now_ns()
        ticks = self._features.whole(value)
        return _Look(ticks=ticks, monotonic_ns=(before_ns + after_ns) // 2, error_ns=(after_ns - before_ns + 1) // 2)

    def _remember(self, look: _Look) -> None:
        """Add a reading; forget all earlier ones if one of the clocks was set."""
        if self._hz is not None:
            expected = self.moment_of(self._ns(look.ticks))
            if expected is not None and abs(expected[0] - look.monotonic_ns) > expected[1] + look.error_ns:
                self._looks.clear()
        self._looks.append(look)
        while look.monotonic_ns - self._looks[0].monotonic_ns > _REMEMBERED_NS:
            self._looks.popleft()
        if self._hz is None:
            self._hz = self._unit()

    def _unit(self) -> int | None:
        """Return the unit of the clock from its progress: nanoseconds in the standard, but not in every camera."""
        first, last = self._looks[0], self._looks[-1]
        base_ns = last.monotonic_ns - first.monotonic_ns
        if base_ns < _UNIT_BASE_NS:
            return None
        tolerance = _UNIT_TOLERANCE + (first.error_ns + last.error_ns) / base_ns
        measured_hz = (last.ticks - first.ticks) * _NS_HZ / base_ns
        stated = [self._features.whole(_TICK_FREQUENCY)] if self._features.has(_TICK_FREQUENCY) else []
        found = next((hz for hz in (*stated, _NS_HZ) if hz > 0 and abs(measured_hz / hz - 1.0) <= tolerance), None)
        if found is None:
            self._looks = deque([last])
        return found

    def _ns(self, ticks: int) -> int:
        return ticks if self._hz is None else ticks * _NS_HZ // self._hz

    def _rate(self) -> tuple[float, float]:
        """Return the relative rate of the camera's clock compared with the host's, less 1, and its error."""
        first, last = self._looks[0], self._looks[-1]
        base_ns = last.monotonic_ns - first.monotonic_ns
        if base_ns <= 0:
            return 0.0, _QUARTZ
        error = (first.error_ns + last.error_ns) / base_ns + _WANDER
        if error >= _QUARTZ:
            return 0.0, _QUARTZ
        return (self._ns(last.ticks) - self._ns(first.ticks)) / base_ns - 1.0, error

    def _ptp_state(self) -> PtpState | None:
        """Return the state of the PTP clock; None if it follows no master with the time of day."""
        features = self._features
        if self._switch is None or not features.truth(self._switch):
            self._ptp_text = "off"
            return None
        latch = features.first_of(*_PTP_LATCHES)
        if latch is not None:
            features.execute(latch)
        state, offset = features.first_of(*_PTP_STATES), features.first_of(*_PTP_OFFSETS)
        self._ptp_text = "tells no state" if state is None else features.text(state)
        if state is None or offset is None or self._ptp_text != _FOLLOWS:
            return None
        offset_ns, last = abs(features.whole(offset)), self._looks[-1]
        ahead_ns = self._ns(last.ticks) - (last.monotonic_ns + self._utc_ns() - self._now_ns())
        ahead_s = min((0, _TAI_AHEAD_S), key=lambda whole_s: abs(ahead_ns - whole_s * _NS_HZ))
        behind_ns = ahead_ns - ahead_s * _NS_HZ
        if abs(behind_ns) >= _HALF_SECOND_NS:
            self._ptp_text += f", of a master that is {ahead_ns / 1e9:.3g} s ahead of this machine: not used"
            return None
        self._ptp_text += f", {offset_ns} ns from its master; this machine is {behind_ns / 1e6:.2f} ms behind it"
        return PtpState(offset_ns=offset_ns, ahead_s=ahead_s, host_behind_ns=behind_ns)
