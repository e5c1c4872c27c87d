"""Sensitivity of what a user reads to the light of each region: a step of each component."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model.accuracy.evaluation.chain import ChainResult
from model.accuracy.evaluation.quantities import Reading, Readings, readings, signed_differences
from model.prediction.pair_detection import PairDetection, detections_of_cases
from model.prediction.prediction import RegionPrediction, predict_all
from model.scene.lit_scene import LitScene
from model.scene.scenario import RegionLight

FloatArray = NDArray[np.float64]
Changes = Mapping[Reading, float]

# Of the tolerance, as a share of S0: small beside what bends the curve of a quantity, large beside its rounding. Of S1
# and S2 no more than this share of what is polarized, which bends DoLP, and no less than this share of the step of S0.
_STEP, _OF_POLARIZED, _LEAST_OF_STEP = 0.3, 0.3, 0.1
_LEAST_STEP = 1e-7
# Of the largest component of an error what any may have at other places of the field.
_ELSEWHERE = 0.3


@dataclass(frozen=True, kw_only=True, eq=False)
class Steps:
    """Steps of the light of a region, one of each component.

    Attributes
    ----------
    sizes
        Of S0, S1 and S2, with their signs, shape (3,) [W m-2 sr-1]; none is 0.
    lights
        The region's light with each of them.
    """

    sizes: FloatArray
    lights: tuple[RegionLight, ...]

    def per_unit(self, found: Sequence[Changes]) -> tuple[Changes, ...]:
        """Return the changes of the readings per unit of each component's error, of those that the steps made."""
        if not self.lights:
            return ({}, {}, {})
        pairs = zip(found, self.sizes.tolist(), strict=True)
        return tuple({key: change / size for key, change in each.items()} for each, size in pairs)


@dataclass(frozen=True, kw_only=True, eq=False)
class Texture:
    """Texture of a region, which what the surface reflects carries.

    Attributes
    ----------
    rms, diagonal
        As `model.scene.field_light.FieldLight.moments` takes them.
    reflected
        Mean Stokes radiance that the surface reflects, shape (3,) [W m-2 sr-1].
    """

    rms: float
    diagonal: tuple[float, float, float]
    reflected: FloatArray

    def change(self, step: FloatArray) -> FloatArray:
        """Return by how much its covariance changes where the reflected light does by a step, shape (3, 3)."""
        across = np.outer(self.reflected, step)
        of_factor = self.rms**2 * (across + across.T + np.outer(step, step))
        of_s0 = step[0] * (2.0 * self.reflected[0] + step[0])
        return np.asarray(of_factor + of_s0 * np.diag(np.square(self.diagonal)))


NO_STEPS = Steps(sizes=np.zeros(0), lights=())


def steps(region: RegionLight, texture: Texture, *, tolerance: float) -> Steps:
    """Return steps small beside what bends the curve of a quantity, and large beside its rounding; none in the dark.

    Parameters
    ----------
    region
        Light of a region.
    texture
        Its texture.
    tolerance
        That is asked for.

    References
    ----------
    Definition: one-sided differences, of light that the surface reflects. Toward more polarization, where DoLP bends so
    that they are rather too large; toward less near a degree of 1, beyond which there is no light.
    """
    s0, polarized = abs(float(region.stokes_radiance[0])), float(np.hypot(*region.stokes_radiance[1:]))
    size = max(_STEP * tolerance, _LEAST_STEP) * s0
    if size == 0.0:
        return NO_STEPS
    smaller = min(size, max(_OF_POLARIZED * polarized, _LEAST_OF_STEP * size))
    outward = np.where(region.stokes_radiance < 0.0, -1.0, 1.0)
    sign = 1.0 if polarized + smaller < s0 else -1.0
    sizes = outward * np.array([size, sign * smaller, sign * smaller])
    return Steps(sizes=sizes, lights=tuple(_moved(region, texture, step) for step in np.diag(sizes)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Alternatives:
    """Other lights of the regions of a case.

    Attributes
    ----------
    scene, result
        What was evaluated, and what was found.
    lights
        Region to its other lights; of all others the light stays.
    """

    scene: LitScene
    result: ChainResult
    lights: Mapping[str, Sequence[RegionLight]]

    @property
    def each(self) -> list[tuple[str, RegionLight]]:
        """Region and light, one after the other."""
        return [(name, light) for name, lights in self.lights.items() for light in lights]


def changes(cases: Sequence[Alternatives]) -> list[dict[str, list[dict[Reading, float]]]]:
    """Return region to the changes of the readings for each other light of it; infinite where a reading is lost.

    Parameters
    ----------
    cases
        One or more, of the same tolerances of DoLP and ROC: all are predicted together.
    """
    alone = iter(_predicted([(case.result, light) for case in cases for _, light in case.each]))
    predicted = [[(name, light, next(alone)) for name, light in case.each] for case in cases]
    pairs = [
        (*pair, {**case.result.predictions, name: found})
        for case, lights in zip(cases, predicted, strict=True)
        for name, _, found in lights
        if found is not None
        for pair in case.scene.pairs
        if name in pair
    ]
    rates, settings = cases[0].scene.p_false_alarm, cases[0].result.settings
    detections = iter(detections_of_cases(pairs, rates, tolerance=settings.roc_tolerance))
    return [_changed(case, lights, detections) for case, lights in zip(cases, predicted, strict=True)]


def _changed(
    case: Alternatives,
    predicted: Sequence[tuple[str, RegionLight, RegionPrediction | None]],
    detections: Iterator[PairDetection],
) -> dict[str, list[dict[Reading, float]]]:
    bases = {name: _base(case.scene, case.result, name) for name in case.lights}
    changed: dict[str, list[dict[Reading, float]]] = {name: [] for name in case.lights}
    for name, light, found in predicted:
        if found is None:
            changed[name].append(dict.fromkeys(bases[name], np.inf))
            continue
        of_pairs = tuple(next(detections) for pair in case.scene.pairs if name in pair)
        there = readings(replace(case.result.scenario, regions=(light,)), {name: found}, of_pairs)
        changed[name].append(signed_differences(bases[name], there))
    return changed


def _base(scene: LitScene, result: ChainResult, name: str) -> Readings:
    """Return the readings that the light of a region acts on."""
    before = replace(result.scenario, regions=tuple(r for r in result.scenario.regions if r.name == name))
    concerned = tuple(found for pair, found in zip(scene.pairs, result.detections, strict=True) if name in pair)
    return readings(before, {name: result.predictions[name]}, concerned)


def _predicted(lights: Sequence[tuple[ChainResult, RegionLight]]) -> list[RegionPrediction | None]:
    """Predictions of other lights of regions; None for light that nothing sends, polarized to more than 1."""
    if not lights:
        return []
    alone = [replace(result.scenario, regions=(one,)) for result, one in lights]
    try:
        found = predict_all(alone, tolerance=lights[0][0].settings.dolp_tolerance)
    except ValueError:
        # One that nothing sends is refused together with all others: each is asked for itself then.
        return [found for one in lights for found in _predicted((one,))] if len(lights) > 1 else [None]
    return [one[light.name] for one, (_, light) in zip(found, lights, strict=True)]


def _moved(region: RegionLight, texture: Texture, step: FloatArray) -> RegionLight:
    """Light of which the surface reflects more by a step, with the texture that this has."""
    return replace(
        region,
        stokes_radiance=region.stokes_radiance + step,
        texture_cov=region.texture_cov + texture.change(step),
    )


def dimmed(region: RegionLight, share: float) -> RegionLight:
    """Return light that is less by a share, with its texture, and as much polarized."""
    left = 1.0 - share
    return replace(region, stokes_radiance=left * region.stokes_radiance, texture_cov=left**2 * region.texture_cov)


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
