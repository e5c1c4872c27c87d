"""A ring with a motor that obeys, or does not, as its options say."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from sim_devices.stages.ring import Ring
from sim_devices.stages.stage_options import MotionOptions

_HAND_TURNS_DEG = 5.0

Outcome = Literal["arrives", "stalls", "is turned by hand", "fails"]


@dataclass(frozen=True, kw_only=True)
class Ending:
    """End of a move: its time [s], and how it ends."""

    time_s: float
    outcome: Outcome


class Drive:
    """Counts the moves and gives each its ending. Times are arguments and never go back.

    Parameters
    ----------
    options : MotionOptions
        How it turns, and what goes wrong.
    counts_per_turn : float
        Encoder counts of a full turn.
    generator : numpy.random.Generator
        Where landing errors are drawn from.

    Attributes
    ----------
    ring : Ring
        What is turned.
    """

    def __init__(self, options: MotionOptions, *, counts_per_turn: float, generator: np.random.Generator) -> None:
        self.ring = Ring(
            counts_per_turn=counts_per_turn,
            landing_deg=options.landing_deg,
            mark_deg=options.mark_deg,
            start_deg=options.start_deg,
            backlash_deg=options.backlash_deg,
            creep_deg=options.creep_deg,
            generator=generator,
        )
        self._options = options
        self._counts_per_turn = counts_per_turn
        self._moves = 0

    def home(self, time_s: float, *, clockwise: bool, speed_deg_per_s: float) -> float:
        """Turn to the reference mark; return when the ring rests there [s]."""
        return self.ring.find_mark(time_s, clockwise=clockwise, speed_deg_per_s=self._possible(speed_deg_per_s))

    def move(self, time_s: float, counts: int, *, speed_deg_per_s: float) -> Ending:
        """Turn to an encoder reading."""
        self._moves += 1
        speed = self._possible(speed_deg_per_s)
        if self._moves == self._options.stall:
            end_s = self.ring.turn_to_counts(time_s, counts, speed_deg_per_s=speed, part=0.5)
            return Ending(time_s=end_s, outcome="stalls")
        target = counts - 1 if self._options.minus_one else counts
        end_s = self.ring.turn_to_counts(time_s, target, speed_deg_per_s=speed)
        return Ending(time_s=end_s, outcome=self._outcome())

    def turn_by_hand(self, time_s: float) -> float:
        """Turn by 5 degrees, as a person at the device would; return when it rests [s]."""
        counts = self.ring.counts(time_s) + round(_HAND_TURNS_DEG * self._counts_per_turn / 360.0)
        return self.ring.turn_to_counts(time_s, counts, speed_deg_per_s=self._options.motor_deg_per_s)

    def _outcome(self) -> Outcome:
        if self._moves == self._options.button:
            return "is turned by hand"
        if self._options.fault is not None and self._moves == self._options.fault[1]:
            return "fails"
        return "arrives"

    def _possible(self, speed_deg_per_s: float) -> float:
        return min(speed_deg_per_s, self._options.motor_deg_per_s)
