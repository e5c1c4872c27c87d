"""Numerical choices of the paper, and of a user, as points of error against time beside ours."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from model.accuracy.chain import DETECTION, ChainResult, Reading, Settings, Value, differences, evaluate, readings
from model.atmosphere.sky import Fidelity
from model.processing.dolp_studies import rx_draws
from model.scene.field import TileRule
from model.scene.scene import LitScene
from rigctl.errors import ConfigError

Clock = Callable[[], float]
Truth = Mapping[Reading, Value]

# [MK14] names these, or its text implies them.
_TILES = {9: 3, 25: 5, 100: 10}
_DRAWS = (1_000, 10_000, 100_000, 1_000_000)
_SEED = 2014
_LEAST_EXCEEDING = 1.0


@dataclass(frozen=True, kw_only=True)
class NamedChoice:
    """One choice of settings beside ours.

    Attributes
    ----------
    name
        In words.
    seconds
        Of the whole chain with it, nothing being kept from before [s].
    error, reading
        Largest true error of any number, and whose; 0 and None where no number differs.
    by_user
        Whether the user added it.
    """

    name: str
    seconds: float
    error: float
    reading: Reading | None
    by_user: bool = False


def named_choices(
    scene: LitScene, fine: Settings, truth: Truth, also: Sequence[str] = (), *, clock: Clock = time.perf_counter
) -> Iterator[NamedChoice]:
    """Yield the paper's choices and the user's, each in the place of one of some fine settings.

    Parameters
    ----------
    scene : LitScene
        To be predicted.
    fine : Settings
        Of all that a choice leaves open.
    truth : mapping
        Readings by the finest settings.
    also : sequence of str
        Choices of the user, such as "tiles_per_side=3,rule=midpoint".
    clock
        Seconds, rising.

    Raises
    ------
    ConfigError
        A choice cannot be read.

    References
    ----------
    [MK14] eq. (3), (8), (24), (25), section V.
    """
    own = [(text, settings_by(text, fine)) for text in also]
    for count, per_side in _TILES.items():
        tiled = replace(fine, tiles_per_side=per_side, tile_rule="midpoint", negligible_spread=0.0)
        yield _evaluated(f"K = {count} midpoint tiles", scene, tiled, truth, clock)
    yield _evaluated("sky kept every 10 deg", scene, replace(fine, sky_zeniths=9, sky_azimuths=36), truth, clock)
    yield _evaluated(
        "one effective wavelength", scene, replace(fine, wavelengths=1, split_at_kinks=False), truth, clock
    )
    yield from _single_scattering(scene, fine, truth, clock)
    result = evaluate(scene, fine, clock=clock)
    yield _first_order(result, truth)
    for draws in _DRAWS:
        yield from _drawn(result, truth, draws, clock)
    for text, settings in own:
        yield replace(_evaluated(text, scene, settings, truth, clock), by_user=True)


def settings_by(text: str, settings: Settings) -> Settings:
    """Return settings with some replaced, as "tiles_per_side=3,rule=midpoint" states them.

    Raises
    ------
    ConfigError
        It cannot be read, there is no such setting, or a value is out of range.
    """
    for part in text.split(","):
        key, _, value = (piece.strip() for piece in part.partition("="))
        if key not in _READ or not value:
            raise ConfigError(f"--also: is {text!r}, must be KEY=VALUE,... with keys {', '.join(_READ)}")
        try:
            settings = _READ[key](settings, value)
        except ValueError as error:
            raise ConfigError(f"--also: {key} = {value!r}: {error}") from error
    return settings


def _whole(least: int, most: int, put: Callable[[Settings, int], Settings]) -> Callable[[Settings, str], Settings]:
    def read(settings: Settings, text: str) -> Settings:
        if not text.removeprefix("-").isdecimal():
            raise ValueError(f"must be a whole number, {least} to {most}")
        number = int(text)
        if not least <= number <= most:
            raise ValueError(f"allowed is {least} to {most}")
        return put(settings, number)

    return read


def _part(least: float, most: float, put: Callable[[Settings, float], Settings]) -> Callable[[Settings, str], Settings]:
    def read(settings: Settings, text: str) -> Settings:
        try:
            number = float(text)
        except ValueError as error:
            raise ValueError(f"must be a number, {least:g} to {most:g}") from error
        if not least <= number <= most:
            raise ValueError(f"allowed is {least:g} to {most:g}")
        return put(settings, number)

    return read


def _rule(settings: Settings, text: str) -> Settings:
    for rule in get_args(TileRule):
        if text == rule:
            return replace(settings, tile_rule=rule)
    raise ValueError(f"allowed are {', '.join(get_args(TileRule))}")


_READ: Mapping[str, Callable[[Settings, str], Settings]] = {
    "tiles_per_side": _whole(1, 50, lambda one, n: replace(one, tiles_per_side=n, negligible_spread=0.0)),
    "rule": _rule,
    "wavelengths": _whole(1, 20, lambda one, n: replace(one, wavelengths=n)),
    "streams": _whole(4, 64, lambda one, n: replace(one, solver=replace(one.solver, nodes=n))),
    "sky_zeniths": _whole(4, 200, lambda one, n: replace(one, sky_zeniths=n)),
    "sky_azimuths": _whole(4, 200, lambda one, n: replace(one, sky_azimuths=n)),
    "hemisphere_tolerance": _part(1e-8, 0.1, lambda one, x: replace(one, hemisphere_tolerance=x)),
    "dolp_tolerance": _part(1e-13, 0.1, lambda one, x: replace(one, dolp_tolerance=x)),
    "roc_tolerance": _part(1e-12, 0.01, lambda one, x: replace(one, roc_tolerance=x)),
}


def _evaluated(name: str, scene: LitScene, settings: Settings, truth: Truth, clock: Clock) -> NamedChoice:
    result = evaluate(scene, settings, clock=clock)
    own = readings(result.scenario, result.predictions, result.detections)
    return _choice(name, sum(result.stage_s.values()), differences(own, truth))


def _choice(name: str, seconds: float, errors: Mapping[Reading, float]) -> NamedChoice:
    finite = {key: error for key, error in errors.items() if np.isfinite(error)}
    worst = max(finite, key=lambda key: finite[key], default=None)
    error = 0.0 if worst is None else finite[worst]
    return NamedChoice(name=name, seconds=seconds, error=error, reading=worst if error > 0.0 else None)


def _single_scattering(scene: LitScene, fine: Settings, truth: Truth, clock: Clock) -> Iterator[NamedChoice]:
    if scene.air is not None and scene.air.is_solved and scene.air.alternative is None:
        alone = replace(scene, air=replace(scene.air, fidelity=Fidelity.SINGLE))
        yield _evaluated("single scattering", alone, fine, truth, clock)


def _first_order(result: ChainResult, truth: Truth) -> NamedChoice:
    """Mean and deviation of DoLP by [MK14] eq. (24), (25), which a prediction has beside the exact ones."""
    errors = {}
    for region, prediction in result.predictions.items():
        for statistic in ("mean", "std"):
            key = Reading(region, "dolp_pixels", statistic)
            first = prediction.quantities.get("dolp", {}).get(statistic)
            if first is not None and key in truth:
                errors[key] = abs(first - truth[key].number) / (truth[key].scale or 1.0)
    return _choice("first-order DoLP", sum(result.stage_s.values()), errors)


def _drawn(result: ChainResult, truth: Truth, draws: int, clock: Clock) -> Iterator[NamedChoice]:
    """ROC by random vectors in the place of its integral."""
    generator, errors, start = np.random.default_rng(_SEED), {}, clock()
    for pair in result.detections:
        target, background = (result.predictions[name].stokes_dn for name in (pair.target, pair.background))
        # A threshold that fewer draws than this exceed cannot be drawn at all.
        rates = [rate for rate in pair.p_false_alarm if rate * draws >= _LEAST_EXCEEDING]
        try:
            drawn = rx_draws(
                rates,
                target.mean,
                target.cov,
                background.mean,
                background.cov,
                draws=draws,
                generator=generator,
                draw_threshold=True,
            )
        except ValueError:
            continue
        for rate, found in zip(rates, np.atleast_1d(drawn.p_detection), strict=True):
            key = Reading(f"{pair.target} on {pair.background}", "p_detection", f"{rate:g}")
            if key in truth:
                errors[key] = abs(float(found) - truth[key].number)
    if errors:
        chain = sum(seconds for stage, seconds in result.stage_s.items() if stage != DETECTION)
        yield _choice(f"ROC of {draws:.0e} draws".replace("e+0", "e"), chain + clock() - start, errors)
