"""Estimated error of the light of each region, knob by knob."""

from dataclasses import dataclass, replace

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
from model.sampled_sky import sample_sky
from model.scene import ApertureLight
from model.surface.tilt import Tilt

FloatArray = NDArray[np.float64]

# Directions in which two skies are set beside each other: zenith angles, and azimuths from the sun.
_ZENITH_RAD, _PHI_RAD = np.meshgrid(np.radians([20.0, 45.0, 65.0, 78.0]), np.radians([10.0, 60.0, 120.0, 170.0]))
_LOWEST_RAD = float(np.radians(88.0))
# A grid of the sky whose largest error, near the horizon, is below this share of the tolerance needs no closer look.
_HARMLESS = 0.05
_BETWEEN = 1.5


@dataclass(frozen=True, kw_only=True, eq=False)
class LightError:
    """Estimated error of the light of a region.

    Attributes
    ----------
    stokes
        Of the mean of S0, S1 and S2, each 0 or more, shape (3,) [W m-2 sr-1].
    field
        How far the error may differ over the field [W m-2 sr-1].
    cov
        Of the covariance over the field, beside what `field` does to it, shape (3, 3).
    """

    stokes: FloatArray
    field: float
    cov: FloatArray


_NOTHING = LightError(stokes=np.zeros(3), field=0.0, cov=np.zeros((3, 3)))


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
    for region in scene.regions:
        if region.surface is None or region.tilt is None:
            continue
        light = result.lights[region.name]
        for knob, pair in pairs.items():
            found[knob][region.name] = _between(pair, light, region.tilt, scene)
        found[SKY_GRID][region.name] = _of_grid(light, region, scene, result, tolerance)
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
    parts = {
        "reflected_sky": np.full(3, abs(light.mean("reflected_sky")[0]) * _sky_difference(pair, seen, tilt, scene)),
        "path": np.max(np.abs(paths[1] - paths[0]), axis=0),
        "reflected": float(np.max(np.abs(through[1] / through[0] - 1.0))) * np.abs(light.mean("reflected")),
    }
    return _counted(light, scene, {name: pair.factor * part for name, part in parts.items()})


def _of_grid(
    light: FieldLight, region: LitRegion, scene: LitScene, result: ChainResult, tolerance: float
) -> LightError:
    """Difference of the sky's grid from the sky itself, as a region reflects both; of one wavelength."""
    illumination = result.illumination
    if illumination is None:
        return _NOTHING
    sky, everything = abs(light.mean("reflected_sky")[0]), abs(light.mean()[0])
    share = illumination.skylight.relative_error
    band = _first_band(illumination.lighting)
    if share * sky > _HARMLESS * tolerance * everything and band is not None:
        share = _BETWEEN * _grid_difference(_looked_at(light)[-1], region, illumination, band, result.settings)
    return _counted(light, scene, {"reflected_sky": np.full(3, sky * share)})


def _grid_difference(
    one: ApertureLight, region: LitRegion, illumination: Illumination, band: BandLighting, settings: Settings
) -> float:
    surface, tilt = region.surface, region.tilt
    if surface is None or tilt is None:
        return 0.0
    panel = PanelLight(surface=surface, tilt=tilt, view=one.view)
    exact = one_wavelength(band).sky
    sampled = sample_sky(
        exact,
        sun_zenith_rad=illumination.sun_zenith_rad,
        zeniths=settings.sky_zeniths,
        azimuths=settings.sky_azimuths,
    )
    seen = [reflected_by_rules(panel, replace(illumination.skylight, sky=sky), one.rules) for sky in (exact, sampled)]
    return float(np.max(np.abs(seen[1] - seen[0])) / seen[0][0]) if seen[0][0] > 0.0 else 0.0


def _of_hemisphere(light: FieldLight, illumination: Illumination, scene: LitScene) -> LightError:
    """Error of the integral over the hemisphere as its rules estimate it, without that of the sky's grid."""
    grid = illumination.skylight.relative_error
    each = [max(one.error - grid * abs(one.reflected_sky[0]), 0.0) for one in light.lights]
    return _counted(light, scene, {"reflected_sky": np.full(3, float(np.array(light.weights) @ each))})


def _of_tiles(light: FieldLight, scene: LitScene) -> LightError:
    if len(light.lights) == 1:
        return _NOTHING
    found = field_error(np.stack([getattr(one, scene.source) for one in light.lights]))
    return LightError(stokes=found.mean, field=0.0, cov=found.cov)


def _counted(light: FieldLight, scene: LitScene, parts: dict[str, FloatArray]) -> LightError:
    """Sum of the errors of the parts that the source has; that of Q and U in any frame is the larger of theirs."""
    has = {
        "total": ("reflected_sky", "path", "reflected"),
        "reflected": ("reflected_sky", "reflected"),
        "reflected_sun": ("reflected",),
        "reflected_sky": ("reflected_sky", "reflected"),
        "path": ("path",),
    }[scene.source]
    stokes = np.sum([parts.get(name, np.zeros(3)) for name in has], axis=0)
    stokes[1:] = np.hypot(stokes[1], stokes[2]) if "path" in has else stokes[1:]
    several = len(light.lights) > 1
    return LightError(stokes=stokes, field=float(np.max(stokes)) if several else 0.0, cov=np.zeros((3, 3)))


def _looked_at(light: FieldLight) -> list[ApertureLight]:
    """One tile, or two corners of the field and its middle, the last."""
    count = len(light.lights)
    return [light.lights[k] for k in dict.fromkeys((0, count - 1, count // 2))]


def _sky_difference(pair: Pair, seen: list[ApertureLight], tilt: Tilt, scene: LitScene) -> float:
    """Difference of two skies over their S0: where the region mirrors the camera, and over all."""
    zenith, phi = _mirrored(seen, tilt, scene.sun_azimuth_rad)
    directions = {
        "zenith_rad": np.concatenate([_ZENITH_RAD.ravel(), zenith]),
        "phi_rad": np.concatenate([_PHI_RAD.ravel(), phi]),
    }
    one, other = pair.one.sky(**directions), pair.other.sky(**directions)
    lit = one[:, 0] > 0.0
    apart = np.zeros(lit.size)
    apart[lit] = np.linalg.norm(other[lit] - one[lit], axis=1) / one[lit, 0]
    over_all = _BETWEEN * float(np.sqrt(np.mean(apart[: _ZENITH_RAD.size] ** 2)))
    return max(over_all, float(np.max(apart[_ZENITH_RAD.size :], initial=0.0)))


def _mirrored(seen: list[ApertureLight], tilt: Tilt, sun_azimuth_rad: float) -> tuple[FloatArray, FloatArray]:
    """Zenith angles and azimuths from the sun at which a region mirrors the sky to the camera."""
    cameras = geometry.direction(
        zenith_rad=[one.view.zenith_rad for one in seen], azimuth_rad=[one.view.azimuth_rad for one in seen]
    )
    mirrored = 2.0 * (cameras @ tilt.normal)[:, np.newaxis] * tilt.normal - cameras
    east, north, up = mirrored[mirrored[:, 2] > 0.0].T
    zenith = np.minimum(np.arctan2(np.hypot(east, north), up), _LOWEST_RAD)
    return zenith, sun_azimuth_rad - np.arctan2(east, north)


def _first_band(lighting: Lighting) -> BandLighting | None:
    """Return a computed sky, which may stand for a mixture of two; None where there is none."""
    one = lighting.first if isinstance(lighting, MixedLighting) else lighting
    return one if isinstance(one, BandLighting) else None
