"""The mechanics of a simulated rotation stage: where its ring is at a time, and what its encoder says."""

import math
from dataclasses import dataclass

import numpy as np

_CREEP_TIME_CONSTANT_S = 0.1


@dataclass(frozen=True, kw_only=True)
class _Travel:
    """A turn at constant speed from one angle to another, and the creeping after it."""

    start_s: float
    end_s: float
    from_deg: float
    to_deg: float
    creep_deg: float

    def angle_deg(self, time_s: float) -> float:
        if time_s >= self.end_s:
            return self.to_deg - self.creep_deg * math.exp(-(time_s - self.end_s) / _CREEP_TIME_CONSTANT_S)
        fraction = max(0.0, time_s - self.start_s) / (self.end_s - self.start_s)
        return self.from_deg + fraction * (self.to_deg - self.creep_deg - self.from_deg)


class Ring:
    """A ring, its motor and its incremental encoder. Times are arguments and never go back.

    Parameters
    ----------
    counts_per_turn : float
        Encoder counts of a full turn.
    landing_deg : float
        Standard deviation of where a move lands about where it should [deg].
    mark_deg : float
        Angle in the housing at which the reference mark lies [deg].
    start_deg : float
        Angle in the housing at power-up [deg]; the encoder calls this zero until the mark is found.
    backlash_deg : float
        A turn ends half of this [deg] before its target, on whichever side it comes from.
    creep_deg : float
        How far before its rest the ring stands when a turn ends [deg].
    generator : numpy.random.Generator
        Where landing errors are drawn from.
    """

    def __init__(
        self,
        *,
        counts_per_turn: float,
        landing_deg: float,
        mark_deg: float,
        start_deg: float,
        backlash_deg: float = 0.0,
        creep_deg: float = 0.0,
        generator: np.random.Generator,
    ) -> None:
        self._counts_per_turn = counts_per_turn
        self._landing_deg = landing_deg
        self._mark_deg = mark_deg
        self._backlash_deg = backlash_deg
        self._creep_deg = creep_deg
        self._generator = generator
        self._zero_deg = start_deg
        self._travel = _Travel(start_s=0.0, end_s=0.0, from_deg=start_deg, to_deg=start_deg, creep_deg=0.0)

    def angle_deg(self, time_s: float) -> float:
        """Return the true angle in the housing [deg], counted on through full turns."""
        return self._travel.angle_deg(time_s)

    def counts(self, time_s: float) -> int:
        """Return what the encoder reads."""
        return round((self.angle_deg(time_s) - self._zero_deg) * self._counts_per_turn / 360.0)

    def is_moving(self, time_s: float) -> bool:
        """Return whether a turn is under way."""
        return time_s < self._travel.end_s

    def turn_to_counts(self, time_s: float, counts: int, *, speed_deg_per_s: float, part: float = 1.0) -> float:
        """Turn towards an encoder reading, and give up after a part of the way; return when it rests [s]."""
        target_deg = self._zero_deg + counts * 360.0 / self._counts_per_turn
        start_deg = self.angle_deg(time_s)
        return self._turn_to(time_s, start_deg + part * (target_deg - start_deg), speed_deg_per_s)

    def find_mark(self, time_s: float, *, clockwise: bool, speed_deg_per_s: float) -> float:
        """Turn to the reference mark, which becomes the encoder's zero; return when it rests [s]."""
        way_deg = (self._mark_deg - self.angle_deg(time_s)) % 360.0
        if clockwise and way_deg:
            way_deg -= 360.0
        self._zero_deg = self.angle_deg(time_s) + way_deg
        return self._turn_to(time_s, self._zero_deg, speed_deg_per_s)

    def halt(self, time_s: float) -> None:
        """Stand still at once."""
        here_deg = self.angle_deg(time_s)
        self._travel = _Travel(start_s=time_s, end_s=time_s, from_deg=here_deg, to_deg=here_deg, creep_deg=0.0)

    def _turn_to(self, time_s: float, target_deg: float, speed_deg_per_s: float) -> float:
        from_deg = self.angle_deg(time_s)
        side = math.copysign(1.0, target_deg - from_deg)
        landing_deg = self._landing_deg * float(self._generator.standard_normal())
        to_deg = target_deg + landing_deg - side * self._backlash_deg / 2.0
        end_s = time_s + abs(to_deg - from_deg) / speed_deg_per_s
        self._travel = _Travel(
            start_s=time_s, end_s=end_s, from_deg=from_deg, to_deg=to_deg, creep_deg=side * self._creep_deg
        )
        return end_s
