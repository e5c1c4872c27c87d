"""Forecast of what each level of each setting leaves out and costs in a scene."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import isqrt

import numpy as np
from numpy.typing import NDArray

from model.accuracy.evaluation.chain import ChainResult
from model.accuracy.planning.numerical_settings import (
    HEMISPHERE,
    LAYERS,
    NUMERICAL_SETTINGS,
    SKY_GRID,
    STREAMS,
    TILES,
    WAVELENGTHS,
    Plan,
    at_level,
    settings_at,
    streams,
    tiles_per_side,
)
from model.accuracy.planning.spectral_error import spectral_errors
from model.atmosphere.profile import Column, column
from model.effects.names import ALL, Effect
from model.quadrature import gauss_legendre
from model.scene.lit_scene import Air, LitScene

# The convergence of the tiles is taken to be no steeper, for few tiles do not show a kink, and no flatter.
_FASTEST, _SLOWEST = 0.05, 0.7
# What streams miss, over the first term of the scattering function that they do not resolve; molecules have as much
# of it as an aerosol of this asymmetry.
_OF_TERM, _LEAST_ASYMMETRY = 0.5, 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Forecast:
    """Likely errors and efforts of a scene.

    Attributes
    ----------
    errors
        Setting to the likely relative error of the light at each of its levels, falling.
    efforts
        Setting to by what the time of its stage is multiplied at each of its levels, over the lowest.
    under_sky
        Scenes that share the time of one sky.
    """

    errors: Mapping[str, tuple[float, ...]]
    efforts: Mapping[str, tuple[float, ...]]
    under_sky: int = 1

    def error(self, plan: Plan, scales: Mapping[str, float]) -> float:
        """Return the sum of the errors that are to be expected, each multiplied by a scale of its setting."""
        return sum(scales[name] * self.errors[name][level] for name, level in plan.items())


def forecast(scene: LitScene, effects: frozenset[Effect] = ALL, *, under_sky: int = 1) -> Forecast:
    """Return the likely errors and efforts of all levels of all settings.

    Parameters
    ----------
    scene
        To be predicted.
    effects
        That act; without that of the wavelengths nothing is asked of the band.
    under_sky
        Scenes that share the time of its sky, such as those of a sweep of the camera.

    Notes
    -----
    The wavelengths are looked at for the scene itself: a narrow band needs one where a wide one needs four. So are the
    streams: the terms of a Henyey-Greenstein function fall as powers of its asymmetry.
    """
    errors = {name: tuple(level.error for level in setting.levels) for name, setting in NUMERICAL_SETTINGS.items()}
    efforts = {name: tuple(level.effort for level in setting.levels) for name, setting in NUMERICAL_SETTINGS.items()}
    found = [_of_wavelengths(air) for air in _computed(scene) if Effect.WAVELENGTHS in effects]
    if found:
        errors[WAVELENGTHS] = tuple(max(each) for each in zip(*(error for error, _ in found), strict=True))
        efforts[WAVELENGTHS] = tuple(max(each) for each in zip(*(effort for _, effort in found), strict=True))
    if _computed(scene):
        errors[STREAMS] = _of_streams(max(_asymmetry(air) for air in _computed(scene)))
    return Forecast(errors=errors, efforts=efforts, under_sky=under_sky)


def unused(effects: frozenset[Effect]) -> frozenset[str]:
    """Return the settings that say nothing where only some effects act: each is then at its lowest level.

    Parameters
    ----------
    effects
        That act.
    """
    rests_on = {
        WAVELENGTHS: {Effect.WAVELENGTHS},
        TILES: {Effect.FIELD_OF_VIEW},
        SKY_GRID: {Effect.SKYLIGHT},
        HEMISPHERE: {Effect.SKYLIGHT},
        STREAMS: {Effect.SKYLIGHT, Effect.PATH_RADIANCE},
        LAYERS: {Effect.SKYLIGHT, Effect.PATH_RADIANCE},
    }
    return frozenset(setting for setting, needed in rests_on.items() if not needed & effects)


def seen(ahead: Forecast, scene: LitScene, result: ChainResult) -> Forecast:
    """Return a forecast with the convergence of the tiles as a field shows it that was seen already.

    Parameters
    ----------
    ahead
        Before.
    scene, result
        What was evaluated, and what was found.

    References
    ----------
    Definition: an error of tiles falls with each more as the degrees of the field do.
    """
    fields = [np.stack([getattr(one, scene.source) for one in light.lights]) for light in result.lights.values()]
    found = [ratio for ratio in map(decay, fields) if ratio is not None]
    if not found:
        return ahead
    ratio = min(max(*found, _FASTEST), _SLOWEST)
    sides = np.array([tiles_per_side(level) for level in range(len(NUMERICAL_SETTINGS[TILES].levels))])
    return replace(ahead, errors={**ahead.errors, TILES: tuple((ratio**sides).tolist())})


def optical_depth(scene: LitScene) -> float:
    """Return the largest of the airs of a scene in the middle of its band; 0 where none is computed.

    Parameters
    ----------
    scene
        All that the scene is.
    """
    return max((_middle(air).depth for air in _computed(scene)), default=0.0)


def _computed(scene: LitScene) -> list[Air]:
    airs = [] if scene.air is None else [scene.air, scene.air.alternative]
    return [air for air in airs if air is not None and air.state is not None]


def _asymmetry(air: Air) -> float:
    """Return the largest of the aerosol in the middle of the band."""
    middle = _middle(air)
    return max(middle.lower.g, middle.upper.g)


def _middle(air: Air) -> Column:
    """Column of air at the middle of the band."""
    if air.state is None:
        raise ValueError("forecast: a table has no aerosol")
    spectrum = air.band.shares
    return column(air.state, wavelength_m=float(spectrum @ air.band.wavelength_m / np.sum(spectrum)))


def _of_streams(asymmetry: float) -> tuple[float, ...]:
    counts = np.array([streams(level) for level in range(len(NUMERICAL_SETTINGS[STREAMS].levels))])
    return tuple((_OF_TERM * max(asymmetry, _LEAST_ASYMMETRY) ** (2.0 * counts)).tolist())


def _of_wavelengths(air: Air) -> tuple[tuple[float, ...], tuple[float, ...]]:
    lowest = settings_at(dict.fromkeys(NUMERICAL_SETTINGS, 0), 1e-2)
    levels = range(len(NUMERICAL_SETTINGS[WAVELENGTHS].levels))
    found = spectral_errors(air, [at_level(lowest, WAVELENGTHS, level) for level in levels])
    return tuple(one.scattered for one in found), tuple(float(one.rule.wavelength_m.size) for one in found)


FloatArray = NDArray[np.float64]


def decay(values: FloatArray) -> float | None:
    """Return by how much each degree of a field over tiles is below the one before; None for tiles too few to tell.

    Parameters
    ----------
    values
        Of the tiles, row by row, shape (n * n, 3).

    Notes
    -----
    Of the last three degrees, for odd and even ones may fall apart; of three tiles a side of the two there are.
    """
    per_side = isqrt(len(values))
    sizes = [float(np.sqrt(np.trace(part))) for part in _by_degree(_coefficients(values))]
    steps = min(per_side - 2, 2)
    if steps < 1 or sizes[-1 - steps] == 0.0:
        return None
    return float((sizes[-1] / sizes[-1 - steps]) ** (1.0 / steps))


def last_degree(values: FloatArray) -> float:
    """Return the size of the highest degree of a field over tiles, over the mean of S0; 0 in the dark.

    Parameters
    ----------
    values
        Of the tiles, row by row, shape (n * n, 3).
    """
    s0 = float(np.mean(values[:, 0]))
    return float(np.sqrt(np.trace(_by_degree(_coefficients(values))[-1]))) / s0 if s0 > 0.0 else 0.0


def _coefficients(values: FloatArray) -> FloatArray:
    """Return those of the polynomial through the tiles, first over the height, shape (n, n, 3)."""
    per_side = isqrt(len(values))
    basis = _legendre(per_side)
    return np.asarray(np.einsum("ai,bj,ijc->abc", basis, basis, values.reshape(per_side, per_side, 3)))


def _by_degree(coefficients: FloatArray) -> list[FloatArray]:
    """Return the part of each degree from 1 on in the covariance, each (3, 3)."""
    degree = np.maximum(*np.indices(coefficients.shape[:2]))
    return [coefficients[degree == k].T @ coefficients[degree == k] for k in range(1, len(coefficients))]


def _legendre(per_side: int) -> FloatArray:
    """Return weights that give coefficients of orthonormal polynomials from values at the nodes, (degree, node)."""
    node, weight = gauss_legendre(per_side)
    plain = np.polynomial.legendre.legvander(2.0 * node - 1.0, per_side - 1)
    return np.asarray((plain * np.sqrt(2.0 * np.arange(per_side) + 1.0)).T * weight)
