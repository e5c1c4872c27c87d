"""Numbers of a whole cycle of angles: the sum rule, and DoLP of regions with the deviation that noise predicts."""

import math
from collections.abc import Sequence
from dataclasses import fields

import numpy as np

from model.moments import Moments
from model.processing import dolp
from model.processing.reconstruction import aolp_moments_rad, design, stokes_moments
from model.stokes import aolp_rad
from model.stokes import dolp as degree_of_polarization
from rigctl.files.session_file import PICTURE
from rigctl.live.frame_summary import FrameSummary
from rigctl.live.light_levels import Level, LightLevels
from rigctl.live.live_status import Estimate, LiveDiagnosis, RegionPolarization
from rigctl.measurement.fault_terms import Fault

_LEAST_ANGLES = 3
_ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)
# A deviation for somebody who watches: three digits are plenty.
_TOLERANCE = 1e-3


def sum_rule(frames: Sequence[FrameSummary], *, region: str, levels: LightLevels) -> Estimate | None:
    """Return (I0 + I90) / (I45 + I135), which is 1; None without all four, or without light."""
    found: dict[float, Level] = {}
    for frame in frames:
        if frame.angle_deg in _ANGLES_DEG:
            found.setdefault(frame.angle_deg, levels.level(frame, region))
    if len(found) < len(_ANGLES_DEG):
        return None
    i0, i45, i90, i135 = (found[angle] for angle in _ANGLES_DEG)
    upper, lower = i0.dn_per_s + i90.dn_per_s, i45.dn_per_s + i135.dn_per_s
    if lower <= 0.0:
        return None
    ratio = upper / lower
    variances = [None if level.variance is None else level.variance for level in (i0, i90, i45, i135)]
    if any(variance is None for variance in variances):
        return Estimate(value=ratio, sigma=None)
    of_upper, of_lower = (sum(v for v in part if v is not None) for part in (variances[:2], variances[2:]))
    return Estimate(value=ratio, sigma=math.sqrt(of_upper + ratio**2 * of_lower) / lower)


def polarization(
    frames: Sequence[FrameSummary], *, region: str, levels: LightLevels, extinction_ratio: float | None
) -> RegionPolarization | None:
    """Return the polarization of a region's mean light in a cycle; None with fewer than three angles, or no light.

    Parameters
    ----------
    frames : sequence of FrameSummary
        Of one exposure; angles may repeat.
    region : str
        Which.
    levels : LightLevels
        What turns counts into light.
    extinction_ratio : float or None
        Of the polarizer; None is taken for an ideal one.

    Notes
    -----
    The deviation is what noise does to one cycle. It knows nothing of drift, of fixed pattern, or of an error of the
    angles.
    """
    seen = [frame for frame in frames if frame.measured_deg is not None]
    if len({frame.angle_deg for frame in seen}) < _LEAST_ANGLES:
        return None
    angles_rad = np.deg2rad([frame.measured_deg or 0.0 for frame in seen])
    found = [levels.level(frame, region) for frame in seen]
    plan = design(angles_rad, np.inf if extinction_ratio is None else extinction_ratio)
    variances = np.diag([0.0 if level.variance is None else level.variance for level in found])
    stokes = stokes_moments(plan, Moments(mean=np.array([level.dn_per_s for level in found]), cov=variances))
    if stokes.mean[0] <= 0.0:
        return None
    degree = float(degree_of_polarization(stokes.mean))
    return RegionPolarization(
        dolp=Estimate(value=degree, sigma=_sigma(stokes) if variances.any() else None),
        aolp_deg=float(np.rad2deg(aolp_rad(stokes.mean))) if degree > 0.0 else None,
        light_dn_per_s=float(stokes.mean[0]),
        aolp_sigma_deg=_angle_sigma_deg(stokes) if degree > 0.0 and variances.any() else None,
    )


def _sigma(stokes: Moments) -> float | None:
    """Return the deviation of DoLP; None where it does not exist."""
    sigma = float(dolp.moments(stokes.mean, stokes.cov, tolerance=_TOLERANCE).std)
    return sigma if math.isfinite(sigma) else None


def _angle_sigma_deg(stokes: Moments) -> float | None:
    sigma = float(np.rad2deg(np.sqrt(aolp_moments_rad(stokes).cov[0, 0])))
    return sigma if math.isfinite(sigma) else None


def cycle_diagnosis(
    frames: Sequence[FrameSummary], *, levels: LightLevels, extinction_ratio: float | None
) -> LiveDiagnosis | None:
    """Return what a whole cycle says of its faults, from its coarse pictures; None where there are none.

    Parameters
    ----------
    frames : sequence of FrameSummary
        Of one exposure, in the order in which they were taken.
    levels : LightLevels
        With the dark level.
    extinction_ratio : float or None
        Of the polarizer; None is taken for an ideal one.
    """
    seen = [frame for frame in frames if frame.measured_deg is not None]
    coarse = [frame.coarse for frame in seen if frame.coarse is not None]
    if not coarse or len(coarse) < len(seen) or len({frame.angle_deg for frame in seen}) < _LEAST_ANGLES:
        return None
    pictures = np.array([picture.counts_dn for picture in coarse]) - levels.dark_dn(PICTURE, seen[0].exposure_s)
    usable = np.asarray(np.isfinite(pictures).all(axis=0))
    pictures = np.where(usable, pictures, 0.0)
    angles_rad = np.deg2rad([frame.measured_deg or 0.0 for frame in seen])
    plan = design(angles_rad, np.inf if extinction_ratio is None else extinction_ratio)
    from rigctl.measurement.run_diagnosis import diagnose_pictures  # not before the first whole cycle

    found = diagnose_pictures(
        plan,
        pictures,
        usable,
        angles_rad=angles_rad % (2.0 * np.pi),
        times=[float(place) for place in range(len(seen))],
        step=1.0,
        means={PICTURE: pictures[:, usable].mean(axis=1)} if usable.any() else {},
        side_pixels=coarse[0].side_pixels,
    )
    terms = tuple(Fault(**{key.name: getattr(term, key.name) for key in fields(Fault)}) for term in found.named)
    return LiveDiagnosis(terms=terms, first=None if found.first is None else found.first.name, reason=found.reason)
