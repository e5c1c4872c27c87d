"""True changes by effects that are left out, and a sharper bound of skylight under thin air.

`check_effects` evaluates the chain with and without each effect, which shows whether its bound holds.
`skylight_bound` is for thin air: a bound of all skylight has to take its polarization in the worst direction, and so is
many times what is there; but light that was scattered once, by the beam or by the beam off the ground, is known without
solving anything.
"""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from model.accuracy.chain import (
    ChainResult,
    LightStore,
    Reading,
    Readings,
    Settings,
    differences,
    evaluate,
    evaluate_all,
)
from model.accuracy.plan import NUMERICAL_SETTINGS, settings_at
from model.atmosphere.air import Column
from model.atmosphere.layers import henyey_greenstein
from model.atmosphere.sky import STANDARD_SETTINGS, BandLighting, Fidelity, compute_lighting
from model.effects.bounds import NEXT_TO_NONE, Light, LightLimits, added, bound_of, is_narrow, radiance_bounds
from model.effects.effect import LIGHT, Bound, Effect, EffectPlan
from model.effects.planner import EFFECTS
from model.numerics import gauss_legendre
from model.quantities import QUANTITIES, is_counts
from model.scene.panel import PanelLight
from model.scene.scene import Air, LitRegion, LitScene
from model.scene.sky_light import DiffuseRadiance
from model.stokes import rotate_frame

FloatArray = NDArray[np.float64]

_DOLP_TOLERANCE = 1e-11
# Sizes of effects are shown with two digits.
_ROUGH, _ROUGH_LAW = 1e-2, 1e-6
# The least of so many times is taken: another program's turn on the processor is not counted.
_REPEATS = 3
# Means that are computed in two ways differ by this share of S0. Where DoLP is 0 but for rounding, as of a level panel
# under a sun at the zenith seen from straight above, its SNR and deviation have no digits that could be compared.
_ROUNDING = 1e-14
_NONE = 1e-11
_RADIANCE = frozenset({"radiance", "s0", "s1", "s2"})


@dataclass(frozen=True, kw_only=True)
class CheckedEffect:
    """An effect with what leaving it out truly changes."""

    effect: Effect
    bound: Bound  #: guaranteed, and found
    actual: Bound
    #: Time of the chain with all effects and without this one, nothing being kept from before [s]; of an effect that
    #: acts behind the lens, of the chain behind the lens.
    with_s: float
    without_s: float

    @property
    def holds(self) -> bool:
        """True if the change is within its bound."""
        return self.bound.holds(self.actual)


def check_effects(
    scene: LitScene,
    settings: Settings,
    plan: EffectPlan,
    *,
    make_store: Callable[[], LightStore] = LightStore,
) -> tuple[CheckedEffect, ...]:
    """Return what leaving out each of some effects changes, one at a time, each of the light with a new store.

    Of the scene as it is asked for: effects that are left out by request are nowhere, but where their own change is
    looked for.
    """
    # Of the distribution of DoLP the error must not hide what is to be seen.
    settings = replace(settings, dolp_tolerance=min(settings.dolp_tolerance, _DOLP_TOLERANCE))
    store, asked = make_store(), plan.asked
    whole, whole_s = _evaluated(scene, settings, asked, store)
    # What acts behind the lens is compared by the time behind the lens: the light of the store is the same.
    _, behind_s = _evaluated(scene, settings, asked, store)
    found = []
    for one in plan.decisions:
        is_light, with_it = one.effect in LIGHT, whole
        if one.effect not in asked:
            with_it, _ = _evaluated(scene, settings, asked | {one.effect}, make_store() if is_light else store)
        without, without_s = _evaluated(scene, settings, asked - {one.effect}, make_store() if is_light else store)
        found.append(
            CheckedEffect(
                effect=one.effect,
                bound=one.bound,
                actual=change(with_it, without),
                with_s=whole_s if is_light else behind_s,
                without_s=without_s,
            )
        )
    return tuple(found)


def with_changes(
    scene: LitScene, plan: EffectPlan, settings: Settings, *, store: LightStore, acting: bool = True
) -> EffectPlan:
    """Return a plan with what its effects change: those that nobody stated, at the ends of their usual range.

    Those that act, or are left out by request, are evaluated too if `acting`. Settings of sky and light are the given
    ones, but for coarse rules of what a field of view adds.
    """
    on = _not_left_out(plan)
    behind = [one for one in plan.decisions if acting and one.answer == "acts" and one.effect not in LIGHT]
    removed = [(one.effect, EFFECTS[one.effect].removed(scene)) for one in behind]
    unstated = _unstated(scene, plan, _NO_RANGES)
    whole, *others = _evaluated_variants(scene, plan, settings, store=store, variants=(*unstated, *removed))
    found: dict[Effect, list[Bound]] = defaultdict(list)
    for (effect, _), other in zip((*unstated, *removed), others, strict=True):
        found[effect].append(change(whole.readings, other.readings))
    if acting:
        # The scenes of one evaluation have the same parts of the light.
        for one in plan.decisions:
            if one.answer == "acts" and one.effect in LIGHT:
                without = evaluate(scene, _rough(settings), effects=on - {one.effect}, store=store)
                found[one.effect].append(change(whole.readings, without.readings))
            elif one.forced and not one.acts:
                with_it = evaluate(scene, _rough(settings), effects=on | {one.effect}, store=store)
                found[one.effect].append(change(with_it.readings, whole.readings))
    return replace(
        plan, decisions=tuple(replace(one, changes=tuple(found.get(one.effect, ()))) for one in plan.decisions)
    )


# Ends of the range of an effect's input, SI.
Ranges = Mapping[Effect, tuple[float, float]]
_NO_RANGES: Ranges = {}
Variants = Sequence[tuple[Effect, LitScene]]


def with_unstated(
    scene: LitScene, plan: EffectPlan, settings: Settings, *, store: LightStore, ranges: Ranges = _NO_RANGES
) -> tuple[ChainResult, tuple[tuple[Effect, ChainResult], ...]]:
    """Return the results of a scene, and of it with each effect that nobody stated at the ends of its range.

    Ranges are the usual ones but for those that are given.
    """
    variants = _unstated(scene, plan, ranges)
    whole, *others = _evaluated_variants(scene, plan, settings, store=store, variants=variants)
    return whole, tuple((effect, other) for (effect, _), other in zip(variants, others, strict=True))


def _evaluated_variants(
    scene: LitScene, plan: EffectPlan, settings: Settings, *, store: LightStore, variants: Variants
) -> tuple[ChainResult, ...]:
    """Return the results of a scene and of its variants, to two digits of what they differ by."""
    scenes = [scene, *(seen for _, seen in variants)]
    return evaluate_all(scenes, _rough(settings), effects=_not_left_out(plan), store=store)


def _unstated(scene: LitScene, plan: EffectPlan, ranges: Ranges) -> Variants:
    found = []
    for one in plan.decisions:
        usual = EFFECTS[one.effect].usual
        if one.answer == "not stated" and usual is not None:
            ends = ranges.get(one.effect, (usual.low, usual.high))
            found += [(one.effect, usual.stated(scene, value)) for value in ends if usual.fits(scene, value)]
    return found


def _not_left_out(plan: EffectPlan) -> frozenset[Effect]:
    return frozenset(one.effect for one in plan.decisions if one.answer != "left out")


def _rough(settings: Settings) -> Settings:
    """Return settings with coarse rules of what a field of view adds; sky and light are as they were."""
    hemisphere = max(settings.hemisphere_tolerance, _ROUGH)
    return replace(settings, hemisphere_tolerance=hemisphere, tiles_per_side=2, dolp_tolerance=_ROUGH_LAW)


def chain_time_s(
    scene: LitScene,
    settings: Settings,
    effects: frozenset[Effect],
    *,
    make_store: Callable[[], LightStore] = LightStore,
) -> float:
    """Return the time of one evaluation with some effects, nothing being kept from before [s]."""
    return min(
        sum(evaluate(scene, settings, effects=effects, store=make_store()).stage_s.values()) for _ in range(_REPEATS)
    )


def change(whole: Readings, without: Readings) -> Bound:
    """Return the largest difference of each kind between two sets of readings, but for rounding of no polarization."""
    found: dict[str, float] = defaultdict(float)
    for reading, apart in differences(whole, without).items():
        if apart > _rounding(reading, whole):
            kind = kind_of(reading)
            found[kind] = max(found[kind], apart)
    return Bound(**found)


def _rounding(reading: Reading, whole: Readings) -> float:
    dolp = whole.get(Reading(reading.place, "dolp", "mean"))
    rests_on_direction = reading.quantity == "dolp_snr" or reading[1:] == ("dolp", "std")
    if not rests_on_direction or dolp is None:
        return 0.0
    return _ROUNDING / dolp.number if dolp.number > _NONE else np.inf


def kind_of(reading: Reading) -> str:
    """Return which number of a `Bound` speaks of a reading."""
    if reading.quantity in {"p_detection", "auc"}:
        return "detection"
    if (
        reading.statistic == "mean"
        and reading.quantity in QUANTITIES
        and QUANTITIES[reading.quantity].error_of == "one"
    ):
        return "ratios"
    is_level = reading.quantity in _RADIANCE or is_counts(reading.quantity)
    if is_level and (reading.statistic == "mean" or reading.quantity == "radiance"):
        return "radiance"
    return "deviations"


def _evaluated(
    scene: LitScene, settings: Settings, effects: frozenset[Effect], store: LightStore
) -> tuple[Readings, float]:
    result = evaluate(scene, settings, effects=effects, store=store)
    return result.readings, sum(result.stage_s.values())


# Rules of the integral over the sky, and by how much of their difference and of all the finer one may be off.
_LOBE, _DIFFUSE = (7, 10), 8
_OF_DIFFERENCE, _OF_ALL = 2.0, 0.03
# Of the statistics, whose error is all but the same with and without the sky.
_STATISTICS = 1e-5
_COARSE_LAYERS = replace(STANDARD_SETTINGS, fine_layers=False)
# Nodes over the ground's hemisphere, of zenith angles and of half a turn; and wavelengths of a band that is not narrow.
_NODES, _WAVELENGTHS = 8, 4


def skylight_bound(scene: LitScene, limits: Mapping[str, LightLimits]) -> Bound | None:
    """Return the most that skylight changes of all but detection; None where only the general bound is known.

    Notes
    -----
    With the beam's light B, once scattered light v that the regions reflect, all other light of the sky r, and path and
    surroundings p, f(B + v + r + p) and f(B + p) differ by no more than f(B + v) and f(B) do, and by what r + p and p
    may change: these by their bounds, that as it is. Each is relative to numbers that are off by as much.
    """
    if not all(_is_known(scene, region, limits[region.name]) for region in scene.regions):
        return None
    once, off = _reflected_once(scene)
    bare = {region.name: limits[region.name].beam for region in scene.regions}
    lit = {name: beam + once[name] for name, beam in bare.items()}
    both = [_with_radiances(scene, one) for one in (lit, bare)]
    known = change(*(one.readings for one in evaluate_all(both, _coarsest(scene), store=LightStore())))
    rest = Bound()
    for region in scene.regions:
        rest = rest.worse(_rest(scene, region, limits[region.name], off[region.name]))
    total = known + rest
    return total.times(1.0 / (1.0 - total.largest)) if total.largest < 0.5 else None


def _is_known(scene: LitScene, region: LitRegion, light: LightLimits) -> bool:
    return (
        region.surface is not None
        and region.part is None
        and not any(region.texture_diagonal)
        and scene.source == "total"
        and light.depth > NEXT_TO_NONE
        and bool(np.isfinite(light.again.s0 + light.added))
    )


def _with_radiances(scene: LitScene, radiances: Mapping[str, FloatArray]) -> LitScene:
    regions = tuple(
        replace(one, surface=None, tilt=None, part=None, radiance=radiances[one.name]) for one in scene.regions
    )
    return replace(scene, regions=regions, air=None, pairs=())


def _coarsest(scene: LitScene) -> Settings:
    lowest = settings_at(dict.fromkeys(NUMERICAL_SETTINGS, 0), _STATISTICS, face_m=scene.sensor_height_m)
    return replace(lowest, dolp_tolerance=_STATISTICS)


def _rest(scene: LitScene, region: LitRegion, light: LightLimits, off: FloatArray) -> Bound:
    """Bound of all that is not known: light scattered again, what the rules miss, and path and surroundings twice."""
    bounds = radiance_bounds(scene, region, light)
    beside = light.but_for(Effect.SKYLIGHT).added
    total = light.again.s0 + float(off[0]) + beside
    polarised = min(light.again.polarised + float(off[1]) + beside, total)
    of_rest = added(scene, bounds, Light(total, polarised))
    return bound_of(bounds, of_rest) + bound_of(bounds, added(scene, bounds, Light(beside, beside)))


def _reflected_once(scene: LitScene) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Once scattered light that regions of a material reflect, and by how much S0 and what is polarised may be off."""
    air, view = scene.air, scene.view
    if air is None or view is None:
        return {}, {}
    lighting = _scattered_once(air)
    sky = DiffuseRadiance(sky=partial(_sky, lighting), sun_azimuth_rad=scene.sun_azimuth_rad)
    through = lighting.transmittance(height_m=view.height_m, zenith_rad=view.zenith_rad)
    found: dict[str, FloatArray] = {}
    off: dict[str, FloatArray] = {}
    for one in scene.regions:
        if one.surface is None or one.tilt is None:
            continue
        panel = PanelLight(surface=one.surface, tilt=one.tilt, views=(view,))
        diffuse = panel.diffuse(sky, _DIFFUSE)[0]
        coarse, fine = (rotate_frame(through * (panel.lobe(sky, order)[0] + diffuse), view.roll_rad) for order in _LOBE)
        found[one.name] = fine
        off[one.name] = _OF_DIFFERENCE * _sizes(fine - coarse) + _OF_ALL * _sizes(fine)
    return found, off


def _sizes(stokes: FloatArray) -> FloatArray:
    """S0 and the polarised part of a light, (2,)."""
    return np.array([abs(stokes[0]), np.hypot(stokes[1], stokes[2])])


def _scattered_once(air: Air) -> BandLighting:
    if air.state is None:
        raise ValueError("air without a state has no light that is scattered once")
    lighting = compute_lighting(
        air.state,
        fidelity=Fidelity.SINGLE,
        band=air.band,
        mu0=float(np.cos(air.sun_zenith_rad)),
        albedo=air.ground_albedo,
        aerosol=air.aerosol,
        settings=_COARSE_LAYERS,
        wavelengths=1 if is_narrow(air.band) else _WAVELENGTHS,
    )
    if not isinstance(lighting, BandLighting):
        raise TypeError(f"light scattered once is a {type(lighting).__name__}")
    return lighting


def _sky(lighting: BandLighting, *, zenith_rad: FloatArray, phi_rad: FloatArray) -> FloatArray:
    """Return the sky of light that air scattered once, of the beam and of the beam off the ground."""
    found = lighting.sky(zenith_rad=zenith_rad, phi_rad=phi_rad)
    mu = np.maximum(np.cos(zenith_rad), 1e-12)
    nodes, place = np.unique(mu, return_inverse=True)
    for column, solution, irradiance in zip(lighting.columns, lighting.solutions, lighting.irradiance, strict=True):
        sent = irradiance * solution.ground_radiance * _from_below(column, nodes)
        found[..., 0] += sent[place].reshape(np.shape(mu))
    return found


def _from_below(column: Column, mu: FloatArray) -> FloatArray:
    """Radiance that air scatters down of an even, unpolarised light from below, over that light, shape of mu.

    Of molecules exactly a half of what they would of light from all sides, and unpolarised: their scattering is the
    same forward and back.
    """
    optics = column.lower
    node, weight = gauss_legendre(_NODES)
    from_direction = (
        henyey_greenstein(g=optics.g, mu=-mu[:, np.newaxis], beam_mu=float(one), phi_rad=np.pi * node) @ weight
        for one in node
    )
    of_aerosol = 0.5 * sum(share * one for share, one in zip(weight, from_direction, strict=True))
    scattered = 0.5 * column.tau_rayleigh + optics.ssa * column.tau_aerosol * of_aerosol
    return np.asarray(scattered / column.depth * -np.expm1(-column.depth / mu))
