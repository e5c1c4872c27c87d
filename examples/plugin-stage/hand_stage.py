"""A rotation mount without a motor: a person turns it and types in what its scale says.

The smallest whole example of a stage from outside of rigctl. It passes the contract suite.
"""

import time
from collections.abc import Callable
from typing import TextIO

from drivers.errors import DeviceTimeoutError, LimitError, NotConnectedError, ProtocolError
from drivers.interfaces import DeviceIdentity, Move, StagePosition, StageStatus, Way
from drivers.stages.serial_stage import distance_deg, require_finite

_TRIES = 3
_DIVISIONS_PER_DEG = 12  # a vernier of 5 arc minutes


class HandStage:
    """A mount, and the person at it.

    Parameters
    ----------
    questions, answers : text files
        Where the person reads, and where the answers come from.
    tolerance_deg : float
        How far the scale may be from the target [deg].
    now_s : callable
        A clock that never goes back [s].
    """

    def __init__(self, questions: TextIO, answers: TextIO, *, tolerance_deg: float, now_s: Callable[[], float]) -> None:
        self._questions, self._answers = questions, answers
        self._tolerance_deg = tolerance_deg
        self._now_s = now_s
        self._homed = False
        self._open = True

    def __enter__(self) -> "HandStage":
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()

    def identify(self) -> DeviceIdentity:
        """Return what it is."""
        return DeviceIdentity(model="hand-turned mount", serial_number="none", firmware="none")

    def home(self) -> StagePosition:
        """Have the mount set to zero; return what its scale says."""
        self._ask("Turn the mount to 0 deg")
        self._homed = True
        return self.position()

    def move_to(self, angle_deg: float, *, way: Way = "short") -> Move:
        """Have the mount turned. The errors are those of the interface."""
        require_finite(angle_deg)
        if not self._homed:
            raise LimitError("hand-turned mount: nobody has looked at its scale yet. Home it first")
        start_s = self._now_s()
        target_deg = round(angle_deg % 360.0 * _DIVISIONS_PER_DEG) / _DIVISIONS_PER_DEG
        for tries in range(1, _TRIES + 1):
            self._ask(f"Turn the mount to {target_deg:.2f} deg ({way} way)")
            position = self.position()
            if distance_deg(position.angle_deg, angle_deg) <= self._tolerance_deg:
                duration_s = self._now_s() - start_s
                return Move(target_deg=angle_deg, position=position, tries=tries, duration_s=duration_s)
        raise LimitError(f"hand-turned mount: asked for {angle_deg:g} deg, its scale says {position.angle_deg:g} deg")

    def position(self) -> StagePosition:
        """Return what the person reads off the scale."""
        text = self._ask("What does the scale say [deg]?")
        try:
            counts = round(float(text) * _DIVISIONS_PER_DEG)
        except ValueError as error:
            raise ProtocolError(f"hand-turned mount: {text!r} is no angle") from error
        return StagePosition(angle_deg=counts / _DIVISIONS_PER_DEG % 360.0, counts=counts)

    def status(self) -> StageStatus:
        """Return what is known without asking."""
        return StageStatus(moving=False, homed=self._homed, code=0, meaning="nothing to tell")

    def stop(self) -> None:
        """Do nothing: who turns it stops by himself."""

    def close(self) -> None:
        """Ask nothing any more, and release the terminal. May be called twice."""
        self._open = False
        self._questions.close()
        self._answers.close()

    def _ask(self, question: str) -> str:
        if not self._open:
            raise NotConnectedError("hand-turned mount: this connection was closed; open it again")
        self._questions.write(f"{question} ")
        self._questions.flush()
        answer = self._answers.readline()
        if not answer:
            raise DeviceTimeoutError("hand-turned mount: nobody answers any more")
        return answer.strip()


def open_hand(port: str, *, tolerance_deg: float = 0.05) -> HandStage:
    """Return the mount whose person sits at a terminal.

    Parameters
    ----------
    port : str
        The terminal, such as ``/dev/tty``.
    tolerance_deg : float
        How far the scale may be from the target [deg].

    Raises
    ------
    NotConnectedError
        There is no such terminal.
    """
    try:
        questions, answers = open(port, "w", encoding="utf-8"), open(port, encoding="utf-8")  # noqa: PTH123, SIM115
    except OSError as error:
        raise NotConnectedError(f"{port}: cannot be opened: {error.strerror}") from error
    return HandStage(questions, answers, tolerance_deg=tolerance_deg, now_s=time.monotonic)
