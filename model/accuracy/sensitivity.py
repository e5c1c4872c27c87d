"""How what a user reads moves with the light of each region: a step of each component, and of the field's spread."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model.accuracy.chain import ChainResult
from model.accuracy.light_error import LightError
from model.accuracy.quantities import Reading, differences, readings
from model.lit_scene import LitScene
from model.moments import covariance_factor
from model.performance import pair_detection
from model.prediction import predict
from model.scenario import RegionLight, Scenario

FloatArray = NDArray[np.float64]

# Of the tolerance, as a share of S0: small beside what bends the law of a quantity, large beside its rounding.
_STEP = 0.3
_LEAST_STEP = 1e-7


@dataclass(frozen=True, kw_only=True, eq=False)
class Sensitivity:
    """Change of each reading, in the units of a tolerance, per unit of an error of the light of one region.

    Attributes
    ----------
    by_stokes
        For S0, S1 and S2.
    by_field
        For an error that differs over the field.
    """

    by_stokes: tuple[Mapping[Reading, float], ...]
    by_field: Mapping[Reading, float]


def sensitivities(scene: LitScene, result: ChainResult, *, tolerance: float) -> dict[str, Sensitivity]:
    """Return region to how the readings move with its light, for the regions that are given by a material.

    Parameters
    ----------
    scene
        That was evaluated.
    result
        What was found.
    tolerance
        That is asked for; it sets the step.

    References
    ----------
    Definition: one-sided differences.
    """
    base = readings(result.scenario, result.predictions, result.detections)
    step = max(_STEP * tolerance, _LEAST_STEP)
    found = {}
    for region in result.scenario.regions:
        if region.name not in result.lights:
            continue
        size = step * abs(float(region.stokes_radiance[0]))
        moved = [_moved(region, component, size) for component in range(3)]
        by_stokes = tuple(_scaled(differences_of(scene, result, base, one), size) for one in moved)
        several = len(result.lights[region.name].lights) > 1
        by_field = _scaled(differences_of(scene, result, base, _spread(region, size)), size) if several else {}
        found[region.name] = Sensitivity(by_stokes=by_stokes, by_field=by_field)
    return found


def differences_of(
    scene: LitScene, result: ChainResult, base: Mapping[Reading, object], changed: RegionLight
) -> dict[Reading, float]:
    """Return by how much each reading differs where the light of one region is another.

    Parameters
    ----------
    scene, result
        That were evaluated.
    base
        Readings of the result.
    changed
        The other light.
    """
    own = replace(result.scenario, regions=(changed,))
    try:
        alone = predict(own, tolerance=result.settings.dolp_tolerance)
    except ValueError:
        # Light that no scene can have, such as a degree of polarization above 1: nothing is promised so near to it.
        return {key: np.inf for key in base if _concerns(key, changed.name)}
    predictions = {**result.predictions, **alone}
    pairs = tuple(
        pair_detection(target, background, predictions, scene.p_false_alarm, tolerance=result.settings.roc_tolerance)
        for target, background in scene.pairs
        if changed.name in (target, background)
    )
    other = readings(own, alone, pairs)
    concerned = {key: value for key, value in _all(result).items() if _concerns(key, changed.name)}
    return differences(concerned, other)
