"""Estimated error of the light of each region, setting by setting."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.accuracy.estimates.lines_of_sight import LinesOfSight, lines_of_sight, reflected_by_all, ways_to_camera
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
from model.scene.field_light import Source
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


# By the place of a case among several, and a region's name.
Lines = Mapping[tuple[int, str], LinesOfSight]
Errors = Mapping[tuple[int, str], LightError]

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
    return light_errors_of_all(((scene, result),), plan, store, tolerance=tolerance)[0]


def light_errors_of_all(
    cases: Sequence[tuple[LitScene, ChainResult]], plan: Plan, store: LightStore, *, tolerance: float
) -> list[dict[str, dict[str, LightError]]]:
    """Return what `light_errors` does for each of several scenes, with one path for all and like regions together.

    Parameters
    ----------
    cases
        Scenes under one sky, from one height, of one source of light, and what one plan found of them.
    plan, store, tolerance
        As in `light_errors`.
    """
    (scene, result), errors = cases[0], [_no_errors() for _ in cases]
    if result.illumination is None or scene.air is None:
        return errors
    idle, air, illumination = unused(result.effects), scene.air, result.illumination
    of_sky = store.once(
        ("references", air.key, tuple(plan[name] for name in _OF_SKY), result.settings.solver, result.effects),
        lambda: _references(air, plan, result.settings, illumination, store, solved=STREAMS not in idle),
    )
    every = {
        (place, region.name): lines_of_sight(one, region, found.lights[region.name])
        for place, (one, found) in enumerate(cases)
        for region in one.regions
        if region.surface is not None
    }
    of_settings: dict[str, Errors] = {
        setting: _between(pair, of_sky.skies[setting], every, scene.source) for setting, pair in of_sky.pairs.items()
    }
    if air.state is not None and WAVELENGTHS not in idle:
        of_settings[WAVELENGTHS] = _of_wavelengths(air, result.settings, every, scene.source)
    if HEMISPHERE not in idle:
        of_settings[SKY_GRID] = _of_grid(of_sky.grid, cases, every, scene.source, tolerance=tolerance)
        of_settings[HEMISPHERE] = {
            key: _of_hemisphere(lines, of_sky.grid.largest, scene.source) for key, lines in every.items()
        }
    for setting, of_setting in of_settings.items():
        for (place, name), error in of_setting.items():
            errors[place][setting][name] = error
    return errors


def _no_errors() -> dict[str, dict[str, LightError]]:
    return {setting: {} for setting in NUMERICAL_SETTINGS}


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


def _between(pair: Pair, sky: Sky, every: Lines, source: Source) -> Errors:
    """Return what two lightings differ by: in the sky that is reflected, and on the way to the camera."""
    seen = tuple(every.values())
    one, other = (ways_to_camera(seen, lighting) for lighting in (pair.one, pair.other))
    reflected = reflected_by_all(seen, sky)
    found = {}
    for place, (key, lines) in enumerate(every.items()):
        through = pair.factor * _changed(one[place].transmittance, other[place].transmittance)
        errors = {
            "reflected_sky": reflected[place],
            "path": pair.factor * (other[place].path - one[place].path),
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


def _of_spectrum(errors: Sequence[SpectralError], lines: LinesOfSight, source: Source) -> LightError:
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


def _of_grid(
    grid: _Grid, cases: Sequence[tuple[LitScene, ChainResult]], every: Lines, source: Source, *, tolerance: float
) -> Errors:
    """Return the difference of the sky's grid from the sky itself, as the regions reflect both."""
    if "reflected_sky" not in _PARTS[source]:
        return dict.fromkeys(every, _NOTHING)

    def is_harmless(place: int, name: str) -> bool:
        light = cases[place][1].lights[name]
        sky, everything = abs(light.mean("reflected_sky")[0]), abs(light.mean()[0])
        return bool(grid.largest * sky <= _HARMLESS * tolerance * everything)

    sizes = {key: grid.largest * np.abs(lines.part("reflected_sky")[:, :1]) for key, lines in every.items()}
    found = {key: _error([], apart=sizes[key] * np.ones(3)) for key in every if is_harmless(*key)}
    close = {key: lines for key, lines in every.items() if key not in found}
    if not close:
        return found
    seen = [reflected_by_all(tuple(close.values()), difference) for difference in grid.differences]
    for key, *ends in zip(close, *seen, strict=True):
        errors = [_largest_last(end) for end in ends]
        any_sign = _ANY_SIGN * np.max(np.abs(np.concatenate(errors)), axis=0)
        found[key] = _error(errors, apart=any_sign + _OF_LARGEST * sizes[key])
    return found


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
