"""Error estimates: from the light of each region, setting by setting, to the error of each number of a prediction.

`light_errors` compares the light by the settings in use with light by finer ones, along a few lines of sight: streams
and layers at one wavelength, wavelengths by functions that are known at all of them, the sky's grid and the hemisphere
integral by finer ones. `error_budgets` carries these errors to what a user reads: it predicts each region with its
light moved by small steps of S0, S1 and S2, with a wider spread over the field, and over one more tile a side.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, islice, repeat
from math import isqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.accuracy.chain import (
    ChainResult,
    LightStore,
    Reading,
    Readings,
    Settings,
    readings,
    region_light,
    signed_differences,
)
from model.accuracy.plan import (
    DOLP,
    HEMISPHERE,
    LAYERS,
    NUMERICAL_SETTINGS,
    ROC,
    SKY_GRID,
    STREAMS,
    TILES,
    WAVELENGTHS,
    Budget,
    Plan,
    SpectralError,
    at_level,
    kept_forecast,
    spectral_error,
    unused,
)
from model.atmosphere.sky import (
    AnalyticLighting,
    BandLighting,
    Fidelity,
    Lighting,
    MixedLighting,
    analytic_lighting,
    single_solution,
    solve_column,
)
from model.effects.planner import acting
from model.prediction import PairDetection, RegionPrediction, detections_of_cases, predict_all
from model.scene.field import FieldLight, Source, Tile, before_lens, tiles
from model.scene.panel import ApertureLight, PanelLight, Rules, View, aperture_lights, reflected_by_rules
from model.scene.scene import Air, LitRegion, LitScene, RegionLight
from model.scene.sky_light import DiffuseRadiance, Illumination, SampledSky, Sky, sample_sky, sample_smooth
from model.stokes import rotate_frame

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class LightError:
    """Estimated error of the light of a region [W m-2 sr-1]."""

    together: FloatArray  #: errors of (S0, S1, S2) that come together, with their signs, (K, 3)
    apart: FloatArray  #: sizes of errors that may have any sign, each on its own, (3,)
    field: FloatArray  #: how far errors may differ over the field, (3,)

    def scaled(self, factor: float) -> LightError:
        """Return all of it multiplied by a factor, 0 or more."""
        return LightError(together=factor * self.together, apart=factor * self.apart, field=factor * self.field)

    @property
    def largest(self) -> float:
        """What S0 may be off by, all with one sign [W m-2 sr-1]."""
        return float(np.sum(np.abs(self.together[:, 0])) + self.apart[0])

    @property
    def is_nothing(self) -> bool:
        """True if there is no error at all."""
        return not (np.any(self.together) or np.any(self.apart) or np.any(self.field))


# Grid on which the difference of two skies is read: it has no aureole, for light scattered once is the same in both.
_ZENITHS, _AZIMUTHS = 12, 10
# The sky's grid is tried with two wavelengths and along few lines of sight, while its error has now one sign, now the
# other: so much of the larger of both, with any sign, and such shares of the largest error of any direction may be
# found beside it. With these, 720 regions of 120 random scenes, three grids each, had more in one of 250.
_ANY_SIGN, _OF_LARGEST = 0.5, np.array([2e-3, 4e-4, 4e-4])
# Steps of the finer grid beside which it is set, over its own.
_FINER_GRID = 1.5
# Light that may be off by no more than this share of the tolerance, whatever its direction, needs no closer look.
_HARMLESS = 0.01
# Settings of a solution, and all settings that the references of a sky depend on.
_SOLVED = (STREAMS, LAYERS)
_OF_SKY = (*_SOLVED, WAVELENGTHS, SKY_GRID)
# Parts of the light that a source has, the error of the transmittance being that of all that is reflected.
_PARTS: dict[Source, frozenset[str]] = {
    "total": frozenset({"reflected_sky", "path", "reflected"}),
    "reflected": frozenset({"reflected_sky", "reflected"}),
    "reflected_sun": frozenset({"reflected"}),
    "reflected_sky": frozenset({"reflected_sky", "reflected"}),
    "path": frozenset({"path"}),
}


def light_errors(
    cases: Sequence[tuple[LitScene, ChainResult]], plan: Plan, store: LightStore, *, tolerance: float
) -> list[dict[str, dict[str, LightError]]]:
    """Return for each of several scenes setting to region to the estimated error of its light, but for the tiles.

    A setting of which the effects that act make no use has no error: what leaving an effect out changes is bounded
    elsewhere. What is far below the tolerance is not looked at closely.
    """
    scene, result = cases[0]
    errors: list[dict[str, dict[str, LightError]]] = [{setting: {} for setting in NUMERICAL_SETTINGS} for _ in cases]
    if result.illumination is None or scene.air is None:
        return errors
    idle, air, illumination = unused(result.effects), scene.air, result.illumination
    of_sky = store.once(
        ("references", air.key, tuple(plan[name] for name in _OF_SKY), result.settings.solver, result.effects),
        lambda: _References(air, plan, result.settings, illumination, store),
    )
    every = {
        (place, region.name): _lines_of_sight(one, region, found.lights[region.name])
        for place, (one, found) in enumerate(cases)
        for region in one.regions
        if region.surface is not None
    }
    of_settings: dict[str, Errors] = {}
    if STREAMS not in idle and of_sky.pair is not None:
        solved = _off_by(1.0, every, scene.source, _SCATTERED, tolerance=tolerance)
        left = {key: lines for key, lines in every.items() if key not in solved}
        solved |= _between(of_sky.pair, of_sky.difference, left, scene.source) if left else {}
        likely = kept_forecast(scene, result.effects, store, tolerance=tolerance).errors
        streams, layers = (likely[name][plan[name]] if air.is_solved or name == LAYERS else 0.0 for name in _SOLVED)
        for name, own in ((STREAMS, streams), (LAYERS, layers)):
            of_settings[name] = {key: error.scaled(own / (streams + layers)) for key, error in solved.items()}
    if air.state is not None and WAVELENGTHS not in idle:
        of_settings[WAVELENGTHS] = _of_wavelengths(air, result.settings, every, scene.source)
    if HEMISPHERE not in idle:
        of_settings[SKY_GRID] = _of_grid(of_sky, every, scene.source, tolerance=tolerance)
        of_settings[HEMISPHERE] = {
            key: _of_hemisphere(lines, of_sky.of_grid, scene.source) for key, lines in every.items()
        }
    for setting, of_setting in of_settings.items():
        for (place, name), error in of_setting.items():
            errors[place][setting][name] = error
    return errors


@dataclass(frozen=True, kw_only=True, eq=False)
class LitCase:
    """A case whose light has errors that are known."""

    scene: LitScene
    result: ChainResult
    lights: Mapping[str, Mapping[str, LightError]]  #: setting to region to error


def error_budgets(cases: Sequence[LitCase], *, tolerance: float, tiles: bool = True) -> list[Budget]:
    """Return the estimated errors of all readings of cases, to first order in the errors of the light.

    The signs of these are not known. Without `tiles` one more tile along each side is not tried, and nothing is said of
    the tiles.
    """
    asked = [
        (place, region.name)
        for place, case in enumerate(cases)
        for region in case.result.scenario.regions
        if region.name in case.result.lights
    ]
    finer: Iterable[RegionLight | None] = _on_more_tiles(cases, asked) if tiles else repeat(None)
    tried: list[dict[str, _Tried]] = [{} for _ in cases]
    for (place, name), more in zip(asked, finer, strict=tiles):
        tried[place][name] = _tried(cases[place], name, more, tolerance=tolerance)
    others = [{name: one.lights for name, one in regions.items() if one.lights} for regions in tried]
    changed = _changes(cases, others)
    return [_budget(case, of, found) for case, of, found in zip(cases, tried, changed, strict=True)]


_SCATTERED: frozenset[str] = frozenset({"reflected_sky", "path"})


def _off_by(
    share: float, every: Lines, source: Source, parts: frozenset[str], *, tolerance: float
) -> dict[tuple[int, str], LightError]:
    """Return the errors of regions where parts of the light may be off by a share and that is harmless."""
    found = {}
    for key, lines in every.items():
        sizes = share * sum((np.abs(lines.part(name)[:, :1]) for name in parts & _PARTS[source]), np.zeros((1, 1)))
        if np.max(sizes) <= _HARMLESS * tolerance * np.min(np.abs(lines.part(source)[:, 0])):
            found[key] = _error([], apart=sizes * np.ones(3))
    return found


@dataclass(frozen=True, eq=False)
class _References:
    """Finer solutions of one sky, which its errors are estimated from; each is computed when first needed."""

    air: Air
    plan: Plan
    settings: Settings
    illumination: Illumination
    store: LightStore

    @cached_property
    def pair(self) -> _Pair | None:
        """Lightings that differ in streams and layers; None for a table."""
        return _beside(self.air, self.plan, self.settings, self.illumination.lighting, self.store)

    @cached_property
    def difference(self) -> SampledSky:
        """Difference of the skies of the pair."""
        pair = self.pair
        if pair is None:
            raise ValueError("a table has no streams and no layers")

        def apart(*, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> FloatArray:
            one, other = (each.sky(zenith_rad=zenith_rad, phi_rad=phi_rad) for each in (pair.one, pair.other))
            return pair.factor * (other - one)

        return sample_smooth(apart, zeniths=_ZENITHS, azimuths=_AZIMUTHS)

    @property
    def of_grid(self) -> float:
        """Largest relative error of the sky's grid in any direction."""
        return self.illumination.diffuse_radiance.relative_error

    @cached_property
    def grid_differences(self) -> tuple[Sky, ...]:
        """Skies of both ends of the band on the grid, minus the same on a finer one."""
        return tuple(self._grid_difference(end.sky) for end in _ends_of_band(self.illumination.lighting))

    def _grid_difference(self, sky: Sky) -> Sky:
        coarse, fine = (
            sample_sky(
                sky,
                sun_zenith_rad=self.illumination.sun_zenith_rad,
                zeniths=round(finer * self.settings.sky_zeniths),
                azimuths=round(finer * self.settings.sky_azimuths),
            )
            for finer in (1.0, _FINER_GRID)
        )

        def apart(*, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> FloatArray:
            found, nearer = (each(zenith_rad=zenith_rad, phi_rad=phi_rad) for each in (coarse, fine))
            return found - nearer

        return apart


def _between(pair: _Pair, sky: Sky, every: Lines, source: Source) -> Errors:
    """Return what two lightings differ by: in the sky that is reflected, and on the way to the camera."""
    seen = tuple(every.values())
    ways = (_ways_to_camera(seen, lighting) for lighting in (pair.one, pair.other))
    reflected = _reflected_by_all(seen, sky)
    found = {}
    for (key, lines), sky_part, (path, kept), (other_path, other_kept) in zip(
        every.items(), reflected, *ways, strict=True
    ):
        through = pair.factor * _changed(kept, other_kept)
        errors = {
            "reflected_sky": sky_part,
            "path": pair.factor * (other_path - path),
            "reflected": through[:, np.newaxis] * lines.part("reflected"),
        }
        found[key] = _error([sum((errors[part] for part in _PARTS[source]), np.zeros((1, 3)))])
    return found


def _changed(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return by what share transmittances differ; by none where nothing is let through at all."""
    return np.divide(other - one, one, out=np.zeros_like(one), where=one > 0.0)


def _of_wavelengths(air: Air, settings: Settings, every: Lines, source: Source) -> Errors:
    """Return what the wavelengths leave out of what the air scatters and lets through; of two airs the larger."""
    errors = [spectral_error(one, settings) for one in (air, air.alternative) if one is not None]
    return {key: _of_spectrum(errors, lines, source) for key, lines in every.items()}


def _of_spectrum(errors: Sequence[SpectralError], lines: _LinesOfSight, source: Source) -> LightError:
    alike, unlike = (max(getattr(error, name) for error in errors) for name in ("scattered", "by_component"))
    through = [max(abs(_of_way(error, light)) for error in errors) for light in lines.lights]
    shares = {"reflected_sky": alike, "path": alike, "reflected": np.array(through)[:, np.newaxis]}
    rows = [share * lines.part(part) for part, share in shares.items() if part in _PARTS[source]]
    scattered = [np.abs(lines.part(part)) for part in {"reflected_sky", "path"} & _PARTS[source]]
    apart = unlike * sum(scattered, np.zeros((1, 3))) * np.array([0.0, 1.0, 1.0])
    return _error(rows, apart=apart)


def _of_way(error: SpectralError, light: ApertureLight) -> float:
    """Relative error of the transmittance, by the slant depth that the transmittance itself tells."""
    if light.transmittance <= 0.0:
        return 0.0
    return error.transmittance(slant=-float(np.log(light.transmittance)) / error.mean_depth)


_NO_ROWS = np.zeros((0, 3))
_NOTHING = LightError(together=_NO_ROWS, apart=np.zeros(3), field=np.zeros(3))


def _of_grid(of_sky: _References, every: Lines, source: Source, *, tolerance: float) -> Errors:
    """Return the difference of the sky's grid from the sky itself, as the regions reflect both."""
    found = _off_by(of_sky.of_grid, every, source, frozenset({"reflected_sky"}), tolerance=tolerance)
    close = {key: lines for key, lines in every.items() if key not in found}
    if not close:
        return found
    seen = [_reflected_by_all(tuple(close.values()), difference) for difference in of_sky.grid_differences]
    for (key, lines), *ends in zip(close.items(), *seen, strict=True):
        errors = [_largest_last(end) for end in ends]
        any_sign = _ANY_SIGN * np.max(np.abs(np.concatenate(errors)), axis=0)
        size = of_sky.of_grid * np.abs(lines.part("reflected_sky")[:, :1])
        found[key] = _error(errors, apart=any_sign + _OF_LARGEST * size)
    return found


def _of_hemisphere(lines: _LinesOfSight, of_grid: float, source: Source) -> LightError:
    """Difference of the rules used from finer ones, and the error of these, without that of the sky's grid."""
    if "reflected_sky" not in _PARTS[source]:
        return _NOTHING
    left = [max(finer.error - of_grid * abs(finer.reflected_sky[0]), 0.0) for finer in lines.finer]
    return _error([_largest_last(lines.missed_by_rules())], apart=np.array(left)[:, np.newaxis] * np.ones(3))


def _largest_last(errors: FloatArray) -> FloatArray:
    """Errors along lines of sight (V, 3), so ordered that the largest stands for the region, and not its middle."""
    return errors[np.argsort(np.max(np.abs(errors), axis=-1))]


def _error(together: list[FloatArray], *, apart: FloatArray | None = None) -> LightError:
    """Errors along lines of sight, each (V, 3), as those of a region: the last is its middle."""
    loose = np.zeros((1, 3)) if apart is None else apart
    differ = sum((np.ptp(each, axis=0) for each in (*together, loose)), np.zeros(3))
    return LightError(
        together=np.array([each[-1] for each in together]).reshape(-1, 3),
        apart=np.max(loose, axis=0),
        field=0.5 * differ,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pair:
    """Two lightings whose difference, times a factor, stands for an error."""

    one: Lighting
    other: Lighting
    factor: float


# What lies beyond the next level of both in the difference from this one: of streams the convergence is geometric, that
# of layers square. In the difference from the level before, where there is no next one, lies at most so much.
_BEYOND, _BEFORE = 1.6, 0.5


def _beside(air: Air, plan: Plan, settings: Settings, lighting: Lighting, store: LightStore) -> _Pair | None:
    """Return the shortest wavelength as it is and with more streams and layers: errors of both together, with signs.

    Light scattered once has no streams, and a table has neither.
    """
    if isinstance(lighting, MixedLighting) and air.alternative is not None:
        one = _beside(replace(air, alternative=None, share=0.0), plan, settings, lighting.first, store)
        other = _beside(air.alternative, plan, settings, lighting.second, store)
        if one is None or other is None:
            return None
        return _Pair(
            one=MixedLighting(first=one.one, second=other.one, share=air.share),
            other=MixedLighting(first=one.other, second=other.other, share=air.share),
            factor=max(one.factor, other.factor),
        )
    band = lighting.path_and_beam if isinstance(lighting, AnalyticLighting) else lighting
    if not isinstance(band, BandLighting):
        return None
    is_finest = any(plan[name] + 1 == len(NUMERICAL_SETTINGS[name].levels) for name in _SOLVED)
    finer = settings
    for name in _SOLVED:
        finer = at_level(finer, name, max(plan[name] - 1, 0) if is_finest else plan[name] + 1)
    return _Pair(
        one=_seen(air, _alone(band, slice(1))),
        other=_seen(air, _solved(air, finer, band, store)),
        factor=_BEFORE if is_finest else _BEYOND,
    )


def _seen(air: Air, band: BandLighting) -> Lighting:
    """Light as the fidelity level of the air has it."""
    if air.fidelity is not Fidelity.ANALYTIC:
        return band
    return analytic_lighting(band, mu0=float(np.cos(air.sun_zenith_rad)), dolp_max=air.dolp_max)


def _solved(air: Air, settings: Settings, band: BandLighting, store: LightStore) -> BandLighting:
    """Light of the shortest wavelength with settings of its own: most of it is scattered more than once."""
    shortest = _alone(band, slice(1))
    (column,), (known,) = shortest.columns, shortest.solutions
    solution = solve_column(
        store.solver if air.is_solved else single_solution,
        column,
        settings.solver,
        mu0=known.mu0,
        albedo=air.ground_albedo,
        aerosol=air.aerosol,
    )
    return replace(shortest, solutions=(solution,))


def _ends_of_band(lighting: Lighting) -> tuple[Lighting, ...]:
    """Return the shortest and the longest wavelength of computed light, each standing for all of its band.

    At the longest the air is thinnest: its sky is brighter toward the horizon, and changes faster, than at any other.
    """
    one = lighting.first if isinstance(lighting, MixedLighting) else lighting
    if not isinstance(one, BandLighting) or len(one.columns) == 1:
        return (one,)
    return (_alone(one, slice(1)), _alone(one, slice(-1, None)))


def _alone(band: BandLighting, at: slice) -> BandLighting:
    """Light of one of a band's wavelengths, standing for all of them."""
    total = np.array([np.sum(band.irradiance)])
    return replace(band, columns=band.columns[at], solutions=band.solutions[at], irradiance=total)


@dataclass(frozen=True, kw_only=True, eq=False)
class _LinesOfSight:
    """Lines of sight of a region given by its material: two corners of its field and the middle."""

    region: LitRegion
    lights: tuple[ApertureLight, ...]
    finer: tuple[ApertureLight, ...]  #: the same light by finer rules of the hemisphere integral
    sun_azimuth_rad: float

    def part(self, name: str) -> FloatArray:
        """Return a part of the light that was found, shape (V, 3)."""
        return np.stack([getattr(light, name) for light in self.lights])

    def missed_by_rules(self) -> FloatArray:
        """Return what finer rules of the hemisphere integral add to the reflected sky, shape (V, 3)."""
        return np.stack([finer.reflected_sky for finer in self.finer]) - self.part("reflected_sky")

    @property
    def views(self) -> tuple[View, ...]:
        """The camera along each of them."""
        return tuple(light.view for light in self.lights)


def _lines_of_sight(scene: LitScene, region: LitRegion, light: FieldLight) -> _LinesOfSight:
    """Return where to look for a region."""
    per_side, tiles = isqrt(len(light.lights)), dict(enumerate(light.lights))
    middle = (per_side // 2) * (per_side + 1)
    chosen = tuple(dict.fromkeys((0, len(tiles) - 1, middle)))
    return _LinesOfSight(
        region=region,
        lights=tuple(tiles[k] for k in chosen),
        finer=tuple({**tiles, **light.finer}[k] for k in chosen),
        sun_azimuth_rad=scene.sun_azimuth_rad,
    )


def _reflected_by_all(several: Sequence[_LinesOfSight], sky: Sky) -> list[FloatArray]:
    """Return what regions send of a sky to the camera, by the rules that were used, each (V, 3)."""
    groups: dict[object, list[int]] = defaultdict(list)
    for place, lines in enumerate(several):
        region = lines.region
        groups[region.surface, region.tilt, lines.sun_azimuth_rad, lines.lights[0].rules].append(place)
    found: dict[int, FloatArray] = {}
    for places in groups.values():
        found |= dict(zip(places, _reflected([several[place] for place in places], sky), strict=True))
    return [found[place] for place in range(len(several))]


def _reflected(alike: Sequence[_LinesOfSight], sky: Sky) -> list[FloatArray]:
    one = alike[0]
    if one.region.surface is None or one.region.tilt is None:
        raise ValueError(f"region {one.region.name}: its radiance is given, it reflects no sky")
    views, lights = (tuple(chain.from_iterable(getattr(each, name) for each in alike)) for name in ("views", "lights"))
    panel = PanelLight(surface=one.region.surface, tilt=one.region.tilt, views=views)
    radiance = DiffuseRadiance(sky=sky, sun_azimuth_rad=one.sun_azimuth_rad)
    stokes = reflected_by_rules(panel, radiance, one.lights[0].rules)
    through = np.array([light.transmittance for light in lights])
    seen = rotate_frame(through[:, np.newaxis] * stokes, np.array([view.roll_rad for view in views]))
    return np.split(seen, _ends(alike))


def _ways_to_camera(several: Sequence[_LinesOfSight], lighting: Lighting) -> list[tuple[FloatArray, FloatArray]]:
    """Return what the air adds along the lines of sight of several regions, and lets through, all in one pass."""
    if not several:
        return []
    views = [view for lines in several for view in lines.views]
    height_m, zenith = views[0].height_m, np.array([view.zenith_rad for view in views])
    phi = np.array([lines.sun_azimuth_rad - view.azimuth_rad for lines in several for view in lines.views])
    path = lighting.path(height_m=height_m, zenith_rad=zenith, phi_rad=phi)
    path = rotate_frame(path, np.array([view.roll_rad for view in views]))
    through = lighting.transmittance(height_m=height_m, zenith_rad=zenith)
    return list(zip(np.split(path, _ends(several)), np.split(through, _ends(several)), strict=True))


def _ends(several: Sequence[_LinesOfSight]) -> NDArray[np.intp]:
    """Return where the lines of sight of each but the last end."""
    return np.cumsum([len(lines.lights) for lines in several])[:-1]


Changes = dict[Reading, float]


def _budget(case: LitCase, tried: Mapping[str, _Tried], changed: Mapping[str, Sequence[Changes]]) -> Budget:
    result = case.result
    by_setting: dict[str, dict[Reading, float]] = {setting: defaultdict(float) for setting in case.lights}
    for name, of_region in changed.items():
        for setting, found in tried[name].changed(of_region):
            _add(by_setting[setting], found)
    by_setting |= {DOLP: _of_dolp(result), ROC: _of_detection(result)}
    total = {key: sum(errors.get(key, 0.0) for errors in by_setting.values()) for key in result.readings}
    return Budget(by_setting={setting: dict(errors) for setting, errors in by_setting.items()}, total=total)


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


# What one more tile along each side changes is what the tiles miss: of the fields of 240 random scenes, by 3 to 5
# tiles, the middle one by a few hundredths more or less, one of twenty by 0.8 of it or less. A kink may hide from it.
_OF_MORE_TILES = 2.0

# Light of a region whose covariance over the field has grown by what errors differ there.
_WIDER = "wider"
# Light that is less by all that its errors may take from S0: what exists by a hair may not exist there.
_DIMMER = "dimmer"


@dataclass(frozen=True, kw_only=True, eq=False)
class _Tried:
    """Other lights of a region, by which its errors are carried to what a user reads."""

    errors: Mapping[str, LightError]
    steps: FloatArray  #: of S0, S1 and S2, one at a time; none where there are no errors
    stepped: tuple[RegionLight, ...]
    others: Mapping[str, RegionLight]

    @property
    def lights(self) -> tuple[RegionLight, ...]:
        """All of them."""
        return (*self.stepped, *self.others.values())

    def changed(self, found: Sequence[Changes]) -> Iterator[tuple[str, Changes]]:
        """Yield settings and changes: by their errors, by differences of these over the field, by the tiles.

        Of dimmer light it counts alone what does not exist there.
        """
        count = len(self.stepped)
        # The changes per unit of each component's error.
        moves = [
            {key: change / size for key, change in each.items()}
            for each, size in zip(found[:count], self.steps.tolist(), strict=True)
        ] or [{}, {}, {}]
        changed = dict(zip(self.others, found[count:], strict=True))
        differ = _differ(self.errors)
        for setting, error in self.errors.items():
            if not np.all(np.isfinite(error.field)):
                # Nothing is known of the light there, as of the air along a line of sight at the horizon.
                yield setting, dict.fromkeys((key for each in moves for key in each), np.inf)
                continue
            yield setting, _moved_error_budget(moves, error)
            yield setting, {key: change for key, change in changed.get(_DIMMER, {}).items() if not np.isfinite(change)}
            if _WIDER in changed and np.any(error.field):
                share = float(np.mean((error.field / differ)[differ > 0.0]))
                yield setting, {key: share * abs(change) for key, change in changed[_WIDER].items()}
        if TILES in changed:
            yield TILES, {key: _OF_MORE_TILES * abs(change) for key, change in changed[TILES].items()}


def _tried(case: LitCase, name: str, more_tiles: RegionLight | None, *, tolerance: float) -> _Tried:
    region = next(one for one in case.result.scenario.regions if one.name == name)
    of_region = ((setting, found[name]) for setting, found in case.lights.items() if name in found)
    there = {setting: error for setting, error in of_region if not error.is_nothing}
    differ = _differ(there)
    others: dict[str, RegionLight] = {}
    if np.all(np.isfinite(differ)) and np.any(differ):
        before = np.zeros((3, 3)) if region.field_cov is None else region.field_cov
        others[_WIDER] = replace(region, field_cov=_grown(before, differ))
    less, s0 = sum(error.largest for error in there.values()), float(region.stokes_radiance[0])
    if 0.0 < less < s0:
        others[_DIMMER] = _dimmed(region, less / s0)
    if more_tiles is not None:
        others[TILES] = more_tiles
    steps = _step_sizes(region, tolerance=tolerance) if there else np.zeros(0)
    change = _texture_change(case, name)
    stepped = tuple(
        replace(region, stokes_radiance=region.stokes_radiance + step, texture_cov=region.texture_cov + change(step))
        for step in (np.diag(steps) if steps.size else ())
    )
    return _Tried(errors=there, steps=steps, stepped=stepped, others=others)


def _moved_error_budget(moves: Sequence[Changes], error: LightError) -> Changes:
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


def _differ(errors: Mapping[str, LightError]) -> FloatArray:
    """Return how far the errors of all settings together may differ over the field."""
    return sum((error.field for error in errors.values()), np.zeros(3))


def _add(errors: dict[Reading, float], more: Changes) -> None:
    for key, error in more.items():
        errors[key] += error


def _texture_change(case: LitCase, name: str) -> Callable[[FloatArray], FloatArray]:
    """Return by how much the texture's covariance of a region changes where the reflected light does by a step."""
    source = case.scene.source
    given = next(region for region in acting(case.scene, case.result.effects).regions if region.name == name)
    light = "reflected" if source == "total" else source
    reflected = case.result.lights[name].moments(light, texture_cov=np.zeros((3, 3))).mean
    rms, diagonal = (0.0, np.zeros(3)) if source == "path" else (given.texture_rms, np.array(given.texture_diagonal))

    def change(step: FloatArray) -> FloatArray:
        across = np.outer(reflected, step)
        of_factor = rms**2 * (across + across.T + np.outer(step, step))
        return np.asarray(of_factor + step[0] * (2.0 * reflected[0] + step[0]) * np.diag(np.square(diagonal)))

    return change


# Of the tolerance, as a share of S0: small beside what bends the curve of a quantity, large beside its rounding. Of S1
# and S2 no more than this share of what is polarized, which bends DoLP, and no less than this share of the step of S0.
_STEP, _OF_POLARIZED, _LEAST_OF_STEP = 0.3, 0.3, 0.1
_LEAST_STEP = 1e-7
# Of the largest component of an error what any may have at other places of the field.
_ELSEWHERE = 0.3


def _step_sizes(region: RegionLight, *, tolerance: float) -> FloatArray:
    """Return steps small beside what bends the curve of a quantity, and large beside its rounding; none in the dark.

    Differences are one-sided. Toward more polarization, where DoLP bends so that they are rather too large; toward less
    near a degree of 1, beyond which there is no light.
    """
    s0, polarized = abs(float(region.stokes_radiance[0])), float(np.hypot(*region.stokes_radiance[1:]))
    size = max(_STEP * tolerance, _LEAST_STEP) * s0
    if size == 0.0:
        return np.zeros(0)
    smaller = min(size, max(_OF_POLARIZED * polarized, _LEAST_OF_STEP * size))
    outward = np.where(region.stokes_radiance < 0.0, -1.0, 1.0)
    sign = 1.0 if polarized + smaller < s0 else -1.0
    return np.asarray(outward * np.array([size, sign * smaller, sign * smaller]))


def _dimmed(region: RegionLight, share: float) -> RegionLight:
    """Return light that is less by a share, with its texture, and as much polarized."""
    left = 1.0 - share
    return replace(region, stokes_radiance=left * region.stokes_radiance, texture_cov=left**2 * region.texture_cov)


def _grown(cov: FloatArray, sizes: FloatArray) -> FloatArray:
    """Return a covariance whose deviations have grown by the sizes of an error along each of its principal axes.

    Definition: axes and deviations in units of the sizes, each deviation by 1.
    """
    unit = np.maximum(sizes, _ELSEWHERE * np.max(sizes))
    values, vectors = np.linalg.eigh(cov / np.outer(unit, unit))
    roots = np.sqrt(np.maximum(values, 0.0)) + 1.0
    return np.asarray((vectors * roots**2) @ vectors.T * np.outer(unit, unit))


def _changes(
    cases: Sequence[LitCase], others: Sequence[Mapping[str, Sequence[RegionLight]]]
) -> list[dict[str, list[Changes]]]:
    """Return for each case region to the changes of the readings by each other light of it; infinite where lost."""
    every = [[(name, light) for name, lights in of_regions.items() for light in lights] for of_regions in others]
    alone = iter(
        _predicted([(case.result, light) for case, each in zip(cases, every, strict=True) for _, light in each])
    )
    predicted = [[(name, light, next(alone)) for name, light in each] for each in every]
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
    return [_changes_of(case, lights, detections) for case, lights in zip(cases, predicted, strict=True)]


def _changes_of(
    case: LitCase,
    predicted: Sequence[tuple[str, RegionLight, RegionPrediction | None]],
    detections: Iterator[PairDetection],
) -> dict[str, list[Changes]]:
    bases = {name: _base(case.scene, case.result, name) for name, _, _ in predicted}
    changed: dict[str, list[Changes]] = {name: [] for name in bases}
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


def _on_more_tiles(cases: Sequence[LitCase], asked: Sequence[tuple[int, str]]) -> list[RegionLight | None]:
    """Return the light of regions of cases over one more tile along each side; None for a point.

    The rules of the hemisphere integral stay; lights that differ in the view alone are computed together.
    """
    groups: dict[object, list[tuple[int, Sequence[Tile]]]] = defaultdict(list)
    for k, (place, name) in enumerate(asked):
        case, region = cases[place], _region_of(cases[place], name)
        if more := _more_tiles(case, region):
            result, scene = case.result, case.scene
            sky = (result.air_key, result.settings, result.effects, scene.sun_azimuth_rad, scene.sensor_height_m)
            groups[sky, region.surface, region.tilt, _rules_of(case, name)].append((k, more))
    found: list[RegionLight | None] = [None for _ in asked]
    for group in groups.values():
        place, name = asked[group[0][0]]
        lights = iter(_lights_at(cases[place], name, [tile for _, more in group for tile in more]))
        for k, more in group:
            place, name = asked[k]
            found[k] = _over_tiles(cases[place], name, more, tuple(islice(lights, len(more))))
    return found


def _more_tiles(case: LitCase, region: LitRegion) -> Sequence[Tile]:
    used, settings = len(case.result.lights[region.name].lights), case.result.settings
    if region.part is None or case.scene.view is None or used == 1:
        return ()
    return tiles(region.part, case.scene.view, per_side=isqrt(used) + 1, rule=settings.tile_rule)


def _lights_at(case: LitCase, name: str, seen: Sequence[Tile]) -> tuple[ApertureLight, ...]:
    region, illumination = _region_of(case, name), case.result.illumination
    if region.surface is None or region.tilt is None or illumination is None:
        raise ValueError(f"region {name}: its radiance is given, there is nothing to compute")
    parts = acting(case.scene, case.result.effects).parts
    return aperture_lights(
        illumination,
        surface=region.surface,
        tilt=region.tilt,
        views=tuple(tile.view for tile in seen),
        rules=_rules_of(case, name),
        skylight=parts.skylight,
        path=parts.path_radiance,
    )


def _over_tiles(case: LitCase, name: str, more: Sequence[Tile], lights: tuple[ApertureLight, ...]) -> RegionLight:
    """Return what a prediction takes of lights over a field."""
    seen, illumination, air = acting(case.scene, case.result.effects), case.result.illumination, case.scene.air
    spread = case.result.lights[name].spread
    field = FieldLight(lights=lights, weights=tuple(tile.weight for tile in more), spread=spread)
    if air is not None and illumination is not None:
        field = before_lens(field, illumination, seen.imperfections, ground_albedo=air.ground_albedo)
    return region_light(seen, _region_of(case, name), field)


def _region_of(case: LitCase, name: str) -> LitRegion:
    return next(one for one in case.scene.regions if one.name == name)


def _rules_of(case: LitCase, name: str) -> Rules:
    """Return the rules of the hemisphere integral by which the tiles of a region were found."""
    return case.result.lights[name].lights[0].rules


# By the place of a case among several, and a region's name.
Lines = Mapping[tuple[int, str], _LinesOfSight]
Errors = Mapping[tuple[int, str], LightError]
