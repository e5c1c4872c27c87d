"""Estimates of what leaving out effects changes: a coarse evaluation of the chain with and without each of them."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from model.accuracy.effect_check import change, readings_of
from model.accuracy.evaluation.chain import evaluate
from model.accuracy.evaluation.light_store import LightStore
from model.accuracy.evaluation.quantities import Reading, Readings, differences
from model.accuracy.evaluation.settings import Settings
from model.accuracy.planning.numerical_settings import NUMERICAL_SETTINGS, settings_at
from model.effects.bound import Bound, Estimate
from model.effects.names import ALL, Effect
from model.effects.planner import LIGHT
from model.prediction.quantity_table import SHARES
from model.scene.lit_scene import LitScene

# The coarse chain: fewest streams and layers, a small grid of the sky, two by two tiles; its light is good to some
# hundredths, and so is what a part of it changes.
_GRID, _HEMISPHERE, _TILES, _ORDERS, _ELEMENT_DEPTH = 8, 1.0, 2, 1e-3, 0.2
_STATISTICS, _POINT = 1e-4, 1e-9
# Errors as shares of the change: of light as the coarse chain has it, and of numbers that only rest on such light.
# Beside them the square of the change: what two effects do together is their sum to first order only.
_OF_LIGHT, _OF_OTHERS = 0.3, 0.1
# Of the change of the polarised light over itself: light that is turned, and no less polarised, changes no SNR to first
# order, but the coarse chain has its direction no better than its amount.
_OF_TURNED, _NO_DOLP = 0.2, 1e-12


def estimate_effects(
    scene: LitScene, bounds: Mapping[Effect, Bound], *, limit: float = np.inf, store: LightStore | None = None
) -> dict[Effect, Estimate]:
    """Return what leaving out each of some effects changes, as a coarse evaluation has it.

    Parameters
    ----------
    scene
        All that the scene is.
    bounds
        Which effects, with their bounds. One without which nothing can be predicted has no estimate.
    limit
        Detection, which costs more than all else, is evaluated only for effects whose other changes, with their
        errors, are no larger, and whose bound of detection is larger; for the others it is infinite.
    store
        Keeps skies and lights between calls; None for a new one.

    Raises
    ------
    ValueError
        A number of the scene is outside its range.

    Notes
    -----
    One at a time, so that the sum over several is right to first order. The error is three tenths of the change for
    light before the lens, one tenth for all others, and the square of the change; it rests on the trial of
    docs/effects.md, and not on a proof.
    """
    effects = frozenset(bounds)
    if not effects:
        return {}
    lights = LightStore() if store is None else store
    settings = coarse_settings(scene, wavelengths=2 if Effect.WAVELENGTHS in effects else 1)
    alone = _estimates(replace(scene, pairs=()), settings, effects, lights)
    if not scene.pairs:
        return alone
    small = frozenset(
        effect
        for effect, one in alone.items()
        if np.isinf(limit) or (one.most.largest <= limit and bounds[effect].detection > limit)
    )
    unknown = {effect: _without_detection(one) for effect, one in alone.items() if effect not in small}
    return unknown | _estimates(scene, settings, small, lights)


def _estimates(
    scene: LitScene, settings: Settings, effects: frozenset[Effect], store: LightStore
) -> dict[Effect, Estimate]:
    if not effects:
        return {}
    seen: dict[frozenset[Effect], Readings] = {}

    def without(left_out: frozenset[Effect]) -> Readings:
        if left_out not in seen:
            seen[left_out] = readings_of(evaluate(scene, settings, effects=ALL - left_out, store=store))
        return seen[left_out]

    found = {}
    for effect in (one for one in Effect if one in effects):
        # What one wavelength misses is looked at in the middle of each field, where light costs least.
        beside = frozenset({Effect.FIELD_OF_VIEW}) if effect is Effect.WAVELENGTHS else frozenset()
        try:
            value = change(without(beside), without(beside | {effect}))
        except ValueError:
            continue
        error = _error(effect, value)
        turned = _OF_TURNED * _turned(without(beside), without(beside | {effect}))
        found[effect] = Estimate(value=value, error=replace(error, deviations=error.deviations + turned))
    return found


def _turned(whole: Readings, without: Readings) -> float:
    """Largest change of polarised light over that light: the SNR of a region may change so much, or hardly at all."""
    apart = differences(whole, without)
    moved: dict[str, float] = {}
    for reading, change_of in apart.items():
        if reading.quantity in SHARES and reading.statistic == "mean":
            moved[reading.place] = max(moved.get(reading.place, 0.0), change_of)
    return max((size / _dolp(whole, place) for place, size in moved.items() if size > 0.0), default=0.0)


def _dolp(whole: Readings, place: str) -> float:
    found = whole.get(Reading(place, "dolp", "mean"))
    return 0.0 if found is None else max(found.number, _NO_DOLP)


def _without_detection(found: Estimate) -> Estimate:
    return replace(found, value=replace(found.value, detection=np.inf))


def coarse_settings(scene: LitScene, *, wavelengths: int) -> Settings:
    """Return the settings of the coarse chain.

    Parameters
    ----------
    scene
        Its sensor's height is where a layer ends.
    wavelengths
        1, or 2 to tell what one of them misses.
    """
    lowest = settings_at(dict.fromkeys(NUMERICAL_SETTINGS, 0), _STATISTICS, face_m=scene.sensor_height_m)
    return replace(
        lowest,
        wavelengths=wavelengths,
        solver=replace(lowest.solver, tolerance=_ORDERS, element_depth=_ELEMENT_DEPTH),
        sky_zeniths=_GRID,
        sky_azimuths=_GRID,
        hemisphere_tolerance=_HEMISPHERE,
        tiles_per_side=_TILES,
        negligible_spread=_POINT,
        dolp_tolerance=_STATISTICS,
        roc_tolerance=_STATISTICS,
    )


def _error(effect: Effect, value: Bound) -> Bound:
    share = _OF_LIGHT if effect in LIGHT else _OF_OTHERS
    # Light that is missed here is a ratio that is missed there.
    of_means = max(value.radiance, value.ratios) if effect in LIGHT else value.ratios
    return Bound(
        radiance=value.radiance * (share + value.radiance),
        ratios=share * of_means + value.ratios**2,
        deviations=value.deviations * (share + value.deviations),
        detection=value.detection * (share + value.detection),
    )
