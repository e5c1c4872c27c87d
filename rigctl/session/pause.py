"""Between two frames: answers to what was asked for, and waits."""

from collections.abc import Callable

from rigctl.session.control import Control
from rigctl.session.session_clock import SessionClock
from rigctl.terminal import warn

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
        while not cleared() and self._polled() != "go on":
            self._clock.sleep(_POLL_S)
        self._note("go on")

    def wait(self, remaining_s: Callable[[], float]) -> None:
        """Return once no time remains [s]; requests are answered meanwhile."""
        while (left_s := remaining_s()) > 0.0:
            self._clock.sleep(min(left_s, _POLL_S))
            self.answer()

    def _polled(self) -> str | None:
        request = self._control.poll()
        if request == "stop":
            raise StopAskedError
        return request
