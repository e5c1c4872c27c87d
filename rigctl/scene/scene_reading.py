"""From a scene file and a noise calibration to the record of the scene."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.sky import distance_factor
from model.sensor import effective_wavelength_m
from model.surface.materials import Material, assumed_properties, properties
from rigctl.errors import ConfigError, as_config_error
from rigctl.files.config import Uncertain
from rigctl.files.material_file import find_material
from rigctl.files.place import SiteSection
from rigctl.files.scene_file import NoiseSection, SceneFile, SceneRegion, SensorSection, pointing_angles
from rigctl.scene.effect_choice import choice_remarks
from rigctl.scene.geometry_limits import geometry_remarks
from rigctl.scene.parameter_table import DRIFT, NOISE_FACTOR, SUN_AZIMUTH, SUN_ZENITH
from rigctl.scene.scene_record import JointErrors, Scene, SceneRegionRecord, Sun
from rigctl.scene.skies.solar_band import response_band
from rigctl.scene.skies.sun_position import sun_moved_by_place, sun_position

if TYPE_CHECKING:
    from rigctl.calibrations.noise.noise_file import NoiseParameters
    from rigctl.files.effect_sections import ErrorsSection
    from rigctl.files.place import SiteSection

FloatArray = NDArray[np.float64]

_NM_PER_M = 1e9


def scene_of_file(file: SceneFile, noise: "NoiseParameters | None" = None) -> Scene:
    """Return the scene of a file; the numbers of a noise calibration take the place of the assumed noise.

    Raises
    ------
    ConfigError
        A material is not found or does not cover the sensor's wavelength, or the sun cannot be placed.
    """
    sensor = _with_wavelength(file)
    wavelength_m = 0.0 if sensor.wavelength_nm is None else sensor.wavelength_nm.value * 1e-9
    sun, by_site = _sun(file)
    known, joint = _calibrated(noise)
    return Scene(
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
        joint_errors=(*joint, *by_site, *_pointing(file)),
        remarks=(
            *_of_noise(file, noise, known),
            *assumed_materials(file),
            *choice_remarks(file),
            *_of_old_keys(file),
            *geometry_remarks(file),
            *_of_pointing(file),
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
    """Return wavelengths [nm] and relative response of a scene's sensor.

    Raises
    ------
    ConfigError
        The scene file does not say.
    """
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


def sun_of_file(file: SceneFile) -> Sun | None:
    """Return the sun of a scene file by its angles.

    Raises
    ------
    ConfigError
        It cannot be placed.
    """
    return _sun(file)[0]


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


def _pointing(file: SceneFile) -> Iterable[JointErrors]:
    """Give the covariance of the angles of camera and panels, of those that the model has."""
    if file.pointing is None:
        return
    given = {f"regions.{region.name}." for region in file.regions if region.material is None}
    keys, angles = file.pointing.parameters, pointing_angles(file)
    used = [k for k, key in enumerate(keys) if key in angles and key.rpartition(".")[0] + "." not in given]
    std = np.array([angles[keys[k]].std for k in used])
    correlation = np.array(file.pointing.correlation)[np.ix_(used, used)]
    if len(used) > 1:
        yield JointErrors(keys=tuple(keys[k] for k in used), covariance=correlation * np.outer(std, std))


def _of_pointing(file: SceneFile) -> Iterable[str]:
    yield from (f"the errors of {', '.join(one.keys)} go together, as [pointing] says" for one in _pointing(file))


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
