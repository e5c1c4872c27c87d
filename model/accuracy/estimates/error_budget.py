"""Error budget of what a user reads, from errors of the light: per setting, and their sum."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import repeat

import numpy as np
from numpy.typing import NDArray

from model.accuracy.estimates.light_error import LightError
from model.accuracy.estimates.more_tiles import Asked, on_more_tiles
from model.accuracy.estimates.sensitivity import (
    NO_STEPS,
    Alternatives,
    Changes,
    Steps,
    Texture,
    changes,
    dimmed,
    grown,
    over_field,
    steps,
)
from model.accuracy.evaluation.chain import ChainResult
from model.accuracy.evaluation.quantities import Reading, readings
from model.accuracy.planning.numerical_settings import DOLP, ROC, TILES
from model.effects.acting import acting
from model.scene.lit_scene import LitScene
from model.scene.scenario import RegionLight

FloatArray = NDArray[np.float64]

# What one more tile along each side changes is what the tiles miss: of the fields of 240 random scenes, by 3 to 5
# tiles, the middle one by a few hundredths more or less, one of twenty by 0.8 of it or less. A kink may hide from it.
_OF_MORE_TILES = 2.0

# Light of a region whose covariance over the field has grown by what errors differ there.
_WIDER = "wider"
# Light that is less by all that its errors may take from S0: what exists by a hair may not exist there.
_DIMMER = "dimmer"


@dataclass(frozen=True, kw_only=True, eq=False)
class Budget:
    """Estimated numerical errors of a prediction, in the units of a tolerance.

    Attributes
    ----------
    by_setting
        Setting to reading to error; readings that a setting does not touch are left out.
    total
        Reading to the sum over the settings: all are of one kind, may have one sign, and are added as they are.
    """

    by_setting: Mapping[str, Mapping[Reading, float]]
    total: Mapping[Reading, float]

    def worst(self, setting: str) -> float:
        """Return the largest error of a setting."""
        return max(self.by_setting.get(setting, {}).values(), default=0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class LitCase:
    """A case whose light has errors that are known.

    Attributes
    ----------
    scene, result
        What was evaluated, and what was found.
    lights
        Setting to region to the error of its light.
    """

    scene: LitScene
    result: ChainResult
    lights: Mapping[str, Mapping[str, LightError]]

    def errors(self, name: str) -> dict[str, LightError]:
        """Return setting to the error of the light of a region."""
        return {setting: found[name] for setting, found in self.lights.items() if name in found}


def error_budget(
    scene: LitScene,
    result: ChainResult,
    lights: Mapping[str, Mapping[str, LightError]],
    *,
    tolerance: float,
    tiles: bool = True,
) -> Budget:
    """Return the estimated errors of all readings of a result.

    Parameters
    ----------
    scene, result, lights
        As `LitCase` has them.
    tolerance
        That is asked for.
    tiles
        Whether one more tile along each side is tried; else nothing is said of the tiles.

    References
    ----------
    Definition: first order in the errors of the light, whose signs are not known.
    """
    return error_budgets((LitCase(scene=scene, result=result, lights=lights),), tolerance=tolerance, tiles=tiles)[0]


def error_budgets(cases: Sequence[LitCase], *, tolerance: float, tiles: bool = True) -> list[Budget]:
    """Return what `error_budget` does for each of several cases, all in few array passes.

    Parameters
    ----------
    cases
        Evaluated with the same tolerances of DoLP and ROC.
    tolerance, tiles
        As in `error_budget`.
    """
    asked = [
        (place, region)
        for place, case in enumerate(cases)
        for region in case.result.scenario.regions
        if region.name in case.result.lights
    ]
    finer: Iterable[RegionLight | None] = repeat(None)
    if tiles:
        finer = on_more_tiles([Asked(cases[place].scene, cases[place].result, region.name) for place, region in asked])
    tried: list[dict[str, _Tried]] = [{} for _ in cases]
    for (place, region), more in zip(asked, finer, strict=tiles):
        tried[place][region.name] = _tried(cases[place], region, more, tolerance=tolerance)
    changed = changes(
        [
            Alternatives(
                scene=case.scene,
                result=case.result,
                lights={name: one.lights for name, one in regions.items() if one.lights},
            )
            for case, regions in zip(cases, tried, strict=True)
        ]
    )
    return [_budget(case, of, found) for case, of, found in zip(cases, tried, changed, strict=True)]


def _budget(case: LitCase, tried: Mapping[str, "_Tried"], changed: Mapping[str, Sequence[Changes]]) -> Budget:
    result = case.result
    by_setting: dict[str, dict[Reading, float]] = {setting: defaultdict(float) for setting in case.lights}
    for name, of_region in changed.items():
        for setting, found in tried[name].changed(of_region):
            _add(by_setting[setting], found)
    by_setting |= {DOLP: _of_dolp(result), ROC: _of_detection(result)}
    every = readings(result.scenario, result.predictions, result.detections)
    total = {key: sum(errors.get(key, 0.0) for errors in by_setting.values()) for key in every}
    return Budget(by_setting={setting: dict(errors) for setting, errors in by_setting.items()}, total=total)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Tried:
    """Other lights of a region, by which its errors are carried to what a user reads.

    Attributes
    ----------
    errors
        Setting to the error of the light, where there is one.
    steps
        Of each component.
    others
        The light with its covariance as wide as the errors may make it, as dim, and over one more tile along each side.
    """

    errors: Mapping[str, LightError]
    steps: Steps
    others: Mapping[str, RegionLight]

    @property
    def lights(self) -> tuple[RegionLight, ...]:
        """All of them."""
        return (*self.steps.lights, *self.others.values())

    def changed(self, found: Sequence[Changes]) -> Iterator[tuple[str, Changes]]:
        """Yield settings and changes: by their errors, by differences of these over the field, by the tiles.

        Of dimmer light it counts alone what does not exist there.
        """
        moves = self.steps.per_unit(found[: len(self.steps.lights)])
        changed = dict(zip(self.others, found[len(self.steps.lights) :], strict=True))
        differ = _differ(self.errors)
        for setting, error in self.errors.items():
            if not np.all(np.isfinite(error.field)):
                # Nothing is known of the light there, as of the air along a line of sight at the horizon.
                yield setting, dict.fromkeys((key for each in moves for key in each), np.inf)
                continue
            yield setting, _moved(moves, error)
            yield setting, {key: change for key, change in changed.get(_DIMMER, {}).items() if not np.isfinite(change)}
            if _WIDER in changed and np.any(error.field):
                share = float(np.mean((error.field / differ)[differ > 0.0]))
                yield setting, {key: share * abs(change) for key, change in changed[_WIDER].items()}
        if TILES in changed:
            yield TILES, {key: _OF_MORE_TILES * abs(change) for key, change in changed[TILES].items()}


def _tried(case: LitCase, region: RegionLight, more_tiles: RegionLight | None, *, tolerance: float) -> _Tried:
    there = {setting: error for setting, error in case.errors(region.name).items() if not error.is_nothing}
    differ = _differ(there)
    others: dict[str, RegionLight] = {}
    if np.all(np.isfinite(differ)) and np.any(differ):
        others[_WIDER] = replace(region, field_cov=grown(over_field(region), differ))
    less, s0 = sum(error.largest for error in there.values()), float(region.stokes_radiance[0])
    if 0.0 < less < s0:
        others[_DIMMER] = dimmed(region, less / s0)
    if more_tiles is not None:
        others[TILES] = more_tiles
    texture = _texture(case.scene, case.result, region.name)
    return _Tried(errors=there, steps=steps(region, texture, tolerance=tolerance) if there else NO_STEPS, others=others)


def _texture(scene: LitScene, result: ChainResult, name: str) -> Texture:
    given = next(region for region in acting(scene, result.effects).regions if region.name == name)
    source = "reflected" if scene.source == "total" else scene.source
    reflected = result.lights[name].moments(source, texture_cov=np.zeros((3, 3))).mean
    if scene.source == "path":
        return Texture(rms=0.0, diagonal=(0.0, 0.0, 0.0), reflected=reflected)
    return Texture(rms=given.texture_rms, diagonal=given.texture_diagonal, reflected=reflected)


def _differ(errors: Mapping[str, LightError]) -> FloatArray:
    """Return how far the errors of all settings together may differ over the field."""
    return sum((error.field for error in errors.values()), np.zeros(3))


def _add(errors: dict[Reading, float], more: Changes) -> None:
    for key, error in more.items():
        errors[key] += error


def _moved(moves: tuple[Changes, ...], error: LightError) -> Changes:
    """Size of what errors make that come together, and sizes of what may have any sign."""
    found: dict[Reading, float] = defaultdict(float)
    for row in error.together:
        together: dict[Reading, float] = defaultdict(float)
        for change, size in zip(moves, row.tolist(), strict=True):
            if size != 0.0:
                _add(together, {key: each * size for key, each in change.items()})
        _add(found, {key: abs(each) for key, each in together.items()})
    for change, size in zip(moves, error.apart.tolist(), strict=True):
        if size > 0.0:
            _add(found, {key: abs(each) * size for key, each in change.items()})
    return found


def _of_dolp(result: ChainResult) -> dict[Reading, float]:
    """Return what the distribution of DoLP says of itself."""
    found = {}
    for name, one in result.predictions.items():
        numbers = one.quantities.get("dolp_pixels")
        if numbers is None:
            continue
        mean = one.dolp_mean_error
        found[Reading(name, "dolp_pixels", "mean")] = mean
        if numbers["std"] == 0.0:
            # Nothing fluctuates: there is no deviation to be off, and no SNR.
            continue
        std = one.dolp_std_error / numbers["std"]
        found[Reading(name, "dolp_pixels", "std")] = std
        found[Reading(name, "dolp_snr", "mean")] = mean / numbers["mean"] + std
    return found


def _of_detection(result: ChainResult) -> dict[Reading, float]:
    found = {}
    for pair in result.detections:
        place = f"{pair.target} on {pair.background}"
        for rate, error in zip(pair.p_false_alarm, pair.p_detection_error, strict=True):
            found[Reading(place, "p_detection", f"{rate:g}")] = float(error)
        found[Reading(place, "auc", "whole curve")] = pair.auc_error
    return found
