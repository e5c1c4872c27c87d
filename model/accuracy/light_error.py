"""Estimated error of the light of each region, knob by knob."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from model import geometry
from model.accuracy.chain import ChainResult
from model.accuracy.companions import Pair, companions, one_wavelength
from model.accuracy.field_error import field_error
from model.accuracy.knobs import HEMISPHERE, KNOBS, SKY_GRID, TILES, Plan
from model.accuracy.light_store import LightStore
from model.accuracy.settings import Settings
from model.atmosphere.lighting.band_lighting import BandLighting
from model.atmosphere.lighting.lighting import Lighting
from model.atmosphere.lighting.mixed_lighting import MixedLighting
from model.field_light import FieldLight
from model.hemisphere import reflected_by_rules
from model.illumination import Illumination
from model.lit_scene import LitRegion, LitScene
from model.panel_light import PanelLight
from model.sampled_sky import Sky, sample_sky
from model.scene import ApertureLight
from model.surface.tilt import Tilt

FloatArray = NDArray[np.float64]

# Directions in which two skies are set beside each other: zenith angles, and azimuths from the sun.
_ZENITH_RAD, _PHI_RAD = np.meshgrid(np.radians([20.0, 45.0, 65.0, 78.0]), np.radians([10.0, 60.0, 120.0, 170.0]))
_LOWEST_RAD = float(np.radians(88.0))
# A grid of the sky whose largest error, near the horizon, is below this share of the tolerance needs no closer look.
_HARMLESS = 0.005
_BETWEEN = 1.5
# Parts of the light that a source has, the error of the transmittance being that of all that is reflected.
_PARTS = {
    "total": ("reflected_sky", "path", "reflected"),
    "reflected": ("reflected_sky", "reflected"),
    "reflected_sun": ("reflected",),
    "reflected_sky": ("reflected_sky", "reflected"),
    "path": ("path",),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class LightError:
    """Estimated error of the light of a region.

    Attributes
    ----------
    stokes
        What the mean of S0, S1 and S2 is likely to be off by, with its sign, shape (3,) [W m-2 sr-1].
    loose
        What it may be off by beside that, of any sign, each 0 or more, shape (3,).
    field
        How far the error may differ over the field [W m-2 sr-1].
    cov
        Of the covariance over the field, beside what `field` does to it, shape (3, 3).
    """

    stokes: FloatArray
    loose: FloatArray
    field: float
    cov: FloatArray


_NOTHING = LightError(stokes=np.zeros(3), loose=np.zeros(3), field=0.0, cov=np.zeros((3, 3)))


def light_errors(
    scene: LitScene, plan: Plan, result: ChainResult, store: LightStore, *, tolerance: float
) -> dict[str, dict[str, LightError]]:
    """Return knob to region to the estimated error of its light.

    Parameters
    ----------
    scene
        That was evaluated.
    plan
        Its levels.
    result
        What was found.
    store
        Solves the companions.
    tolerance
        That is asked for; what is far below it need not be looked at closely.
    """
    found: dict[str, dict[str, LightError]] = {knob: {} for knob in KNOBS}
    illumination = result.illumination
    if illumination is None or scene.air is None:
        return found
    pairs = companions(scene.air, plan, result.settings, illumination.lighting, store)
    grid = _Grid(illumination=illumination, settings=result.settings)
    for region in scene.regions:
        if region.surface is None or region.tilt is None:
            continue
        light = result.lights[region.name]
        for knob, pair in pairs.items():
            found[knob][region.name] = _between(pair, light, region.tilt, scene)
        found[SKY_GRID][region.name] = _of_grid(light, region, scene, grid, tolerance)
        found[HEMISPHERE][region.name] = _of_hemisphere(light, illumination, scene)
        found[TILES][region.name] = _of_tiles(light, scene)
    return found


def _between(pair: Pair, light: FieldLight, tilt: Tilt, scene: LitScene) -> LightError:
    """Difference of two lightings, in the sky that a region reflects and on the way to the camera."""
    seen = _looked_at(light)
    zenith = np.array([one.view.zenith_rad for one in seen])
    phi = scene.sun_azimuth_rad - np.array([one.view.azimuth_rad for one in seen])
    height_m = seen[0].view.height_m
    paths = [each.path(height_m=height_m, zenith_rad=zenith, phi_rad=phi) for each in (pair.one, pair.other)]
    through = [each.transmittance(height_m=height_m, zenith_rad=zenith) for each in (pair.one, pair.other)]
    scaled, rest = _sky_difference(pair, seen, tilt, scene)
    sky = np.stack([one.reflected_sky for one in seen])
    reflected = np.stack([one.reflected for one in seen])
    signed = {
        "reflected_sky": pair.factor * scaled[:, np.newaxis] * sky,
        "path": pair.factor * (paths[1] - paths[0]),
        "reflected": pair.factor * (through[1] / through[0] - 1.0)[:, np.newaxis] * reflected,
    }
    return _counted(
        scene, signed, {"reflected_sky": pair.factor * rest[:, np.newaxis] * np.abs(sky[:, :1]) * np.ones(3)}
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Grid:
    """The sky of one wavelength, itself and on the grid, for all regions."""

    illumination: Illumination
    settings: Settings

    @cached_property
    def both(self) -> tuple[Sky, Sky] | None:
        """Sky and grid; None where nothing is computed."""
        band = _first_band(self.illumination.lighting)
        if band is None:
            return None
        exact = one_wavelength(band).sky
        sampled = sample_sky(
            exact,
            sun_zenith_rad=self.illumination.sun_zenith_rad,
            zeniths=self.settings.sky_zeniths,
            azimuths=self.settings.sky_azimuths,
        )
        return exact, sampled


def _of_grid(light: FieldLight, region: LitRegion, scene: LitScene, grid: _Grid, tolerance: float) -> LightError:
    """Difference of the sky's grid from the sky itself, as a region reflects both; of one wavelength."""
    sky, everything = abs(light.mean("reflected_sky")[0]), abs(light.mean()[0])
    share = grid.illumination.skylight.relative_error
    if share * sky > _HARMLESS * tolerance * everything and grid.both is not None:
        share = _BETWEEN * _grid_difference(_looked_at(light)[-1], region, grid.illumination, grid.both)
    each = np.array([abs(one.reflected_sky[0]) for one in _looked_at(light)])
    return _counted(scene, {}, {"reflected_sky": share * each[:, np.newaxis] * np.ones(3)})


def _grid_difference(one: ApertureLight, region: LitRegion, illumination: Illumination, both: tuple[Sky, Sky]) -> float:
    surface, tilt = region.surface, region.tilt
    if surface is None or tilt is None:
        return 0.0
    panel = PanelLight(surface=surface, tilt=tilt, view=one.view)
    seen = [reflected_by_rules(panel, replace(illumination.skylight, sky=sky), one.rules) for sky in both]
    return float(np.max(np.abs(seen[1] - seen[0])) / seen[0][0]) if seen[0][0] > 0.0 else 0.0


def _of_hemisphere(light: FieldLight, illumination: Illumination, scene: LitScene) -> LightError:
    """Error of the integral over the hemisphere as its rules estimate it, without that of the sky's grid."""
    grid = illumination.skylight.relative_error
    each = np.array([max(one.error - grid * abs(one.reflected_sky[0]), 0.0) for one in _looked_at(light)])
    return _counted(scene, {}, {"reflected_sky": each[:, np.newaxis] * np.ones(3)})


def _of_tiles(light: FieldLight, scene: LitScene) -> LightError:
    if len(light.lights) == 1:
        return _NOTHING
    found = field_error(np.stack([getattr(one, scene.source) for one in light.lights]))
    return LightError(stokes=np.zeros(3), loose=found.mean, field=0.0, cov=found.cov)


def _counted(scene: LitScene, signed: dict[str, FloatArray], loose: dict[str, FloatArray]) -> LightError:
    """Sum of the errors (V, 3) of those parts that the source has, at V lines of sight, the last in the middle."""
    has = _PARTS[scene.source]
    own = np.sum([part for name, part in signed.items() if name in has] or [np.zeros((1, 3))], axis=0)
    other = np.sum([part for name, part in loose.items() if name in has] or [np.zeros((1, 3))], axis=0)
    apart = float(np.max(np.ptp(own, axis=0))) + float(np.max(np.ptp(other, axis=0)))
    return LightError(stokes=own[-1], loose=np.max(other, axis=0), field=0.5 * apart, cov=np.zeros((3, 3)))


def _looked_at(light: FieldLight) -> list[ApertureLight]:
    """One tile, or two corners of the field and its middle, the last."""
    count = len(light.lights)
    return [light.lights[k] for k in dict.fromkeys((0, count - 1, count // 2))]


def _sky_difference(
    pair: Pair, seen: list[ApertureLight], tilt: Tilt, scene: LitScene
) -> tuple[FloatArray, FloatArray]:
    """By what two skies differ as a common factor, and in any other way over their S0, for each line of sight (V,).

    The factor is that where the region mirrors the sky, or in the mean over it; the rest that of both.
    """
    zenith, phi, above = _mirrored(seen, tilt, scene.sun_azimuth_rad)
    directions = {
        "zenith_rad": np.concatenate([_ZENITH_RAD.ravel(), zenith]),
        "phi_rad": np.concatenate([_PHI_RAD.ravel(), phi]),
    }
    one, other = pair.one.sky(**directions), pair.other.sky(**directions)
    lit = one[:, 0] > 0.0
    factor, rest = np.zeros(lit.size), np.zeros(lit.size)
    factor[lit] = other[lit, 0] / one[lit, 0] - 1.0
    rest[lit] = np.linalg.norm(other[lit] - one[lit] * (1.0 + factor[lit, np.newaxis]), axis=1) / one[lit, 0]
    grid = _ZENITH_RAD.size
    mean = float(np.mean(factor[:grid]))
    about = float(np.sqrt(np.mean((factor[:grid] - mean) ** 2 + rest[:grid] ** 2)))
    where = np.where(above, factor[grid:], mean)
    return where, np.maximum(np.where(above, rest[grid:], 0.0), about) + np.abs(where - mean) / 2.0


def _mirrored(
    seen: list[ApertureLight], tilt: Tilt, sun_azimuth_rad: float
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Zenith angles and azimuths from the sun at which a region mirrors what is above, and whether that is the sky."""
    cameras = geometry.direction(
        zenith_rad=[one.view.zenith_rad for one in seen], azimuth_rad=[one.view.azimuth_rad for one in seen]
    )
    east, north, up = (2.0 * (cameras @ tilt.normal)[:, np.newaxis] * tilt.normal - cameras).T
    zenith = np.minimum(np.arctan2(np.hypot(east, north), up), _LOWEST_RAD)
    return zenith, sun_azimuth_rad - np.arctan2(east, north), up > 0.0


def _first_band(lighting: Lighting) -> BandLighting | None:
    """Return a computed sky, which may stand for a mixture of two; None where there is none."""
    one = lighting.first if isinstance(lighting, MixedLighting) else lighting
    return one if isinstance(one, BandLighting) else None
