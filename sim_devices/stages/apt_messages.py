"""The messages that a simulated APT controller sends, from a reading of Thorlabs' protocol document (issue 25)."""

import struct

from sim_devices.stages.apt_address import MODELS, AptOptions

_HOST, _UNIT, _LONG = 0x01, 0x50, 0x80
_CHANNEL = 1
_GET_INFO = 0x0006
_STEPPER_TYPE, _DC_TYPE = 16, 44
_FIRMWARE = bytes([2, 1, 3, 0])  # minor, interim, major


def short(number: int, first: int = _CHANNEL, second: int = 0) -> bytes:
    """Return a message without data."""
    return struct.pack("<HBBBB", number, first, second, _HOST, _UNIT)


def long(number: int, data: bytes) -> bytes:
    """Return a message with data."""
    return struct.pack("<HHBB", number, len(data), _HOST | _LONG, _UNIT) + data


def information(options: AptOptions) -> bytes:
    """Return what the controller says of itself."""
    model = MODELS[options.model]
    serial_number = model.serial_number if options.serial_number is None else options.serial_number
    kind = _STEPPER_TYPE if model.is_stepper else _DC_TYPE
    head = struct.pack("<i8sH4s48s", serial_number, options.model.encode(), kind, _FIRMWARE, b"simulated")
    return long(_GET_INFO, head + bytes(10) + struct.pack("<HHHH", model.stage_id, 1, 1, 1))


def stepper_status(counts: int, bits: int) -> bytes:
    """Return the data that tell the status of a stepper motor."""
    return struct.pack("<HiiI", _CHANNEL, counts, 0, bits)


def servo_status(counts: int, bits: int) -> bytes:
    """Return the data that tell the status of a DC servo motor."""
    return struct.pack("<HiHHI", _CHANNEL, counts, 0, 0, bits)


def with_channel(data: bytes) -> bytes:
    """Return parameters with the channel that they belong to."""
    return struct.pack("<H", _CHANNEL) + data
