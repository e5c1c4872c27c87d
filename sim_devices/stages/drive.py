"""A ring and its motor: each motion arrives, stalls, fails or is disturbed by hand, according to the options."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sim_devices.stages.options import StageOptions

_CREEP_TIME_CONSTANT_S = 0.1


@dataclass(frozen=True, kw_only=True)
class _Travel:
    """A turn at constant speed between angles, and the creep after it."""

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
    """A ring, its motor and its incremental encoder. Times are arguments and never go back."""

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
        """Return the true angle in the housing, through full turns [deg]."""
        return self._travel.angle_deg(time_s)

    def counts(self, time_s: float) -> int:
        """Return what the encoder reads."""
        return round((self.angle_deg(time_s) - self._zero_deg) * self._counts_per_turn / 360.0)

    def is_moving(self, time_s: float) -> bool:
        """Return whether a turn is under way."""
        return time_s < self._travel.end_s

    def turn_to_counts(self, time_s: float, counts: int, *, speed_deg_per_s: float, part: float = 1.0) -> float:
        """Turn part of the way to an encoder reading; return the time at which it rests [s]."""
        target_deg = self._zero_deg + counts * 360.0 / self._counts_per_turn
        start_deg = self.angle_deg(time_s)
        return self._turn_to(time_s, start_deg + part * (target_deg - start_deg), speed_deg_per_s)

    def find_mark(self, time_s: float, *, clockwise: bool, speed_deg_per_s: float, offset_counts: int = 0) -> float:
        """Turn to the reference mark or an offset from it, zero the encoder; return the time at which it rests [s]."""
        home_deg = self._mark_deg + offset_counts * 360.0 / self._counts_per_turn
        way_deg = (home_deg - self.angle_deg(time_s)) % 360.0
        if clockwise and way_deg:
            way_deg -= 360.0
        self._zero_deg = self.angle_deg(time_s) + way_deg
        return self._turn_to(time_s, self._zero_deg, speed_deg_per_s)

    def call_here(self, time_s: float, counts: int) -> None:
        """Set the encoder's reading at the present angle."""
        self._zero_deg = self.angle_deg(time_s) - counts * 360.0 / self._counts_per_turn

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


_HAND_TURNS_DEG = 5.0
_ENDLESS_TURNS = 10**6

Outcome = Literal["arrives", "stalls", "is turned by hand", "fails"]


class Drive:
    """Counts the moves and determines how each ends. Times are arguments and never decrease."""

    def __init__(self, options: StageOptions, *, generator: np.random.Generator) -> None:
        self.ring = Ring(
            counts_per_turn=options.counts_per_turn,
            landing_deg=options.landing_deg,
            mark_deg=options.mark_deg,
            start_deg=options.start_deg,
            backlash_deg=options.backlash_deg,
            creep_deg=options.creep_deg,
            generator=generator,
        )
        self._options = options
        self._moves = 0

    def home(self, time_s: float, *, clockwise: bool, speed_deg_per_s: float, offset_counts: int = 0) -> float:
        """Turn to the reference mark, or to an offset from it; return the time at which the ring rests [s]."""
        return self.ring.find_mark(
            time_s,
            clockwise=clockwise,
            speed_deg_per_s=self._possible(speed_deg_per_s),
            offset_counts=offset_counts,
        )

    def turn_on(self, time_s: float, *, forward: bool, speed_deg_per_s: float) -> None:
        """Turn on and on, until the ring is halted."""
        counts = self.ring.counts(time_s) + round(
            (1 if forward else -1) * _ENDLESS_TURNS * self._options.counts_per_turn
        )
        self.ring.turn_to_counts(time_s, counts, speed_deg_per_s=self._possible(speed_deg_per_s))

    def move(self, time_s: float, counts: int, *, speed_deg_per_s: float) -> tuple[float, Outcome]:
        """Turn to an encoder reading; return the time of the end [s], and its kind."""
        self._moves += 1
        speed = self._possible(speed_deg_per_s)
        if self._moves == self._options.stall:
            end_s = self.ring.turn_to_counts(time_s, counts, speed_deg_per_s=speed, part=0.5)
            return end_s, "stalls"
        target = counts - 1 if self._options.minus_one else counts
        end_s = self.ring.turn_to_counts(time_s, target, speed_deg_per_s=speed)
        return end_s, self._outcome()

    def turn_by_hand(self, time_s: float) -> float:
        """Turn by 5 degrees, like a person at the device; return the time at which it rests [s]."""
        counts = self.ring.counts(time_s) + round(_HAND_TURNS_DEG * self._options.counts_per_turn / 360.0)
        return self.ring.turn_to_counts(time_s, counts, speed_deg_per_s=self._options.motor_deg_per_s)

    def _outcome(self) -> Outcome:
        if self._moves == self._options.button:
            return "is turned by hand"
        if self._options.fault is not None and self._moves == self._options.fault[1]:
            return "fails"
        return "arrives"

    def _possible(self, speed_deg_per_s: float) -> float:
        return min(speed_deg_per_s, self._options.motor_deg_per_s)
