"""The clocks that a session lives by; tests hand in others."""

import time
from collections.abc import Callable
from dataclasses import dataclass

from rigctl.devices import host_checkup
from rigctl.files.rig_file import RigFile
from rigctl.numbers.utc_time import NS_PER_S, unix_ns
from rigctl.simulated.simulated_clock import SimulatedClock

# Waiting costs nothing in simulated time, looking for requests does.
_SIMULATED_POLL_S = 60.0


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
    utc_error_s : callable
        How far the first of them may be off, as the system says [s]; None where nothing synchronises it.
    rest : callable or None
        Pauses for so many seconds while somebody is waited for, where `sleep` is no true pause.
    poll_s : float
        How often a wait looks for requests [s].
    simulated : SimulatedClock or None
        What makes the time of a simulated rig with a clock of its own.
    """

    utc_ns: Callable[[], int] = time.time_ns
    monotonic_ns: Callable[[], int] = time.monotonic_ns
    sleep: Callable[[float], None] = time.sleep
    problem: Callable[[], str | None] = _clock_problem
    utc_error_s: Callable[[], float | None] = host_checkup.utc_error_s
    rest: Callable[[float], None] | None = None
    poll_s: float = 0.5
    simulated: SimulatedClock | None = None


def clock_of(rig_file: RigFile, *, after_ns: int | None = None) -> SessionClock:
    """Return the clocks that a session on a rig lives by: the host's, or those of its simulation.

    Parameters
    ----------
    rig_file : RigFile
        The rig.
    after_ns : int or None
        A simulated time goes on from there, where a part of the session was taken [ns since 1970 UTC].
    """
    section = rig_file.simulation
    if section is None or section.clock is None:
        return SessionClock()
    start_ns = unix_ns(section.clock)
    clock = SimulatedClock(start_ns if after_ns is None else max(start_ns, after_ns))
    return SessionClock(
        utc_ns=clock.utc_ns,
        monotonic_ns=clock.monotonic_ns,
        sleep=clock.sleep,
        problem=lambda: None,
        rest=time.sleep,
        poll_s=_SIMULATED_POLL_S,
        simulated=clock,
    )


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
