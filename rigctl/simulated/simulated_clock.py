"""The time of a simulated rig: it passes by what the session does, and by waiting, which takes no time."""

import threading

from rigctl.numbers.utc_time import NS_PER_S


class SimulatedClock:
    """A clock that is moved on, never waited for.

    Parameters
    ----------
    start_ns : int
        What it says first [ns since 1970 UTC].
    """

    def __init__(self, start_ns: int) -> None:
        self._now_ns = start_ns
        self._lock = threading.Lock()

    def utc_ns(self) -> int:
        """Return the time since 1970 UTC [ns]."""
        with self._lock:
            return self._now_ns

    def monotonic_ns(self) -> int:
        """Return the same: nobody sets this clock [ns]."""
        return self.utc_ns()

    def sleep(self, duration_s: float) -> None:
        """Move the time on by so much [s]; return at once."""
        with self._lock:
            self._now_ns += max(0, round(duration_s * NS_PER_S))

    def reach(self, time_ns: int) -> None:
        """Move the time on to this point [ns], unless it has gone by."""
        with self._lock:
            self._now_ns = max(self._now_ns, time_ns)
