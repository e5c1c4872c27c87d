"""Polarizer angles that are best for a number of frames and a kind of noise.

If nothing is known of the light, equal spacing over 180 deg is best: it minimises condition number, equally weighted
variance and determinant at once under additive noise, and the mean over all angles of polarization under shot noise.
If the light is known, angles can be turned so that the bright channels are where they hurt least.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize

from model.stokes import analyzer_row, checked_stokes, require_positive_intensity

FloatArray = NDArray[np.float64]

# Starts of the search: equal spacing, turned by these shares of it.
_TURNS = 6
# A channel without light and without floor still has the variance of one electron.
_LEAST_VAR_E2 = 1.0


@dataclass(frozen=True, kw_only=True)
class AngleChoice:
    """Angles and what they achieve.

    Parameters
    ----------
    angles_rad
        Shape (N,), in [0, pi), ascending [rad].
    variance_e2
        Sum of the variances of S0, S1, S2 with generalised least squares [e-^2]; its mean over all angles of
        polarization if the light's is not known.
    equispaced_variance_e2
        The same for equal spacing that starts at 0 [e-^2].
    method
        "equal spacing" or "search".
    """

    angles_rad: FloatArray
    variance_e2: float
    equispaced_variance_e2: float
    method: str


def equispaced_rad(frames: int, *, start_rad: float = 0.0) -> FloatArray:
    """Return angles that are equally spaced over 180 deg.

    Parameters
    ----------
    frames
        Number of frames, at least 3.
    start_rad
        First angle [rad].

    Returns
    -------
    ndarray
        Shape (frames,) [rad].

    Raises
    ------
    ValueError
        If there are fewer than three frames.

    Notes
    -----
    Condition number sqrt 2 and equally weighted variance 20 / N for unit noise, whatever N and the start.

    References
    ----------
    J. S. Tyo, Appl. Opt. 41 (2002) 619, doi:10.1364/AO.41.000619.
    """
    if frames < 3:
        raise ValueError(f"frames = {frames}; allowed is 3 or more")
    return start_rad + np.pi * np.arange(frames) / frames


def optimal_angles(frames: int, *, stokes_e: ArrayLike, floor_var_e2: float, aolp_known: bool) -> AngleChoice:
    """Return the polarizer angles that give the least sum of variances of the Stokes parameters.

    Parameters
    ----------
    frames
        Number of frames, at least 3.
    stokes_e
        Light that is expected, (S0, S1, S2) in electrons, S0 > 0, DoLP <= 1. Shot noise follows from it.
    floor_var_e2
        Variance of a channel without light (read noise, dark shot noise, quantisation) [e-^2], >= 0. Additive
        noise alone is the limit of a floor far above S0.
    aolp_known
        Whether the angle of polarization is known beforehand. If not, the mean over all angles counts.

    Returns
    -------
    AngleChoice
        Found by a local search from several starts if the angle of polarization is known.

    Raises
    ------
    ValueError
        If there are fewer than three frames, S0 or the floor is out of range, or DoLP is above 1.

    Notes
    -----
    An angle set made for one angle of polarization is worse than equal spacing at others. The variance of DoLP
    alone is no criterion: for a known angle of polarization it is least for frames along and across it only, which
    determine no angle of polarization any more.

    References
    ----------
    D. Lara and C. Paterson, Opt. Express 17 (2009) 21240, doi:10.1364/OE.17.021240: the least condition number is
    not the least variance under shot noise.
    """
    light = _checked_light(stokes_e, floor_var_e2)
    equal = equispaced_rad(frames)
    if not aolp_known:
        mean = _mean_over_aolp(equal, light, floor_var_e2)
        return AngleChoice(angles_rad=equal, variance_e2=mean, equispaced_variance_e2=mean, method="equal spacing")
    reference = _variance(equal, light, floor_var_e2)
    best, angles = reference, equal
    for turn in range(_TURNS):
        start = equispaced_rad(frames, start_rad=np.pi / frames * turn / _TURNS)
        found = minimize(_log_variance, start, args=(light, floor_var_e2), method="BFGS")
        value = _variance(found.x, light, floor_var_e2)
        if value < best:
            best, angles = value, np.sort(np.mod(found.x, np.pi))
    return AngleChoice(angles_rad=angles, variance_e2=best, equispaced_variance_e2=reference, method="search")


def _checked_light(stokes_e: ArrayLike, floor_var_e2: float) -> FloatArray:
    light = checked_stokes(stokes_e)
    if light.shape != (3,):
        raise ValueError(f"stokes_e has shape {light.shape}; allowed is (3,)")
    require_positive_intensity(light)
    if np.hypot(light[1], light[2]) > light[0] * (1.0 + 1e-12):
        raise ValueError(f"stokes_e has DoLP {np.hypot(light[1], light[2]) / light[0]:.4g}; allowed is at most 1")
    if not floor_var_e2 >= 0.0:
        raise ValueError(f"floor_var_e2 = {floor_var_e2} e-^2; allowed is at least 0")
    return light


def _log_variance(angles: FloatArray, light: FloatArray, floor: float) -> float:
    return float(np.log(_variance(angles, light, floor)))


def _variance(angles: FloatArray, light: FloatArray, floor: float) -> float:
    """Return the trace of the covariance of the generalised least-squares estimate."""
    rows = analyzer_row(angles)
    deviations = np.sqrt(np.maximum(rows @ light + floor, _LEAST_VAR_E2))
    singular = np.linalg.svd(rows / deviations[:, None], compute_uv=False)
    return float(np.sum(1.0 / np.maximum(singular, 1e-150) ** 2))


def _mean_over_aolp(angles: FloatArray, light: FloatArray, floor: float) -> float:
    polarized = float(np.hypot(light[1], light[2]))
    turns = 2.0 * np.pi * np.arange(48) / 48
    values = [
        _variance(angles, np.array([light[0], polarized * np.cos(turn), polarized * np.sin(turn)]), floor)
        for turn in turns
    ]
    return float(np.mean(values))
