"""Interlocks on a whole cycle of angles: its sums have to agree, and the light has to stand still."""

import math

from rigctl.files.interlock_section import InterlockSection
from rigctl.files.session_file import PICTURE
from rigctl.live.drift import Drift
from rigctl.live.frame_summary import FrameSummary
from rigctl.live.mean_noise import MeanNoise
from rigctl.session.interlocks import InterlockViolation

_ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)
_SIGMAS = 5.0


class SumRule:
    """Collects the mean counts of a cycle and judges them at its end.

    Parameters
    ----------
    section : InterlockSection
        How far both sums may be apart: light, sensor and polarizer drift within a cycle.
    noise : MeanNoise or None
        What noise does to a mean, from a calibration. Without one the tolerance has to cover it too.

    Notes
    -----
    Black levels cancel between the two sums and stay in their mean, so the test is a little weaker where there is
    little light.
    """

    def __init__(self, section: InterlockSection, noise: MeanNoise | None) -> None:
        self._section, self._noise = section, noise
        self._means: dict[float, dict[float, tuple[float, float]]] = {}

    def add(self, frame: FrameSummary, *, ends_cycle: bool) -> InterlockViolation | None:
        """Take in a frame; return a violation at the end of a cycle whose sums are too far apart."""
        if frame.kind != "scene" or frame.angle_deg is None:
            return None
        mean, exposure_s = frame.means[PICTURE], frame.exposure_s
        noise_dn2 = (
            0.0
            if self._noise is None
            else self._noise.variance_dn2(mean.mean_dn, exposure_s=exposure_s, pixels=mean.pixels)
        )
        self._means.setdefault(exposure_s, {}).setdefault(frame.angle_deg, (mean.mean_dn, noise_dn2))
        if not ends_cycle:
            return None
        cycles, self._means = self._means, {}
        violations = (self._judge(means) for means in cycles.values())
        return next((violation for violation in violations if violation is not None), None)

    def _judge(self, means: dict[float, tuple[float, float]]) -> InterlockViolation | None:
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
        return InterlockViolation(
            name="sum_rule", message=f"{text}: light, exposure or an angle changed within the cycle"
        )


def drift_violation(drift: Drift | None, section: InterlockSection) -> InterlockViolation | None:
    """Return a violation where the light has changed within a cycle by more than is allowed, noise apart."""
    if drift is None or abs(drift.change) <= section.drift_tolerance + _SIGMAS * (drift.sigma or 0.0):
        return None
    text = f"the light changed by {100 * drift.change:+.2f} % in {drift.over_s:.1f} s"
    allowed = f"allowed are {100 * section.drift_tolerance:g} % from cycle to cycle"
    return InterlockViolation(name="drift", message=f"{text}, {allowed}: polarization of this cycle is doubtful")
