"""Is it time for a step? Rounds wait until they are due, and are left out where that has gone by."""

from rigctl.runs.run_writer import RunWriter
from rigctl.session.pause import Pause
from rigctl.session.planning.session_steps import Step
from rigctl.session.session_clock import SteadyUtc
from rigctl.session.session_context import SessionContext
from rigctl.utc_time import NS_PER_S, utc_text


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
        """How many rounds were left out."""
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
