"""I0 + I90 against I45 + I135 of each cycle: both are all of the light, whatever its polarization."""

import math

from rigctl.files.interlock_section import InterlockSection
from rigctl.sessions.interlocks import Trip
from rigctl.sessions.mean_noise import VarianceOfMean
from rigctl.sessions.plan import Step

_ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)
_SIGMAS = 5.0


class SumRule:
    """Collects the mean counts of a cycle and judges them at its end.

    Parameters
    ----------
    section : InterlockSection
        How far both sums may be apart: light, sensor and polarizer drift within a cycle.
    variance : callable or None
        What noise does to a mean, from a calibration. Without one the tolerance has to cover it too.

    Notes
    -----
    Black levels cancel between the two sums and stay in their mean, so the test is a little weaker where there is
    little light.
    """

    def __init__(self, section: InterlockSection, variance: VarianceOfMean | None) -> None:
        self._section, self._variance = section, variance
        self._means: dict[float, dict[float, tuple[float, float]]] = {}

    def add(self, step: Step, *, mean_dn: float, exposure_s: float, pixels: int) -> Trip | None:
        """Take in a frame; return a trip at the end of a cycle whose sums are too far apart."""
        if step.kind != "scene" or step.polarizer_angle_deg is None:
            return None
        angle = step.polarizer_angle_deg % 180.0
        noise_dn2 = 0.0 if self._variance is None else self._variance(mean_dn, exposure_s, pixels)
        self._means.setdefault(exposure_s, {}).setdefault(angle, (mean_dn, noise_dn2))
        if not step.ends_cycle:
            return None
        cycles, self._means = self._means, {}
        trips = (self._judge(means) for means in cycles.values())
        return next((trip for trip in trips if trip is not None), None)

    def _judge(self, means: dict[float, tuple[float, float]]) -> Trip | None:
        if not set(_ANGLES_DEG) <= set(means):
            return None
        i0, i45, i90, i135 = (means[angle][0] for angle in _ANGLES_DEG)
        noise_dn = math.sqrt(sum(means[angle][1] for angle in _ANGLES_DEG))
        difference, both = i0 + i90 - i45 - i135, (i0 + i45 + i90 + i135) / 2.0
        allowed = self._section.sum_rule_tolerance * both + _SIGMAS * noise_dn
        if abs(difference) <= allowed:
            return None
        text = (
            f"I0 + I90 is {i0 + i90:.1f} DN and I45 + I135 is {i45 + i135:.1f} DN, allowed are {allowed:.1f} DN apart"
        )
        return Trip(name="sum_rule", message=f"{text}: light, exposure or an angle changed within the cycle")
