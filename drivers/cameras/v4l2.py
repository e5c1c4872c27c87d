"""Cameras of Linux's video interface (V4L2), driven by its own requests, on 64-bit little-endian Linux.

In this order: structures, the device with its memory, controls, time stamps, options of an address, the camera, and the
search for devices with their best format.
"""

import ctypes
import errno
import fcntl
import mmap
import os
import select
import struct
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

from drivers.cameras.bounded_camera import Asked, BoundedCamera, asked_now, one_of, positive, split_place, whole
from drivers.cameras.samples import (
    PLANES,
    V4L2,
    Justified,
    PixelFormat,
    Plane,
    counts_of_picture,
    needed_bytes,
    size_of_counts,
    unpack,
)
from drivers.errors import AddressError, DeviceError, DeviceTimeoutError, LimitError, NotConnectedError, ProtocolError
from drivers.interfaces import CameraFacts, CameraSettings, DeviceIdentity, Frame, FrameTally

_u8, _u32, _i32, _i64, _u64 = ctypes.c_uint8, ctypes.c_uint32, ctypes.c_int32, ctypes.c_int64, ctypes.c_uint64


class Capability(ctypes.Structure):
    """Name, driver and abilities of a device."""

    _fields_ = (
        ("driver", ctypes.c_char * 16),
        ("card", ctypes.c_char * 32),
        ("bus_info", ctypes.c_char * 32),
        ("version", _u32),
        ("capabilities", _u32),
        ("device_caps", _u32),
        ("reserved", _u32 * 3),
    )


class PixFormat(ctypes.Structure):
    """Size and format of pictures in one plane."""

    _fields_ = (
        ("width", _u32),
        ("height", _u32),
        ("pixelformat", _u32),
        ("field", _u32),
        ("bytesperline", _u32),
        ("sizeimage", _u32),
        ("colorspace", _u32),
        ("priv", _u32),
        ("flags", _u32),
        ("ycbcr_enc", _u32),
        ("quantization", _u32),
        ("xfer_func", _u32),
    )


class _FormatUnion(ctypes.Union):
    _fields_ = (("pix", PixFormat), ("raw", _u8 * 200), ("alignment", _u64))


class Format(ctypes.Structure):
    """A format and its purpose."""

    _fields_ = (("type", _u32), ("fmt", _FormatUnion))


class FormatDescription(ctypes.Structure):
    """A format that a device offers, by its place in the list."""

    _fields_ = (
        ("index", _u32),
        ("type", _u32),
        ("flags", _u32),
        ("description", ctypes.c_char * 32),
        ("pixelformat", _u32),
        ("mbus_code", _u32),
        ("reserved", _u32 * 3),
    )


class RequestBuffers(ctypes.Structure):
    """Number of buffers requested, and in the answer the number granted."""

    _fields_ = (
        ("count", _u32),
        ("type", _u32),
        ("memory", _u32),
        ("capabilities", _u32),
        ("flags", _u8),
        ("reserved", _u8 * 3),
    )


class _Timeval(ctypes.Structure):
    _fields_ = (("seconds", _i64), ("microseconds", _i64))


class _Memory(ctypes.Union):
    _fields_ = (("offset", _u32), ("pointer", _u64))


class Buffer(ctypes.Structure):
    """A buffer for a picture."""

    _fields_ = (
        ("index", _u32),
        ("type", _u32),
        ("bytesused", _u32),
        ("flags", _u32),
        ("field", _u32),
        ("timestamp", _Timeval),
        ("timecode", _u8 * 16),
        ("sequence", _u32),
        ("memory", _u32),
        ("m", _Memory),
        ("length", _u32),
        ("reserved2", _u32),
        ("request_fd", _i32),
    )


class Control(ctypes.Structure):
    """Value of a control."""

    _fields_ = (("id", _u32), ("value", _i32))


class QueryControl(ctypes.Structure):
    """Range and kind of a control."""

    _fields_ = (
        ("id", _u32),
        ("type", _u32),
        ("name", ctypes.c_char * 32),
        ("minimum", _i32),
        ("maximum", _i32),
        ("step", _i32),
        ("default_value", _i32),
        ("flags", _u32),
        ("reserved", _u32 * 2),
    )


_READ, _WRITE, _BOTH = 2, 1, 3


def _request(direction: int, number: int, content: type[ctypes.Structure] | type[ctypes.c_int]) -> int:
    return direction << 30 | ctypes.sizeof(content) << 16 | ord("V") << 8 | number


QUERYCAP = _request(_READ, 0, Capability)
ENUM_FMT = _request(_BOTH, 2, FormatDescription)
G_FMT, S_FMT = _request(_BOTH, 4, Format), _request(_BOTH, 5, Format)
REQBUFS = _request(_BOTH, 8, RequestBuffers)
QUERYBUF, QBUF, DQBUF = (_request(_BOTH, number, Buffer) for number in (9, 15, 17))
STREAMON, STREAMOFF = _request(_WRITE, 18, ctypes.c_int), _request(_WRITE, 19, ctypes.c_int)
G_CTRL, S_CTRL = _request(_BOTH, 27, Control), _request(_BOTH, 28, Control)
QUERYCTRL = _request(_BOTH, 36, QueryControl)
CAPTURE, MMAP, NO_FIELDS = 1, 1, 1
CAN_CAPTURE, CAN_STREAM, HAS_DEVICE_CAPS = 0x1, 0x04000000, 0x80000000
DAMAGED, MONOTONIC, COPIED, CLOCK_MASK, AT_START_OF_EXPOSURE, SOURCE_MASK = (
    0x40,
    0x2000,
    0x4000,
    0xE000,
    0x10000,
    0x70000,
)
DISABLED_CONTROL = 0x1
EXPOSURE_AUTO, EXPOSURE_ABSOLUTE = 0x009A0901, 0x009A0902
GAIN = 0x00980913
# Control and the value that switches it off.
AUTOMATIC = {
    EXPOSURE_AUTO: 1,
    0x009A0903: 0,  # exposure by frame rate
    0x00980912: 0,  # gain
    0x0098090C: 0,  # white balance
    0x00980920: 0,  # brightness
    0x00980919: 0,  # hue
    0x009A090C: 0,  # focus
}
# Other controls that may change counts: brightness, contrast, gamma, sharpness, backlight compensation. The standard
# defines no neutral values.
PROCESSING = (0x00980900, 0x00980901, 0x00980910, 0x0098091B, 0x0098091C)
_BIG_END, _BIG_END_BIT = "_BE", 1 << 31
_STAMP_STEP_NS = 1000
# Later stamps are the time of day (from 2001) and not the time since the machine was started.
_TIME_OF_DAY_NS = 10**18
_EXPOSURE_STEP_S = 100e-6
_BUFFERS = 4
_FIRST_EXPOSURE_S = 0.01
_DEVICES = Path("/dev")
_PATTERN = "video*"
# Most bits first, except formats that pad an unknown number of bits to 16.
_BEST_FIRST = ("Y14 ", "Y12 ", "Y12P", "Y10 ", "Y10P", "Y16 ", "GREY")
_MOST_FORMATS = 100


class VideoNode(Protocol):
    """The system calls that the driver needs."""

    @property
    def path(self) -> str:
        """Return the name for messages."""

    def request(self, number: int, content: Any) -> None:
        """Make a request; its content is changed in place. Raises OSError."""

    def map(self, *, length: int, offset: int) -> memoryview:
        """Return the memory of a buffer."""

    def wait(self, timeout_s: float) -> bool:
        """Wait for a picture; return whether one came in time."""

    def close(self) -> None:
        """Release the device. May be called twice."""


class LinuxVideoNode:
    """A device file such as /dev/video0."""

    def __init__(self, path: str) -> None:
        if struct.calcsize("P") != 8 or sys.byteorder != "little":
            raise NotConnectedError(f"{path}: video devices are read on 64-bit little-endian Linux only")
        self._path = path
        self._maps: list[mmap.mmap] = []
        try:
            self._file: int | None = os.open(path, os.O_RDWR | os.O_NONBLOCK)
        except OSError as error:
            raise _device_error(error, path=path, what="opening") from error

    @property
    def path(self) -> str:
        """Return the path."""
        return self._path

    def request(self, number: int, content: Any) -> None:
        """Make a request; its content is changed in place."""
        fcntl.ioctl(self._opened(), number, content)

    def map(self, *, length: int, offset: int) -> memoryview:
        """Return the memory of a buffer."""
        self._maps.append(mmap.mmap(self._opened(), length, offset=offset))
        return memoryview(self._maps[-1])

    def wait(self, timeout_s: float) -> bool:
        """Wait for a picture; return whether one came in time."""
        readable, _, _ = select.select([self._opened()], [], [], max(0.0, timeout_s))
        return bool(readable)

    def close(self) -> None:
        """Release the device; its memory is freed once no picture refers to it. May be called twice."""
        self._maps.clear()
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def _opened(self) -> int:
        if self._file is None:
            raise NotConnectedError(f"{self._path}: it was closed; open it again")
        return self._file


@dataclass(frozen=True, kw_only=True)
class V4l2Options:
    """Content of an address ``/dev/video0?key=value``."""

    path: str  #: The device file.
    pixel_format: str = "Y12"  #: Its four letters, without the trailing space.
    width: int | None = None  #: Size of a picture; None: the device's own.
    height: int | None = None
    plane: Plane | None = None  #: Colour of a Bayer format: see `drivers.cameras.samples`.
    bit_depth: int | None = None  #: Bits in use, if fewer than the format's 16.
    justified: Justified = "right"  #: End of the 16 bits that they fill.
    #: "none": the device has no control, and the configured exposure was set by other means.
    exposure_control: str = "device"
    #: Step of the gain [dB]. None: unknown; the gain is then the smallest, called 0 dB.
    gain_step_db: float | None = None
    retakes: int = 20  #: Largest number of damaged pictures in a row; more are an error.


def open_v4l2(place: str) -> BoundedCamera:
    """Return a video device by ``/dev/video0?pixel_format=Y12&...``.

    See `drivers.cameras.v4l2.V4l2Options` for the keys.

    Raises
    ------
    NotConnectedError
        It is not there, in use, or no camera.
    LimitError
        It does not allow the settings in the address.
    """
    options = read_v4l2_place(place)
    return BoundedCamera(lambda: _open(options), name=f"video device {options.path}")


def find_v4l2(
    paths: Iterable[str] | None = None, *, open_node: Callable[[str], VideoNode] = LinuxVideoNode
) -> Iterator[tuple[str, DeviceIdentity]]:
    """Yield address and identity of each video device that takes pictures (by default of all /dev/video*).

    Nothing is set. A device that does not answer raises DeviceError after the others are yielded.
    """
    failure: DeviceError | None = None
    for path in sorted(map(str, _DEVICES.glob(_PATTERN))) if paths is None else paths:
        try:
            node = open_node(path)
            try:
                found = _address_and_identity(node)
            finally:
                node.close()
        except DeviceError as error:
            failure = error
            continue
        if found is not None:
            yield found
    if failure is not None:
        raise failure


def read_v4l2_place(text: str) -> V4l2Options:
    """Return the options in an address; see `V4l2Options` for its keys."""
    path, values = split_place(text, _READERS)
    options = V4l2Options(path=path, **values)
    if (_known(options).cell is None) != (options.plane is None):
        raise AddressError(f"camera address {text!r}: plane={'|'.join(PLANES)} is for Bayer formats only")
    return options


def sample_format(options: V4l2Options) -> PixelFormat:
    """Return the format of the samples in a picture of the device."""
    known = _known(options)
    depth = options.bit_depth or known.bit_depth
    if depth != known.bit_depth and known.bit_depth != 16:
        raise LimitError(f"{options.path}: bit_depth {depth}: samples of {known.name} have {known.bit_depth}")
    return replace(known, bit_depth=depth, justified=options.justified)


class V4l2Stamps:
    """The time stamps of a device, converted to the monotonic clock."""

    def __init__(self, name: str, *, now_ns: Callable[[], int], utc_ns: Callable[[], int]) -> None:
        self._name, self._now_ns, self._utc_ns = name, now_ns, utc_ns
        self._last: tuple[int, int] | None = None
        self._period_ns: int | None = None

    def asked_now(self) -> Asked:
        """Return this moment by both clocks."""
        return asked_now(now_ns=self._now_ns, utc_ns=self._utc_ns)

    def start_of(self, buffer: Buffer, asked: Asked, *, exposure_ns: int) -> tuple[int, int | None]:
        """Return the start of a picture's exposure and its error; None while unknown [ns].

        If the stamp is of the picture's end, its transfer took an unknown time, at most the measured time between
        pictures.
        """
        stamp_ns = self._monotonic_ns(buffer, asked)
        self._measure_period(buffer.sequence, stamp_ns)
        if buffer.flags & SOURCE_MASK == AT_START_OF_EXPOSURE:
            return stamp_ns, _STAMP_STEP_NS + asked.error_ns
        error_ns = None if self._period_ns is None else self._period_ns + asked.error_ns
        return stamp_ns - exposure_ns, error_ns

    def _monotonic_ns(self, buffer: Buffer, asked: Asked) -> int:
        """Return a picture's time stamp on the monotonic clock.

        Flags do not reveal a stamp of the time of day: they are "unknown", or "monotonic" if the kernel's driver was
        switched to that clock (uvcvideo's parameter ``clock``). Its size does. If the time of day was set meanwhile,
        such a stamp counts as too old.
        """
        stamp_ns = int(buffer.timestamp.seconds) * 10**9 + int(buffer.timestamp.microseconds) * 1000
        clock = buffer.flags & CLOCK_MASK
        if stamp_ns >= _TIME_OF_DAY_NS and clock != COPIED:
            was_set = asked.was_clock_set(self.asked_now())
            return 0 if was_set else stamp_ns - asked.utc_ns + asked.monotonic_ns
        if clock != MONOTONIC:
            raise ProtocolError(
                f"{self._name}: its time stamps are neither of the monotonic clock nor of the time of day, so the age "
                "of pictures is unknown"
            )
        return stamp_ns

    def _measure_period(self, sequence: int, stamp_ns: int) -> None:
        """Note the arrival of a picture, for the time between pictures."""
        last, self._last = self._last, (sequence, stamp_ns)
        if last is not None and sequence > last[0] and stamp_ns > last[1]:
            self._period_ns = (stamp_ns - last[1]) // (sequence - last[0])


class V4l2Controls:
    """The controls of one device."""

    def __init__(self, node: VideoNode, options: V4l2Options) -> None:
        self._node, self._options = node, options
        self.used: dict[str, str] = {}
        for control, off in AUTOMATIC.items():
            if self._described(control) is not None:
                self._set(control, off)
        self._exposure_s = 0.0
        if options.exposure_control == "device" and self._described(EXPOSURE_ABSOLUTE) is None:
            raise LimitError(
                f"video device {node.path}: it has no exposure in units of 100 us; if it is set by other means, add "
                "exposure_control=none to its address"
            )

    def set(self, *, exposure_s: float, gain_db: float) -> None:
        """Set exposure and gain; a refusal changes nothing."""
        steps = self._exposure_steps(exposure_s)
        gain = self._gain(gain_db)
        if steps is not None:
            self._set(EXPOSURE_ABSOLUTE, steps)
        if gain is not None:
            self._set(GAIN, gain)
        self._exposure_s = exposure_s

    def exposure_s(self) -> float:
        """Return the exposure of the device, or the configured one without such a control."""
        if self._options.exposure_control == "none":
            return self._exposure_s
        return self._get(EXPOSURE_ABSOLUTE) * _EXPOSURE_STEP_S

    def gain_db(self) -> float:
        """Read the gain."""
        limits = self._described(GAIN)
        if limits is None:
            return 0.0
        return (self._get(GAIN) - int(limits.minimum)) * (self._options.gain_step_db or 0.0)

    def found(self) -> dict[str, str]:
        """Return the controls that may change counts, which are left unchanged."""
        there = ((control, self._described(control)) for control in PROCESSING)
        return {
            described.name.decode(): f"{self._get(control)} (as found)"
            for control, described in there
            if described is not None
        }

    def require_manual(self) -> None:
        """Raise LimitError if an automatic control was switched on again."""
        for control, off in AUTOMATIC.items():
            described = self._described(control)
            if described is not None and (found := self._get(control)) != off:
                raise LimitError(
                    f"video device {self._node.path}: {described.name.decode()} is {found} again instead of {off}: "
                    "another program has switched it on"
                )

    def _exposure_steps(self, exposure_s: float) -> int | None:
        if not 0.0 < exposure_s < float("inf"):
            raise LimitError(f"video device {self._node.path}: exposure_s is {exposure_s} s; allowed is above 0")
        limits = self._described(EXPOSURE_ABSOLUTE)
        if self._options.exposure_control == "none" or limits is None:
            return None
        steps = round(exposure_s / _EXPOSURE_STEP_S)
        if not limits.minimum <= steps <= limits.maximum:
            raise LimitError(
                f"video device {self._node.path}: exposure_s is {exposure_s} s; it takes "
                f"{limits.minimum * _EXPOSURE_STEP_S:g} to {limits.maximum * _EXPOSURE_STEP_S:g} s"
            )
        return steps

    def _gain(self, gain_db: float) -> int | None:
        limits = self._described(GAIN)
        step_db = self._options.gain_step_db
        if limits is None or step_db is None:
            if gain_db != 0.0:
                raise LimitError(
                    f"video device {self._node.path}: gain_db is {gain_db} dB; the step of its gain is not known in "
                    "dB: add gain_step_db=X to its address, or use 0"
                )
            return None if limits is None else int(limits.minimum)
        steps = gain_db / step_db
        if not 0 <= steps <= limits.maximum - limits.minimum or steps != round(steps):
            raise LimitError(
                f"video device {self._node.path}: gain_db is {gain_db} dB; it takes 0 to "
                f"{(limits.maximum - limits.minimum) * step_db:g} dB in steps of {step_db:g} dB"
            )
        return int(limits.minimum) + round(steps)

    def _described(self, control: int) -> QueryControl | None:
        described = QueryControl(id=control)
        try:
            self._node.request(QUERYCTRL, described)
        except OSError:
            return None  # the only sign that the device has no such control
        return None if described.flags & DISABLED_CONTROL else described

    def _get(self, control: int) -> int:
        content = Control(id=control)
        _request_of(self._node, G_CTRL, content, f"control {control:#x}")
        return int(content.value)

    def _set(self, control: int, value: int) -> None:
        _request_of(self._node, S_CTRL, Control(id=control, value=value), f"control {control:#x} = {value}")
        described = self._described(control)
        name = described.name.decode() if described is not None else f"{control:#x}"
        if (found := self._get(control)) != value:
            raise LimitError(f"video device {self._node.path}: {name} was set to {value} and reads back {found}")
        self.used[name] = str(value)


class V4l2Camera:
    """An open, streaming video device; `open_v4l2` makes one.

    The device runs freely. A picture is accepted if its exposure began after the call by the driver's time stamp: the
    stamp itself if it marks the start, else the stamp minus the exposure. In the second case the exposure may have
    begun earlier by the transfer time, at most the time between pictures. Damaged or short pictures, and gaps in the
    device's numbers, are skipped and counted.
    """

    def __init__(
        self,
        node: VideoNode,
        options: V4l2Options,
        *,
        now_ns: Callable[[], int] = time.monotonic_ns,
        utc_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._node, self._options = node, options
        self._now_ns = now_ns
        self._pixel_format = sample_format(options)
        self._identity = self._identified()
        self._controls = V4l2Controls(node, options)
        self._controls.set(exposure_s=_FIRST_EXPOSURE_S, gain_db=0.0)
        self._format = self._set_format()
        self._settings = self._read_settings()
        self._tally = FrameTally()
        self._last_sequence: int | None = None
        self._stamps = V4l2Stamps(self._name, now_ns=now_ns, utc_ns=utc_ns)
        self._memory = self._start()
        self._open = True

    def __enter__(self) -> "V4l2Camera":
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()

    def identify(self) -> DeviceIdentity:
        """Return card, place on its bus (in place of a serial number) and version of the kernel's driver."""
        self._refuse_closed()
        return self._identity

    def configure(self, *, exposure_s: float, gain_db: float) -> CameraSettings:
        """Set exposure and gain; return what was read back."""
        self._refuse_closed()
        self._controls.set(exposure_s=exposure_s, gain_db=gain_db)
        self._settings = self._read_settings()
        return self._settings

    def tally(self) -> FrameTally:
        """Return the fate of the pictures so far."""
        return self._tally

    def facts(self) -> CameraFacts:
        """Return the format of its samples; their linearity is unknown."""
        fmt = self._pixel_format
        return CameraFacts(sample_format=fmt.name, justified=fmt.justified, linear=None)

    def features(self) -> dict[str, str]:
        """Return the controls that were set and those left unchanged, by the device's own names."""
        self._refuse_closed()
        plane = {} if self._options.plane is None else {"plane": self._options.plane}
        return plane | self._controls.used | self._controls.found()

    def take_frame(self, *, timeout_s: float) -> Frame:
        """Return a complete picture whose exposure began after this call."""
        self._refuse_closed()
        asked = self._stamps.asked_now()
        deadline_ns = asked.monotonic_ns + round(timeout_s * 1e9)
        damaged = 0
        while (left_ns := deadline_ns - self._now_ns()) > 0 and self._node.wait(left_ns / 1e9):
            picture = self._next_picture(asked)
            if isinstance(picture, Frame):
                self._require_settings()
                self._tally += FrameTally(accepted=1)
                return picture
            damaged = damaged + 1 if picture == "damaged" else 0
            if damaged > self._options.retakes:
                raise ProtocolError(f"{self._name}: {damaged} damaged pictures in a row; check cable and USB hub")
        raise DeviceTimeoutError(
            f"{self._name}: no new picture within {timeout_s} s at an exposure of {self._settings.exposure_s} s; allow "
            "more time or expose shorter"
        )

    def close(self) -> None:
        """Stop the stream and release the device. May be called twice."""
        if not self._open:
            return
        self._open = False
        self._memory = []
        try:
            self._node.request(STREAMOFF, ctypes.c_int(CAPTURE))
        except OSError:
            pass  # unplugged: there is nothing left to stop
        finally:
            self._node.close()

    @property
    def _name(self) -> str:
        return f"video device {self._node.path}"

    def _refuse_closed(self) -> None:
        if not self._open:
            raise NotConnectedError(f"{self._name}: it was closed; open it again")

    def _identified(self) -> DeviceIdentity:
        found = Capability()
        _request_of(self._node, QUERYCAP, found, "reading its identity")
        if not can_take_pictures(found):
            raise NotConnectedError(f"{self._name}: it is not a streaming camera; try the next /dev/video*")
        version = (found.version >> 16, found.version >> 8 & 0xFF, found.version & 0xFF)
        return DeviceIdentity(
            model=found.card.decode(errors="replace"),
            serial_number=found.bus_info.decode(errors="replace"),
            firmware=f"{found.driver.decode(errors='replace')} {'.'.join(map(str, version))}",
        )

    def _set_format(self) -> PixFormat:
        """Set size and format; raise LimitError if the device chose others."""
        content = Format(type=CAPTURE)
        _request_of(self._node, G_FMT, content, "reading its format")
        pix, letters = content.fmt.pix, self._options.pixel_format.ljust(4)
        asked = (self._options.width or pix.width, self._options.height or pix.height, fourcc(letters))
        pix.width, pix.height, pix.pixelformat = asked
        pix.field, pix.bytesperline, pix.sizeimage = NO_FIELDS, 0, 0
        _request_of(self._node, S_FMT, content, "setting its format")
        if (pix.width, pix.height, pix.pixelformat) != asked:
            got = letters_of(pix.pixelformat)
            raise LimitError(
                f"{self._name}: asked for {asked[0]} x {asked[1]} in {letters.strip()}, it offers {pix.width} x "
                f"{pix.height} in {got.strip()}"
            )
        return PixFormat.from_buffer_copy(pix)

    def _start(self) -> list[memoryview]:
        request = RequestBuffers(count=_BUFFERS, type=CAPTURE, memory=MMAP)
        _request_of(self._node, REQBUFS, request, "asking for buffers")
        memory = []
        for index in range(request.count):
            buffer = Buffer(index=index, type=CAPTURE, memory=MMAP)
            _request_of(self._node, QUERYBUF, buffer, "asking for a buffer")
            memory.append(self._node.map(length=buffer.length, offset=buffer.m.offset))
            _request_of(self._node, QBUF, buffer, "queueing a buffer")
        _request_of(self._node, STREAMON, ctypes.c_int(CAPTURE), "starting the stream")
        return memory

    def _next_picture(self, asked: Asked) -> Frame | str:
        """Return the waiting picture, or "damaged" or "too old"."""
        buffer = Buffer(index=0, type=CAPTURE, memory=MMAP)
        _request_of(self._node, DQBUF, buffer, "taking a picture")
        try:
            return self._frame_of(buffer, asked)
        finally:
            _request_of(self._node, QBUF, buffer, "queueing a buffer")

    def _frame_of(self, buffer: Buffer, asked: Asked) -> Frame | str:
        self._count_gap(buffer.sequence)
        start_ns, error_ns = self._stamps.start_of(buffer, asked, exposure_ns=round(self._settings.exposure_s * 1e9))
        if start_ns < asked.monotonic_ns:
            self._tally += FrameTally(too_old=1)
            return "too old"
        if buffer.flags & DAMAGED or buffer.bytesused < self._needed_bytes():
            self._tally += FrameTally(damaged=1)
            return "damaged"
        counts = unpack(
            self._memory[buffer.index][: buffer.bytesused],
            pixel_format=self._pixel_format,
            width=self._format.width,
            height=self._format.height,
            row_bytes=self._format.bytesperline,
        )
        start_utc_ns = start_ns - asked.monotonic_ns + asked.utc_ns
        return Frame(
            counts=counts_of_picture(counts, pixel_format=self._pixel_format, plane=self._options.plane),
            settings=self._settings,
            sequence=buffer.sequence,
            start_utc_ns=start_utc_ns,
            end_utc_ns=start_utc_ns + round(self._settings.exposure_s * 1e9),
            start_monotonic_ns=start_ns,
            start_uncertainty_s=None if error_ns is None else error_ns / 1e9,
            start_source="driver",
        )

    def _count_gap(self, sequence: int) -> None:
        last, self._last_sequence = self._last_sequence, sequence
        if last is not None and (gap := (sequence - last - 1) % 2**32) > 0:
            self._tally += FrameTally(never_came=gap)

    def _needed_bytes(self) -> int:
        last_row = needed_bytes(self._pixel_format, samples=int(self._format.width))
        return int(self._format.bytesperline) * (int(self._format.height) - 1) + last_row

    def _require_settings(self) -> None:
        self._controls.require_manual()
        found = self._read_settings()
        if found != self._settings:
            raise LimitError(f"{self._name}: it has {found} instead of {self._settings}: another program changed it")

    def _read_settings(self) -> CameraSettings:
        width, height, bit_depth = size_of_counts(
            self._pixel_format,
            plane=self._options.plane,
            width=int(self._format.width),
            height=int(self._format.height),
        )
        return CameraSettings(
            exposure_s=self._controls.exposure_s(),
            gain_db=self._controls.gain_db(),
            width=width,
            height=height,
            bit_depth=bit_depth,
        )


def can_take_pictures(device: Capability) -> bool:
    """Return whether a device is a streaming camera."""
    can = device.device_caps if device.capabilities & HAS_DEVICE_CAPS else device.capabilities
    return bool(can & CAN_CAPTURE and can & CAN_STREAM)


def fourcc(letters: str) -> int:
    """Return the number of a format by its four letters; "_BE" behind them sets the highest bit."""
    plain = letters.removesuffix(_BIG_END).ljust(4)
    return int.from_bytes(plain.encode(), "little") | (_BIG_END_BIT if letters.endswith(_BIG_END) else 0)


def letters_of(number: int) -> str:
    """Return the four letters of a format, followed by "_BE" if its highest bit is set."""
    plain = (number & ~_BIG_END_BIT).to_bytes(4, "little").decode(errors="replace")
    return f"{plain.strip()}{_BIG_END}" if number & _BIG_END_BIT else plain


def _request_of(node: VideoNode, number: int, content: object, what: str) -> None:
    """Make a request; turn an error of the system into one of the drivers."""
    try:
        node.request(number, content)
    except OSError as error:
        raise _device_error(error, path=node.path, what=what) from error


def _device_error(error: OSError, *, path: str, what: str) -> DeviceError:
    """Return the error of the drivers for a refusal by the system."""
    text = f"video device {path}: {what}: {error.strerror}"
    if error.errno in (errno.ENODEV, errno.ENOENT, errno.ENXIO):
        return NotConnectedError(f"{text}. It does not exist or was unplugged: `rigctl devices` lists video devices")
    if error.errno == errno.ENOTTY:
        return NotConnectedError(f"video device {path}: is not a video device: `rigctl devices` lists them")
    if error.errno == errno.EBUSY:
        return NotConnectedError(f"{text}. Another program uses it: close that one first")
    if error.errno in (errno.EACCES, errno.EPERM):
        return NotConnectedError(f"{text}. You may not use it: join its group (`ls -l {path}`, mostly `video`)")
    if error.errno in (errno.EINVAL, errno.ERANGE):
        return LimitError(f"{text}. The device does not have this, or not with this value")
    return ProtocolError(f"{text}. Unplug it and plug it in again")


_READERS: dict[str, Callable[[str], Any]] = {
    "pixel_format": one_of(*(name.strip() for name in V4L2)),
    "width": whole(1, 65535),
    "height": whole(1, 65535),
    "plane": one_of(*PLANES),
    "bit_depth": whole(8, 16),
    "justified": one_of("right", "left"),
    "exposure_control": one_of("device", "none"),
    "gain_step_db": positive,
    "retakes": whole(0, 1000),
}


def _known(options: V4l2Options) -> PixelFormat:
    return V4L2[options.pixel_format.ljust(4)]


def _open(options: V4l2Options) -> V4l2Camera:
    node = LinuxVideoNode(options.path)
    try:
        return V4l2Camera(node, options)
    except BaseException:
        node.close()
        raise


def _address_and_identity(node: VideoNode) -> tuple[str, DeviceIdentity] | None:
    """Return a device's address and identity; None if it takes no pictures."""
    capability = Capability()
    _request_of(node, QUERYCAP, capability, "reading its identity")
    if not can_take_pictures(capability):
        return None
    offered = _formats(node)
    best = next((letters for letters in (*_BEST_FIRST, *V4L2) if letters in offered), None)
    model = capability.card.decode(errors="replace")
    address = f"v4l2:{node.path}"
    if best is None:
        model += f" (sends finished pictures only, {', '.join(map(str.strip, offered))}: no counts to measure with)"
    else:
        address += f"?pixel_format={best.strip()}" + ("" if V4L2[best].cell is None else "&plane=green-1")
    identity = DeviceIdentity(
        model=model,
        serial_number=capability.bus_info.decode(errors="replace"),
        firmware=capability.driver.decode(errors="replace"),
    )
    return address, identity


def _formats(node: VideoNode) -> list[str]:
    """Return the formats of a device by their four letters."""
    offered = []
    for index in range(_MOST_FORMATS):
        description = FormatDescription(index=index, type=CAPTURE)
        try:
            node.request(ENUM_FMT, description)
        except OSError:
            break  # the only sign that there are no more
        offered.append(letters_of(description.pixelformat))
    return offered
