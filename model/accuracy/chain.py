"""The whole chain from sun and materials to detection, evaluated for given numerical settings."""

from __future__ import annotations

import time
from collections import OrderedDict, defaultdict
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, TypeVar, Unpack, cast

import numpy as np

from model.atmosphere.layers import Layer
from model.atmosphere.sky import (
    FIDELITY_LEVELS,
    STANDARD_SETTINGS,
    DiffuseLight,
    Fidelity,
    HowToSolve,
    Lighting,
    LightSolver,
    MixedLighting,
    SolverSettings,
    compute_lighting,
    unlit_solution,
)
from model.atmosphere.solver import solve
from model.effects.effect import ALL, Effect
from model.effects.planner import acting
from model.prediction import PairDetection, RegionPrediction, detections_of_sweep, predict_all
from model.quantities import CIRCULAR, error_scale
from model.scene.field import (
    FieldLight,
    FieldPart,
    TileRule,
    before_lens,
    cosine_fourth,
    light_over_field,
    lights_by_rules,
    lights_over_tiles,
    middle,
    off_axis,
)
from model.scene.panel import ApertureLight, Rules, View, aperture_lights
from model.scene.scene import ALL_LIGHT, Air, LightParts, LitRegion, LitScene, RegionLight, Scenario
from model.scene.sky_light import Illumination, MixedSky, Sky, illuminate, sample_sky

# Stages of which the time is taken.
SKY, LIGHT, STATISTICS, DETECTION = "sky", "light", "statistics", "detection"
STAGES = (SKY, LIGHT, STATISTICS, DETECTION)

Clock = Callable[[], float]


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Numerical settings of the whole chain: what costs time and buys accuracy, and nothing else."""

    wavelengths: int  #: at how many the atmosphere is solved, 1 to 20
    solver: SolverSettings  #: streams, layers, element depth and orders of scattering of a solution
    #: Whether each stretch between the entries of the aerosol's tables has its own part of the wavelengths, rounded up.
    split_at_kinks: bool = False
    #: Steps of the grid on which the sky is kept (`model.scene.sky_light.sample_sky`); 0 zeniths for none: the sky
    #: itself is then asked in every direction.
    sky_zeniths: int = 24
    sky_azimuths: int = 20
    hemisphere_tolerance: float = 1e-4  #: of the integral of pBRDF times sky, share of its S0
    tiles_per_side: int = 5  #: nodes over the field of view along each side
    tile_rule: TileRule = "gauss-legendre"
    #: A field over which light varies by less than this share of S0 is taken as a point; 0 to take none as one.
    negligible_spread: float = 1e-3
    #: Relative, of mean and deviation of the pixels' DoLP: decides between first order, second order and quadrature.
    dolp_tolerance: float = 1e-6
    roc_tolerance: float = 1e-10  #: relative, of the tail of the detector's statistic, 1e-12 to 0.01


def settings_of_fidelity(fidelity: Fidelity, *, wavelengths: int = 4) -> Settings:
    """Return the settings that a fidelity level stands for; of one that solves nothing they are not used."""
    return Settings(wavelengths=wavelengths, solver=FIDELITY_LEVELS[fidelity].settings or STANDARD_SETTINGS)


class Reading(NamedTuple):
    """One number of a prediction."""

    place: str  #: a region, or "target on background"
    quantity: str  #: as in `model.prediction.Quantities`, or "radiance", "p_detection", "auc"
    statistic: str


class Value(NamedTuple):
    """A number and what its error is counted in: 1 for an absolute tolerance, its own size for a relative one."""

    number: float
    scale: float


@dataclass(frozen=True, kw_only=True, eq=False)
class ChainResult:
    """Result of one evaluation of the chain."""

    scenario: Scenario  #: light of each region at the aperture, sensor and readout
    illumination: Illumination | None  #: sun, sky and air; None where every radiance is given
    lights: dict[str, FieldLight]  #: of the regions that are given by a material
    predictions: dict[str, RegionPrediction]  #: of the regions, in the order of the scene
    detections: tuple[PairDetection, ...]  #: one for each pair of the scene
    stage_s: dict[str, float]  #: time of each stage [s]; a store that had the answer makes it short
    settings: Settings  #: that were in use
    effects: frozenset[Effect]
    air_key: object = None  #: equal for results under one sky; None where no light of the air was asked for

    @cached_property
    def readings(self) -> dict[Reading, Value]:
        """All numbers that a tolerance speaks of."""
        return readings(self.scenario, self.predictions, self.detections)


_NO_RULES: Mapping[str, Rules] = {}
# That a store keeps at the least, of the scenes that are evaluated together.
_MOST_SKIES, _MOST_LIGHTS = 12, 256


def evaluate(
    scene: LitScene,
    settings: Settings,
    *,
    effects: frozenset[Effect] = ALL,
    rules: Mapping[str, Rules] = _NO_RULES,
    store: LightStore | None = None,
    clock: Clock = time.perf_counter,
) -> ChainResult:
    """Return what the model predicts of a scene, computed with given numerical settings and effects.

    Parameters
    ----------
    scene
        All that the scene is.
    settings
        Numerical settings: what costs time and buys accuracy.
    effects
        That act; the others are left out and not computed.
    rules
        Region to the rules of its hemisphere integral, where they are known from a neighbouring scene.
    store
        Keeps skies and lights between calls; None for a new one.
    clock
        Seconds, rising.

    Raises
    ------
    ValueError
        A number of the scene is outside its range.

    References
    ----------
    [MK14] eq. (1)-(30).
    """
    lights = LightStore() if store is None else store
    return evaluate_all((scene,), settings, effects=effects, rules=rules, store=lights, clock=clock)[0]


def evaluate_all(
    scenes: Sequence[LitScene],
    settings: Settings,
    *,
    effects: frozenset[Effect] = ALL,
    rules: Mapping[str, Rules] = _NO_RULES,
    store: LightStore,
    clock: Clock = time.perf_counter,
) -> tuple[ChainResult, ...]:
    """Return what `evaluate` does for each of several scenes, each stage of all of them in few array passes.

    The scenes have the same regions and pairs; those under one sky follow one another. Each has its share of the time.
    A region without rules has some that suffice in several scenes that differ in the view alone.
    """
    found: list[ChainResult] = []
    for some in _together(scenes):
        found += _evaluated(some, settings, effects, rules, store, clock)
    return tuple(found)


def scenario_of(
    scene: LitScene, settings: Settings, *, effects: frozenset[Effect] = ALL, store: LightStore | None = None
) -> Scenario:
    """Return the first half of `evaluate`: the light of each region at the aperture, sensor and readout."""
    seen = acting(scene, effects)
    used = used_settings(settings, seen)
    if seen.air is None:
        return lit_scenario(seen, {})
    return lit_scenario(seen, lit_fields(seen, used, LightStore() if store is None else store))


def _together(scenes: Sequence[LitScene]) -> Iterator[list[LitScene]]:
    """Yield scenes whose skies and lights a store keeps together."""
    some: list[LitScene] = []
    skies: set[object] = set()
    for scene in scenes:
        sky = None if scene.air is None else scene.air.key
        if some and (len(skies | {sky}) > _MOST_SKIES or len(some) * len(scene.regions) >= _MOST_LIGHTS):
            yield some
            some, skies = [], set()
        some.append(scene)
        skies.add(sky)
    if some:
        yield some


def _evaluated(
    scenes: Sequence[LitScene],
    settings: Settings,
    effects: frozenset[Effect],
    rules: Mapping[str, Rules],
    store: LightStore,
    clock: Clock,
) -> list[ChainResult]:
    seen = [acting(scene, effects) for scene in scenes]
    used, rates = used_settings(settings, seen[0]), scenes[0].p_false_alarm
    taken = dict.fromkeys(STAGES, 0.0)
    with _timed(taken, SKY, clock):
        illuminations = [sun_and_sky(one, used, store) for one in seen]
    with _timed(taken, LIGHT, clock):
        store.keep_together(request for one in seen for request in light_requests(one, used, rules))
        fields = [lit_fields(one, used, store, rules) for one in seen]
    with _timed(taken, STATISTICS, clock):
        scenarios = [lit_scenario(one, field) for one, field in zip(seen, fields, strict=True)]
        predictions = predict_all(scenarios, tolerance=used.dolp_tolerance)
    with _timed(taken, DETECTION, clock):
        detections = detections_of_sweep(predictions, rates, pairs=scenes[0].pairs, tolerance=used.roc_tolerance)
    return [
        ChainResult(
            scenario=scenarios[k],
            illumination=illuminations[k],
            lights=fields[k],
            predictions=predictions[k],
            detections=detections[k],
            stage_s={stage: seconds / len(scenes) for stage, seconds in taken.items()},
            settings=used,
            effects=effects,
            air_key=None if (air := scenes[k].air) is None else air.key,
        )
        for k in range(len(scenes))
    ]


@contextmanager
def _timed(taken: dict[str, float], stage: str, clock: Clock) -> Iterator[None]:
    start = clock()
    yield
    taken[stage] += clock() - start


def readings(
    scenario: Scenario, predictions: Mapping[str, RegionPrediction], detections: tuple[PairDetection, ...]
) -> dict[Reading, Value]:
    """Return all numbers that a tolerance speaks of.

    Absolute: means of DoLP, s1, s2; P_D and the area under its curve. Relative: radiance (S1 and S2 as shares of S0),
    counts, deviations, SNR. A number that does not exist has no reading.
    """
    found: dict[Reading, Value] = {}
    for region in scenario.regions:
        found |= _radiance(region.name, region.stokes_radiance)
    for name, prediction in predictions.items():
        found |= dict(_of_region(name, prediction))
    for pair in detections:
        found |= dict(_of_pair(pair))
    return {key: value for key, value in found.items() if np.isfinite(value.number)}


Readings = Mapping[Reading, Value]


def signed_differences(one: Readings, other: Readings) -> dict[Reading, float]:
    """Return other minus one for each reading of one, in the units of a tolerance; infinite where other has none."""
    return {key: _change(value, other[key].number) if key in other else np.inf for key, value in one.items()}


def differences(one: Readings, other: Readings) -> dict[Reading, float]:
    """Return the size of `signed_differences`."""
    return {key: abs(change) for key, change in signed_differences(one, other).items()}


def _change(value: Value, number: float) -> float:
    apart = number - value.number
    if apart == 0.0:
        return 0.0
    return apart / value.scale if value.scale > 0.0 else np.inf


def _radiance(name: str, stokes: np.ndarray) -> dict[Reading, Value]:
    return {
        Reading(name, "radiance", f"s{k}"): Value(float(stokes[k]), abs(float(stokes[0]))) for k in range(stokes.size)
    }


def _of_region(name: str, prediction: RegionPrediction) -> Iterator[tuple[Reading, Value]]:
    s0 = float(prediction.stokes_dn.mean[0])
    for quantity, statistics in prediction.quantities.items():
        if quantity in CIRCULAR:
            continue
        for statistic, number in statistics.items():
            scale = error_scale(quantity, statistic, number, s0)
            yield Reading(name, quantity, statistic), Value(number, scale)


def _of_pair(pair: PairDetection) -> Iterator[tuple[Reading, Value]]:
    place = f"{pair.target} on {pair.background}"
    for rate, number in zip(pair.p_false_alarm, pair.p_detection, strict=True):
        yield Reading(place, "p_detection", f"{rate:g}"), Value(float(number), 1.0)
    yield Reading(place, "auc", "whole curve"), Value(pair.auc, 1.0)


def used_settings(settings: Settings, scene: LitScene) -> Settings:
    """Return settings with one wavelength where the band does not act."""
    return settings if scene.parts.wavelengths else replace(settings, wavelengths=1)


def sun_and_sky(scene: LitScene, settings: Settings, lights: LightStore) -> Illumination | None:
    """Return sun, sky and air of a scene; None where every radiance is given."""
    if scene.air is None or not _materials(scene):
        return None
    return lights.illumination(scene.air, settings, sun_azimuth_rad=scene.sun_azimuth_rad, parts=scene.parts)


def lit_fields(
    scene: LitScene, settings: Settings, lights: LightStore, rules: Mapping[str, Rules] = _NO_RULES
) -> dict[str, FieldLight]:
    """Return the light of the regions that are given by a material."""
    found = {request.region.name: lights.light(request) for request in light_requests(scene, settings, rules)}
    illumination = sun_and_sky(scene, settings, lights)
    if illumination is None or scene.air is None:
        return found
    albedo = scene.air.ground_albedo
    return {
        name: before_lens(light, illumination, scene.imperfections, ground_albedo=albedo)
        for name, light in found.items()
    }


def light_requests(scene: LitScene, settings: Settings, rules: Mapping[str, Rules]) -> Iterator[LightRequest]:
    """Yield the lights of a scene that are to be computed, by known rules of the hemisphere integral if there are."""
    air, view = scene.air, scene.view
    if air is None or view is None:
        return
    for region in _materials(scene):
        yield LightRequest(
            region=region,
            settings=settings,
            air=air,
            view=view,
            sun_azimuth_rad=scene.sun_azimuth_rad,
            parts=scene.parts,
            rules=rules.get(region.name),
        )


def _materials(scene: LitScene) -> tuple[LitRegion, ...]:
    return tuple(region for region in scene.regions if region.surface is not None)


def lit_scenario(scene: LitScene, fields: dict[str, FieldLight]) -> Scenario:
    """Return the light of each region at the aperture, with sensor and readout."""
    regions = tuple(_region_light(region, fields, scene) for region in scene.regions)
    return Scenario(regions=regions, sensor=scene.sensor, readout=scene.readout, imperfections=scene.imperfections)


def _region_light(region: LitRegion, fields: dict[str, FieldLight], scene: LitScene) -> RegionLight:
    if region.radiance is None:
        return region_light(scene, region, fields[region.name])
    given = RegionLight(
        name=region.name,
        stokes_radiance=region.radiance,
        texture_rms=region.texture_rms,
        texture_cov=region.texture_cov,
    )
    return _with_falloff(given, region, scene)


def region_light(seen: LitScene, region: LitRegion, field: FieldLight) -> RegionLight:
    """Return what a prediction takes of the light of a region over its part of the field.

    [MK14] eq. (7)-(10).
    """
    whole = field.moments(
        seen.source,
        texture_rms=region.texture_rms,
        texture_diagonal=region.texture_diagonal,
        texture_cov=region.texture_cov,
    )
    over_field = field.moments(seen.source, texture_cov=np.zeros((3, 3))).cov
    light = RegionLight(
        name=region.name,
        stokes_radiance=whole.mean,
        texture_rms=0.0,
        texture_cov=whole.cov - over_field,
        field_cov=over_field,
    )
    return _with_falloff(light, region, seen)


def _with_falloff(light: RegionLight, region: LitRegion, scene: LitScene) -> RegionLight:
    if region.part is None or not scene.imperfections.off_axis_falloff:
        return light
    falloff = cosine_fourth(region.part)
    return replace(light, falloff_mean=falloff.mean, falloff_var=falloff.var)


# A sky is asked for again by the next region, the next geometry, or not at all; lights by a sweep or a derivative.
_SKIES, _LIGHTS = 16, 512

# Light that varies by less over a field is the same throughout, whatever parts of it count.
_NEVER = 1e-9

Made = TypeVar("Made")


class LightStore:
    """Computes the light of scenes, and keeps the last of what it computed."""

    def __init__(self, *, solver: LightSolver = solve) -> None:
        """Set what solves a wavelength, such as a store of solutions."""
        self._solver = KeptSolutions(solver)
        self._skies: OrderedDict[object, _Lit] = OrderedDict()
        self._lights: OrderedDict[object, FieldLight] = OrderedDict()
        self._others: OrderedDict[object, object] = OrderedDict()

    @property
    def solver(self) -> LightSolver:
        """Solver of a wavelength, which keeps the last solutions."""
        return self._solver

    def once(self, key: object, make: Callable[[], Made]) -> Made:
        """Return what is kept under a key of the caller's own, with all that it depends on; made where it is not."""
        # What is kept is of many kinds; the key says of which.
        return cast("Made", _kept(self._others, key, _SKIES, make))

    def illumination(
        self, air: Air, settings: Settings, *, sun_azimuth_rad: float, parts: LightParts = ALL_LIGHT
    ) -> Illumination:
        """Return sun, sky and air for given settings, without the parts of the light that do not count."""
        lit = self._kept_sky(air, settings, parts)
        return illuminate(
            lit.lighting,
            sun_zenith_rad=air.sun_zenith_rad,
            sun_azimuth_rad=sun_azimuth_rad,
            ground_albedo=air.ground_albedo,
            sky=lit.sky,
            sky_error=lit.sky_error,
        )

    def light(self, request: LightRequest) -> FieldLight:
        """Return the light of a region that is given by its material."""
        if (whole := self._whole(request)) is not None:
            # Leaving out parts of light that is known needs no computing.
            return whole.with_parts(skylight=request.parts.skylight, path=request.parts.path_radiance)
        return _kept(self._lights, request.key(request.parts), _LIGHTS, lambda: self._made((request,))[0])

    def _whole(self, request: LightRequest) -> FieldLight | None:
        """Return light of which only some parts are asked for, where it is kept with all of them."""
        whole = replace(request.parts, skylight=True, path_radiance=True)
        if request.parts == whole or request.settings.negligible_spread > _NEVER:
            return None
        return self._lights.get(request.key(whole))

    def keep_together(self, requests: Iterable[LightRequest]) -> None:
        """Compute and keep lights, those that differ in the view alone in one pass: together no more than are kept."""
        groups: dict[object, dict[object, LightRequest]] = defaultdict(dict)
        for one in requests:
            if one.key(one.parts) not in self._lights and self._whole(one) is None:
                groups[one.alike][one.key(one.parts)] = one
        for group in groups.values():
            for keys in passes(group):
                for key, light in zip(keys, self._made([group[key] for key in keys]), strict=True):
                    self._lights[key] = light
        while len(self._lights) > _LIGHTS:
            self._lights.popitem(last=False)

    def _made(self, requests: Sequence[LightRequest]) -> tuple[FieldLight, ...]:
        """Lights that differ in the view alone."""
        one = requests[0]
        illumination = self.illumination(one.air, one.settings, sun_azimuth_rad=one.sun_azimuth_rad, parts=one.parts)
        try:
            return lights_of(illumination, requests)
        except ValueError as error:
            raise ValueError(f"region {one.region.name}: {error}") from error

    def _kept_sky(self, air: Air, settings: Settings, parts: LightParts) -> _Lit:
        key = sky_key(air, settings, parts)
        return _kept(self._skies, key, _SKIES, lambda: self._lit(air, settings, parts))

    def _lit(self, air: Air, settings: Settings, parts: LightParts) -> _Lit:
        if air.alternative is not None:
            alone = self._kept_sky(replace(air, alternative=None, share=0.0), settings, parts)
            return _mixed(air, alone, self._kept_sky(air.alternative, settings, parts))
        lighting = self._lighting(air, settings, parts)
        if not parts.skylight:
            return _Lit(air=air, lighting=lighting, sky=_black, sky_error=0.0)
        if air.table is not None or settings.sky_zeniths == 0:
            return _Lit(air=air, lighting=lighting, sky=lighting.sky, sky_error=0.0)
        sampled = sample_sky(
            lighting.sky,
            sun_zenith_rad=air.sun_zenith_rad,
            zeniths=settings.sky_zeniths,
            azimuths=settings.sky_azimuths,
        )
        return _Lit(air=air, lighting=lighting, sky=sampled, sky_error=sampled.relative_error)

    def _lighting(self, air: Air, settings: Settings, parts: LightParts) -> Lighting:
        if air.table is not None:
            return air.table
        if air.state is None:
            raise ValueError("atmosphere: visibility or optical depth of the aerosol is needed, or a table")
        return compute_lighting(
            air.state,
            fidelity=air.fidelity,
            band=air.band,
            mu0=float(np.cos(air.sun_zenith_rad)),
            albedo=air.ground_albedo,
            aerosol=air.aerosol,
            wavelengths=settings.wavelengths,
            split_at_kinks=settings.split_at_kinks,
            dolp_max=air.dolp_max,
            solver=self._solver if scatters(parts) else unlit_solution,
            settings=settings.solver,
        )


def _kept(kept: OrderedDict[object, Made], key: object, limit: int, make: Callable[[], Made]) -> Made:
    """Return what is kept under a key, made where it is not; the oldest by use goes first."""
    if key not in kept:
        kept[key] = make()
        if len(kept) > limit:
            kept.popitem(last=False)
    kept.move_to_end(key)
    return kept[key]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Lit:
    air: Air  # a table is known by its identity, which holds while it is kept
    lighting: Lighting
    sky: Sky
    sky_error: float


def _mixed(air: Air, one: _Lit, other: _Lit) -> _Lit:
    return _Lit(
        air=air,
        lighting=MixedLighting(first=one.lighting, second=other.lighting, share=air.share),
        sky=MixedSky(first=one.sky, second=other.sky, share=air.share),
        sky_error=max(one.sky_error, other.sky_error),
    )


def _black(*, zenith_rad: object, phi_rad: object) -> np.ndarray:
    """Sky without light."""
    shape = np.broadcast_shapes(np.shape(np.asarray(zenith_rad)), np.shape(np.asarray(phi_rad)))
    return np.zeros((*shape, 3))


@dataclass(frozen=True, kw_only=True, eq=False)
class LightRequest:
    """Light of a region given by its material that is asked for."""

    region: LitRegion
    settings: Settings
    air: Air
    view: View
    sun_azimuth_rad: float
    parts: LightParts = ALL_LIGHT
    rules: Rules | None = None

    @cached_property
    def seen(self) -> tuple[View, FieldPart | None]:
        """View and part of the field; of a field that is left out its middle."""
        part = self.region.part
        if part is None or self.parts.field_of_view:
            return self.view, part
        across, upward = middle(part)
        return off_axis(self.view, right=across, up=upward), None

    def key(self, parts: LightParts) -> object:
        """Return what tells this light from others, were some parts of it computed."""
        return self._shared(parts), self.seen

    @property
    def alike(self) -> object:
        """Equal for lights that differ in the view alone, from one height."""
        return self._shared(self.parts), self.view.height_m

    def _shared(self, parts: LightParts) -> object:
        settings, region = self.settings, self.region
        return (
            sky_key(self.air, settings, parts),
            (self.sun_azimuth_rad, region.surface, region.tilt, parts.skylight, parts.path_radiance),
            (settings.hemisphere_tolerance, settings.tiles_per_side, settings.tile_rule, settings.negligible_spread),
            self.rules,
        )


# Views of one pass times the square of their order: some 4e5 nodes, of which a block at a time is looked at. Rules that
# are not known yet are taken to have this order in the end.
_TOGETHER = 4e4
_LIKELY_ORDER = 34


def passes(group: Mapping[object, LightRequest]) -> Iterator[tuple[object, ...]]:
    """Yield keys of requests that are computed together: their nodes need little memory."""
    some: list[object] = []
    nodes = 0
    for key, one in group.items():
        tiles = 1 if one.seen[1] is None else one.settings.tiles_per_side**2
        order = _LIKELY_ORDER if one.rules is None else max(one.rules.lobe, one.rules.diffuse)
        if some and nodes + tiles * order**2 > _TOGETHER:
            yield tuple(some)
            some, nodes = [], 0
        some.append(key)
        nodes += tiles * order**2
    yield tuple(some)


def lights_of(illumination: Illumination, requests: Sequence[LightRequest]) -> tuple[FieldLight, ...]:
    """Return lights that differ in the view alone, in few passes; without known rules by some that suffice for all."""
    one = requests[0]
    surface, tilt, settings = one.region.surface, one.region.tilt, one.settings
    if surface is None or tilt is None:
        raise ValueError("its radiance is given, there is nothing to compute")

    def lights_at(views: tuple[View, ...], rules: Rules | None) -> tuple[ApertureLight, ...]:
        return aperture_lights(
            illumination,
            surface=surface,
            tilt=tilt,
            views=views,
            tolerance=settings.hemisphere_tolerance,
            rules=rules,
            skylight=one.parts.skylight,
            path=one.parts.path_radiance,
        )

    per_side, rule, fields = settings.tiles_per_side, settings.tile_rule, [each.seen for each in requests]
    if one.rules is not None:
        return lights_by_rules(lights_at, one.rules, fields=fields, per_side=per_side, rule=rule)
    if settings.negligible_spread == 0.0:
        return lights_over_tiles(lights_at, fields=fields, per_side=per_side, rule=rule)
    return tuple(
        light_over_field(
            lights_at, view=view, part=part, per_side=per_side, rule=rule, negligible=settings.negligible_spread
        )
        for view, part in fields
    )


def sky_key(air: Air, settings: Settings, parts: LightParts) -> object:
    """Return what tells a sky from others."""
    numbers = (
        settings.wavelengths,
        settings.split_at_kinks,
        settings.solver,
        settings.sky_zeniths,
        settings.sky_azimuths,
    )
    return (air.key, numbers, parts.skylight, scatters(parts))


def scatters(parts: LightParts) -> bool:
    """Return whether light scattered by the air counts at all."""
    return parts.skylight or parts.path_radiance


# Of one wavelength, with many streams and layers ten megabytes.
_KEPT = 48


class KeptSolutions:
    """Calls a solver, and keeps the last solutions."""

    def __init__(self, solver: LightSolver) -> None:
        """Set the solver."""
        self._solver = solver
        self._kept: OrderedDict[Hashable, tuple[tuple[Layer, ...], DiffuseLight]] = OrderedDict()

    def __call__(self, layers: tuple[Layer, ...], **how: Unpack[HowToSolve]) -> DiffuseLight:
        """Return the solution of one wavelength; arguments as `model.atmosphere.solver.solve`."""
        key = (tuple(map(_facts, layers)), *sorted(how.items()))
        if key not in self._kept:
            solution = self._solver(layers, **how)
            # The layers stay with it: a scattering matrix is known by its identity.
            self._kept[key] = (layers, solution)
            if len(self._kept) > _KEPT:
                self._kept.popitem(last=False)
        self._kept.move_to_end(key)
        return self._kept[key][1]


def _facts(layer: Layer) -> Hashable:
    matrix = None if layer.matrix is None else id(layer.matrix)
    scattering = (layer.ssa_aerosol, layer.g_aerosol, layer.delta, layer.forward_share)
    return (layer.tau_rayleigh, layer.tau_aerosol, *scattering, matrix)
