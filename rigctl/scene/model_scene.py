"""The model's scene and its scenario from the record of a scene."""

from itertools import permutations
from typing import TYPE_CHECKING

import numpy as np

from model.accuracy.chain import scenario_of
from model.quantities import counts_name
from model.scene.scene import LitScene, Readout, Scenario
from model.sensor import Imperfections, Sensor, SensorNoise
from rigctl.errors import as_config_error
from rigctl.files.effect_sections import error_numbers
from rigctl.files.scene_file import NoiseSection
from rigctl.scene.effect_choice import acting_effects
from rigctl.scene.model_records import (
    air_of,
    camera_view,
    lit_region,
    radians,
    settings_of,
    sun_azimuth_rad,
    wavelength_m,
)
from rigctl.scene.scene_light import SceneLight

if TYPE_CHECKING:
    from model.accuracy.chain import Settings
    from model.scene.field import Source
    from rigctl.scene.scene_record import Scene


def build_scenario(
    scene: "Scene",
    *,
    readout: Readout,
    exposure_s: float,
    light: SceneLight | None = None,
    source: "Source" = "total",
    settings: "Settings | None" = None,
) -> Scenario:
    """Return the scenario of a scene.

    Parameters
    ----------
    scene : Scene
        Its regions, light and sensor.
    readout : Readout
        Angles and cycles, of a run or of the file.
    exposure_s : float
        Exposure of a frame [s].
    light : SceneLight or None
        Computes the light of materials; whoever asks more than once gives the same one.
    source : str
        Which light of the regions that are given by a material.
    settings : Settings or None
        Numerical settings in place of those of the file.

    Raises
    ------
    ConfigError
        The light of a material cannot be computed.
    """
    used = settings_of(scene) if settings is None else settings
    sensor = sensor_of(scene, exposure_s)
    lit = lit_scene(scene, sensor=sensor, readout=readout, source=source)
    effects = acting_effects(scene)
    if not scene.has_materials:
        return scenario_of(lit, used, effects=effects)
    computer = SceneLight() if light is None else light
    with as_config_error(f"scene {scene.name}"):
        return scenario_of(lit, used, effects=effects, store=computer.lights)


def lit_scene(scene: "Scene", *, sensor: Sensor, readout: Readout, source: "Source" = "total") -> LitScene:
    """Return all that a scene is, as one record of the model.

    Parameters
    ----------
    scene : Scene
        Its regions and light.
    sensor, readout
        Of the scene, or of a run.
    source : str
        Which light of the regions that are given by a material.

    Raises
    ------
    ConfigError
        A number is outside its range, or a table of the sky cannot be read.
    """
    with as_config_error(f"scene {scene.name}"):
        lit = scene.has_materials
        return LitScene(
            air=air_of(scene) if lit else None,
            view=camera_view(scene) if lit else None,
            sun_azimuth_rad=sun_azimuth_rad(scene),
            regions=tuple(lit_region(scene, region) for region in scene.regions),
            sensor=sensor,
            readout=readout,
            source=source,
            pairs=tuple(permutations((region.name for region in scene.regions), 2)),
            imperfections=imperfections_of(scene, frames=readout.angles_rad.size),
        )


def readout_of(scene: "Scene") -> Readout:
    """Return angles and cycles as the scene file states them, for a prediction without a run."""
    angles_deg = sorted(angle % 180.0 for angle in scene.acquisition.angles_deg)
    return Readout(
        angles_rad=np.deg2rad(angles_deg),
        channel_names=tuple(counts_name(f"{angle:g}") for angle in angles_deg),
        cycles=scene.acquisition.cycles,
        extinction_ratio=scene.sensor.extinction_ratio.value,
    )


def sensor_of(scene: "Scene", exposure_s: float) -> Sensor:
    """Return the sensor of a scene at an exposure [s].

    Raises
    ------
    ValueError
        A number is outside its range.
    """
    given = scene.sensor
    along = given.polarizer_transmittance.value
    noise = {name: getattr(scene.noise, name).value for name in NoiseSection.model_fields}
    return Sensor(
        pixel_pitch_m=given.pixel_pitch_um.value * 1e-6,
        f_number=given.f_number.value,
        optics_transmittance=given.optics_transmittance.value,
        quantum_efficiency=given.quantum_efficiency.value,
        wavelength_m=wavelength_m(scene),
        exposure_s=exposure_s,
        bit_depth=given.bit_depth,
        tau_parallel=along,
        tau_perpendicular=along / given.extinction_ratio.value,
        noise=SensorNoise(**noise),
    )


def imperfections_of(scene: "Scene", *, frames: int) -> Imperfections:
    """Return what the session adds; angles of the file are in the order of time, those of the readout rise."""
    errors = scene.errors
    angles_deg = np.mod(scene.acquisition.angles_deg, 180.0)
    in_time = tuple(np.argsort(angles_deg, kind="stable").tolist()) if scene.rig is None else scene.rig.frame_order
    given = {one.field: (getattr(errors, key), one) for key, one in error_numbers().items()}
    return Imperfections(
        drift=errors.illumination_drift.value,
        drift_order=in_time if len(in_time) == frames else (),
        off_axis_falloff=errors.off_axis_falloff,
        **{
            field: radians(number) if one.unit == "deg" else number.value
            for field, (number, one) in given.items()
            if number is not None
        },
    )
