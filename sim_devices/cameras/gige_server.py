"""A simulated camera on the network, for any GigE Vision program.

libaravis's own simulated device answers on the network and gets every picture from Python. It cannot resend packets and
has no readable clock. A simulated network in front of it (control: GVCP, pictures: GVSP) loses packets, stores recent
ones, resends them on request, and provides a clock that may follow a PTP master. Written from the GigE Vision standard
and the names of GenICam, without the driver's code.
"""

import ctypes
import random
import re
import select
import socket
import struct
import tempfile
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.errors import NotConnectedError
from drivers.interfaces import Camera

_POINTER, _TEXT = ctypes.c_void_p, ctypes.c_char_p
_FILL = ctypes.CFUNCTYPE(None, _POINTER, _POINTER, ctypes.c_uint32, ctypes.c_uint32, ctypes.c_uint32)
_FUNCTIONS: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "arv_fake_camera_new": (_POINTER, (_TEXT,)),
    "arv_fake_camera_get_genicam_xml": (_POINTER, (_POINTER, ctypes.POINTER(ctypes.c_size_t))),
    "arv_fake_camera_write_register": (ctypes.c_int, (_POINTER, ctypes.c_uint32, ctypes.c_uint32)),
    "arv_fake_camera_read_register": (
        ctypes.c_int,
        (_POINTER, ctypes.c_uint32, ctypes.POINTER(ctypes.c_uint32)),
    ),
    "arv_fake_camera_set_trigger_frequency": (None, (_POINTER, ctypes.c_double)),
    "arv_fake_camera_set_fill_pattern": (None, (_POINTER, _FILL, _POINTER, _POINTER)),
    "arv_gv_fake_camera_new_full": (_POINTER, (_TEXT, _TEXT, _TEXT)),
    "arv_gv_fake_camera_is_running": (ctypes.c_int, (_POINTER,)),
    "arv_gv_fake_camera_get_fake_camera": (_POINTER, (_POINTER,)),
    "arv_buffer_get_data": (_POINTER, (_POINTER, ctypes.POINTER(ctypes.c_size_t))),
    "arv_buffer_get_image_width": (ctypes.c_int, (_POINTER,)),
    "arv_buffer_get_image_height": (ctypes.c_int, (_POINTER,)),
}

# Rate at which the device looks for a trigger; its own 25 Hz would delay pictures by 20 ms on average.
_TRIGGER_LOOKS_HZ = 1000.0
_CONTROL_PORT = 3956
_CAPABILITY, _RESEND_CAPABILITY = 0x0934, 0x4  # capabilities beyond the standard's minimum

Fill = Callable[[int, int, int, int, int], bytes]
"""Width, height, exposure [us], gain [dB] and pixel format in; the bytes of a picture out."""


class AravisDevice:
    """A device on the network, initially off.

    Parameters
    ----------
    address : str
        Address of one of this machine's interfaces, for one device, since the standard fixes the port 3956.
    serial_number : str
        At most 15 letters.
    edit_features : callable
        Makes the device's list of features (GenICam XML) from the library's own.
    fill : callable
        Makes a picture, in a thread of the library. Exceptions are kept in `failures`, and the buffer of such a picture
        is unchanged.

    Raises
    ------
    NotConnectedError
        libaravis is not installed.
    """

    def __init__(self, *, address: str, serial_number: str, edit_features: Callable[[str], str], fill: Fill) -> None:
        self._library, self._gobject = _load()
        self.address, self._serial_number = address, serial_number
        self._resends = False
        self._features = edit_features(_own_features(self._library))
        self.failures: list[Exception] = []
        self._callback = _callback(self._library, fill, self.failures)
        self._camera: int | None = None
        # One thread switches the power while another uses it.
        self._lock = threading.RLock()

    def power_up(self) -> None:
        """Answer on the network, with the registers of the library.

        Raises
        ------
        NotConnectedError
            The address is not this machine's or in use.
        """
        with self._lock:
            _refuse_taken(self.address)
            self._camera = self._new_camera()
            registers = self._registers()
            self._library.arv_fake_camera_set_trigger_frequency(registers, _TRIGGER_LOOKS_HZ)
            self._library.arv_fake_camera_set_fill_pattern(registers, self._callback, None, None)
            self.promise_resends(self._resends)

    def power_down(self) -> None:
        """Stop answering; not to be called from within `fill`, whose thread ends first. May be called twice."""
        with self._lock:
            camera, self._camera = self._camera, None
        if camera is not None:
            self._gobject.g_object_unref(camera)

    def write_register(self, address: int, value: int) -> None:
        """Set a register without the controlling program."""
        with self._lock:
            self._library.arv_fake_camera_write_register(self._registers(), address, value)

    def read_register(self, address: int) -> int:
        """Return the value of a register; 0 without power."""
        with self._lock:
            if self._camera is None:
                return 0
            value = ctypes.c_uint32()
            self._library.arv_fake_camera_read_register(self._registers(), address, ctypes.byref(value))
            return value.value

    def promise_resends(self, resends: bool) -> None:
        """State whether lost packets are sent again; the simulated network does it."""
        self._resends = resends
        self.write_register(_CAPABILITY, _RESEND_CAPABILITY if resends else 0)

    def lose_packets(self, share: float) -> None:
        """Lose this share of the packets of pictures until the power goes off."""
        with self._lock:
            if self._camera is not None:
                self._gobject.g_object_set(_POINTER(self._camera), b"gvsp-lost-ratio", ctypes.c_double(share), None)

    def _registers(self) -> int:
        if self._camera is None:
            raise NotConnectedError(f"the simulated GigE camera on {self.address} has no power")
        registers: int = self._library.arv_gv_fake_camera_get_fake_camera(self._camera)
        return registers

    def _new_camera(self) -> int:
        with tempfile.TemporaryDirectory(prefix="rigctl-") as folder:
            features = Path(folder) / "features.xml"
            features.write_text(self._features, encoding="utf-8")
            camera: int = self._library.arv_gv_fake_camera_new_full(
                self.address.encode(), self._serial_number.encode(), str(features).encode()
            )
        if not self._library.arv_gv_fake_camera_is_running(camera):
            self._gobject.g_object_unref(camera)
            raise NotConnectedError(f"no GigE camera can be served on {self.address}: the library gives no reason")
        return camera


def _refuse_taken(address: str) -> None:
    """Refuse an address in use, since the library would listen there too and both would answer."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((address, _CONTROL_PORT))
        except OSError as error:
            raise NotConnectedError(
                f"no GigE camera can be served on {address}, port {_CONTROL_PORT}: {error.strerror}. Use an address of "
                "this machine without another camera"
            ) from error


def _callback(library: ctypes.CDLL, fill: Fill, failures: list[Exception]) -> Any:
    def fill_buffer(buffer: int, _: int, exposure_us: int, gain: int, pixel_format: int) -> None:
        width = library.arv_buffer_get_image_width(buffer)
        height = library.arv_buffer_get_image_height(buffer)
        try:
            picture = fill(width, height, exposure_us, gain, pixel_format)
        except Exception as error:  # must not reach the library, which would end the program
            failures.append(error)
            return
        room = width * height * (pixel_format >> 16 & 0xFF) // 8
        ctypes.memmove(library.arv_buffer_get_data(buffer, None), picture, min(len(picture), room))

    return _FILL(fill_buffer)


def _load() -> tuple[ctypes.CDLL, ctypes.CDLL]:
    try:
        library, gobject = ctypes.CDLL("libaravis-0.8.so.0"), ctypes.CDLL("libgobject-2.0.so.0")
    except OSError as error:
        raise NotConnectedError(
            f"a simulated GigE camera needs libaravis 0.8: `apt install libaravis-0.8-0` ({error})"
        ) from error
    for name, (result, arguments) in _FUNCTIONS.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, list(arguments)
    gobject.g_object_unref.argtypes = [_POINTER]
    return library, gobject


def _own_features(library: ctypes.CDLL) -> str:
    size = ctypes.c_size_t()
    probe = library.arv_fake_camera_new(b"probe")
    xml = ctypes.string_at(library.arv_fake_camera_get_genicam_xml(probe, ctypes.byref(size)), size.value)
    return xml.rstrip(b"\0").decode()


# Registers of the standard: frequency of the clock, its latch, and the latched value, in two halves each.
FREQUENCY, CONTROL, LATCHED = 0x093C, 0x0944, 0x0948
_LATCH = 2
# Memory unused by the library's device.
_PTP_ENABLE, _PTP_LATCH, _PTP_STATUS, _PTP_OFFSET = 0x0500, 0x0504, 0x0508, 0x050C
_LISTENING, _SLAVE, _DISABLED = 4, 9, 3  # as IEEE 1588 numbers the states
_TAI_AHEAD_S = 37
_LOCKING_S = 0.2  # cameras take some seconds

_NODES = """
<Command Name="GevTimestampControlLatch"><pValue>TimestampControlRegister</pValue>
<CommandValue>2</CommandValue></Command>
<IntReg Name="TimestampControlRegister"><Address>0x944</Address><Length>4</Length><AccessMode>WO</AccessMode>
<pPort>Device</pPort><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>
<Integer Name="GevTimestampValue"><pValue>TimestampRegister</pValue></Integer>
<IntReg Name="TimestampRegister"><Address>0x948</Address><Length>8</Length><AccessMode>RO</AccessMode>
<pPort>Device</pPort><Cachable>NoCache</Cachable><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>
<Integer Name="GevTimestampTickFrequency"><pValue>TickFrequencyRegister</pValue></Integer>
<IntReg Name="TickFrequencyRegister"><Address>0x93c</Address><Length>8</Length><AccessMode>RO</AccessMode>
<pPort>Device</pPort><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>
"""
_PTP_NODES = """
<Boolean Name="PtpEnable"><pValue>PtpEnableRegister</pValue><OnValue>1</OnValue><OffValue>0</OffValue></Boolean>
<IntReg Name="PtpEnableRegister"><Address>0x500</Address><Length>4</Length><AccessMode>RW</AccessMode>
<pPort>Device</pPort><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>
<Command Name="PtpDataSetLatch"><pValue>PtpLatchRegister</pValue><CommandValue>1</CommandValue></Command>
<IntReg Name="PtpLatchRegister"><Address>0x504</Address><Length>4</Length><AccessMode>WO</AccessMode>
<pPort>Device</pPort><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>
<Enumeration Name="PtpStatus"><EnumEntry Name="Disabled"><Value>3</Value></EnumEntry>
<EnumEntry Name="Listening"><Value>4</Value></EnumEntry><EnumEntry Name="Slave"><Value>9</Value></EnumEntry>
<pValue>PtpStatusRegister</pValue></Enumeration>
<IntReg Name="PtpStatusRegister"><Address>0x508</Address><Length>4</Length><AccessMode>RO</AccessMode>
<pPort>Device</pPort><Cachable>NoCache</Cachable><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>
<Integer Name="PtpOffsetFromMaster"><pValue>PtpOffsetRegister</pValue></Integer>
<IntReg Name="PtpOffsetRegister"><Address>0x50c</Address><Length>8</Length><AccessMode>RO</AccessMode>
<pPort>Device</pPort><Cachable>NoCache</Cachable><Sign>Signed</Sign><Endianess>BigEndian</Endianess></IntReg>
"""


@dataclass(frozen=True, kw_only=True)
class ClockTruth:
    """Properties of a camera's clock.

    Attributes
    ----------
    drift_ppm : float
        Relative excess of its rate.
    tick_hz : int
        Ticks per second.
    start_s : float
        Initial reading: cameras count from power-up.
    has_ptp : bool
        True if it can follow a master with TAI from the host's clock.
    master_ahead_s, ptp_offset_ns : float, int
        Lead of the master over TAI, and of the camera over its master.
    """

    drift_ppm: float = 0.0
    tick_hz: int = 1_000_000_000
    start_s: float = 100.0
    has_ptp: bool = False
    master_ahead_s: float = 0.0
    ptp_offset_ns: int = 0


class DeviceClock:
    """A clock with the registers that tell of it."""

    def __init__(
        self,
        truth: ClockTruth,
        *,
        now_ns: Callable[[], int] = time.monotonic_ns,
        utc_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self.truth, self._now_ns, self._utc_ns = truth, now_ns, utc_ns
        self._made_ns = now_ns()
        self.stamped_utc_ns = 0
        self._follows_from_ns: int | None = None
        self._written: dict[int, int] = {}
        self._set_values()

    def features(self, xml: str) -> str:
        """Return a list of features with those of the clock."""
        nodes = _NODES + (_PTP_NODES if self.truth.has_ptp else "")
        return xml.replace("</RegisterDescription>", f"{nodes}</RegisterDescription>")

    def ticks(self, true_utc_ns: int | None = None) -> int:
        """Return the reading of the clock at a time of the host's clock; None for now."""
        utc_ns, now_ns = self._utc_ns(), self._now_ns()
        ago_ns = 0 if true_utc_ns is None else utc_ns - true_utc_ns
        if self._is_slave():
            ahead_ns = round((_TAI_AHEAD_S + self.truth.master_ahead_s) * 1e9) + self.truth.ptp_offset_ns
            return (utc_ns - ago_ns + ahead_ns) * self.truth.tick_hz // 10**9
        since_s = (now_ns - ago_ns - self._made_ns) / 1e9
        return round((self.truth.start_s + since_s * (1.0 + self.truth.drift_ppm * 1e-6)) * self.truth.tick_hz)

    def stamp(self, true_utc_ns: int) -> int:
        """Return the reading of the clock when a picture was taken."""
        self.stamped_utc_ns = true_utc_ns
        return self.ticks(true_utc_ns)

    def has(self, address: int) -> bool:
        """Return whether a register is the clock's."""
        return address in self._written or FREQUENCY <= address < LATCHED + 8

    def read(self, address: int, count: int = 4) -> bytes:
        """Return what stands in the clock's memory."""
        return b"".join(self._written.get(place, 0).to_bytes(4, "big") for place in range(address, address + count, 4))

    def write(self, address: int, value: int) -> None:
        """Do what writing a register does."""
        if address == CONTROL and value & _LATCH:
            self._hold(LATCHED, self.ticks())
        if address == _PTP_ENABLE:
            self._written[_PTP_ENABLE] = value
            self._follows_from_ns = self._now_ns() + round(_LOCKING_S * 1e9) if value else None
        if address == _PTP_LATCH:
            state = _SLAVE if self._is_slave() else _LISTENING
            self._written[_PTP_STATUS] = state if self._follows_from_ns is not None else _DISABLED

    def _is_slave(self) -> bool:
        return self._follows_from_ns is not None and self._now_ns() >= self._follows_from_ns

    def _set_values(self) -> None:
        self._hold(FREQUENCY, self.truth.tick_hz)
        self._hold(LATCHED, 0)
        self._hold(_PTP_OFFSET, self.truth.ptp_offset_ns & 0xFFFFFFFF_FFFFFFFF)
        self._written |= {_PTP_ENABLE: 0, _PTP_LATCH: 0, _PTP_STATUS: _DISABLED}

    def _hold(self, address: int, value: int) -> None:
        self._written |= {address: value >> 32, address + 4: value & 0xFFFFFFFF}


@dataclass(frozen=True, kw_only=True)
class GigeFaults:
    """Faults. Pictures are counted from 1 at power-up; None: never.

    Attributes
    ----------
    lost_share : float
        Share of the packets of pictures that are lost, 0 to below 1.
    resends : bool
        True if it sends lost packets again on request.
    die : int or None
        Its power goes off for good at this picture.
    restart : int or None
        Its power goes off and comes back at this picture, with the settings of a power-up; again after as many more.
    off_s : float
        Time without power at a restart.
    hang : int or None
        It stops answering at this picture for `hang_s`.
    hang_s : float
        Time without answers.
    forget : int or None
        After this picture its exposure changes on its own.
    clock : ClockTruth or None
        Its clock if it can be read, as in `serve_behind_network`; None if not.
    """

    lost_share: float = 0.0
    resends: bool = True
    die: int | None = None
    restart: int | None = None
    off_s: float = 0.5
    hang: int | None = None
    hang_s: float = 6.0
    forget: int | None = None
    clock: ClockTruth | None = None


class FaultyPower:
    """Counts pictures and causes the faults. A context manager: leaving it ends a hang and all waiting.

    Another thread switches the power off, because the thread that makes the pictures ends with it.
    """

    def __init__(
        self,
        faults: GigeFaults,
        *,
        power_down: Callable[[], None],
        power_up: Callable[[], None],
        forget: Callable[[], None],
        cut: Callable[[], None] = lambda: None,
    ) -> None:
        self._faults = faults
        self._power_down, self._power_up, self._forget, self._cut = power_down, power_up, forget, cut
        self._pictures = 0
        self._is_for_good = False
        self._is_over = threading.Event()
        self._switch = threading.Event()
        self._thread = threading.Thread(target=self._watch_switch, name="power of a simulated camera", daemon=True)

    def __enter__(self) -> "FaultyPower":
        self._thread.start()
        return self

    def __exit__(self, *exc_info: object) -> None:
        self._is_over.set()
        self._switch.set()
        self._thread.join()

    def before_picture(self) -> None:
        """Count a picture before it is made, in the same thread."""
        self._pictures += 1
        faults, number = self._faults, self._pictures
        if number == faults.hang:
            self._is_over.wait(faults.hang_s)
        if number in (faults.die, faults.restart):
            # Another picture may be counted before the power goes off.
            self._is_for_good = number == faults.die
            self._cut()
            self._switch.set()

    def after_picture(self) -> None:
        """Change the settings after the last picture with the right ones."""
        if self._pictures == self._faults.forget:
            self._forget()

    def _watch_switch(self) -> None:
        while self._switch.wait() and not self._is_over.is_set():
            self._switch.clear()
            self._power_down()
            self._pictures = 0
            if self._is_for_good or self._is_over.wait(self._faults.off_s):
                return
            self._power_up()


MONO8, MONO10, MONO12, MONO16 = 0x01080001, 0x01100003, 0x01100005, 0x01100007
MONO12_PACKED, MONO12P = 0x010C0006, 0x010C0047
BAYER_RG12 = 0x01100011
# LUCID's numbers.
POLARIZE_MONO8, POLARIZE_MONO12, POLARIZE_MONO12P = 0x81080001, 0x81100008, 0x810C0047
FORMATS = {
    "Mono8": MONO8,
    "Mono10": MONO10,
    "Mono12": MONO12,
    "Mono16": MONO16,
    "Mono12Packed": MONO12_PACKED,
    "Mono12p": MONO12P,
    "BayerRG12": BAYER_RG12,  # the source is read as a mosaic
    "PolarizeMono8": POLARIZE_MONO8,
    "PolarizeMono12": POLARIZE_MONO12,
    "PolarizeMono12p": POLARIZE_MONO12P,
}
_BITS = {
    MONO8: 8,
    MONO10: 10,
    MONO12: 12,
    MONO16: 16,
    MONO12_PACKED: 12,
    MONO12P: 12,
    BAYER_RG12: 12,
    POLARIZE_MONO8: 8,
    POLARIZE_MONO12: 12,
    POLARIZE_MONO12P: 12,
}


def bytes_of(counts: NDArray[np.uint16], *, bit_depth: int, pixel_format: int) -> bytes:
    """Return a picture as a camera sends it."""
    if pixel_format not in _BITS:
        raise ValueError(f"pixel format {pixel_format:#010x} is not supported by this camera")
    spare = _BITS[pixel_format] - bit_depth
    samples = (np.left_shift(counts, spare) if spare >= 0 else np.right_shift(counts, -spare)).ravel()
    if pixel_format in (MONO8, POLARIZE_MONO8):
        return samples.astype(np.uint8).tobytes()
    if pixel_format in (MONO12_PACKED, MONO12P, POLARIZE_MONO12P):
        return _in_threes(samples, lowest_first=pixel_format != MONO12_PACKED)
    return samples.astype("<u2").tobytes()


def _in_threes(samples: NDArray[np.uint16], *, lowest_first: bool) -> bytes:
    """Return two samples of 12 bits in three bytes, the last of an odd number in two."""
    padded = np.append(samples, np.uint16(0)) if samples.size % 2 else samples
    first, second = padded[0::2], padded[1::2]
    triples = np.empty((first.size, 3), dtype=np.uint8)
    if lowest_first:
        triples[:, 0] = first & 0xFF
        triples[:, 1] = (first >> 8) | (second & 0xF) << 4
    else:
        triples[:, 0] = first >> 4
        triples[:, 1] = (first & 0xF) | (second & 0xF) << 4
    triples[:, 2] = second >> 4
    return triples.tobytes()[: -(-12 * samples.size // 8)]


# Registers of the library's device.
SENSOR_HEIGHT, SENSOR_WIDTH, WIDTH, HEIGHT = 0x118, 0x11C, 0x100, 0x104
OFFSET_X, OFFSET_Y = 0x130, 0x134
EXPOSURE_US = 0x120
GAIN_AUTO = 0x114
# Memory that it does not use.
EXPOSURE_AUTO, REVERSE_X, TEMPERATURE_TENTHS_C, GAMMA = 0x400, 0x404, 0x408, 0x40C
EXPOSURE_AUTO_OFF, EXPOSURE_AUTO_CONTINUOUS = 0, 2
GAIN_AUTO_OFF, GAIN_AUTO_CONTINUOUS = 1, 2

_REGISTER = """
<IntReg Name="{name}Register" NameSpace="Custom"><Address>{address:#x}</Address><Length>4</Length>
<AccessMode>{access}</AccessMode><pPort>Device</pPort><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>
"""
_EXPOSURE_AUTO = """
<Enumeration Name="ExposureAuto" NameSpace="Standard">
<EnumEntry Name="Off" NameSpace="Standard"><Value>0</Value></EnumEntry>
<EnumEntry Name="Once" NameSpace="Standard"><Value>1</Value></EnumEntry>
<EnumEntry Name="Continuous" NameSpace="Standard"><Value>2</Value></EnumEntry>
<pValue>ExposureAutoRegister</pValue></Enumeration>
"""
_SWITCH = """
<Boolean Name="{name}" NameSpace="Standard"><pValue>{name}Register</pValue>
<OnValue>1</OnValue><OffValue>0</OffValue></Boolean>
"""
_TEMPERATURE = """
<Float Name="DeviceTemperature"><pValue>DeviceTemperatureConverter</pValue></Float>
<Converter Name="DeviceTemperatureConverter"><FormulaTo>(FROM * 10)</FormulaTo><FormulaFrom>(TO / 10.0)</FormulaFrom>
<pValue>DeviceTemperatureInteger</pValue></Converter>
<Integer Name="DeviceTemperatureInteger" NameSpace="Custom"><pValue>DeviceTemperatureRegister</pValue></Integer>
"""


def extended(xml: str) -> str:
    """Return the list with 10 and 12 bits, automatic exposure, mirroring, gamma and a thermometer; no binning."""
    entries = "".join(
        f'<EnumEntry Name="{name}" NameSpace="Standard"><Value>{code}</Value></EnumEntry>'
        for name, code in FORMATS.items()
        if f'<EnumEntry Name="{name}"' not in xml
    )
    first = re.search(r'<EnumEntry Name="Mono16"', xml)
    last = xml.rindex("</RegisterDescription>")
    if first is None:
        raise ValueError("the library's list of features is not the one of libaravis 0.8")
    added = (
        _EXPOSURE_AUTO
        + _REGISTER.format(name="ExposureAuto", address=EXPOSURE_AUTO, access="RW")
        + _SWITCH.format(name="ReverseX")
        + _REGISTER.format(name="ReverseX", address=REVERSE_X, access="RW")
        + _SWITCH.format(name="GammaEnable")
        + _REGISTER.format(name="GammaEnable", address=GAMMA, access="RW")
        + _TEMPERATURE
        + _REGISTER.format(name="DeviceTemperature", address=TEMPERATURE_TENTHS_C, access="RO")
    )
    whole = xml[: first.start()] + entries + xml[first.start() : last] + added + xml[last:]
    return whole.replace("<Max>16</Max>", "<Max>1</Max>").replace("<Min>10.0</Min>", "<Min>1.0</Min>")


_CONTROL = struct.Struct(">BBHHH")  # key or status, flags, command, length, request
_KEY = 0x42
_DISCOVERY_ACK, _READ_REGISTER_ACK = 0x0003, 0x0081
_READ_REGISTER, _WRITE_REGISTER, _RESEND = 0x0080, 0x0082, 0x0040
_READ_MEMORY, _WRITE_MEMORY = 0x0084, 0x0086
_STREAM_PORT, _STREAM_ADDRESS = 0x0D00, 0x0D18
_ADDRESS_IN_DISCOVERY = 36  # of its data, the last four of 16 bytes
_PICTURE = struct.Struct(">HHI")  # status, picture, kind and number of the packet
_NUMBER = 0xFFFFFF
_LEADER, _KIND = 1, 0x7F
_STAMP = slice(12, 20)  # of a leader: time of its picture by the camera's clock
_HEADERS_BYTES = 28  # IP and UDP
_KEPT_PICTURES = 8
_SOCKET_BYTES = 2**22
_LARGEST = 2**16
_LOOK_S = 0.1


class _LossyNetwork:
    """Simulated network with its own address in front of a camera; `lossy_network` makes one."""

    def __init__(
        self,
        *,
        camera: str,
        address: str,
        lost_share: float,
        resends: bool,
        largest_bytes: int | None,
        clock: DeviceClock | None,
        seed: int,
    ) -> None:
        self._lost_share, self._resends, self._largest_bytes = lost_share, resends, largest_bytes
        self._clock = clock
        self._camera, self._address = (camera, _CONTROL_PORT), address
        self._random = random.Random(seed)
        self._control = _socket(address, _CONTROL_PORT)
        self._to_camera = _socket("0.0.0.0", 0)
        self._pictures = _socket("0.0.0.0", 0)
        self._host: tuple[str, int] | None = None
        self._asked: dict[int, tuple[tuple[str, int], bytes]] = {}
        self._sends_to: dict[int, bytes] = {}
        self._kept: OrderedDict[int, dict[int, bytes]] = OrderedDict()
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._carry, name="lossy network", daemon=True)

    def start(self) -> None:
        """Carry packets from now on."""
        self._thread.start()

    def close(self) -> None:
        """Carry none any more."""
        self._is_over.set()
        self._thread.join()
        for end in (self._control, self._to_camera, self._pictures):
            end.close()

    def _carry(self) -> None:
        ends = {
            self._pictures: self._carry_picture,
            self._control: self._carry_question,
            self._to_camera: self._carry_answer,
        }
        while not self._is_over.is_set():
            for ready in select.select(list(ends), [], [], _LOOK_S)[0]:
                self._empty(ready, ends[ready])

    def _empty(self, end: socket.socket, carry: Callable[[bytes, tuple[str, int]], None]) -> None:
        while True:
            try:
                data, sender = end.recvfrom(_LARGEST)
            except (BlockingIOError, ConnectionRefusedError):
                return
            carry(data, sender)

    def _carry_picture(self, packet: bytes, _camera: tuple[str, int]) -> None:
        _, picture, kind_and_number = _PICTURE.unpack_from(packet)
        if self._clock is not None and kind_and_number >> 24 & _KIND == _LEADER:
            # The device stamps it in nanoseconds of UTC.
            stamp = self._clock.stamp(int.from_bytes(packet[_STAMP], "big")).to_bytes(8, "big")
            packet = packet[: _STAMP.start] + stamp + packet[_STAMP.stop :]
        if picture not in self._kept:
            self._kept[picture] = {}
            if len(self._kept) > _KEPT_PICTURES:
                self._kept.popitem(last=False)
        self._kept[picture][kind_and_number & _NUMBER] = packet
        self._pass_on(packet)

    def _pass_on(self, packet: bytes) -> None:
        is_too_large = self._largest_bytes is not None and len(packet) + _HEADERS_BYTES > self._largest_bytes
        is_lost = is_too_large or self._random.random() < self._lost_share
        if self._host is not None and not is_lost:
            self._pictures.sendto(packet, self._host)

    def _carry_question(self, data: bytes, asker: tuple[str, int]) -> None:
        if len(data) < _CONTROL.size or data[0] != _KEY:
            return
        _, _, command, _, request = _CONTROL.unpack_from(data)
        if command == _RESEND:
            self._send_again(data[_CONTROL.size :])
            return
        of_clock = self._answer_of_clock(command, data[_CONTROL.size :])
        if of_clock is not None:
            self._control.sendto(_CONTROL.pack(0, 0, command + 1, len(of_clock), request) + of_clock, asker)
            return
        self._asked[request] = (asker, data[_CONTROL.size :] if command == _READ_REGISTER else b"")
        self._to_camera.sendto(self._redirected(data, asker) if command == _WRITE_REGISTER else data, self._camera)

    def _answer_of_clock(self, command: int, content: bytes) -> bytes | None:
        """Return the answer of the camera's clock; None for other requests."""
        clock = self._clock
        if clock is None or len(content) < 4 or not clock.has(int.from_bytes(content[:4], "big")):
            return None
        address = int.from_bytes(content[:4], "big")
        if command == _READ_REGISTER:
            return b"".join(
                clock.read(int.from_bytes(content[k : k + 4], "big")) for k in range(0, len(content) - 3, 4)
            )
        if command == _READ_MEMORY:
            return content[:4] + clock.read(address, int.from_bytes(content[6:8], "big"))
        if command in (_WRITE_REGISTER, _WRITE_MEMORY):
            clock.write(address, int.from_bytes(content[4:8], "big"))
            return (1 if command == _WRITE_REGISTER else 4).to_bytes(4, "big")
        return None

    def _redirected(self, data: bytes, asker: tuple[str, int]) -> bytes:
        """Redirect the camera's pictures here, and note their destination."""
        told = bytearray(data)
        for place in range(_CONTROL.size, len(data) - 7, 8):
            register = int.from_bytes(data[place : place + 4], "big")
            if register not in (_STREAM_PORT, _STREAM_ADDRESS):
                continue
            value = data[place + 4 : place + 8]
            self._sends_to[register] = value
            if register == _STREAM_PORT and any(value):
                self._host = (asker[0], int.from_bytes(value, "big"))
                told[place + 4 : place + 8] = self._pictures.getsockname()[1].to_bytes(4, "big")
            elif register == _STREAM_ADDRESS:
                told[place + 4 : place + 8] = socket.inet_aton(self._camera[0])
        return bytes(told)

    def _carry_answer(self, data: bytes, _camera: tuple[str, int]) -> None:
        _, _, command, _, request = _CONTROL.unpack_from(data)
        if request not in self._asked:
            return
        asker, registers = self._asked[request]
        told = bytearray(data)
        if command == _DISCOVERY_ACK:
            place = _CONTROL.size + _ADDRESS_IN_DISCOVERY
            told[place : place + 4] = socket.inet_aton(self._address)
        if command == _READ_REGISTER_ACK:
            for index in range(0, len(registers), 4):
                value = self._sends_to.get(int.from_bytes(registers[index : index + 4], "big"))
                if value is not None:
                    told[_CONTROL.size + index : _CONTROL.size + index + 4] = value
        self._control.sendto(bytes(told), asker)

    def _send_again(self, wanted: bytes) -> None:
        """Send stored packets of a picture again."""
        _channel, picture, first, last = struct.unpack(">HHII", wanted[:12])
        for number in range(first & _NUMBER, (last & _NUMBER) + 1):
            packet = self._kept.get(picture, {}).get(number) if self._resends else None
            if packet is not None:
                self._pass_on(packet)


@contextmanager
def lossy_network(
    *,
    camera: str,
    address: str = "127.0.0.2",
    lost_share: float = 0.0,
    resends: bool = True,
    largest_bytes: int | None = None,
    clock: DeviceClock | None = None,
    seed: int = 0,
) -> Iterator[None]:
    """Put a simulated network between a camera at one address and clients of another address.

    It loses a share of all packets of pictures, and those larger than `largest_bytes` with headers, like a switch
    without jumbo frames. It sends packets again on request if `resends`.
    """
    network = _LossyNetwork(
        camera=camera,
        address=address,
        lost_share=lost_share,
        resends=resends,
        largest_bytes=largest_bytes,
        clock=clock,
        seed=seed,
    )
    network.start()
    try:
        yield
    finally:
        network.close()


def _socket(address: str, port: int) -> socket.socket:
    end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _SOCKET_BYTES)
    try:
        end.bind((address, port))
    except OSError as error:
        end.close()
        raise NotConnectedError(f"no network can be simulated at {address}, port {port}: {error.strerror}") from error
    end.setblocking(False)
    return end


_ENDLESS_S = 1e9
_START_TEMPERATURE_TENTHS_C = 285
# The picture shows an automatic exposure that was left on.
_AUTOMATIC_FACTOR = 2.0
_FORGOTTEN_EXPOSURE_US = 1234


@contextmanager
def serve_gige_camera(
    source: Camera,
    *,
    address: str = "127.0.0.1",
    serial_number: str = "SIM1",
    faults: GigeFaults | None = None,
    clock: DeviceClock | None = None,
    wait: Callable[[float], None] = time.sleep,
) -> Iterator[AravisDevice]:
    """Serve a camera on an IP address of this machine until the context is left.

    Parameters
    ----------
    source : Camera
        Makes the pictures, for this server alone. It need not wait for its exposures.
    address : str
        Address of one of this machine's interfaces.
    serial_number : str
        Reported serial number.
    faults : GigeFaults or None
        What goes wrong.
    clock : DeviceClock or None
        Clock in its list of features; the simulated network answers for it.
    wait : callable
        Waits for an exposure [s] after the picture is made, so that the light is from its start and the picture leaves
        at its end.

    Raises
    ------
    NotConnectedError
        libaravis is not installed, or the address is not this machine's or in use.

    Notes
    -----
    Like real cameras it powers up with automatic exposure and gain and with a gamma; pictures then have twice the
    exposure and a nonlinear response. It does not resend packets (except behind `serve_behind_network`) and cannot bin.
    It does not answer during an exposure, so that longer ones than 2 s look like a hang. Exceptions of the source are
    raised when the context is left.
    """
    served = _ServedCamera(
        source, address=address, serial_number=serial_number, faults=faults or GigeFaults(), clock=clock, wait=wait
    )
    try:
        with served.power:
            served.power_up()
            yield served.device
    finally:
        served.device.power_down()
    if served.device.failures:
        raise served.device.failures[0]


@contextmanager
def serve_behind_network(
    source: Camera,
    *,
    address: str = "127.0.0.2",
    serial_number: str = "SIM1",
    faults: GigeFaults,
    wait: Callable[[float], None] = time.sleep,
) -> Iterator[str]:
    """Serve a camera of this machine behind a simulated network with faults; yield the address for clients.

    Parameters are those of `serve_gige_camera`; the camera itself is at 127.0.0.1, and the address is another one of
    127.0.0.0/8. Its clock is as `faults.clock` says. Raises as that.
    """
    clock = None if faults.clock is None else DeviceClock(faults.clock)
    hidden = replace(faults, lost_share=0.0)
    with serve_gige_camera(source, serial_number=serial_number, faults=hidden, clock=clock, wait=wait) as device:
        device.promise_resends(faults.resends)
        with lossy_network(
            camera=device.address, address=address, lost_share=faults.lost_share, resends=faults.resends, clock=clock
        ):
            yield address


class _ServedCamera:
    """Makes the pictures for the device, with the settings from its client."""

    def __init__(
        self,
        source: Camera,
        *,
        address: str,
        serial_number: str,
        faults: GigeFaults,
        clock: DeviceClock | None,
        wait: Callable[[float], None],
    ) -> None:
        self._source, self._wait = source, wait
        self._lost_share = faults.lost_share
        self._asked = (0.01, 0.0)
        self._settings = source.configure(exposure_s=self._asked[0], gain_db=self._asked[1])
        self.device = AravisDevice(
            address=address,
            serial_number=serial_number,
            edit_features=lambda xml: extended(xml) if clock is None else clock.features(extended(xml)),
            fill=self._fill,
        )
        self.power = FaultyPower(
            faults,
            power_down=self.device.power_down,
            power_up=self.power_up,
            forget=self._forget,
            cut=lambda: self.device.lose_packets(1.0),
        )

    def power_up(self) -> None:
        """Answer on the network, with the settings of a power-up."""
        self.device.power_up()
        self.device.lose_packets(self._lost_share)
        width, height = self._settings.width, self._settings.height
        for register, value in (
            (SENSOR_WIDTH, width),
            (SENSOR_HEIGHT, height),
            (WIDTH, width),
            (HEIGHT, height),
            (EXPOSURE_AUTO, EXPOSURE_AUTO_CONTINUOUS),
            (GAIN_AUTO, GAIN_AUTO_CONTINUOUS),
            (GAMMA, 1),
            (TEMPERATURE_TENTHS_C, _START_TEMPERATURE_TENTHS_C),
        ):
            self.device.write_register(register, value)

    def _fill(self, width: int, height: int, exposure_us: int, gain_db: int, pixel_format: int) -> bytes:
        """Return the bytes of a picture of the present world."""
        self.power.before_picture()
        asked = (self._factor() * exposure_us / 1e6, float(gain_db))
        if asked != self._asked:
            self._settings = self._source.configure(exposure_s=asked[0], gain_db=asked[1])
            self._asked = asked
        counts = self._source.take_frame(timeout_s=_ENDLESS_S).counts
        self._wait(exposure_us / 1e6)
        self.power.after_picture()
        region = self._bent(self._region(counts, width, height))
        return bytes_of(region, bit_depth=self._settings.bit_depth, pixel_format=pixel_format)

    def _bent(self, counts: NDArray[np.uint16]) -> NDArray[np.uint16]:
        """Return counts with gamma, if it was left on."""
        if not self.device.read_register(GAMMA):
            return counts
        full_dn = 2**self._settings.bit_depth - 1
        bent: NDArray[np.uint16] = np.rint(full_dn * np.sqrt(counts / full_dn)).astype(np.uint16)
        return bent

    def _forget(self) -> None:
        self.device.write_register(EXPOSURE_US, _FORGOTTEN_EXPOSURE_US)

    def _factor(self) -> float:
        is_manual = self.device.read_register(EXPOSURE_AUTO) == EXPOSURE_AUTO_OFF
        return 1.0 if is_manual else _AUTOMATIC_FACTOR

    def _region(self, counts: NDArray[np.uint16], width: int, height: int) -> NDArray[np.uint16]:
        left, top = (self.device.read_register(register) for register in (OFFSET_X, OFFSET_Y))
        region = counts[top : top + height, left : left + width]
        return region[:, ::-1] if self.device.read_register(REVERSE_X) else region
