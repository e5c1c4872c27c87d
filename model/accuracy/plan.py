"""Plans: levels of the numerical settings, forecasts of their errors and times, and the choice of levels.

The errors and times of the levels are those of one scene (23 km visibility, sun at 50 deg, one core), which tells a
plan where to begin. The errors that a result states are estimated on its own scene (`model.accuracy.errors`).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from math import isqrt
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from model.accuracy.chain import ChainResult, LightStore, Reading, Settings
from model.atmosphere.air import (
    AerosolSpectrum,
    AtmosphereState,
    Column,
    aerosol_spectra,
    column,
    kinks_m,
    ozone_optical_depth,
    rayleigh_optical_depth,
)
from model.atmosphere.sky import SolverSettings, SpectralRule, spectral_rule
from model.effects.effect import ALL, Effect
from model.numerics import gauss_legendre
from model.scene.scene import Air, LitScene

FloatArray = NDArray[np.float64]

STREAMS, LAYERS, WAVELENGTHS, SKY_GRID, HEMISPHERE, TILES, DOLP, ROC = (
    "streams",
    "layers",
    "wavelengths",
    "sky grid",
    "hemisphere",
    "tiles",
    "DoLP order",
    "ROC",
)


@dataclass(frozen=True, kw_only=True)
class Level:
    """One position of a setting."""

    label: str
    error: float
    effort: float


@dataclass(frozen=True, kw_only=True)
class NumericalSetting:
    """One thing that costs time and buys accuracy."""

    levels: tuple[Level, ...]


def _levels(labels: tuple[str, ...], errors: tuple[float, ...], efforts: tuple[float, ...]) -> tuple[Level, ...]:
    return tuple(
        Level(label=label, error=error, effort=effort)
        for label, error, effort in zip(labels, errors, efforts, strict=True)
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Budget:
    """Estimated numerical errors of a prediction, in the units of a tolerance."""

    by_setting: Mapping[str, Mapping[Reading, float]]
    total: Mapping[Reading, float]

    def worst(self, setting: str) -> float:
        """Return the largest error of a setting."""
        return max(self.by_setting.get(setting, {}).values(), default=0.0)


# Level of each setting by its name.
Plan = Mapping[str, int]

_STREAMS = (4, 6, 8, 12, 16, 24, 32)
# Cuts of each layer of the coarse profile, and whether they are extrapolated with twice as many.
_LAYERS = ((1, False), (2, False), (1, True), (2, True), (4, True), (8, True))
_ELEMENT_DEPTH = 0.1
# How many, and whether each stretch between the entries of the aerosol's tables has its part of them.
_WAVELENGTHS = ((1, False), (2, False), (3, False), (3, True), (4, True), (6, True), (8, True), (12, True), (16, True))
_GRIDS = ((16, 14), (24, 20), (36, 32), (48, 44))
_TILES = (2, 3, 4, 5, 6, 8, 10, 13, 16, 20)
_TOLERANCES = (3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 1e-5, 1e-6, 1e-7)
# Orders of scattering, and the statistics, cost so little that they are always finer than what is asked for.
_OF_ORDERS, _FINER = 0.003, 0.02


def settings_at(plan: Plan, tolerance: float, *, face_m: float = 0.0) -> Settings:
    """Return the settings of a plan.

    Parameters
    ----------
    plan
        Level of each setting of `NUMERICAL_SETTINGS`.
    tolerance
        That is asked for; statistics and orders of scattering follow it.
    face_m
        Height of the sensor [m], at which a layer ends: extrapolation is of what is read between layers.
    """
    zeniths, azimuths = _GRIDS[plan[SKY_GRID]]
    count, split_at_kinks = _WAVELENGTHS[plan[WAVELENGTHS]]
    solver = SolverSettings(
        fine_layers=False,
        nodes=_STREAMS[plan[STREAMS]],
        element_depth=_ELEMENT_DEPTH,
        tolerance=min(max(_OF_ORDERS * tolerance, 1e-9), 1e-4),
        matrix_tolerance=min(0.3 * tolerance, 3e-3),
        face_m=face_m,
    )
    return Settings(
        wavelengths=count,
        split_at_kinks=split_at_kinks,
        solver=_in_layers(solver, plan[LAYERS]),
        sky_zeniths=zeniths,
        sky_azimuths=azimuths,
        hemisphere_tolerance=_TOLERANCES[plan[HEMISPHERE]],
        tiles_per_side=_TILES[plan[TILES]],
        negligible_spread=0.0,
        dolp_tolerance=max(_FINER * tolerance, 1e-11),
        roc_tolerance=max(_FINER * tolerance, 1e-12),
    )


def at_level(settings: Settings, setting: str, level: int) -> Settings:
    """Return settings with one setting of the sky at another level."""
    if setting == STREAMS:
        return replace(settings, solver=replace(settings.solver, nodes=_STREAMS[level]))
    if setting == WAVELENGTHS:
        count, split_at_kinks = _WAVELENGTHS[level]
        return replace(settings, wavelengths=count, split_at_kinks=split_at_kinks)
    return replace(settings, solver=_in_layers(settings.solver, level))


def _in_layers(solver: SolverSettings, level: int) -> SolverSettings:
    cuts, extrapolated = _LAYERS[level]
    return replace(solver, layer_cuts=cuts, extrapolated=extrapolated, element_depth=_ELEMENT_DEPTH / cuts)


def tiles_per_side(level: int) -> int:
    """Return the tiles along each side of the field at a level of TILES."""
    return _TILES[level]


def streams(level: int) -> int:
    """Return the streams of a hemisphere at a level of STREAMS."""
    return _STREAMS[level]


NUMERICAL_SETTINGS: Mapping[str, NumericalSetting] = MappingProxyType(
    {
        # Convergence: geometric above the length of the phase function's expansion.
        STREAMS: NumericalSetting(
            levels=_levels(
                tuple(f"{n} a hemisphere" for n in _STREAMS),
                (5e-3, 1.5e-3, 5e-4, 6e-5, 4e-6, 3e-7, 1e-7),
                (0.7, 1.0, 1.3, 2.2, 3.5, 6.0, 9.0),
            ),
        ),
        # Convergence: square of the thickness; its fourth power where two are extrapolated to none.
        LAYERS: NumericalSetting(
            levels=_levels(
                tuple(f"{15 * n} and {30 * n}" if both else f"{15 * n}" for n, both in _LAYERS),
                (1.5e-3, 4e-4, 1e-5, 5e-7, 6e-8, 6e-9),
                (1.0, 1.3, 2.3, 3.3, 5.5, 10.0),
            ),
        ),
        # Convergence: geometric; below 1e-4 only between the entries of the aerosol's tables.
        WAVELENGTHS: NumericalSetting(
            levels=_levels(
                tuple(f"{n} split" if split else str(n) for n, split in _WAVELENGTHS),
                (5e-2, 2e-3, 2e-4, 1e-4, 1e-5, 1e-6, 2e-7, 5e-8, 1e-8),
                (1.0, 2.0, 3.0, 5.0, 6.0, 8.0, 10.0, 14.0, 18.0),
            ),
        ),
        # Convergence: geometric, as fast as the aureole lets it.
        SKY_GRID: NumericalSetting(
            levels=_levels(tuple(f"{z} x {a}" for z, a in _GRIDS), (4e-4, 1.6e-4, 3e-5, 6e-6), (1.0, 2.2, 5.0, 9.4)),
        ),
        # Convergence: geometric; of the square root of the nodes where a horizon lies in the lobe.
        HEMISPHERE: NumericalSetting(
            levels=_levels(
                tuple(f"{t:g}" for t in _TOLERANCES),
                (1.5e-2, 5e-3, 1.5e-3, 5e-4, 1.5e-4, 5e-5, 5e-6, 5e-7, 2e-7),
                (1.0, 1.1, 1.3, 1.6, 1.9, 2.3, 3.3, 6.4, 32.0),
            ),
        ),
        # Convergence: geometric over a smooth field; slower where the shadowing has its kink in it.
        TILES: NumericalSetting(
            levels=_levels(
                tuple(f"{n} x {n}" for n in _TILES),
                (1.5e-2, 1.5e-3, 1e-4, 2e-5, 1e-5, 3e-6, 1e-6, 4e-7, 1e-7, 5e-8),
                tuple(float(n**2 + (n + 1) ** 2 + 5) for n in _TILES),
            ),
        ),
    }
)

# Share of the tolerance that a plan aims at: first with the errors of the light, of which some numbers show several
# times as much, then with errors as they were estimated for each number.
_FIRST_AIM, _AIM = 0.6, 0.75
# A first plan is no coarser than this, or than a share of a large tolerance: a second one would cost more. Where it
# would have to be finer it is the coarsest: it costs little beside the one that follows, and tells it what counts.
_FIRST_COARSEST, _FIRST_FINEST, _OF_LARGE = 1e-2, 7e-4, 0.25
# A scene alone is planned with so many times the likely error of its rules: a second round costs more than finer ones.
_LIKELY = {HEMISPHERE: 2.0}
_SOLVED = (STREAMS, LAYERS, WAVELENGTHS)
_OF_SKY = (*_SOLVED, SKY_GRID)
# A sky that so many scenes share is solved to this share of the tolerance.
_MANY, _SHARED_AIM = 10, 0.1


def first_plan(
    scene: LitScene, *, tolerance: float, store: LightStore, effects: frozenset[Effect] = ALL, under_sky: int = 1
) -> dict[str, int]:
    """Return the plan to begin with, of a scene of which nothing is known yet."""
    ahead, left_out = kept_forecast(scene, effects, store, tolerance=tolerance, under_sky=under_sky), unused(effects)
    are_many = under_sky >= _MANY
    likely = {} if are_many else _LIKELY
    scales = {name: 0.0 if name in left_out else likely.get(name, 1.0) for name in NUMERICAL_SETTINGS}
    plan = dict.fromkeys(NUMERICAL_SETTINGS, 0)
    if are_many:
        finer = allocate(scene, ahead, scales, _SHARED_AIM * tolerance)
        plan |= {name: finer[name] for name in _SOLVED}
    return allocate(scene, ahead, scales, _first_aim(tolerance), start=plan)


def _first_aim(tolerance: float) -> float:
    aim = _FIRST_AIM * tolerance
    return _FIRST_COARSEST if aim < _FIRST_FINEST else min(aim, max(_FIRST_COARSEST, _OF_LARGE * tolerance))


def plan_beside(
    scene: LitScene,
    neighbour: Plan,
    budget: Budget,
    *,
    sky: object,
    unsure: Collection[Reading] = (),
    tolerance: float,
    store: LightStore,
    effects: frozenset[Effect] = ALL,
) -> dict[str, int]:
    """Return the plan for a scene much like one that was predicted under a sky, were the errors of both as large.

    Definition: the likely errors of the scene, scaled as those of its neighbour were, for those readings that a
    setting, or all together, act on most.
    """
    ahead, left_out = kept_forecast(scene, effects, store, tolerance=tolerance), unused(effects)
    plan = _least_beside(scene, neighbour, sky, left_out)
    kept = [key for key in budget.total if key not in unsure]
    if not kept:
        return allocate(scene, ahead, dict.fromkeys(plan, 1.0), _first_aim(tolerance), start=plan)
    several = (*(budget.by_setting[name] for name in plan), budget.total)
    for key in dict.fromkeys(max(kept, key=lambda one: errors.get(one, 0.0)) for errors in several):
        found = _scales(ahead, neighbour, budget, key)
        scales = {name: 0.0 if name in left_out else scale for name, scale in found.items()}
        raised = allocate(scene, ahead, scales, _AIM * tolerance, start=plan)
        if ahead.error(raised, scales) > _AIM * tolerance:
            # No levels keep this number: those of the neighbour do as well as the finest of all, which take minutes.
            raised = {name: max(level, neighbour[name]) for name, level in plan.items()}
        plan = raised
    return plan


def _least_beside(scene: LitScene, neighbour: Plan, sky: object, left_out: frozenset[str]) -> dict[str, int]:
    """Levels below which a scene beside another is not tried: its tiles, and the settings of a sky that both have.

    The convergence of the tiles shows once they are seen, and too few of them cost a second evaluation; a sky that was
    solved costs nothing.
    """
    plan = dict.fromkeys(NUMERICAL_SETTINGS, 0)
    if TILES not in left_out:
        plan[TILES] = neighbour[TILES]
    if sky is not None and scene.air is not None and scene.air.key == sky:
        plan |= {name: neighbour[name] for name in _OF_SKY if name not in left_out}
    return plan


def finer_plan(
    scene: LitScene, ahead: Forecast, plan: dict[str, int], budget: Budget, tolerance: float
) -> dict[str, int]:
    """Return a finer plan for the readings that can be brought within the tolerance; the same one if there are none."""
    allowed, finer = _AIM * tolerance, plan
    for key in (key for key, error in budget.total.items() if error > tolerance):
        scales = _scales(ahead, plan, budget, key)
        raised = allocate(scene, ahead, scales, allowed, start=finer)
        if ahead.error(raised, scales) <= allowed:
            finer = raised
    return finer


def _scales(ahead: Forecast, plan: Plan, budget: Budget, key: Reading) -> dict[str, float]:
    """Factors from the likely errors of the settings to those that were estimated of a reading."""
    return {name: budget.by_setting[name].get(key, 0.0) / ahead.errors[name][level] for name, level in plan.items()}


def allocate(
    scene: LitScene, ahead: Forecast, scales: Mapping[str, float], allowed: float, *, start: Plan | None = None
) -> dict[str, int]:
    """Return the cheapest plan whose expected errors sum to no more than is allowed, or the finest of all.

    From the lowest levels that setting is raised, again and again, and by as many levels, which takes off most error
    per second; in the end what the last steps made superfluous is taken back. For errors that fall as powers of the
    time this ends where each error times its power is in proportion to its time.

    Definition: steepest descent.
    """
    lowest = dict.fromkeys(NUMERICAL_SETTINGS, 0) if start is None else dict(start)
    plan = dict(lowest)
    while ahead.error(plan, scales) > allowed:
        finer = _raised(scene, ahead, scales, plan)
        if finer == plan:
            return plan
        plan = finer
    return _without_the_superfluous(scene, ahead, scales, allowed, plan, lowest)


def _without_the_superfluous(
    scene: LitScene, ahead: Forecast, scales: Mapping[str, float], allowed: float, plan: dict[str, int], lowest: Plan
) -> dict[str, int]:
    """Lower settings, each time by the level that saves most time, while the errors stay within what is allowed."""
    while True:
        lowered = [{**plan, name: plan[name] - 1} for name in NUMERICAL_SETTINGS if plan[name] > lowest[name]]
        within = [coarser for coarser in lowered if ahead.error(coarser, scales) <= allowed]
        if not within:
            return plan
        plan = min(within, key=lambda coarser: expected_s(scene, coarser, ahead))


def _raised(scene: LitScene, ahead: Forecast, scales: Mapping[str, float], plan: dict[str, int]) -> dict[str, int]:
    """Return a plan with that setting raised which takes off most error per second; the same of the finest of all."""
    error, seconds = ahead.error(plan, scales), expected_s(scene, plan, ahead)

    def gain(finer: Plan) -> float:
        return (error - ahead.error(finer, scales)) / max(expected_s(scene, finer, ahead) - seconds, 1e-6)

    raised = (
        {**plan, name: level}
        for name, setting in NUMERICAL_SETTINGS.items()
        for level in range(plan[name] + 1, len(setting.levels))
    )
    return max(raised, key=gain, default=plan)


# Seconds, on one core: a wavelength solved with the least of all, its sky read on the smallest grid, one line of sight.
_SOLVED_S, _READ_S, _SEEN_S = 0.008, 0.005, 0.0005
# In the time of so many lines of sight, out of many that are computed together, one alone is.
_LINES_OF_POINT = 12.0
# What the readings of a solution cost more with its streams and layers than the solution itself: less.
_READING = 0.6


def expected_s(scene: LitScene, plan: Plan, ahead: Forecast) -> float:
    """Return the time that a plan is likely to take, of a sky that several scenes share a share [s]."""
    effort = {name: ahead.efforts[name][level] for name, level in plan.items()}
    solver = effort[STREAMS] * effort[LAYERS]
    sky = _SOLVED_S * solver + _READ_S * effort[SKY_GRID] * float(solver**_READING)
    seen = [region.part for region in scene.regions if region.surface is not None]
    lines = sum(_LINES_OF_POINT if part is None else effort[TILES] for part in seen)
    return effort[WAVELENGTHS] * sky / ahead.under_sky + _SEEN_S * lines * effort[HEMISPHERE]


@dataclass(frozen=True, kw_only=True, eq=False)
class Forecast:
    """Likely errors and efforts of a scene."""

    errors: Mapping[str, tuple[float, ...]]
    efforts: Mapping[str, tuple[float, ...]]
    under_sky: int = 1

    def error(self, plan: Plan, scales: Mapping[str, float]) -> float:
        """Return the sum of the errors that are to be expected, each multiplied by a scale of its setting."""
        return sum(scales[name] * self.errors[name][level] for name, level in plan.items())


def kept_forecast(
    scene: LitScene, effects: frozenset[Effect], store: LightStore, *, tolerance: float, under_sky: int = 1
) -> Forecast:
    """Return the forecast of a scene, made once for all under its sky."""
    key = ("forecast", None if scene.air is None else scene.air.key, effects, tolerance, under_sky)
    return store.once(key, lambda: forecast(scene, effects, tolerance=tolerance, under_sky=under_sky))


def forecast(
    scene: LitScene, effects: frozenset[Effect] = ALL, *, tolerance: float = 0.0, under_sky: int = 1
) -> Forecast:
    """Return the likely errors and efforts of all levels of all settings.

    The wavelengths are looked at for the scene itself: a narrow band needs one where a wide one needs four. So are the
    streams: the terms of a Henyey-Greenstein function fall as powers of its asymmetry. All errors of the sky are
    shares of the light that air scatters, and thin air scatters little.
    """
    errors = {name: tuple(level.error for level in setting.levels) for name, setting in NUMERICAL_SETTINGS.items()}
    efforts = {name: tuple(level.effort for level in setting.levels) for name, setting in NUMERICAL_SETTINGS.items()}
    found = [_of_wavelengths(air, tolerance) for air in _computed(scene) if Effect.WAVELENGTHS in effects]
    if found:
        errors[WAVELENGTHS] = tuple(max(each) for each in zip(*(error for error, _ in found), strict=True))
        efforts[WAVELENGTHS] = tuple(max(each) for each in zip(*(effort for _, effort in found), strict=True))
    if columns := [_middle(air) for air in _computed(scene)]:
        errors[STREAMS] = _of_streams(max(max(one.lower.g, one.upper.g) for one in columns))
        share = min(1.0, _SCATTERED * max(one.depth for one in columns))
        errors |= {name: tuple(share * error for error in errors[name]) for name in (*_OF_SKY, HEMISPHERE)}
    return Forecast(errors=errors, efforts=efforts, under_sky=under_sky)


# Light that air scatters, over that of the beam, in optical depths; a low sun or a panel that mirrors only sky has
# more, and then a second plan follows.
_SCATTERED = 10.0
# The convergence of the tiles is taken to be no steeper, for few tiles do not show a kink, and no flatter.
_FASTEST, _SLOWEST = 0.05, 0.7
# What streams miss, over the first term of the scattering function that they do not resolve; molecules have as much
# of it as an aerosol of this asymmetry.
_OF_TERM, _LEAST_ASYMMETRY = 0.5, 0.5


def _of_streams(asymmetry: float) -> tuple[float, ...]:
    counts = np.array([streams(level) for level in range(len(NUMERICAL_SETTINGS[STREAMS].levels))])
    return tuple((_OF_TERM * max(asymmetry, _LEAST_ASYMMETRY) ** (2.0 * counts)).tolist())


# Finer wavelengths than with this share of the tolerance are not looked at: they err less as those of the table do.
_FINE_ENOUGH = 0.02


def _of_wavelengths(air: Air, tolerance: float) -> tuple[list[float], list[float]]:
    lowest = settings_at(dict.fromkeys(NUMERICAL_SETTINGS, 0), 1e-2)
    levels = NUMERICAL_SETTINGS[WAVELENGTHS].levels
    errors, efforts = [one.error for one in levels], [one.effort for one in levels]
    every = spectral_errors(air, (at_level(lowest, WAVELENGTHS, level) for level in range(len(levels))))
    for level, found in enumerate(every):
        efforts[level] = float(found.rule.wavelength_m.size)
        errors[level:] = [found.scattered * error / errors[level] for error in errors[level:]]
        if found.scattered <= _FINE_ENOUGH * tolerance:
            break
    return errors, efforts


def unused(effects: frozenset[Effect]) -> frozenset[str]:
    """Return the settings that say nothing where only some effects act: each is then at its lowest level."""
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

    Definition: an error of tiles falls with each more as the degrees of the field do.
    """
    fields = [np.stack([getattr(one, scene.source) for one in light.lights]) for light in result.lights.values()]
    found = [ratio for ratio in map(decay, fields) if ratio is not None]
    if not found:
        return ahead
    ratio = min(max(*found, _FASTEST), _SLOWEST)
    sides = np.array([tiles_per_side(level) for level in range(len(NUMERICAL_SETTINGS[TILES].levels))])
    return replace(ahead, errors={**ahead.errors, TILES: tuple((ratio**sides).tolist())})


def decay(values: FloatArray) -> float | None:
    """Return by how much each degree of a field over tiles is below the one before; None for tiles too few to tell.

    Of the last three degrees, for odd and even ones may fall apart; of three tiles a side of the two there are.
    """
    per_side = isqrt(len(values))
    sizes = [float(np.sqrt(np.trace(part))) for part in _by_degree(_coefficients(values))]
    steps = min(per_side - 2, 2)
    if steps < 1 or sizes[-1 - steps] == 0.0:
        return None
    return float((sizes[-1] / sizes[-1 - steps]) ** (1.0 / steps))


def last_degree(values: FloatArray) -> float:
    """Return the size of the highest degree of a field over tiles, over the mean of S0; 0 in the dark."""
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


def _middle(air: Air) -> Column:
    """Column of air at the middle of the band."""
    if air.state is None:
        raise ValueError("forecast: a table has no aerosol")
    spectrum = air.band.shares
    return column(air.state, wavelength_m=float(spectrum @ air.band.wavelength_m / np.sum(spectrum)))


@dataclass(frozen=True, kw_only=True, eq=False)
class SpectralError:
    """Relative errors of a band's light, by the wavelengths that stand for it."""

    scattered: float
    by_component: float
    rule: SpectralRule
    _all: _Spectrum
    _few: _Spectrum

    @property
    def mean_depth(self) -> float:
        """Optical depth of the column in the mean over the band."""
        return float(self._all.irradiance @ self._all.depth / np.sum(self._all.irradiance))

    def transmittance(self, *, slant: float) -> float:
        """Return the relative error of the beam's mean transmittance, with its sign."""
        few, all_of_it = self._few.transmittance(slant), self._all.transmittance(slant)
        return few / all_of_it - 1.0


def spectral_error(air: Air, settings: Settings) -> SpectralError:
    """Return what the wavelengths of some settings leave out, before anything is solved."""
    return next(spectral_errors(air, (settings,)))


# Of the angles by which aerosol scatters: backward, aside, and toward the aureole.
_COSINES = (-0.5, 0.3, 0.9)
# Slant depths, in vertical ones, of the functions that stand for scattered light.
_SLANTS = (0.5, 1.0, 3.0)
# Beside the skies and paths of 160 random scenes, by one or two wavelengths, where over 1e-5 was missing: S0 is off
# by a quarter of the estimate in the middle, by 0.75 of it at most. Aerosol of many kinks, as soot, needs the rest.
_BEYOND = 1.4
# The same of S1 and S2 beside that, over what the functions are off among themselves: off by a sixth to a half of it in
# the middle, by more in one of ten; by more than both estimates together in less than one of a hundred.
_UNLIKE = 0.6
# Of which the sums over the spectrum are certain.
_ROUNDING = 1e-11


def spectral_errors(air: Air, several: Iterable[Settings]) -> Iterator[SpectralError]:
    """Yield what `spectral_error` returns for each of several settings.

    The functions are light scattered once, on a slant depth m tau, by molecules or by aerosol at one of three angles,
    without and with a share that is scattered twice; each without and with the loss of the beam on its whole way. The
    largest error of them is taken.
    """
    state = air.state
    if state is None:
        raise ValueError("spectral_error: a table has no wavelengths")
    mu0 = float(np.cos(air.sun_zenith_rad))
    ozone = np.exp(-ozone_optical_depth(wavelength_m=air.band.wavelength_m, ozone_m=state.ozone_m) / mu0)
    lit = air.band.shares > 0.0
    everything = SpectralRule(wavelength_m=air.band.wavelength_m[lit], irradiance=(air.band.shares * ozone)[lit])
    ends_m = float(everything.wavelength_m[0]), float(everything.wavelength_m[-1])
    spectrum_of = partial(_spectrum, state, aerosol_spectra(state, shortest_m=ends_m[0], longest_m=ends_m[1]), mu0=mu0)
    whole = spectrum_of(everything)
    present = [k for k, part in enumerate(whole.parts) if np.any(part > _ROUNDING)]
    true = {k: whole.sums(whole.parts[k]) for k in present}
    for one in several:
        rule = spectral_rule(
            wavelength_m=everything.wavelength_m,
            irradiance=everything.irradiance,
            count=one.wavelengths,
            kinks_m=kinks_m(state, aerosol=air.aerosol) if one.split_at_kinks else (),
        )
        yield _error_of(rule, spectrum_of(rule), whole, true)


def _error_of(rule: SpectralRule, few: _Spectrum, whole: _Spectrum, true: Mapping[int, FloatArray]) -> SpectralError:
    """Error of a rule by the sums of the parts that are there, beside what they are over all wavelengths."""
    errors = np.stack([few.sums(few.parts[k]) / every - 1.0 for k, every in true.items()])
    # Polarized light is of the molecules, or of both alike.
    unlike = max(float(np.max(np.ptp(errors, axis=0))), float(np.max(np.ptp(errors, axis=1))))
    return SpectralError(
        scattered=_BEYOND * float(np.max(np.abs(errors))) + _ROUNDING,
        by_component=_UNLIKE * unlike,
        rule=rule,
        _all=whole,
        _few=few,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Spectrum:
    """Wavelengths with their irradiance, the optical depth there, and the share of it that each part of the air has."""

    irradiance: FloatArray
    depth: FloatArray
    parts: tuple[FloatArray, ...]
    mu0: float

    def sums(self, part: FloatArray) -> FloatArray:
        """Light that stands for what a part scatters, one number for each function."""
        once = np.stack([-np.expm1(-slant * self.depth) for slant in _SLANTS])
        functions = np.concatenate([once, once * (2.0 - np.exp(-self.depth))]) * part
        beam = np.exp(-self.depth / self.mu0)
        return np.asarray(np.concatenate([functions, functions * beam]) @ self.irradiance)

    def transmittance(self, slant: float) -> float:
        """Mean transmittance of a slant depth over the spectrum of the beam at the ground."""
        beam = self.irradiance * np.exp(-self.depth / self.mu0)
        return float(np.sum(beam * np.exp(-slant * self.depth)) / np.sum(beam))


def _spectrum(
    state: AtmosphereState, aerosols: tuple[AerosolSpectrum, AerosolSpectrum], rule: SpectralRule, mu0: float
) -> _Spectrum:
    wavelength_m = rule.wavelength_m
    molecules = rayleigh_optical_depth(wavelength_m=wavelength_m, surface_pressure_pa=state.surface_pressure_pa)
    depths = [aerosol.depth(wavelength_m) for aerosol in aerosols]
    depth = molecules + sum(depths)
    scattered = [own * aerosol.ssa(wavelength_m) for own, aerosol in zip(depths, aerosols, strict=True)]
    toward = [
        sum(
            own * _henyey_greenstein(aerosol.asymmetry(wavelength_m), cosine)
            for own, aerosol in zip(scattered, aerosols, strict=True)
        )
        for cosine in _COSINES
    ]
    parts = tuple(part / depth for part in (molecules, *toward))
    return _Spectrum(irradiance=rule.irradiance, depth=depth, parts=parts, mu0=mu0)


def _henyey_greenstein(asymmetry: FloatArray, cosine: float) -> FloatArray:
    """Scattering function of an asymmetry at one angle, of mean 1."""
    return np.asarray((1.0 - asymmetry**2) / (1.0 + asymmetry**2 - 2.0 * asymmetry * cosine) ** 1.5)


# Both have a tolerance of their own and estimate their error themselves. DoLP goes by first order (1/SNR^2), second
# order (1/SNR^4), then quadrature (1e-13); the ROC converges geometrically in the nodes of the contour.
STATISTICS = (DOLP, ROC)
