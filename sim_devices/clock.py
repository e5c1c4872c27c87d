"""Time for simulated devices: proportional to the wall clock, or advanced by calls."""

import math
import threading
import time
from collections.abc import Callable
from typing import Protocol


class Clock(Protocol):
    """Common clock of simulated devices."""

    def now_s(self) -> float:
        """Return the simulated time [s], which never decreases."""

    def sleep(self, duration_s: float) -> None:
        """Return once this much simulated time [s] has passed."""

    def wait_until(self, time_s: float) -> None:
        """Return once the simulated time [s] has been reached, at once if it is past."""


class SimClock:
    """Simulated time that follows the wall clock times a factor, from 0 at its making.

    Parameters
    ----------
    speed : float
        Simulated seconds in a second of the wall clock, above 0.
    wall_s, wall_sleep : callables
        The wall clock [s] and a pause [s] on it.
    """

    def __init__(
        self,
        *,
        speed: float = 1.0,
        wall_s: Callable[[], float] = time.monotonic,
        wall_sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        if not (math.isfinite(speed) and speed > 0.0):
            raise ValueError(f"speed = {speed}: must be a number above 0")
        self._speed = speed
        self._wall_s = wall_s
        self._wall_sleep = wall_sleep
        self._origin_s = wall_s()

    def now_s(self) -> float:
        """Return the simulated time [s]."""
        return (self._wall_s() - self._origin_s) * self._speed

    def wall_s_until(self, time_s: float) -> float:
        """Return the time on the wall clock until a simulated time [s]; 0 if it is past."""
        return max(0.0, time_s - self.now_s()) / self._speed

    def sleep(self, duration_s: float) -> None:
        """Return once this much simulated time [s] has passed."""
        self.wait_until(self.now_s() + duration_s)

    def wait_until(self, time_s: float) -> None:
        """Return once the simulated time [s] has been reached, at once if it is past."""
        while (remaining_s := self.wall_s_until(time_s)) > 0.0:
            self._wall_sleep(remaining_s)


class ManualClock:
    """Simulated time that advances only by `advance` and by sleeping."""

    def __init__(self) -> None:
        self._now_s = 0.0
        self._lock = threading.Lock()

    def now_s(self) -> float:
        """Return the simulated time [s]."""
        with self._lock:
            return self._now_s

    def advance(self, duration_s: float) -> None:
        """Advance the time by at least 0 [s]."""
        if not duration_s >= 0.0:
            raise ValueError(f"duration_s = {duration_s} s: time cannot go back")
        with self._lock:
            self._now_s += duration_s

    def sleep(self, duration_s: float) -> None:
        """Move the time on by this much [s]."""
        self.advance(max(0.0, duration_s))

    def wait_until(self, time_s: float) -> None:
        """Advance the time to this point [s], unless it is past."""
        with self._lock:
            self._now_s = max(self._now_s, time_s)
