"""The clock of a simulated GigE camera: runs as it likes, is latched by a register, and may follow a PTP master.

From a reading of the GigE Vision standard's registers and of the names that GenICam has for them. libaravis's own
device has neither: whoever stands before it on the network answers for its clock (`lossy_network`).
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

# Registers of the standard: how fast the clock counts, what latches it, and what was latched, each value in two halves.
FREQUENCY, CONTROL, LATCHED = 0x093C, 0x0944, 0x0948
_LATCH = 2
# Memory that the library's device does not use.
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
    """What the clock of a camera is like.

    Attributes
    ----------
    drift_ppm : float
        By how much it is faster than true.
    tick_hz : int
        What it counts in.
    start_s : float
        What it said when it was made: cameras count from their power-up.
    has_ptp : bool
        Whether it can follow a master, whose time is TAI by the host's own clock.
    master_ahead_s, ptp_offset_ns : float, int
        How far the master is ahead of TAI, and the camera of its master.
    """

    drift_ppm: float = 0.0
    tick_hz: int = 1_000_000_000
    start_s: float = 100.0
    has_ptp: bool = False
    master_ahead_s: float = 0.0
    ptp_offset_ns: int = 0


class DeviceClock:
    """A clock with the registers that tell of it.

    Parameters
    ----------
    truth : ClockTruth
        What it is like.
    now_ns, utc_ns : callable
        True time, which it is off from.

    Attributes
    ----------
    stamped_utc_ns : int
        When the picture that was stamped last was truly taken, by the host's clock.
    """

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
        """Return what the clock said at a time by the host's clock; None: what it says."""
        utc_ns, now_ns = self._utc_ns(), self._now_ns()
        ago_ns = 0 if true_utc_ns is None else utc_ns - true_utc_ns
        if self._is_slave():
            ahead_ns = round((_TAI_AHEAD_S + self.truth.master_ahead_s) * 1e9) + self.truth.ptp_offset_ns
            return (utc_ns - ago_ns + ahead_ns) * self.truth.tick_hz // 10**9
        since_s = (now_ns - ago_ns - self._made_ns) / 1e9
        return round((self.truth.start_s + since_s * (1.0 + self.truth.drift_ppm * 1e-6)) * self.truth.tick_hz)

    def stamp(self, true_utc_ns: int) -> int:
        """Return what the clock said when a picture was taken."""
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
