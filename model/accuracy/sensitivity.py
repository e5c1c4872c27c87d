"""How what a user reads moves with the light of each region: a step of each component."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from model.accuracy.chain import ChainResult
from model.accuracy.quantities import Reading, readings, signed_differences
from model.lit_scene import LitScene
from model.performance import pair_detection
from model.prediction import predict
from model.scenario import RegionLight

FloatArray = NDArray[np.float64]
Changes = Mapping[Reading, float]

# Of the tolerance, as a share of S0: small beside what bends the law of a quantity, large beside its rounding.
_STEP = 0.3
_LEAST_STEP = 1e-7
# Of the largest component of an error what any may have at other places of the field.
_ELSEWHERE = 0.3


def sensitivity(scene: LitScene, result: ChainResult, region: RegionLight, *, tolerance: float) -> tuple[Changes, ...]:
    """Return for S0, S1 and S2 the change of each reading, in the units of a tolerance, per unit of its error.

    Parameters
    ----------
    scene, result
        What was evaluated, and what was found.
    region
        Of the result's scenario.
    tolerance
        That is asked for; it sets the step.

    References
    ----------
    Definition: one-sided differences.
    """
    size = max(_STEP * tolerance, _LEAST_STEP) * abs(float(region.stokes_radiance[0]))
    if size == 0.0:
        return ({}, {}, {})

    def per_unit(changed: RegionLight, step: float) -> Changes:
        return {key: change / step for key, change in changes(scene, result, changed).items()}

    steps = [_step(region, component, size) for component in range(3)]
    return tuple(per_unit(_moved(region, component, step), step) for component, step in enumerate(steps))


def changes(scene: LitScene, result: ChainResult, changed: RegionLight) -> dict[Reading, float]:
    """Return the change of each reading where the light of one region is another; infinite where it is lost.

    Parameters
    ----------
    scene, result
        What was evaluated, and what was found.
    changed
        The other light of the region of that name.
    """
    own = replace(result.scenario, regions=(changed,))
    concerned = [(pair, at) for at, pair in enumerate(scene.pairs) if changed.name in pair]
    before = replace(result.scenario, regions=tuple(r for r in result.scenario.regions if r.name == changed.name))
    base = readings(
        before,
        {changed.name: result.predictions[changed.name]},
        tuple(result.detections[at] for _, at in concerned),
    )
    try:
        alone = predict(own, tolerance=result.settings.dolp_tolerance)
    except ValueError:
        # Light that nothing sends, of a degree of polarization above 1: so near to it nothing is promised.
        return dict.fromkeys(base, np.inf)
    every = {**result.predictions, **alone}
    pairs = tuple(
        pair_detection(*pair, every, scene.p_false_alarm, tolerance=result.settings.roc_tolerance)
        for pair, _ in concerned
    )
    return signed_differences(base, readings(own, alone, pairs))


def _step(region: RegionLight, component: int, size: float) -> float:
    """Toward less polarization: beyond a degree of 1 there is no light."""
    return size if component == 0 or region.stokes_radiance[component] < 0.0 else -size


def _moved(region: RegionLight, component: int, step: float) -> RegionLight:
    """Light with one component moved; its texture goes with S0."""
    stokes = region.stokes_radiance.copy()
    stokes[component] += step
    grown = (stokes[0] / region.stokes_radiance[0]) ** 2
    return replace(region, stokes_radiance=stokes, texture_cov=grown * region.texture_cov)


def over_field(region: RegionLight) -> FloatArray:
    """Return the covariance of a region's light over its part of the field, shape (3, 3)."""
    return np.zeros((3, 3)) if region.field_cov is None else region.field_cov


def grown(cov: FloatArray, sizes: FloatArray) -> FloatArray:
    """Return a covariance whose deviations have grown by the sizes of an error along each of its principal axes.

    Parameters
    ----------
    cov
        Positive semi-definite, shape (3, 3).
    sizes
        Of the error's components, each 0 or more and one above, shape (3,).

    References
    ----------
    Definition: axes and deviations in units of the sizes, each deviation by 1.
    """
    unit = np.maximum(sizes, _ELSEWHERE * np.max(sizes))
    values, vectors = np.linalg.eigh(cov / np.outer(unit, unit))
    roots = np.sqrt(np.maximum(values, 0.0)) + 1.0
    return np.asarray((vectors * roots**2) @ vectors.T * np.outer(unit, unit))
