"""Clocks, waits and context of a session. Tests pass other clocks."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from rigctl.base.numbers import NS_PER_S, unix_ns, utc_text
from rigctl.console import warn
from rigctl.files.rig_file import RigFile
from rigctl.files.session_file import PICTURE, SessionFile
from rigctl.rig import checkup as host_checkup
from rigctl.rig.simulated_parts import SimulatedClock
from rigctl.runs.records import ASKED_EVENT, SessionNoise
from rigctl.runs.writer import RunWriter
from rigctl.session.control import Control
from rigctl.session.numbers import LiveNumbers, RegionMeans
from rigctl.session.plan import Step, SunTrack

# In simulated time waiting costs nothing, but looking for requests does.
_SIMULATED_POLL_S = 60.0
_POLL_S = 0.5
_S_PER_MIN = 60.0
_LATE_S = 300.0
Note = Callable[..., None]


def _clock_problem() -> str | None:
    found = host_checkup.clock()
    return None if found.advice is None else found.found


@dataclass(frozen=True, kw_only=True)
class SessionClock:
    """The host's clocks, and a pause."""

    #: Time since 1970 (UTC), which may be set; and time that never jumps [ns].
    utc_ns: Callable[[], int] = time.time_ns
    monotonic_ns: Callable[[], int] = time.monotonic_ns
    sleep: Callable[[float], None] = time.sleep  #: Pauses for a number of seconds.
    #: Returns a problem of the UTC clock, such as "not synchronised", or None.
    problem: Callable[[], str | None] = _clock_problem
    #: Returns the largest error of the UTC clock by the system [s]; None if nothing synchronises it.
    utc_error_s: Callable[[], float | None] = host_checkup.utc_error_s
    #: Pauses while waiting for a person, if `sleep` only moves a simulated clock.
    rest: Callable[[float], None] | None = None
    poll_s: float = 0.5  #: How often a wait looks for requests [s].
    simulated: SimulatedClock | None = None  #: The clock of a simulated rig that has its own.


def clock_of(rig_file: RigFile, *, after_ns: int | None = None) -> SessionClock:
    """Return the clocks of a session: the host's, or those of the rig's simulation."""
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
    """UTC at the beginning of the session, continued by the monotonic clock.

    Setting the host's clock during a session would otherwise disturb its schedule.
    """

    def __init__(self, clock: SessionClock) -> None:
        self._clock = clock
        self._offset_ns = clock.utc_ns() - clock.monotonic_ns()
        self._seen_offset_ns = self._offset_ns

    def now_ns(self) -> int:
        """Return the steady UTC [ns since 1970]."""
        return self.at_ns(self._clock.monotonic_ns())

    def at_ns(self, monotonic_ns: int) -> int:
        """Return the steady UTC at a time of the monotonic clock [ns]."""
        return monotonic_ns + self._offset_ns

    def jump_s(self) -> float:
        """Return the jump of the host's clock since the last call [s], including slow drift."""
        offset_ns = self._clock.utc_ns() - self._clock.monotonic_ns()
        jump_ns, self._seen_offset_ns = offset_ns - self._seen_offset_ns, offset_ns
        return jump_ns / NS_PER_S


class SessionContext:
    """Objects that the parts of a session share."""

    def __init__(
        self,
        session: SessionFile,
        rig_file: RigFile,
        *,
        clock: SessionClock,
        control: Control,
        until_ns: int | None,
        noise: SessionNoise | None,
        asks_by_hold: bool,
    ) -> None:
        self.clock, self.control = clock, control  #: The host's clocks, and requests.
        self.utc = SteadyUtc(clock)  #: UTC at the beginning of the session, continued.
        self.interlocks, self.metering = session.interlocks, session.metering
        #: A round that would begin later than this after its due time is left out [s].
        self.late_s = _LATE_S if session.schedule is None else session.schedule.late_min * _S_PER_MIN
        self.until_ns = until_ns  #: No frame begins after this [ns since 1970 UTC].
        self.sun = None if rig_file.site is None else SunTrack(rig_file.site)
        self.noise = noise  #: From a calibration.
        self.regions = RegionMeans(session.regions)
        self.live = LiveNumbers(
            noise=noise,
            extinction_ratio=rig_file.polarizer.extinction_ratio,
            reference=session.reference_region or PICTURE,
        )
        #: Exposures metered earlier in this session, by round [s].
        self.metered_s: Mapping[int, float] = {}
        #: True: where a person is needed, the session holds until it is continued. False: it asks at the terminal.
        self.asks_by_hold = asks_by_hold


class StopAskedError(Exception):
    """A stop was requested; the session stops between two frames."""


class Pause:
    """Holds, waits and requests of a session."""

    def __init__(self, control: Control, clock: SessionClock, note: Note) -> None:
        self._control, self._clock, self._note = control, clock, note
        self._is_loss_noted = False

    def answer(self) -> None:
        """Hold or stop if requested; each request is answered by an event."""
        if self._polled() == "hold":
            self.hold("requested", cleared=lambda: False)

    def hold(self, reason: str, *, cleared: Callable[[], bool]) -> None:
        """Hold until `cleared` returns True, or the session is continued."""
        self._note("hold", reason=reason)
        warn(f"holding: {reason}")
        rest = self._clock.rest or self._clock.sleep
        while not cleared() and self._polled() != "continue":
            rest(_POLL_S)
        self._note("continue")

    def wait(self, remaining_s: Callable[[], float]) -> None:
        """Return once no time remains [s]; answer requests meanwhile."""
        while (left_s := remaining_s()) > 0.0:
            self._clock.sleep(min(left_s, self._clock.poll_s))
            self.answer()

    def _polled(self) -> str | None:
        if self._control.is_terminal_lost and not self._is_loss_noted:
            self._is_loss_noted = True
            self._note("terminal lost", action="the session continues without it")
        request = self._control.poll()
        if request is not None:
            self._note(ASKED_EVENT, request=request)
        if request == "stop":
            raise StopAskedError
        return request

    def answer_rest(self, answer: str) -> None:
        """Note requests that came after a stop, or after the last frame."""
        while (request := self._control.poll()) is not None:
            self._note(ASKED_EVENT, request=request, answer=answer)


class Timing:
    """Waits for the rounds of a schedule, and leaves out those that are missed."""

    def __init__(self, context: SessionContext, pause: Pause, writer: RunWriter) -> None:
        self._context, self._utc, self._pause, self._writer = context, context.utc, pause, writer
        self._round: int | None = None
        self._missed: set[int] = set()
        self._is_over = False

    @property
    def missed(self) -> int:
        """Number of rounds that were left out."""
        return len(self._missed)

    def is_time_for(self, step: Step) -> bool:
        """Wait for the time of a step and return True; return False if its round is missed or the session is over."""
        if self._after_end() or step.round in self._missed:
            return False
        if step.due_ns is None or step.round == self._round:
            return True
        return self._begin_round(step.round, step.due_ns)

    def _begin_round(self, number: int, due_ns: int) -> bool:
        late_s = (self._utc.now_ns() - due_ns) / NS_PER_S
        if late_s > self._context.late_s:
            self._missed.add(number)
            self._writer.event("round missed", round=number, due_utc=utc_text(due_ns), late_s=round(late_s, 1))
            return False
        if late_s < 0.0:
            self._writer.event("waiting", round=number, due_utc=utc_text(due_ns))
        self._pause.wait(lambda: (due_ns - self._utc.now_ns()) / NS_PER_S)
        self._writer.event("round", round=number, due_utc=utc_text(due_ns))
        self._round = number
        return True

    def _after_end(self) -> bool:
        until_ns = self._context.until_ns
        if until_ns is None or self._utc.now_ns() < until_ns:
            return False
        if not self._is_over:
            self._is_over = True
            self._writer.event("time is up", until_utc=utc_text(until_ns))
        return True
