"""The clocks that a session lives by; tests hand in others."""

import time
from collections.abc import Callable
from dataclasses import dataclass

from rigctl.devices import host_checkup
from rigctl.utc_time import NS_PER_S


def _clock_problem() -> str | None:
    found = host_checkup.clock()
    return None if found.advice is None else found.found


@dataclass(frozen=True, kw_only=True)
class SessionClock:
    """The host's clocks, and a pause.

    Attributes
    ----------
    utc_ns, monotonic_ns : callable
        Time since 1970 (UTC), which somebody may set; time that only goes on [ns].
    sleep : callable
        Pauses for so many seconds.
    problem : callable
        What is wrong with the first of them, such as "not synchronised"; None if nothing is.
    """

    utc_ns: Callable[[], int] = time.time_ns
    monotonic_ns: Callable[[], int] = time.monotonic_ns
    sleep: Callable[[float], None] = time.sleep
    problem: Callable[[], str | None] = _clock_problem


class SteadyUtc:
    """UTC as it was when the session began, carried on by the monotonic clock.

    A host's clock that is set in the middle of a session would else stall its schedule or rush through it.

    Parameters
    ----------
    clock : SessionClock
        The host's clocks.
    """

    def __init__(self, clock: SessionClock) -> None:
        self._clock = clock
        self._offset_ns = clock.utc_ns() - clock.monotonic_ns()
        self._seen_offset_ns = self._offset_ns

    def now_ns(self) -> int:
        """Return the time since 1970 by the clock as it was at the beginning [ns]."""
        return self.at_ns(self._clock.monotonic_ns())

    def at_ns(self, monotonic_ns: int) -> int:
        """Return what `now_ns` was or will be at a time of the monotonic clock [ns]."""
        return monotonic_ns + self._offset_ns

    def jump_s(self) -> float:
        """Return how far the host's clock was set since the last call [s]; slow drift counts too."""
        offset_ns = self._clock.utc_ns() - self._clock.monotonic_ns()
        jump_ns, self._seen_offset_ns = offset_ns - self._seen_offset_ns, offset_ns
        return jump_ns / NS_PER_S
