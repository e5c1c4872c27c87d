"""A stage that gives itself, after each move, the time that it was measured to need until it rests."""

import time
from collections.abc import Callable

from drivers.interfaces import DeviceIdentity, Move, RotationStage, StagePosition, StageStatus, Way


class SettlingStage:
    """Another stage, with a pause and a fresh readback after each move.

    Parameters
    ----------
    stage : RotationStage
        What turns.
    settle_s : float
        Pause after a move [s].
    sleep : callable
        Makes the pause.
    """

    def __init__(self, stage: RotationStage, *, settle_s: float, sleep: Callable[[float], None] = time.sleep) -> None:
        self._stage = stage
        self._settle_s = settle_s
        self._sleep = sleep

    def __enter__(self) -> "SettlingStage":
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()

    def identify(self) -> DeviceIdentity:
        """Return what the device says of itself."""
        return self._stage.identify()

    def home(self) -> StagePosition:
        """Search the reference mark; return the readback after the pause."""
        self._stage.home()
        self._sleep(self._settle_s)
        return self._stage.position()

    def move_to(self, angle_deg: float, *, way: Way = "short") -> Move:
        """Go to an angle; return once it is there and rests. Raises what the stage raises."""
        move = self._stage.move_to(angle_deg, way=way)
        self._sleep(self._settle_s)
        return Move(
            target_deg=move.target_deg,
            position=self._stage.position(),
            tries=move.tries,
            duration_s=move.duration_s + self._settle_s,
            remarks=move.remarks,
        )

    def position(self) -> StagePosition:
        """Read the encoder."""
        return self._stage.position()

    def status(self) -> StageStatus:
        """Ask the device what it is doing."""
        return self._stage.status()

    def stop(self) -> None:
        """Stop any motion that the device is able to stop."""
        self._stage.stop()

    def close(self) -> None:
        """Release the port. May be called twice."""
        self._stage.close()
