"""Waits of a session: until a round is due, while somebody or an interlock holds it, or for good."""

from collections.abc import Callable

from rigctl.console.terminal import warn
from rigctl.numbers.utc_time import NS_PER_S, utc_text
from rigctl.runs.run_writer import RunWriter
from rigctl.session.control import Control
from rigctl.session.planning.session_steps import Step
from rigctl.session.session_clock import SessionClock, SteadyUtc
from rigctl.session.session_context import SessionContext

_POLL_S = 0.5
Note = Callable[..., None]


class StopAskedError(Exception):
    """Somebody asked the session to stop; it does so between two frames."""


class Pause:
    """The places at which a session may stand still.

    Parameters
    ----------
    control : Control
        What somebody asks for.
    clock : SessionClock
        For waiting.
    note : callable
        Notes an event: its name, and facts by keyword.
    """

    def __init__(self, control: Control, clock: SessionClock, note: Note) -> None:
        self._control, self._clock, self._note = control, clock, note
        self._is_loss_noted = False

    def answer(self) -> None:
        """Hold or stop if that was asked for.

        Raises
        ------
        StopAskedError
            A stop was asked for.
        """
        if self._polled() == "hold":
            self.hold("somebody asked for it", cleared=lambda: False)

    def hold(self, reason: str, *, cleared: Callable[[], bool]) -> None:
        """Stand still until the reason is gone, or somebody says to go on."""
        self._note("hold", reason=reason)
        warn(f"holding: {reason}")
        rest = self._clock.rest or self._clock.sleep
        while not cleared() and self._polled() != "go on":
            rest(_POLL_S)
        self._note("go on")

    def wait(self, remaining_s: Callable[[], float]) -> None:
        """Return once no time remains [s]; requests are answered meanwhile."""
        while (left_s := remaining_s()) > 0.0:
            self._clock.sleep(min(left_s, self._clock.poll_s))
            self.answer()

    def _polled(self) -> str | None:
        if self._control.is_terminal_lost and not self._is_loss_noted:
            self._is_loss_noted = True
            self._note("terminal lost", action="the session goes on without it")
        request = self._control.poll()
        if request == "stop":
            raise StopAskedError
        return request


class Timing:
    """Remembers which round is under way.

    Parameters
    ----------
    context : SessionContext
        How late a round may begin, and when the session ends.
    utc : SteadyUtc
        What time it is.
    pause : Pause
        For waiting.
    writer : RunWriter
        Where events go.
    """

    def __init__(self, context: SessionContext, utc: SteadyUtc, pause: Pause, writer: RunWriter) -> None:
        self._context, self._utc, self._pause, self._writer = context, utc, pause, writer
        self._round: int | None = None
        self._missed: set[int] = set()
        self._is_over = False

    @property
    def missed(self) -> int:
        """Number of rounds that were left out."""
        return len(self._missed)

    def is_time_for(self, step: Step) -> bool:
        """Return True once it is time for a step, or False where that has gone by.

        Raises
        ------
        StopAskedError
            Somebody asked to stop meanwhile.
        """
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
