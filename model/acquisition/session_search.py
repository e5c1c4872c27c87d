"""The shortest session that reaches what is wanted: a deviation of DoLP, or a probability of detection."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from enum import Enum
from functools import lru_cache

import numpy as np

from model.acquisition.session_design import CycleLight, Disturbances, DolpBudget, Session, dolp_budget
from model.processing.detection import rx_p_detection

MOST_CYCLES = 100_000
# A share of clipped pixels above which counts are no longer linear in the light.
SATURATED = 1e-3


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """Goals of a session; None asks for nothing of that kind.

    Attributes
    ----------
    dolp_total
        Largest error of DoLP: noise, and systematic errors in square to it.
    p_detection
        Least probability of detection of a pixel, in (0, 1), at `p_false_alarm`.
    p_false_alarm
        In (0, 1).
    """

    dolp_total: float | None = None
    p_detection: float | None = None
    p_false_alarm: float = 1e-3

    def __post_init__(self) -> None:
        if self.dolp_total is not None and not self.dolp_total > 0.0:
            raise ValueError(f"dolp_total = {self.dolp_total}; allowed is above 0")
        for name in ("p_detection", "p_false_alarm"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < 1.0:
                raise ValueError(f"{name} = {value}; allowed is between 0 and 1")


@dataclass(frozen=True, kw_only=True, eq=False)
class Scheme:
    """A way to take frames, but for the number of cycles, and what its cycle shows of each region.

    Attributes
    ----------
    session
        Its cycles are set by the search.
    lights
        Region to what one cycle shows of it.
    """

    session: Session
    lights: dict[str, CycleLight]

    @property
    def saturation_probability(self) -> float:
        """Largest chance that a pixel of any region is clipped."""
        return max(light.saturation_probability for light in self.lights.values())

    def detection(self, pair: tuple[str, str], *, cycles: int, p_false_alarm: float) -> float:
        """Return the probability to detect a pixel of the first region of a pair on the second."""
        target, background = (self.lights[name] for name in pair)
        return detection(target, background, cycles=cycles, p_false_alarm=p_false_alarm)


class Obstacle(Enum):
    """Why no number of cycles reaches what is wanted."""

    SATURATED = "saturated"
    CYCLES = "cycles"


@dataclass(frozen=True, kw_only=True, eq=False)
class Reached:
    """A session that reaches what is wanted in as few cycles as its scheme allows; or why none does.

    Attributes
    ----------
    session
        With the cycles found; None where no number of them reaches it.
    budgets
        Region to errors of DoLP; empty without a session.
    p_detection
        Of the pair that was asked for; None if none was.
    obstacle
        What stands in the way; None where there is a session.
    why_not
        The same in words; empty where there is a session.
    """

    session: Session | None
    budgets: dict[str, DolpBudget]
    p_detection: float | None = None
    obstacle: Obstacle | None = None
    why_not: str = ""


@lru_cache(maxsize=8192)
def detection(target: CycleLight, background: CycleLight, *, cycles: int, p_false_alarm: float) -> float:
    """Return the probability to detect a pixel of one region among those of another in the mean of cycles.

    Parameters
    ----------
    target, background
        What one cycle shows of them.
    cycles
        How many are averaged, 1 or more.
    p_false_alarm
        In (0, 1).

    Raises
    ------
    ValueError
        The background has no covariance to stand out from.

    References
    ----------
    [MK14] eq. (30).
    """
    found = rx_p_detection(
        p_false_alarm,
        target.stokes_dn,
        target.cov_dn2(cycles),
        background.stokes_dn,
        background.cov_dn2(cycles),
    )
    return float(found)


def fewest_cycles(
    scheme: Scheme,
    wanted: Wanted,
    *,
    disturbances: Disturbances,
    regions: tuple[str, ...],
    pair: tuple[str, str] | None = None,
    pixels: int = 1,
) -> Reached:
    """Return the session of a scheme with the fewest cycles that reaches what is wanted.

    Parameters
    ----------
    scheme
        Angles, order, exposure and times.
    wanted
        What to reach, all of it.
    disturbances
        Drift and settling.
    regions
        Whose DoLP counts; each of them has to reach it.
    pair
        Target and background, where a detection is wanted.
    pixels
        How many are averaged before DoLP is taken, 1 or more.

    Raises
    ------
    ValueError
        A detection is wanted of no pair, or an argument is outside its range.

    Notes
    -----
    Noise falls with every cycle; drift and settling do not, but for pairs of cycles that go back and forth, of which
    only whole pairs are taken. So one bisection finds the number. Grouped frames, whose drift grows with their number,
    are refused.
    """
    if scheme.session.pattern == "grouped":
        raise ValueError("fewest_cycles: frames grouped by angle have no cycles to count; take cycles or a palindrome")
    if wanted.p_detection is not None and pair is None:
        raise ValueError("fewest_cycles: a detection is wanted, but of which target on which background?")
    if scheme.saturation_probability > SATURATED:
        share = scheme.saturation_probability
        why_not = f"saturated: {share:.2g} of the pixels are clipped"
        return Reached(session=None, budgets={}, obstacle=Obstacle.SATURATED, why_not=why_not)
    step = 2 if scheme.session.pattern == "palindrome" else 1

    def at(count: int) -> Reached:
        return _evaluated(scheme, wanted, count * step, disturbances, regions, pair, pixels)

    return _first(at, lambda reached: _is_enough(reached, wanted), MOST_CYCLES // step)


def shortest(found: Iterable[Reached]) -> Reached | None:
    """Return the session that takes the least time; None where there is none."""
    reached = [one for one in found if one.session is not None]
    return min(reached, key=_duration_s) if reached else None


def _duration_s(reached: Reached) -> float:
    return np.inf if reached.session is None else reached.session.duration_s


def _evaluated(
    scheme: Scheme,
    wanted: Wanted,
    cycles: int,
    disturbances: Disturbances,
    regions: tuple[str, ...],
    pair: tuple[str, str] | None,
    pixels: int,
) -> Reached:
    session = replace(scheme.session, cycles=cycles)
    budgets = {name: dolp_budget(scheme.lights[name], session, disturbances, pixels=pixels) for name in regions}
    detected = None
    if pair is not None:
        detected = scheme.detection(pair, cycles=cycles, p_false_alarm=wanted.p_false_alarm)
    return Reached(session=session, budgets=budgets, p_detection=detected)


def _is_enough(reached: Reached, wanted: Wanted) -> bool:
    allowed = np.inf if wanted.dolp_total is None else wanted.dolp_total
    # Written so that a deviation that does not exist is not enough.
    if not all(budget.total <= allowed for budget in reached.budgets.values()):
        return False
    if wanted.p_detection is None:
        return True
    return reached.p_detection is not None and reached.p_detection >= wanted.p_detection


def _first(at: Callable[[int], Reached], enough: Callable[[Reached], bool], most: int) -> Reached:
    """Return the first of a row that is enough, where all after it are, too; or the last, with why it is not."""
    high, found = 1, at(1)
    while not enough(found) and high < most:
        high = min(2 * high, most)
        found = at(high)
    if not enough(found):
        return replace(found, session=None, obstacle=Obstacle.CYCLES, why_not=_why_not(found))
    low = high // 2
    while high - low > 1:
        middle = (low + high) // 2
        tried = at(middle)
        if enough(tried):
            high, found = middle, tried
        else:
            low = middle
    return found


def _why_not(last: Reached) -> str:
    """Say what is left after the largest number of cycles."""
    parts = [
        f"{name}: noise {budget.sigma:.2g}, drift {budget.drift_error:.2g}, settling {budget.settling_error:.2g}"
        for name, budget in last.budgets.items()
    ]
    if last.p_detection is not None:
        parts.append(f"probability of detection {last.p_detection:.4f} (texture and pattern set it)")
    return f"not within {MOST_CYCLES} cycles: " + "; ".join(parts)
