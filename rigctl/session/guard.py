"""Acts on interlock violations as the session file says: take again, hold, stop, or note."""

from collections.abc import Callable, Iterable

from rigctl.files.interlock_section import Action, InterlockSection
from rigctl.runs.run_writer import RunWriter
from rigctl.session.interlocks import InterlockViolation, failure_of
from rigctl.session.planning.session_steps import Step
from rigctl.session.timing import Pause

# What a scene is like, frame after frame: an event once a round is enough, beside the remark in each frame.
_LASTING = ("low_signal", "saturated")


class Guard:
    """Acts on violations. Each is an event of the run; those that only note what a scene is like are one once a round.

    Parameters
    ----------
    locks : InterlockSection
        What is to be done.
    pause : Pause
        For holding.
    writer : RunWriter
        Where events go.
    """

    def __init__(self, locks: InterlockSection, pause: Pause, writer: RunWriter) -> None:
        self.locks = locks
        self._pause, self._writer = pause, writer
        self._told: set[tuple[str, int]] = set()

    def watched(self, violations: Iterable[InterlockViolation]) -> tuple[InterlockViolation, ...]:
        """Return those violations that are not switched off."""
        return tuple(violation for violation in violations if self._action(violation) != "off")

    def note(self, violation: InterlockViolation, **facts: int) -> None:
        """Write down a violation and what is done about it."""
        action = self._action(violation)
        self._writer.event("interlock", interlock=violation.name, action=action, message=violation.message, **facts)

    def react(self, violation: InterlockViolation, *, cleared: Callable[[], bool]) -> None:
        """Note a violation, and hold until it is cleared, or stop, where that is asked for.

        Raises
        ------
        DeviceError, DataError
            It stops the session.
        StopAskedError
            Somebody asked to stop while it held.
        """
        self.note(violation)
        action = self._action(violation)
        if action == "stop":
            raise failure_of(violation)
        if action == "hold":
            self._pause.hold(violation.message, cleared=cleared)

    def wants_again(self, violation: InterlockViolation, step: Step, *, tries_left: int) -> bool:
        """Note a violation of a frame, and return whether the frame is to be taken again.

        Raises
        ------
        DeviceError, DataError
            It stops the session, at once or since taking again has not helped.
        StopAskedError
            Somebody asked to stop while it held.
        """
        action = self._action(violation)
        if action != "note" or violation.name not in _LASTING or (violation.name, step.round) not in self._told:
            self.note(violation, sequence=step.sequence)
        self._told.add((violation.name, step.round))
        if action == "stop" or (action == "retry" and tries_left <= 0):
            raise failure_of(violation)
        if action == "hold":
            self._pause.hold(violation.message, cleared=lambda: False)
        return action in ("retry", "hold")

    def _action(self, violation: InterlockViolation) -> Action:
        action: Action = getattr(self.locks, violation.name)
        return action
