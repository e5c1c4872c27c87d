"""The clock of a GenICam camera, held against the host's: what a picture's own time stamp says becomes a time.

The camera is told to latch its clock, between two readings of the host's: the offset is known to half of what lies
between these. Two such looks give the rate. A camera whose clock follows a PTP master is believed as far as it says
that it is off from that master, once its clock shows UTC or TAI at all.
"""

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from drivers.cameras.gige_features import GigeFeatures
from drivers.errors import LimitError, ProtocolError

# What latches the clock, and where the value is found, by several editions of the standard.
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
_TAI_AHEAD_S = 37  # of UTC since 2017; masters give TAI, some of them UTC
_HALF_SECOND_NS = 500_000_000

_NS_HZ = 1_000_000_000
# From one look to the next: so long, or until what is not known of the rate has come to more than the look's own error.
_EACH_NS, _GROWN_NS = 10 * 10**9, 50_000
_REMEMBERED_NS = 600 * 10**9  # longer than that a clock's rate need not stay as it is
_TRIES = 3  # of a look; the shortest one counts
_QUARTZ = 1e-4  # by which a rate may be off, until it was measured
_WANDER = 1e-6  # of a rate that was measured
_UNIT_BASE_NS = 20_000_000  # from which on two looks tell what the clock counts in
_UNIT_TOLERANCE = 0.01


@dataclass(frozen=True, kw_only=True)
class Moment:
    """A time on the host's monotonic clock, and by how much it may be off at most [ns]."""

    monotonic_ns: int
    error_ns: int


@dataclass(frozen=True, kw_only=True)
class PtpState:
    """State of a camera's clock that follows a master.

    Attributes
    ----------
    offset_ns : int
        How far it is from its master, as it says [ns].
    ahead_s : int
        How many whole seconds its clock is ahead of UTC: those of TAI, or 0.
    host_behind_ns : int
        How far the host's UTC is behind the master's [ns].
    """

    offset_ns: int
    ahead_s: int
    host_behind_ns: int


@dataclass(frozen=True, kw_only=True)
class _Look:
    ticks: int
    monotonic_ns: int
    error_ns: int


class CameraClock:
    """The clock of one open camera.

    Parameters
    ----------
    features : GigeFeatures
        Of the camera.
    ptp : bool or None
        Whether it is to follow a PTP master; None leaves that as it is.
    now_ns, utc_ns : callable
        The host's clocks.

    Raises
    ------
    LimitError
        It is to follow a master, and cannot.
    """

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
        self._ptp_said = "off"
        self._switch = features.first_of(*_PTP_SWITCHES)
        if ptp is not None and self._switch is not None:
            features.set_truth(self._switch, ptp)
        elif ptp:
            raise LimitError(f"ptp=1: it cannot follow a PTP master ({', '.join(_PTP_SWITCHES)})")
        self.look()

    def look(self) -> None:
        """Hold the camera's clock against the host's, where that was not done lately.

        Raises
        ------
        NotConnectedError, DeviceTimeoutError
            The camera does not answer.
        """
        if self._latch is None or not self._is_due():
            return
        try:
            self._remember(min((self._look_once(*self._latch) for _ in range(_TRIES)), key=lambda one: one.error_ns))
            self.ptp = self._ptp_state()
        except (LimitError, ProtocolError):
            self._latch = None  # it has these features and does not grant them

    def moment_of(self, stamp_ns: int) -> Moment | None:
        """Return when the camera's clock stood at a picture's time stamp; None where that is not known."""
        if self._hz is None:
            return None
        last = self._looks[-1]
        rate, rate_error = self._rate()
        since_ns = stamp_ns - self._ns(last.ticks)
        host_ns = round(since_ns / (1.0 + rate))
        tick_ns = -(-_NS_HZ // self._hz)
        error_ns = last.error_ns + tick_ns + round(abs(since_ns) * rate_error)
        return Moment(monotonic_ns=last.monotonic_ns + host_ns, error_ns=error_ns)

    def told(self) -> str | None:
        """Return what is known of the clock, for people; None of a camera that tells nothing of it."""
        if self._latch is None or self._hz is None:
            return None
        rate, rate_error = self._rate()
        ptp = f"; PTP {self._ptp_said}" if self._switch is not None else ""
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
        """Take in a look; forget all earlier ones where one of the clocks was set since."""
        if self._hz is not None:
            expected = self.moment_of(self._ns(look.ticks))
            if (
                expected is not None
                and abs(expected.monotonic_ns - look.monotonic_ns) > expected.error_ns + look.error_ns
            ):
                self._looks.clear()
        self._looks.append(look)
        while look.monotonic_ns - self._looks[0].monotonic_ns > _REMEMBERED_NS:
            self._looks.popleft()
        if self._hz is None:
            self._hz = self._unit()

    def _unit(self) -> int | None:
        """Return what the clock counts in, by how far it went: the standard says nanoseconds, not every camera does."""
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
        """Return by how much the camera's clock is faster than the host's, as a share, and the error of that."""
        first, last = self._looks[0], self._looks[-1]
        base_ns = last.monotonic_ns - first.monotonic_ns
        if base_ns <= 0:
            return 0.0, _QUARTZ
        error = (first.error_ns + last.error_ns) / base_ns + _WANDER
        if error >= _QUARTZ:
            return 0.0, _QUARTZ
        return (self._ns(last.ticks) - self._ns(first.ticks)) / base_ns - 1.0, error

    def _ptp_state(self) -> PtpState | None:
        """Return how the clock follows a PTP master; None where it does not, or what it follows is not time of day."""
        features = self._features
        if self._switch is None or not features.truth(self._switch):
            self._ptp_said = "off"
            return None
        latch = features.first_of(*_PTP_LATCHES)
        if latch is not None:
            features.execute(latch)
        state, offset = features.first_of(*_PTP_STATES), features.first_of(*_PTP_OFFSETS)
        self._ptp_said = "tells no state" if state is None else features.text(state)
        if state is None or offset is None or self._ptp_said != _FOLLOWS:
            return None
        offset_ns, last = abs(features.whole(offset)), self._looks[-1]
        ahead_ns = self._ns(last.ticks) - (last.monotonic_ns + self._utc_ns() - self._now_ns())
        ahead_s = min((0, _TAI_AHEAD_S), key=lambda whole_s: abs(ahead_ns - whole_s * _NS_HZ))
        behind_ns = ahead_ns - ahead_s * _NS_HZ
        if abs(behind_ns) >= _HALF_SECOND_NS:
            self._ptp_said += f", of a master that is {ahead_ns / 1e9:.3g} s ahead of this machine: not used"
            return None
        self._ptp_said += f", {offset_ns} ns from its master; this machine is {behind_ns / 1e6:.2f} ms behind it"
        return PtpState(offset_ns=offset_ns, ahead_s=ahead_s, host_behind_ns=behind_ns)
