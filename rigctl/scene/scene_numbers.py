"""The numbers that a scene file states, by name, each with its uncertainty and the smallest value it may take."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.sun import distance_factor
from model.sensor.electrons import effective_wavelength_m
from model.surface.lobe import SLOPE_RMS_MIN
from model.surface.materials import Material, assumed_properties, properties
from rigctl.config import Uncertain
from rigctl.errors import ConfigError
from rigctl.files.material_file import find_material
from rigctl.files.place import SiteSection
from rigctl.files.scene_file import COVARIANCE_PAIRS, SceneFile, SceneRegion, SensorSection
from rigctl.scene.scene_records import band_points
from rigctl.scene.skies.solar_band import response_band
from rigctl.scene.skies.sun_position import sun_moved_by_place, sun_position

FloatArray = NDArray[np.float64]

_NOT_NUMBERS = frozenset({"bit_depth", "response", "band_nm"})
SUN_ZENITH, SUN_AZIMUTH = "sun.zenith_deg", "sun.azimuth_deg"
_SIGNED_ERRORS = frozenset({"illumination_drift"})
# An index of refraction is not 0.
_LEAST_INDEX = 1e-3


@dataclass(frozen=True, kw_only=True)
class Stated:
    """A number, its standard uncertainty and the smallest value that it may take."""

    value: float
    std: float = 0.0
    least: float = 0.0

    @classmethod
    def of(cls, number: Uncertain, *, least: float = 0.0) -> "Stated":
        """Return a number of a file."""
        return cls(value=number.value, std=number.std, least=least)


def sensor_numbers(scene: SceneFile) -> dict[str, Stated]:
    """Return the numbers of optics and sensor; an effective wavelength that is not stated follows from the band."""
    given = {name: getattr(scene.sensor, name) for name in SensorSection.model_fields if name not in _NOT_NUMBERS}
    found = {f"sensor.{name}": Stated.of(number) for name, number in given.items() if number is not None}
    if scene.sensor.wavelength_nm is None:
        found["sensor.wavelength_nm"] = Stated(value=_effective_wavelength_nm(scene))
    return found


def light_numbers(scene: SceneFile) -> dict[str, Stated]:
    """Return the numbers of sun, camera position, atmosphere and field of view, as far as the file has them.

    Raises
    ------
    ConfigError
        The sun cannot be placed.
    """
    return _sun(scene) | _geometry(scene) | _atmosphere(scene) | _field(scene)


def error_numbers(scene: SceneFile) -> dict[str, Stated]:
    """Return the numbers of what a session adds to the scene."""
    given = {name: getattr(scene.errors, name) for name in type(scene.errors).model_fields}
    return {
        f"errors.{name}": Stated.of(number, least=-math.inf if name in _SIGNED_ERRORS else 0.0)
        for name, number in given.items()
        if isinstance(number, Uncertain)
    }


def sun_covariance_deg2(site: SiteSection, time: datetime) -> FloatArray:
    """Return the covariance of zenith and azimuth of the sun by what is not known of the site, shape (2, 2) [deg^2]."""
    effects = [np.rad2deg(sun_moved_by_place(time, site.place, name, by=std)) for name, std in site.std.items()]
    moved = np.array(effects).reshape(-1, 2)
    return np.asarray(moved.T @ moved)


def region_numbers(region: SceneRegion, *, wavelength_m: float) -> dict[str, Stated]:
    """Return the numbers of a region: its radiance, or its material at the sensor's wavelength and how it stands.

    Raises
    ------
    ConfigError
        The material is not found, or does not cover the wavelength.
    """
    prefix = f"regions.{region.name}"
    found = {f"{prefix}.texture_rms": Stated.of(region.texture_rms)} | _covariance_numbers(region, prefix)
    if region.stokes_radiance is not None:
        radiance = {
            f"{prefix}.stokes_radiance.{k}": Stated.of(number, least=-math.inf)
            for k, number in enumerate(region.stokes_radiance)
        }
        return radiance | found
    for k, number in enumerate(region.texture_diagonal or ()):
        found[f"{prefix}.texture_diagonal.{k}"] = Stated.of(number)
    found[f"{prefix}.tilt_deg"] = Stated.of(region.tilt_deg)
    found[f"{prefix}.tilt_azimuth_deg"] = Stated.of(region.tilt_azimuth_deg, least=-math.inf)
    return found | _material_numbers(region, prefix, wavelength_m)


def _covariance_numbers(region: SceneRegion, prefix: str) -> dict[str, Stated]:
    rows = region.texture_covariance
    if rows is None:
        return {}
    return {
        f"{prefix}.texture_covariance.{i}.{j}": Stated.of(rows[i][j], least=0.0 if i == j else -math.inf)
        for i, j in COVARIANCE_PAIRS
    }


def assumed_materials(scene: SceneFile) -> Iterable[str]:
    """Return for each region what is only assumed of its material, in words."""
    for region in scene.regions:
        material = _material(region)
        assumed = () if material is None else assumed_properties(material)
        if material is not None and assumed:
            yield f"assumed, not measured: {', '.join(assumed)} of {material.name} (region {region.name})"


def _effective_wavelength_nm(scene: SceneFile) -> float:
    """Mean wavelength of sunlight outside the atmosphere in the sensor's band."""
    nm, response = np.array(band_points(scene)).T
    try:
        band = response_band(wavelength_nm=nm, response=response, distance_factor=1.0)
    except ValueError as error:
        raise ConfigError(f"scene {scene.name}: {error}") from error
    return effective_wavelength_m(band.wavelength_m, band.weighted) * 1e9


def _sun(scene: SceneFile) -> dict[str, Stated]:
    sun = scene.sun
    if sun is None:
        return {}
    if sun.time is not None:
        return _sun_of_time(scene, sun.time)
    stated = sun.distance_factor
    factor = Stated(value=_distance_factor(sun.day_of_year)) if stated is None else Stated.of(stated)
    found = {"sun.distance_factor": factor}
    if sun.zenith_deg is not None:
        found[SUN_ZENITH] = Stated.of(sun.zenith_deg)
    if sun.azimuth_deg is not None:
        found[SUN_AZIMUTH] = Stated.of(sun.azimuth_deg, least=-math.inf)
    return found


def _sun_of_time(scene: SceneFile, time: datetime) -> dict[str, Stated]:
    if scene.site is None:
        raise ConfigError(f"scene {scene.name}: sun.time also needs [site]")
    position = sun_position(time, **scene.site.place)
    zenith_std, azimuth_std = np.sqrt(np.diag(sun_covariance_deg2(scene.site, time))).tolist()
    return {
        SUN_ZENITH: Stated(value=math.degrees(position.zenith_rad), std=zenith_std),
        SUN_AZIMUTH: Stated(value=math.degrees(position.azimuth_rad), std=azimuth_std, least=-math.inf),
        "sun.distance_factor": Stated(value=position.distance_factor),
    }


def _distance_factor(day_of_year: float | None) -> float:
    return 1.0 if day_of_year is None else distance_factor(day_of_year=day_of_year)


def _geometry(scene: SceneFile) -> dict[str, Stated]:
    if scene.geometry is None:
        return {}
    signed = ("camera_azimuth_deg", "phi_deg", "camera_roll_deg")
    given = {name: getattr(scene.geometry, name) for name in type(scene.geometry).model_fields}
    return {
        f"geometry.{name}": Stated.of(number, least=-math.inf if name in signed else 0.0)
        for name, number in given.items()
        if number is not None
    }


def _atmosphere(scene: SceneFile) -> dict[str, Stated]:
    if scene.atmosphere is None:
        return {}
    given = {name: getattr(scene.atmosphere, name) for name in type(scene.atmosphere).model_fields}
    found = {
        f"atmosphere.{name}": Stated.of(number, least=-math.inf if name == "angstrom_exponent" else 0.0)
        for name, number in given.items()
        if isinstance(number, Uncertain)
    }
    for k, measured in enumerate(scene.atmosphere.measured_depths or ()):
        found[f"atmosphere.measured_depths.{k}.optical_depth"] = Stated.of(measured.optical_depth)
    if scene.atmosphere.alternative is not None:
        found["atmosphere.alternative.share"] = Stated.of(scene.atmosphere.alternative.share)
    return found


def _field(scene: SceneFile) -> dict[str, Stated]:
    if scene.field_of_view is None:
        return {}
    names = ("width_deg", "height_deg", "focal_length_mm")
    given = {name: getattr(scene.field_of_view, name) for name in names}
    return {f"field_of_view.{name}": Stated.of(number) for name, number in given.items() if number is not None}


def _material(region: SceneRegion) -> Material | None:
    # A file's path was made absolute when the scene file was read.
    return None if region.material is None else find_material(region.material, beside=Path())


def _material_numbers(region: SceneRegion, prefix: str, wavelength_m: float) -> dict[str, Stated]:
    material = _material(region)
    if material is None:
        return {}
    least = {"n": _LEAST_INDEX, "slope_rms": SLOPE_RMS_MIN}
    try:
        found = {
            f"{prefix}.{name}": Stated(
                value=value.at(wavelength_m), std=value.standard_uncertainty, least=least.get(name, 0.0)
            )
            for name, value in properties(material).items()
        }
    except ValueError as error:
        raise ConfigError(f"region {region.name}: {error}") from error
    return found | {f"{prefix}.dhr_angle_deg": Stated(value=math.degrees(material.dhr_angle_rad))}
