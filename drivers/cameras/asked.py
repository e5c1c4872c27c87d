"""Moment at which a picture is asked for, by both clocks of the host: a picture counts only if it began after it."""

import time
from collections.abc import Callable
from dataclasses import dataclass

_CLOCK_STEP_NS = 2_000_000


@dataclass(frozen=True, kw_only=True)
class Asked:
    """A moment by the host's monotonic clock and by its time of day."""

    monotonic_ns: int
    utc_ns: int
    error_ns: int = 0  #: How far from each other the two may have been read.

    def was_clock_set(self, now: "Asked") -> bool:
        """Return whether the time of day has been set since then."""
        return abs((now.utc_ns - self.utc_ns) - (now.monotonic_ns - self.monotonic_ns)) > _CLOCK_STEP_NS


def asked_now(*, now_ns: Callable[[], int] = time.monotonic_ns, utc_ns: Callable[[], int] = time.time_ns) -> Asked:
    """Return this moment."""
    before_ns, utc, after_ns = now_ns(), utc_ns(), now_ns()
    # The earlier one: no exposure that was asked for then is taken for an older one.
    return Asked(utc_ns=utc, monotonic_ns=before_ns, error_ns=after_ns - before_ns)
