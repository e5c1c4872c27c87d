"""Drift of the light: the same angle looked at twice."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rigctl.live.frame_summary import FrameSummary
    from rigctl.live.light_levels import LightLevels

_S_PER_MIN = 60.0


@dataclass(frozen=True, kw_only=True)
class Drift:
    """A relative change of the light.

    Attributes
    ----------
    change : float
        Relative change over `over_s`, positive if the light grew.
    sigma : float or None
        Standard deviation of it by the camera's noise; None without a calibration.
    over_s : float
        Time between the looks, the mean of the angles weighted by their light.
    """

    change: float
    sigma: float | None
    over_s: float

    @property
    def per_min(self) -> float:
        """Relative change a minute."""
        return self.change / self.over_s * _S_PER_MIN

    @property
    def sigma_per_min(self) -> float | None:
        """Standard deviation of `per_min`."""
        return None if self.sigma is None else self.sigma / self.over_s * _S_PER_MIN


def drift_of(
    frames: Sequence["FrameSummary"], before: Sequence["FrameSummary"], *, region: str, levels: "LightLevels"
) -> Drift | None:
    """Return how the light has changed: within a cycle that repeats an angle, or else since the cycle before.

    Parameters
    ----------
    frames, before : sequences of FrameSummary
        Of this cycle and of the one before; empty if there is none.
    region : str
        Whose light.
    levels : LightLevels
        What turns counts into light.

    Returns
    -------
    Drift or None
        None where no angle was looked at twice, or there is no light.

    Notes
    -----
    The sum of the changes of all angles over the sum of their means; polarization cancels, since each angle is
    compared with itself.
    """
    pairs = list(_pairs(frames, frames)) or list(_pairs(before, frames))
    looks = [(levels.level(one, region), levels.level(two, region), two.time_s - one.time_s) for one, two in pairs]
    light = sum((one.dn_per_s + two.dn_per_s) / 2.0 for one, two, _ in looks)
    light_s = sum((one.dn_per_s + two.dn_per_s) / 2.0 * time_s for one, two, time_s in looks)
    if light <= 0.0 or light_s <= 0.0:
        return None
    variances = [level.variance for one, two, _ in looks for level in (one, two)]
    known = [variance for variance in variances if variance is not None]
    return Drift(
        change=sum(two.dn_per_s - one.dn_per_s for one, two, _ in looks) / light,
        sigma=math.sqrt(sum(known)) / light if len(known) == len(variances) else None,
        over_s=light_s / light,
    )


def _pairs(
    earlier: Sequence["FrameSummary"], later: Sequence["FrameSummary"]
) -> Iterator[tuple["FrameSummary", "FrameSummary"]]:
    """Give the first look of an angle among the earlier frames and the last among the later, where they differ."""
    first: dict[float | None, FrameSummary] = {}
    for frame in earlier:
        first.setdefault(frame.angle_deg, frame)
    last = {frame.angle_deg: frame for frame in later}
    for angle, one in first.items():
        two = last.get(angle)
        if two is not None and two.time_s > one.time_s:
            yield one, two
