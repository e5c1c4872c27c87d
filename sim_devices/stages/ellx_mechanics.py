"""The mechanics of a simulated Elliptec rotation stage: where it is at a time, and what its encoder says."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class _Travel:
    """A turn at constant speed from one angle to another."""

    start_s: float
    end_s: float
    from_deg: float
    to_deg: float

    def angle_deg(self, time_s: float) -> float:
        if time_s >= self.end_s:
            return self.to_deg
        fraction = max(0.0, time_s - self.start_s) / (self.end_s - self.start_s)
        return self.from_deg + fraction * (self.to_deg - self.from_deg)


class EllxMechanics:
    """A ring, its motor and its incremental encoder. Times are arguments and never go back.

    Parameters
    ----------
    pulses : int
        Encoder counts of a full turn.
    landing_deg : float
        Standard deviation of where a move lands about where it should [deg].
    mark_deg : float
        Angle in the housing at which the reference mark lies [deg].
    start_deg : float
        Angle in the housing at power-up [deg]; the encoder calls this zero until the mark is found.
    generator : numpy.random.Generator
        Where landing errors are drawn from.
    """

    def __init__(
        self,
        *,
        pulses: int,
        landing_deg: float,
        mark_deg: float,
        start_deg: float,
        generator: np.random.Generator,
    ) -> None:
        self._pulses = pulses
        self._landing_deg = landing_deg
        self._mark_deg = mark_deg
        self._generator = generator
        self._zero_deg = start_deg
        self._travel = _Travel(start_s=0.0, end_s=0.0, from_deg=start_deg, to_deg=start_deg)

    def angle_deg(self, time_s: float) -> float:
        """Return the true angle in the housing [deg], counted on through full turns."""
        return self._travel.angle_deg(time_s)

    def counts(self, time_s: float) -> int:
        """Return what the encoder reads."""
        return round((self.angle_deg(time_s) - self._zero_deg) * self._pulses / 360.0)

    def is_moving(self, time_s: float) -> bool:
        """Return whether a turn is under way."""
        return time_s < self._travel.end_s

    def turn_to_counts(self, time_s: float, counts: int, *, speed_deg_per_s: float, part: float = 1.0) -> float:
        """Turn towards an encoder reading, and give up after a part of the way; return when it rests [s]."""
        target_deg = self._zero_deg + counts * 360.0 / self._pulses
        start_deg = self.angle_deg(time_s)
        return self._turn_to(time_s, start_deg + part * (target_deg - start_deg), speed_deg_per_s)

    def find_mark(self, time_s: float, *, clockwise: bool, speed_deg_per_s: float) -> float:
        """Turn to the reference mark, which becomes the encoder's zero; return when it rests [s]."""
        way_deg = (self._mark_deg - self.angle_deg(time_s)) % 360.0
        if clockwise and way_deg:
            way_deg -= 360.0
        self._zero_deg = self.angle_deg(time_s) + way_deg
        return self._turn_to(time_s, self._zero_deg, speed_deg_per_s)

    def _turn_to(self, time_s: float, target_deg: float, speed_deg_per_s: float) -> float:
        from_deg = self.angle_deg(time_s)
        to_deg = target_deg + self._landing_deg * float(self._generator.standard_normal())
        end_s = time_s + abs(to_deg - from_deg) / speed_deg_per_s
        self._travel = _Travel(start_s=time_s, end_s=end_s, from_deg=from_deg, to_deg=to_deg)
        return end_s
