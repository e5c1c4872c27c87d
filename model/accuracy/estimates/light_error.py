"""Estimated error of the light of each region, setting by setting."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.accuracy.estimates.lines_of_sight import LinesOfSight, Way, lines_of_sight, ways_to_camera
from model.accuracy.estimates.refined_reference import Pair, ends_of_band, refined_references
from model.accuracy.evaluation.chain import ChainResult
from model.accuracy.evaluation.light_store import LightStore
from model.accuracy.evaluation.settings import Settings
from model.accuracy.planning.forecast import unused
from model.accuracy.planning.numerical_settings import (
    HEMISPHERE,
    LAYERS,
    NUMERICAL_SETTINGS,
    SKY_GRID,
    STREAMS,
    WAVELENGTHS,
    Plan,
)
from model.accuracy.planning.spectral_error import SpectralError, spectral_error
from model.scene.aperture_radiance import ApertureLight
from model.scene.field_light import FieldLight, Source
from model.scene.illumination import Illumination
from model.scene.lit_scene import Air, LitScene
from model.scene.sampled_sky import SampledSky, sample_sky, sample_smooth
from model.scene.sky import Sky

FloatArray = NDArray[np.float64]

# Grid on which the difference of two skies is read: it has no aureole, for light scattered once is the same in both.
_ZENITHS, _AZIMUTHS = 12, 10
# The sky's grid is tried with two wavelengths and along few lines of sight, while its error has now one sign, now the
# other: so much of the larger of both, with any sign, and such shares of the largest error of any direction may be
# found beside it. With these, 720 regions of 120 random scenes, three grids each, had more in one of 250.
_ANY_SIGN, _OF_LARGEST = 0.5, np.array([2e-3, 4e-4, 4e-4])
# Steps of the finer grid beside which it is set, over its own.
_FINER_GRID = 1.5
# A grid whose largest error, of any direction, is below this share of the tolerance needs no closer look.
_HARMLESS = 0.001
# What the references of a sky depend on, whoever looks at it.
_OF_SKY = (STREAMS, LAYERS, WAVELENGTHS, SKY_GRID)
# Parts of the light that a source has, the error of the transmittance being that of all that is reflected.
_PARTS: dict[Source, frozenset[str]] = {
    "total": frozenset({"reflected_sky", "path", "reflected"}),
    "reflected": frozenset({"reflected_sky", "reflected"}),
    "reflected_sun": frozenset({"reflected"}),
    "reflected_sky": frozenset({"reflected_sky", "reflected"}),
    "path": frozenset({"path"}),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class LightError:
    """Estimated error of the light of a region.

    Attributes
    ----------
    together
        Errors of S0, S1 and S2 that come together, with their signs, shape (K, 3) [W m-2 sr-1]; those of different
        rows may add up or not.
    apart
        What each component may be off by beside that, of any sign, each 0 or more, shape (3,).
    field
        How far the error of each component may differ over the field, shape (3,) [W m-2 sr-1].
    """

    together: FloatArray
    apart: FloatArray
    field: FloatArray

    def scaled(self, factor: float) -> "LightError":
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


_NO_ROWS = np.zeros((0, 3))
_NOTHING = LightError(together=_NO_ROWS, apart=np.zeros(3), field=np.zeros(3))


def light_errors(
    scene: LitScene, plan: Plan, result: ChainResult, store: LightStore, *, tolerance: float
) -> dict[str, dict[str, LightError]]:
    """Return setting to region to the estimated error of its light, but for the tiles.

    Parameters
    ----------
    scene
        That was evaluated.
    plan
        Its levels.
    result
        What was found.
    store
        Solves the refined references.
    tolerance
        That is asked for; what is far below it need not be looked at closely.

    Notes
    -----
    A setting of which the effects that act make no use has no error: what leaving an effect out changes is bounded
    elsewhere.
    """
    found: dict[str, dict[str, LightError]] = {setting: {} for setting in NUMERICAL_SETTINGS}
    if result.illumination is None or scene.air is None:
        return found
    idle, air, illumination = unused(result.effects), scene.air, result.illumination
    of_sky = store.once(
        ("references", air.key, tuple(plan[name] for name in _OF_SKY), result.settings.solver, result.effects),
        lambda: _references(air, plan, result.settings, illumination, store, solved=STREAMS not in idle),
    )
    pairs, skies, grid = of_sky.pairs, of_sky.skies, of_sky.grid
    every = {
        region.name: lines_of_sight(scene, region, result.lights[region.name])
        for region in scene.regions
        if region.surface is not None
    }
    ways = {setting: _ways(pair, every) for setting, pair in pairs.items()}
    for name, lines in every.items():
        for setting in pairs:
            found[setting][name] = _between(ways[setting][name], skies[setting], lines, scene.source)
        if scene.air.state is not None and WAVELENGTHS not in idle:
            found[WAVELENGTHS][name] = _of_wavelengths(scene.air, result.settings, lines, scene.source)
        if HEMISPHERE in idle:
            continue
        found[SKY_GRID][name] = _of_grid(grid, result.lights[name], lines, scene.source, tolerance=tolerance)
        found[HEMISPHERE][name] = _of_hemisphere(lines, grid.largest, scene.source)
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class _References:
    """What the errors of a sky are found by, whoever looks at it: pairs of lightings, their differences, its grid."""

    pairs: dict[str, Pair]
    skies: dict[str, SampledSky]
    grid: "_Grid"


def _references(
    air: Air, plan: Plan, settings: Settings, illumination: Illumination, store: LightStore, *, solved: bool
) -> _References:
    lighting = illumination.lighting
    pairs = refined_references(air, plan, settings, lighting, store) if solved else {}
    ends = tuple(end.sky for end in ends_of_band(lighting))
    return _References(
        pairs=pairs,
        skies={setting: _difference(pair) for setting, pair in pairs.items()},
        grid=_Grid(skies=ends, settings=settings, illumination=illumination),
    )


def _difference(pair: Pair) -> SampledSky:
    """Difference of the skies of a pair."""

    def apart(*, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> FloatArray:
        one, other = (each.sky(zenith_rad=zenith_rad, phi_rad=phi_rad) for each in (pair.one, pair.other))
        return pair.factor * (other - one)

    return sample_smooth(apart, zeniths=_ZENITHS, azimuths=_AZIMUTHS)


def _ways(pair: Pair, every: Mapping[str, LinesOfSight]) -> dict[str, Way]:
    """Return what two lightings differ by on the way from each region to the camera, of all in one pass."""
    one, other = (ways_to_camera(tuple(every.values()), lighting) for lighting in (pair.one, pair.other))
    return {
        name: Way(
            path=pair.factor * (finer.path - coarser.path),
            transmittance=pair.factor * (finer.transmittance / coarser.transmittance - 1.0),
        )
        for name, coarser, finer in zip(every, one, other, strict=True)
    }


def _between(way: Way, sky: Sky, lines: LinesOfSight, source: Source) -> LightError:
    """Return what two lightings differ by: in the sky that is reflected, and on the way to the camera."""
    errors = {
        "reflected_sky": lines.reflected(sky),
        "path": way.path,
        "reflected": way.transmittance[:, np.newaxis] * lines.part("reflected"),
    }
    return _error([sum((errors[part] for part in _PARTS[source]), np.zeros((1, 3)))])


def _of_wavelengths(air: Air, settings: Settings, lines: LinesOfSight, source: Source) -> LightError:
    """Return what the wavelengths leave out of what the air scatters and lets through; of two airs the larger."""
    errors = [spectral_error(one, settings) for one in (air, air.alternative) if one is not None]
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


@dataclass(frozen=True, kw_only=True, eq=False)
class _Grid:
    """The grid on which the sky is kept, and skies of single wavelengths."""

    skies: tuple[Sky, ...]
    settings: Settings
    illumination: Illumination

    @property
    def largest(self) -> float:
        """Largest relative error of any direction."""
        return self.illumination.diffuse_radiance.relative_error

    @cached_property
    def differences(self) -> tuple[Sky, ...]:
        """Each of the skies on the grid, minus the same on a finer one."""
        return tuple(self._difference(sky) for sky in self.skies)

    def _difference(self, sky: Sky) -> Sky:
        coarse, fine = (self._sampled(sky, finer) for finer in (1.0, _FINER_GRID))

        def apart(*, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> FloatArray:
            found, nearer = (each(zenith_rad=zenith_rad, phi_rad=phi_rad) for each in (coarse, fine))
            return found - nearer

        return apart

    def _sampled(self, sky: Sky, finer: float) -> Sky:
        """Sky on a grid of so many times the steps."""
        return sample_sky(
            sky,
            sun_zenith_rad=self.illumination.sun_zenith_rad,
            zeniths=round(finer * self.settings.sky_zeniths),
            azimuths=round(finer * self.settings.sky_azimuths),
        )


def _of_grid(grid: _Grid, light: FieldLight, lines: LinesOfSight, source: Source, *, tolerance: float) -> LightError:
    """Difference of the sky's grid from the sky itself, as the region reflects both."""
    if "reflected_sky" not in _PARTS[source]:
        return _NOTHING
    sky, everything = abs(light.mean("reflected_sky")[0]), abs(light.mean()[0])
    if grid.largest * sky <= _HARMLESS * tolerance * everything:
        return _error([], apart=grid.largest * np.abs(lines.part("reflected_sky")[:, :1]) * np.ones(3))
    found = [_largest_last(lines.reflected(difference)) for difference in grid.differences]
    anywhere = _OF_LARGEST * grid.largest * np.abs(lines.part("reflected_sky")[:, :1])
    return _error(found, apart=_ANY_SIGN * np.max(np.abs(np.concatenate(found)), axis=0) + anywhere)


def _of_hemisphere(lines: LinesOfSight, of_grid: float, source: Source) -> LightError:
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
