"""Time stamps of a video device: by which clock they are, and when the exposure of a picture began."""

from collections.abc import Callable
from dataclasses import dataclass

from drivers.cameras import v4l2_structs as v4l2
from drivers.errors import ProtocolError

_STAMP_STEP_NS = 1000
# A stamp from here on is no time since the machine was started: the time of day, in 2001.
_TIME_OF_DAY_NS = 10**18
_CLOCK_STEP_NS = 2_000_000


@dataclass(frozen=True, kw_only=True)
class Asked:
    """Moment at which a picture was asked for.

    Attributes
    ----------
    monotonic_ns : int
        By the host's monotonic clock.
    to_utc_ns : int
        How far the time of day was ahead of it.
    error_ns : int
        How far from each other the two may have been read.
    """

    monotonic_ns: int
    to_utc_ns: int
    error_ns: int


class V4l2Stamps:
    """Memory of the stamps of one device.

    Parameters
    ----------
    name : str
        What messages call the device.
    now_ns, utc_ns : callable
        The host's clocks.
    """

    def __init__(self, name: str, *, now_ns: Callable[[], int], utc_ns: Callable[[], int]) -> None:
        self._name, self._now_ns, self._utc_ns = name, now_ns, utc_ns
        self._last: tuple[int, int] | None = None
        self._period_ns: int | None = None

    def asked_now(self) -> Asked:
        """Return the time, for a picture that is asked for now."""
        before_ns = self._now_ns()
        to_utc_ns = self._utc_ns() - before_ns
        return Asked(monotonic_ns=before_ns, to_utc_ns=to_utc_ns, error_ns=self._now_ns() - before_ns)

    def start_of(self, buffer: v4l2.Buffer, asked: Asked, *, exposure_ns: int) -> tuple[int, int | None]:
        """Return when a picture's exposure began, and by how much that may be off; None for not known yet [ns].

        Raises
        ------
        ProtocolError
            Its stamp is of neither clock.

        Notes
        -----
        A stamp of the picture's end leaves open how long it took to come: not longer than from one picture to the next,
        which is measured.
        """
        stamp_ns = self._monotonic_ns(buffer, asked)
        self._measure_period(buffer.sequence, stamp_ns)
        if buffer.flags & v4l2.SOURCE_MASK == v4l2.AT_START_OF_EXPOSURE:
            return stamp_ns, _STAMP_STEP_NS + asked.error_ns
        error_ns = None if self._period_ns is None else self._period_ns + asked.error_ns
        return stamp_ns - exposure_ns, error_ns

    def _monotonic_ns(self, buffer: v4l2.Buffer, asked: Asked) -> int:
        """Return a picture's time stamp on the monotonic clock.

        Notes
        -----
        Of a stamp of the time of day the flags say "unknown", or "monotonic" where the driver was told to use that
        clock later (uvcvideo's parameter ``clock``): its size tells. Where the time of day was set meanwhile, such a
        stamp counts as of long ago.
        """
        stamp_ns = int(buffer.timestamp.seconds) * 10**9 + int(buffer.timestamp.microseconds) * 1000
        clock = buffer.flags & v4l2.CLOCK_MASK
        if stamp_ns >= _TIME_OF_DAY_NS and clock != v4l2.COPIED:
            was_set = abs(self._utc_ns() - self._now_ns() - asked.to_utc_ns) > _CLOCK_STEP_NS
            return 0 if was_set else stamp_ns - asked.to_utc_ns
        if clock != v4l2.MONOTONIC:
            raise ProtocolError(
                f"{self._name}: its time stamps are neither of the monotonic clock nor of the time of day, so age "
                "cannot be known"
            )
        return stamp_ns

    def _measure_period(self, sequence: int, stamp_ns: int) -> None:
        """Take in when a picture came, for the time from one to the next."""
        last, self._last = self._last, (sequence, stamp_ns)
        if last is not None and sequence > last[0] and stamp_ns > last[1]:
            self._period_ns = (stamp_ns - last[1]) // (sequence - last[0])
