"""Does about an interlock what the session file says: take again, hold, stop, or note."""

from collections.abc import Callable, Iterable

from rigctl.files.interlock_section import Action, InterlockSection
from rigctl.runs.run_writer import RunWriter
from rigctl.sessions.interlocks import failure_of
from rigctl.sessions.pause import Pause
from rigctl.sessions.plan import Step
from rigctl.sessions.trip import Trip

# What a scene is like, frame after frame: an event once a round is enough, beside the remark in each frame.
_LASTING = ("low_signal", "saturated")


class Guard:
    """Acts on trips. Each is an event of the run; those that only note what a scene is like are one once a round.

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

    def watched(self, trips: Iterable[Trip]) -> tuple[Trip, ...]:
        """Return those trips that are not switched off."""
        return tuple(trip for trip in trips if self._action(trip) != "off")

    def note(self, trip: Trip, **facts: int) -> None:
        """Write down a trip and what is done about it."""
        action = self._action(trip)
        self._writer.event("interlock", interlock=trip.name, action=action, message=trip.message, **facts)

    def react(self, trip: Trip, *, cleared: Callable[[], bool]) -> None:
        """Note a trip, and hold until it is cleared, or stop, where that is asked for.

        Raises
        ------
        DeviceError, DataError
            It stops the session.
        StopAskedError
            Somebody asked to stop while it held.
        """
        self.note(trip)
        action = self._action(trip)
        if action == "stop":
            raise failure_of(trip)
        if action == "hold":
            self._pause.hold(trip.message, cleared=cleared)

    def wants_again(self, trip: Trip, step: Step, *, tries_left: int) -> bool:
        """Note a trip of a frame, and return whether the frame is to be taken again.

        Raises
        ------
        DeviceError, DataError
            It stops the session, at once or since taking again has not helped.
        StopAskedError
            Somebody asked to stop while it held.
        """
        action = self._action(trip)
        if action != "note" or trip.name not in _LASTING or (trip.name, step.round) not in self._told:
            self.note(trip, sequence=step.sequence)
        self._told.add((trip.name, step.round))
        if action == "stop" or (action == "retry" and tries_left <= 0):
            raise failure_of(trip)
        if action == "hold":
            self._pause.hold(trip.message, cleared=lambda: False)
        return action in ("retry", "hold")

    def _action(self, trip: Trip) -> Action:
        action: Action = getattr(self.locks, trip.name)
        return action
