"""Influence of single flats: which stand off what the others say, and on which axis."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calibration.sensor.curve_model import CurveModel
from calibration.sensor.frame_statistics import LevelStatistics
from calibration.sensor.light_stability import LightStability, wander_variance_dn2
from calibration.sensor.outlying_points import PointInfluence, point_influence
from calibration.sensor.rounding_error import least_noise_dn2, mean_rounding_error_dn
from calibration.sensor.transfer_points import TransferPoints

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]
LightName = Literal["exposure", "photons"]

# Chances that a sound set has a flat named on one axis; with those of the darks below 1 %.
_FALSE_VARIANCE, _FALSE_LIGHT = 1e-3, 1.5e-3
_LEAST_LEVELS = 5
# Exposures are longer or shorter than stated by a fixed time: some microseconds of a sweep of ten milliseconds.
_USUAL_OFFSET = 3e-4
# Usual sizes of what a sweep may have besides, in shares of the brightest: an offset, bends of response and of noise.
_OFFSET, _BEND_OF_RESPONSE, _BEND_OF_NOISE = 0.02, 0.1, 0.2


def noise_influence(points: TransferPoints, used: Mask) -> PointInfluence | None:
    """Return each used point of a photon-transfer curve beside the curve through the others.

    Parameters
    ----------
    points
        Of the curve.
    used
        Levels that stand on it, shape (K,).
    """
    signal, variance = points.signal_dn[used], points.variance_dn2[used]
    gain = float(np.median(variance / signal))
    dark = float(np.median(points.flat_variance_dn2[used] - variance))
    relative = points.flat_std_error_dn2[used] / points.flat_variance_dn2[used]
    own = np.square(relative * np.maximum(dark + gain * signal, 0.0)) + np.diag(points.dark_covariance_dn4)[used]
    scaled = signal / signal.max()
    models = [
        CurveModel(
            design=np.column_stack([scaled**power for power in powers]),
            scatter_shape=signal,
            term_sizes=abs(gain) * signal.max() * np.where(np.equal(powers, 1), np.inf, _BEND_OF_NOISE),
        )
        for powers in ((1,), (1, 2), (1, 2, 3))
    ]
    return point_influence(models, variance, own, abscissa=signal, p_false=_FALSE_VARIANCE)


@dataclass(frozen=True, kw_only=True, eq=False)
class LightInfluence:
    """The means of flats beside the response to the light.

    Attributes
    ----------
    light : {"exposure", "photons"}
        What the light was taken to be proportional to.
    points : PointInfluence
        Of the levels that were judged.
    """

    light: LightName
    points: PointInfluence


def light_influence(
    flats: Sequence[LevelStatistics], signal_dn: FloatArray, own_dn2: FloatArray
) -> tuple[LightInfluence, ...]:
    """Return the flats beside the response to their light, the light that they follow best first.

    Parameters
    ----------
    flats : sequence of LevelStatistics
        Below saturation.
    signal_dn : (n,) array
        Their means, dark taken off, > 0 [DN].
    own_dn2 : (n,) array
        Variance of these by noise, rounding and wander of the light [DN^2].

    Notes
    -----
    Exposures, photons, both or neither may be stated. Scatter of the levels beyond their own errors is in proportion to
    the signal (the lamp) or, where that explains more than one wrong level would, the same at all (steps of exposures).
    """
    lights: tuple[tuple[LightName, FloatArray], ...] = (("exposure", _exposures(flats)), ("photons", _photons(flats)))
    found = [
        LightInfluence(light=name, points=points)
        for name, light in lights
        if (points := _beside_response(signal_dn, light, own_dn2)) is not None
    ]
    return tuple(sorted(found, key=lambda one: one.points.cost))


def _exposures(flats: Sequence[LevelStatistics]) -> FloatArray:
    return np.array([np.nan if flat.exposure_s is None else flat.exposure_s for flat in flats])


def _photons(flats: Sequence[LevelStatistics]) -> FloatArray:
    return np.array([np.nan if flat.photons is None else flat.photons for flat in flats])


def stated_light(flats: Sequence[LevelStatistics]) -> FloatArray | None:
    """Return photons or exposures of flats, None where neither is known of all or they do not differ.

    Parameters
    ----------
    flats : sequence of LevelStatistics
        In any order.
    """
    known = [light for light in (_photons(flats), _exposures(flats)) if not np.isnan(light).any()]
    return next((light for light in known if len(np.unique(light)) > len(light) // 2), None)


def is_lamp_sweep(flats: Sequence[LevelStatistics]) -> bool:
    """Return whether the light of flats was varied by the lamp, at one exposure or at unknown ones.

    Parameters
    ----------
    flats : sequence of LevelStatistics
        In any order.
    """
    return len(flats) > 1 and len({flat.exposure_s for flat in flats}) <= max(1, len(flats) // 4)


def mean_variance_dn2(flats: Sequence[LevelStatistics], signal_dn: FloatArray, stability: LightStability) -> FloatArray:
    """Return the variance of the means of flats by noise of pixels, rounding and wander of the light [DN^2].

    Parameters
    ----------
    flats
        Statistics of each level.
    signal_dn
        Mean of each level, dark level off, shape (K,) [DN].
    stability
        How the light wanders.
    """
    temporal = np.array([flat.temporal_variance_dn2 for flat in flats])
    spatial = np.array([max(flat.ordinary.variance_dn2, 0.0) for flat in flats])
    n_frames = np.array([float(flat.n_frames) for flat in flats])
    n_pixels = np.array([float(flat.n_pixels) for flat in flats])
    rounding = mean_rounding_error_dn(least_noise_dn2(temporal, spatial) + spatial)
    variance: FloatArray = (
        temporal / n_pixels + wander_variance_dn2(flats, signal_dn, stability)
    ) / n_frames + np.square(rounding)
    return variance


def _beside_response(signal_dn: FloatArray, light: FloatArray, own_dn2: FloatArray) -> PointInfluence | None:
    if np.isnan(light).any() or len(np.unique(light)) < max(_LEAST_LEVELS, len(light) // 2 + 1):
        return None
    scaled = light / light.max()
    even, full = np.full(len(light), float(np.median(signal_dn))), float(signal_dn.max())
    bends = (np.inf, _BEND_OF_RESPONSE, _BEND_OF_RESPONSE)
    models = [
        CurveModel(
            design=scaled[:, None] ** np.arange(n_terms),
            scatter_shape=shape,
            first_term_std=_USUAL_OFFSET * full if offset == _USUAL_OFFSET else None,
            term_sizes=full * np.array([offset, *bends][:n_terms]),
            is_usual=shape is signal_dn and offset == _USUAL_OFFSET,
        )
        for n_terms in (2, 3, 4)
        for offset in (_USUAL_OFFSET, _OFFSET)
        for shape in (signal_dn, even)
    ]
    without_offset = [
        CurveModel(
            design=scaled[:, None] ** np.arange(1, n_terms),
            scatter_shape=signal_dn,
            term_sizes=full * np.array(bends[: n_terms - 1]),
            is_through_zero=True,
        )
        for n_terms in (2, 3, 4)
    ]
    return point_influence([*models, *without_offset], signal_dn, own_dn2, abscissa=light, p_false=_FALSE_LIGHT)
