"""Does about an interlock what the session file says: take again, hold, stop, or note."""

from collections.abc import Callable, Iterable

from rigctl.files.interlock_section import Action, InterlockSection
from rigctl.runs.run_writer import RunWriter
from rigctl.sessions.interlocks import failure_of
from rigctl.sessions.pause import Pause
from rigctl.sessions.trip import Trip


class Guard:
    """Acts on trips. Each is an event of the run.

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

    def wants_again(self, trip: Trip, *, sequence: int, tries_left: int) -> bool:
        """Note a trip of a frame, and return whether the frame is to be taken again.

        Raises
        ------
        DeviceError, DataError
            It stops the session, at once or since taking again has not helped.
        StopAskedError
            Somebody asked to stop while it held.
        """
        self.note(trip, sequence=sequence)
        action = self._action(trip)
        if action == "stop" or (action == "retry" and tries_left <= 0):
            raise failure_of(trip)
        if action == "hold":
            self._pause.hold(trip.message, cleared=lambda: False)
        return action in ("retry", "hold")

    def _action(self, trip: Trip) -> Action:
        action: Action = getattr(self.locks, trip.name)
        return action
