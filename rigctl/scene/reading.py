"""Effects that act by a user's own choice, from the scene file and from options.

Limits of the geometry: where a plane-parallel atmosphere and few tiles of a wide field are poor, and by how much.

From a scene file and a noise calibration to the record of the scene.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from difflib import get_close_matches
from math import cos, hypot, radians, sqrt
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.sky import distance_factor
from model.effects.names import ALL, Effect
from model.sensor import effective_wavelength_m
from model.surface.materials import Material, assumed_properties, properties
from rigctl.base.numbers import percent
from rigctl.errors import ConfigError, as_config_error
from rigctl.files.materials import find_material
from rigctl.files.place import GeometrySection, PointingSection, SiteSection
from rigctl.files.scene_file import (
    EffectsSection,
    NoiseSection,
    SceneFile,
    SceneRegion,
    SensorSection,
    effect_names,
    effect_of,
    pointing_angles,
)
from rigctl.files.toml import Uncertain
from rigctl.scene.scene import DRIFT, NOISE_FACTOR, SUN_AZIMUTH, SUN_ZENITH, JointErrors, Scene, SceneRegionRecord, Sun
from rigctl.scene.sun import response_band, sun_moved_by_place, sun_position

if TYPE_CHECKING:
    from rigctl.calibrations.noise import NoiseParameters
    from rigctl.files.scene_file import ErrorsSection


def with_choices(scene: "SceneFile", *, switched_on: Sequence[str], left_out: Sequence[str]) -> "SceneFile":
    """Return the scene file with effects forced by options, which go before those of the file."""
    chosen = scene.model_copy(update={"effects": _chosen(scene.effects, switched_on, left_out)})
    forced_effects(chosen)
    return chosen


def _chosen(stated: EffectsSection, switched_on: Sequence[str], left_out: Sequence[str]) -> EffectsSection:
    for name in (*switched_on, *left_out):
        if name not in effect_names():
            close = get_close_matches(name, effect_names(), n=1)
            alike = f"did you mean {close[0]}?" if close else f"allowed are {', '.join(effect_names())}"
            raise ConfigError(f"effect {name!r} is not known; {alike}")
    mine = {*switched_on, *left_out}
    return EffectsSection.model_validate(
        {
            "with": (*switched_on, *(one for one in stated.switched_on if one not in mine)),
            "without": (*left_out, *(one for one in stated.left_out if one not in mine)),
        }
    )


def without_effects(scene: Scene, effects: frozenset[Effect]) -> Scene:
    """Return the scene with some effects left out, in addition to those that it leaves out itself."""
    names = tuple(name for name in effect_names() if effect_of(name) in effects)
    return _with_remarks(replace(scene, effects=_chosen(scene.effects, (), names)))


def forced_effects(scene: "SceneFile | Scene") -> dict[Effect, bool]:
    """Return the effects that are forced on (True) or off (False)."""
    both = sorted(set(scene.effects.switched_on) & set(scene.effects.left_out))
    if both:
        raise ConfigError(f"scene {scene.name}: effects {', '.join(both)} are both switched on and left out")
    return {effect_of(name): True for name in scene.effects.switched_on} | {
        effect_of(name): False for name in scene.effects.left_out
    }


def acting_effects(scene: "SceneFile | Scene") -> frozenset[Effect]:
    """Return the effects that act where no tolerance leaves any out: all but those that the user did."""
    return ALL - {effect for effect, acts in forced_effects(scene).items() if not acts}


def choice_remarks(scene: Scene) -> tuple[str, ...]:
    """Return what has to be said of every result: which effects are left out by request."""
    names = scene.effects.left_out
    if not names:
        return ()
    return (f"left out by request: {', '.join(names)}; rigctl effects says what that may change",)


# As far as a plane-parallel atmosphere is taken for the sun without remark.
_PLANE_TO_DEG = 85.0
_EARTH_RADIUS_M = 6.371e6
# A field so wide, corner to corner, may come near the horizon, where light is not smooth over few tiles.
_WIDE_DEG = 90.0


def geometry_remarks(scene: Scene) -> Iterable[str]:
    """Return where the geometry of a scene goes beyond what the model holds for, and by how much that is off."""
    if not scene.has_materials:
        return
    if scene.geometry is not None and _PLANE_TO_DEG < scene.geometry.camera_zenith_deg.value < 90.0:
        yield _of_view(scene.geometry)
    field = scene.field_of_view
    if field is not None and field.width_deg is not None and field.height_deg is not None:
        width, height = field.width_deg.value, field.height_deg.value
        if hypot(width, height) > _WIDE_DEG:
            yield (
                f"field of view {width:g} x {height:g} deg: {field.tiles_per_side} x {field.tiles_per_side} tiles are "
                "few where it comes near the horizon; --tolerance chooses them, and says what cannot be promised"
            )


def slant_path_m(*, height_m: float, zenith_rad: float) -> float:
    """Return the way from the ground to a height over a round earth, without refraction [m].

    Definition: law of cosines in the triangle with the earth's centre.
    """
    along = _EARTH_RADIUS_M * cos(zenith_rad)
    beyond = height_m * (2.0 * _EARTH_RADIUS_M + height_m)
    # The difference of two long ways, without its loss of digits.
    return beyond / (sqrt(along**2 + beyond) + along) if height_m > 0.0 else 0.0


def _of_view(geometry: GeometrySection) -> str:
    zenith_deg, height_m = geometry.camera_zenith_deg.value, geometry.camera_height_m.value
    zenith_rad = radians(zenith_deg)
    if height_m == 0.0:
        return (
            f"camera zenith {zenith_deg:g} deg: above {_PLANE_TO_DEG:g} deg light of the sky that is "
            "reflected comes from near the horizon, where a plane-parallel atmosphere is wrong"
        )
    plane_m, round_m = height_m / cos(zenith_rad), slant_path_m(height_m=height_m, zenith_rad=zenith_rad)
    return (
        f"camera zenith {zenith_deg:g} deg: above {_PLANE_TO_DEG:g} deg a plane-parallel atmosphere is "
        f"wrong; it takes {plane_m / 1000.0:.3g} km of air to the camera, over a round earth they are "
        f"{round_m / 1000.0:.3g} km ({percent(plane_m / round_m - 1.0)} too long)"
    )


FloatArray = NDArray[np.float64]

_NM_PER_M = 1e9
# Beginning of the keys of angles whose errors [pointing] joins.
_POINTED = ("geometry.", "regions.")


def scene_of_file(file: SceneFile, noise: "NoiseParameters | None" = None) -> Scene:
    """Return the scene of a file; the numbers of a noise calibration take the place of the assumed noise."""
    sensor = _with_wavelength(file)
    wavelength_m = 0.0 if sensor.wavelength_nm is None else sensor.wavelength_nm.value * 1e-9
    sun, by_site = _sun(file)
    known, joint = _calibrated(noise)
    scene = Scene(
        name=file.name,
        sensor=sensor,
        noise=file.noise.model_copy(update=known),
        acquisition=file.acquisition,
        regions=tuple(_region(region, wavelength_m) for region in file.regions),
        errors=_errors(file),
        effects=file.effects,
        sun=sun,
        geometry=file.geometry,
        atmosphere=file.atmosphere,
        field_of_view=file.field_of_view,
        sun_time=None if file.sun is None else file.sun.time,
        joint_errors=(*joint, *by_site),
        assumed=(*_of_noise(file, noise, known), *assumed_materials(file), *_of_old_keys(file)),
    )
    return with_geometry(scene, file.geometry, file.pointing)


def with_geometry(scene: Scene, geometry: GeometrySection | None, pointing: PointingSection | None) -> Scene:
    """Return the scene seen from elsewhere, and how the errors of its angles go together then."""
    others = [one for one in scene.joint_errors if not one.keys[0].startswith(_POINTED)]
    regions = [region.given for region in scene.regions]
    joint = (*others, *_pointing(pointing, geometry, regions))
    return _with_remarks(replace(scene, geometry=geometry, pointing=pointing, joint_errors=joint))


def with_sun(scene: Scene, sun: Sun) -> Scene:
    """Return the scene under another sun, whose angles are not off together by the place of the scene."""
    joint = tuple(one for one in scene.joint_errors if one.keys[0] != SUN_ZENITH)
    return replace(scene, sun=sun, joint_errors=joint)


def _with_remarks(scene: Scene) -> Scene:
    together = [one.keys for one in scene.joint_errors if one.keys[0].startswith(_POINTED)]
    return replace(
        scene,
        remarks=(
            *scene.assumed,
            *choice_remarks(scene),
            *geometry_remarks(scene),
            *(f"the errors of {', '.join(keys)} go together, as [pointing] says" for keys in together),
        ),
    )


def assumed_materials(scene: SceneFile) -> Iterable[str]:
    """Return for each region what is only assumed of its material, in words."""
    for region in scene.regions:
        material = _material(region)
        assumed = () if material is None else assumed_properties(material)
        if material is not None and assumed:
            yield f"assumed, not measured: {', '.join(assumed)} of {material.name} (region {region.name})"


def band_points(sensor: SensorSection, scene_name: str) -> tuple[tuple[float, float], ...]:
    """Return wavelengths [nm] and relative response of a scene's sensor."""
    if sensor.response is not None:
        return tuple(zip(sensor.response.wavelength_nm, sensor.response.response, strict=True))
    if sensor.band_nm is None:
        raise ConfigError(f"scene {scene_name}: the sensor needs band_nm or response")
    return tuple((wavelength_nm, 1.0) for wavelength_nm in sensor.band_nm)


def sun_covariance_deg2(site: "SiteSection", time: datetime) -> FloatArray:
    """Return the covariance of zenith and azimuth of the sun by what is not known of the site, shape (2, 2) [deg^2]."""
    moved = np.rad2deg(sun_moved_by_place(time, site.place, site.std))
    return np.asarray(moved.T @ moved)


def _with_wavelength(file: SceneFile) -> SensorSection:
    """Return the sensor with an effective wavelength that is not stated: that of sunlight in its band."""
    if file.sensor.wavelength_nm is not None:
        return file.sensor
    nm, response = np.array(band_points(file.sensor, file.name)).T
    with as_config_error(f"scene {file.name}"):
        band = response_band(wavelength_nm=nm, response=response, distance_factor=1.0)
    wavelength_nm = effective_wavelength_m(band.wavelength_m, band.weighted) * _NM_PER_M
    return file.sensor.model_copy(update={"wavelength_nm": Uncertain(value=wavelength_nm)})


def _errors(file: SceneFile) -> "ErrorsSection":
    """Return what the session adds, with the drift of the light from where it was stated before."""
    drift = file.rig.light_drift
    return file.errors if drift is None else file.errors.model_copy(update={"illumination_drift": drift})


def _of_old_keys(file: SceneFile) -> Iterable[str]:
    if file.rig.light_drift is not None:
        yield f"rig.light_drift: is called {DRIFT} now, and taken as that"


def _calibrated(noise: "NoiseParameters | None") -> tuple[dict[str, Uncertain], tuple[JointErrors, ...]]:
    """Return what a calibration knows, by the names of the file, and the covariance of its errors."""
    if noise is None:
        return {}, ()
    names = [name for name in NoiseSection.model_fields if name in noise.known]
    values = {name: 0.0 if name in noise.below_zero else noise.known[name].value for name in names}
    found = {name: Uncertain(value=values[name], std=noise.known[name].std_error) for name in names}
    keys = tuple(f"noise.{name}" for name in names)
    return found, (JointErrors(keys=keys, covariance=noise.covariance_of(names)),)


def _of_noise(file: SceneFile, noise: "NoiseParameters | None", known: Mapping[str, Uncertain]) -> Iterable[str]:
    for name, value in (noise.below_zero if noise is not None else {}).items():
        yield f"noise.{name}: the calibration's estimate {value:.3g} is below 0 by its error; 0 is used"
    # The noise factor is a choice of the user's, not a property of a sensor: no calibration gives it.
    assumed = [
        f"noise.{name} = {getattr(file.noise, name).value:g}"
        for name in NoiseSection.model_fields
        if name not in known and f"noise.{name}" != NOISE_FACTOR
    ]
    if assumed:
        yield f"assumed, not calibrated: {', '.join(assumed)}"


def _sun(file: SceneFile) -> tuple[Sun | None, tuple[JointErrors, ...]]:
    """Return the sun by its angles, and what one place moves together of them."""
    stated = file.sun
    if stated is None:
        return None, ()
    if stated.time is not None:
        return _sun_of_time(file, stated.time)
    if stated.zenith_deg is None:
        raise ConfigError(f"scene {file.name}: [sun] needs zenith_deg or time")
    factor = stated.distance_factor
    if factor is None:
        day = stated.day_of_year
        factor = Uncertain(value=1.0 if day is None else distance_factor(day_of_year=day))
    return Sun(zenith_deg=stated.zenith_deg, azimuth_deg=stated.azimuth_deg, distance_factor=factor), ()


def _sun_of_time(file: SceneFile, time: datetime) -> tuple[Sun, tuple[JointErrors, ...]]:
    if file.site is None:
        raise ConfigError(f"scene {file.name}: sun.time also needs [site]")
    position, covariance = sun_position(time, file.site.place), sun_covariance_deg2(file.site, time)
    zenith_std, azimuth_std = np.sqrt(np.diag(covariance)).tolist()
    sun = Sun(
        zenith_deg=Uncertain(value=math.degrees(position.zenith_rad), std=zenith_std),
        azimuth_deg=Uncertain(value=math.degrees(position.azimuth_rad), std=azimuth_std),
        distance_factor=Uncertain(value=position.distance_factor),
    )
    joint = JointErrors(keys=(SUN_ZENITH, SUN_AZIMUTH), covariance=covariance)
    return sun, (joint,) if file.site.is_uncertain else ()


def _pointing(
    pointing: PointingSection | None, geometry: GeometrySection | None, regions: Sequence[SceneRegion]
) -> Iterable[JointErrors]:
    """Yield the covariance of the angles of camera and panels, of those that the model has."""
    if pointing is None:
        return
    given = {f"regions.{region.name}." for region in regions if region.material is None}
    keys, angles = pointing.parameters, pointing_angles(geometry, regions)
    used = [k for k, key in enumerate(keys) if key in angles and key.rpartition(".")[0] + "." not in given]
    std = np.array([angles[keys[k]].std for k in used])
    correlation = np.array(pointing.correlation)[np.ix_(used, used)]
    if len(used) > 1:
        yield JointErrors(keys=tuple(keys[k] for k in used), covariance=correlation * np.outer(std, std))


def _region(region: SceneRegion, wavelength_m: float) -> SceneRegionRecord:
    material = _material(region)
    if material is None:
        return SceneRegionRecord(given=region, material=None)
    try:
        at: dict[str, Any] = {
            name: replace(found, values=(found.at(wavelength_m),), wavelengths_m=())
            for name, found in properties(material).items()
        }
    except ValueError as error:
        raise ConfigError(f"region {region.name}: {error}") from error
    return SceneRegionRecord(given=region, material=replace(material, **at))


def _material(region: SceneRegion) -> Material | None:
    # A file's path was made absolute when the scene file was read.
    return None if region.material is None else find_material(region.material, beside=Path())
