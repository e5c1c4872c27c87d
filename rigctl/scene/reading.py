"""From a scene file and a noise calibration to the record `Scene`: the only module that knows both.

Sections of the file that the model's units allow stay as they are. What the file may state in several ways becomes one:
the sun by its angles, materials at the sensor's wavelength, the noise of a calibration in place of the assumed one.

Whatever changes a scene afterwards works on the record (`rigctl.scene.scene`).
"""

import math
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.sky import distance_factor
from model.sensor import effective_wavelength_m
from rigctl.errors import ConfigError, as_config_error
from rigctl.files.materials import find_material
from rigctl.files.scene_file import (
    NoiseSection,
    SceneFile,
    SceneRegion,
    SensorSection,
)
from rigctl.files.toml import Uncertain
from rigctl.scene.scene import (
    NOISE_FACTOR,
    SUN_AZIMUTH,
    SUN_ZENITH,
    JointErrors,
    Rig,
    Scene,
    SceneRegionRecord,
    Sun,
    assumed_materials,
    chosen_effects,
    forced,
    with_geometry,
)
from rigctl.scene.sun import band_points, response_band, sun_covariance_deg2, sun_position

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


def with_choices(scene: SceneFile, *, switched_on: Sequence[str], left_out: Sequence[str]) -> SceneFile:
    """Return the scene file with effects forced by options, which go before those of the file."""
    chosen = scene.model_copy(update={"effects": chosen_effects(scene.effects, switched_on, left_out)})
    forced(chosen.effects, scene.name)
    return chosen


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


def _region(region: SceneRegion, wavelength_m: float) -> SceneRegionRecord:
    if region.material is None:
        return SceneRegionRecord(given=region, material=None)
    # A file's path was made absolute when the scene file was read.
    material = find_material(region.material, beside=Path())
    try:
        here = material.at(wavelength_m)
    except ValueError as error:
        raise ConfigError(f"region {region.name}: {error}") from error
    return SceneRegionRecord(given=region, material=here)
