"""Structures and numbers of the Linux video interface (V4L2), as 64-bit little-endian Linux lays them out."""

import ctypes

_u8, _u32, _i32, _i64, _u64 = ctypes.c_uint8, ctypes.c_uint32, ctypes.c_int32, ctypes.c_int64, ctypes.c_uint64


class Capability(ctypes.Structure):
    """Answer of a device on what it is."""

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
    """A format and what it is for."""

    _fields_ = (("type", _u32), ("fmt", _FormatUnion))


class FormatDescription(ctypes.Structure):
    """One of the formats that a device offers, by its place in their list."""

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
    """Number of buffers that are wanted, and then of those that there are."""

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
    """A buffer with a picture, or for one."""

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
# Control -> value that switches it off.
AUTOMATIC = {
    EXPOSURE_AUTO: 1,
    0x009A0903: 0,  # exposure by frame rate
    0x00980912: 0,  # gain
    0x0098090C: 0,  # white balance
    0x00980920: 0,  # brightness
    0x00980919: 0,  # hue
    0x009A090C: 0,  # focus
}
# What else may change counts: brightness, contrast, gamma, sharpness, backlight compensation. The standard does not say
# which value of each changes nothing.
PROCESSING = (0x00980900, 0x00980901, 0x00980910, 0x0098091B, 0x0098091C)


def can_take_pictures(device: Capability) -> bool:
    """Return whether a device is a camera that streams."""
    can = device.device_caps if device.capabilities & HAS_DEVICE_CAPS else device.capabilities
    return bool(can & CAN_CAPTURE and can & CAN_STREAM)


_BIG_END, _BIG_END_BIT = "_BE", 1 << 31


def fourcc(letters: str) -> int:
    """Return the number of a format by its four letters; "_BE" behind them sets the highest bit."""
    plain = letters.removesuffix(_BIG_END).ljust(4)
    return int.from_bytes(plain.encode(), "little") | (_BIG_END_BIT if letters.endswith(_BIG_END) else 0)


def letters_of(number: int) -> str:
    """Return the four letters of a format, "_BE" behind them where its highest bit is set."""
    plain = (number & ~_BIG_END_BIT).to_bytes(4, "little").decode(errors="replace")
    return f"{plain.strip()}{_BIG_END}" if number & _BIG_END_BIT else plain
