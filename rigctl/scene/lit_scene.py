"""From a scene file and its numbers to the record that the model evaluates, and the settings that the file states."""

from dataclasses import replace
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from model.accuracy.evaluation.settings import Settings, settings_of_tier
from model.atmosphere.lighting.fidelity import Tier
from model.scene.field_light import Source
from model.scene.lit_scene import LitRegion, LitScene
from model.scene.scenario import Readout
from model.sensor.imperfections import Imperfections
from model.sensor.sensor import Sensor
from rigctl.errors import ConfigError
from rigctl.files.scene_file import COVARIANCE_PAIRS, SceneFile, SceneRegion
from rigctl.scene.scene_records import (
    Values,
    camera_view,
    field_part,
    region_surface,
    region_tilt,
    sky_request,
    sun_azimuth_rad,
)
from rigctl.scene.skies.sky_request import air_of


def lit_scene(
    scene: SceneFile, values: Values, *, sensor: Sensor, readout: Readout, source: Source = "total"
) -> LitScene:
    """Return all that a scene file says, with given numbers in place of its own.

    Parameters
    ----------
    scene : SceneFile
        Which regions there are.
    values : mapping
        Every name that `rigctl.scene.scene_inputs.gather` returns, to its number in the units of the file.
    sensor, readout
        Sensor and readout with those numbers.
    source : str
        Which light of the regions that are given by a material.

    Raises
    ------
    ConfigError
        A number is outside its range, or a table of the sky cannot be read.
    """
    try:
        lit = scene.has_materials
        return LitScene(
            air=air_of(sky_request(scene, values)) if lit else None,
            view=camera_view(scene, values) if lit else None,
            sun_azimuth_rad=sun_azimuth_rad(values),
            regions=tuple(lit_region(scene, region, values) for region in scene.regions),
            sensor=sensor,
            readout=readout,
            source=source,
            pairs=tuple(permutations((region.name for region in scene.regions), 2)),
            imperfections=_imperfections(scene, values, frames=readout.angles_rad.size),
        )
    except ValueError as error:
        raise ConfigError(f"scene {scene.name}: {error}") from error


def lit_region(scene: SceneFile, region: SceneRegion, values: Values) -> LitRegion:
    """Return one region of a scene file with given numbers.

    Raises
    ------
    ConfigError
        A number is outside its range.
    """
    prefix = f"regions.{region.name}"
    covariance = _texture_covariance(region, values)
    texture_rms = values[f"{prefix}.texture_rms"]
    if region.material is None:
        radiance = np.array([values[f"{prefix}.stokes_radiance.{k}"] for k in range(3)])
        return LitRegion(name=region.name, radiance=radiance, texture_rms=texture_rms, texture_cov=covariance)
    r0, r1, r2 = (values.get(f"{prefix}.texture_diagonal.{k}", 0.0) for k in range(3))
    try:
        return LitRegion(
            name=region.name,
            surface=region_surface(region, values),
            tilt=region_tilt(region, values),
            part=field_part(scene, region, values),
            texture_rms=texture_rms,
            texture_diagonal=(r0, r1, r2),
            texture_cov=covariance,
        )
    except ValueError as error:
        raise ConfigError(f"scene {scene.name}, region {region.name}: {error}") from error


def _texture_covariance(region: SceneRegion, values: Values) -> NDArray[np.float64]:
    found = np.zeros((3, 3))
    if region.texture_covariance is not None:
        for i, j in COVARIANCE_PAIRS:
            found[i, j] = found[j, i] = values[f"regions.{region.name}.texture_covariance.{i}.{j}"]
    return found


def file_settings(scene: SceneFile) -> Settings:
    """Return the numerical settings that a scene file states, without a tolerance."""
    air, field = scene.atmosphere, scene.field_of_view
    settings = settings_of_tier(
        Tier.STANDARD if air is None else air.tier, wavelengths=4 if air is None else air.wavelengths
    )
    if field is None:
        return settings
    return replace(settings, tiles_per_side=field.tiles_per_side, tile_rule=field.rule)


def _imperfections(scene: SceneFile, values: Values, *, frames: int) -> Imperfections:
    """Return what the session adds; angles of the file are in the order of time, those of the readout rise."""
    in_time = np.argsort([angle % 180.0 for angle in scene.acquisition.angles_deg], kind="stable").tolist()
    return Imperfections(
        polarizer_angle_std_rad=np.deg2rad(values["errors.polarizer_angle_std_deg"]).item(),
        misregistration_pixels=values["errors.misregistration_px"],
        texture_correlation_pixels=values["errors.texture_correlation_px"],
        drift=values["errors.illumination_drift"],
        drift_order=tuple(in_time) if len(in_time) == frames else (),
        surround_albedo=values.get("errors.surround_albedo"),
        off_axis_falloff=scene.errors.off_axis_falloff,
    )
