"""From a scene file and a noise calibration to the record `Scene`: the only module that knows both.

Sections of the file that the model's units allow stay as they are. What the file may state in several ways becomes one:
the sun by its angles, materials at the sensor's wavelength, the noise of a calibration in place of the assumed one.

Effects that a user forces on or off, in the file or by options, are read here too.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.sky import distance_factor
from model.effects.names import ALL, Effect
from model.sensor import effective_wavelength_m
from model.surface.materials import assumed_properties, properties
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
from rigctl.scene.scene import (
    NOISE_FACTOR,
    POINTED,
    SUN_AZIMUTH,
    SUN_ZENITH,
    JointErrors,
    Rig,
    Scene,
    SceneRegionRecord,
    Sun,
)
from rigctl.scene.sun import response_band, sun_moved_by_place, sun_position

if TYPE_CHECKING:
    from rigctl.calibrations.noise import NoiseParameters

FloatArray = NDArray[np.float64]

_NM_PER_M = 1e9


def scene_of_file(file: SceneFile, noise: "NoiseParameters | None" = None) -> Scene:
    """Return the scene of a file; the numbers of a noise calibration take the place of the assumed noise."""
    sensor = _with_wavelength(file)
    wavelength_m = 0.0 if sensor.wavelength_nm is None else sensor.wavelength_nm.value * 1e-9
    sun, by_site = _sun(file)
    known, joint = _calibrated(noise)
    regions = tuple(_region(region, wavelength_m) for region in file.regions)
    scene = Scene(
        name=file.name,
        sensor=sensor,
        noise=file.noise.model_copy(update=known),
        acquisition=file.acquisition,
        regions=regions,
        errors=file.errors,
        effects=file.effects,
        sun=sun,
        geometry=file.geometry,
        atmosphere=file.atmosphere,
        field_of_view=file.field_of_view,
        sun_time=None if file.sun is None else file.sun.time,
        joint_errors=(*joint, *by_site),
        rig=_rig(file),
        assumed=(*_of_noise(file, noise, known), *assumed_materials(regions)),
    )
    return with_geometry(scene, file.geometry, file.pointing)


def with_geometry(scene: Scene, geometry: GeometrySection | None, pointing: PointingSection | None) -> Scene:
    """Return the scene seen from elsewhere, and how the errors of its angles go together then."""
    others = [one for one in scene.joint_errors if not one[0][0].startswith(POINTED)]
    regions = [region.given for region in scene.regions]
    joint = (*others, *_pointing(pointing, geometry, regions))
    return replace(scene, geometry=geometry, pointing=pointing, joint_errors=joint)


def with_sun(scene: Scene, sun: Sun) -> Scene:
    """Return the scene under another sun, whose angles are not off together by the place of the scene."""
    joint = tuple(one for one in scene.joint_errors if one[0][0] != SUN_ZENITH)
    return replace(scene, sun=sun, joint_errors=joint)


def assumed_materials(regions: Iterable[SceneRegionRecord]) -> Iterable[str]:
    """Yield for each region what is only assumed of its material, in words."""
    for region in regions:
        assumed = () if region.material is None else assumed_properties(region.material)
        if region.material is not None and assumed:
            yield f"assumed, not measured: {', '.join(assumed)} of {region.material.name} (region {region.name})"


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


def _calibrated(noise: "NoiseParameters | None") -> tuple[dict[str, Uncertain], tuple[JointErrors, ...]]:
    """Return what a calibration knows, by the names of the file, and the covariance of its errors."""
    if noise is None:
        return {}, ()
    names = [name for name in NoiseSection.model_fields if name in noise.known]
    values = {name: 0.0 if name in noise.below_zero else noise.known[name].value for name in names}
    found = {name: Uncertain(value=values[name], std=noise.known[name].std_error) for name in names}
    keys = tuple(f"noise.{name}" for name in names)
    return found, ((keys, noise.covariance_of(names)),)


def _of_noise(file: SceneFile, noise: "NoiseParameters | None", known: Mapping[str, Uncertain]) -> tuple[str, ...]:
    below = (
        f"noise.{name}: the calibration's estimate {value:.3g} is below 0 by its error; 0 is used"
        for name, value in (noise.below_zero if noise is not None else {}).items()
    )
    # The noise factor is a choice of the user's, not a property of a sensor: no calibration gives it.
    assumed = [
        f"noise.{name} = {getattr(file.noise, name).value:g}"
        for name in NoiseSection.model_fields
        if name not in known and f"noise.{name}" != NOISE_FACTOR
    ]
    return (*below, *([f"assumed, not calibrated: {', '.join(assumed)}"] if assumed else []))


def _rig(file: SceneFile) -> Rig:
    """Return the rig of a scene file, with the cycle that the file states; errors of exposure and ratio are apart."""
    stated, taken = file.rig, file.acquisition
    in_time_deg = np.mod(taken.angles_deg, 180.0)
    ratio = stated.exposure_ratio
    exposure_std = taken.exposure_std_ms / taken.exposure_ms * ratio.value
    return Rig(
        polarizer_offset_deg=stated.polarizer_offset_deg,
        exposure_ratio=Uncertain(value=ratio.value, std=float(np.hypot(ratio.std, exposure_std))),
        angle_deg=(Uncertain(value=0.0, std=stated.angle_std_deg),) * len(in_time_deg),
        angle_names=tuple(f"{angle:g}" for angle in np.sort(in_time_deg)),
        frame_order=tuple(np.argsort(in_time_deg, kind="stable").tolist()),
    )


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
    return sun, (((SUN_ZENITH, SUN_AZIMUTH), covariance),) if file.site.is_uncertain else ()


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
        yield tuple(keys[k] for k in used), correlation * np.outer(std, std)


def _region(region: SceneRegion, wavelength_m: float) -> SceneRegionRecord:
    if region.material is None:
        return SceneRegionRecord(given=region, material=None)
    # A file's path was made absolute when the scene file was read.
    material = find_material(region.material, beside=Path())
    try:
        at: dict[str, Any] = {
            name: replace(found, values=(found.at(wavelength_m),), wavelengths_m=())
            for name, found in properties(material).items()
        }
    except ValueError as error:
        raise ConfigError(f"region {region.name}: {error}") from error
    return SceneRegionRecord(given=region, material=replace(material, **at))


def with_choices(scene: SceneFile, *, switched_on: Sequence[str], left_out: Sequence[str]) -> SceneFile:
    """Return the scene file with effects forced by options, which go before those of the file."""
    chosen = scene.model_copy(update={"effects": _chosen(scene.effects, switched_on, left_out)})
    _forced(chosen.effects, scene.name)
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
    return replace(scene, effects=_chosen(scene.effects, (), names))


def forced_effects(scene: Scene) -> dict[Effect, bool]:
    """Return the effects that are forced on (True) or off (False)."""
    return _forced(scene.effects, scene.name)


def _forced(effects: EffectsSection, scene_name: str) -> dict[Effect, bool]:
    both = sorted(set(effects.switched_on) & set(effects.left_out))
    if both:
        raise ConfigError(f"scene {scene_name}: effects {', '.join(both)} are both switched on and left out")
    return {effect_of(name): True for name in effects.switched_on} | {
        effect_of(name): False for name in effects.left_out
    }


def acting_effects(scene: Scene) -> frozenset[Effect]:
    """Return the effects that act where no tolerance leaves any out: all but those that the user did."""
    return ALL - {effect for effect, acts in forced_effects(scene).items() if not acts}
