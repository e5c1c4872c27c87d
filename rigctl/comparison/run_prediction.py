"""Prediction of a run from a scene file: at the run's own angles, cycles, exposure, sun and rig."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.accuracy.chain import Settings
from model.prediction import RegionPrediction, predict, predict_with_errors
from model.quantities import angle_of
from model.scene.field import FieldLight
from model.scene.scene import Readout
from rigctl.calibrations.noise.noise_file import NoiseParameters
from rigctl.comparison.rows import with_ratios
from rigctl.comparison.run_geometry import scene_of_run, sun_used
from rigctl.errors import ConfigError, DataError
from rigctl.files.scene_file import SceneFile
from rigctl.measurement.measurement import Measurement, frame_order
from rigctl.scene.model_scene import build_scenario
from rigctl.scene.rig_inputs import TakenCycle, exposure_std, rig_errors, with_rig
from rigctl.scene.scene_inputs import Inputs, gather
from rigctl.scene.scene_light import SceneLight
from rigctl.scene.scene_reading import scene_of_file
from rigctl.scene.scene_record import Scene

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class RunPredictor:
    """A scene as it was when a run was taken, ready to be predicted with other values of its inputs.

    Attributes
    ----------
    inputs : Inputs
        Numbers of scene file, calibration and rig.
    readout : Readout
        Angles and cycles of the run.
    exposure_s : float
        Of each frame [s].
    light : SceneLight
        Computes the light of materials, and keeps it.
    settings : Settings or None
        Numerical settings in place of those of the file.
    moved : tuple of str
        Which sun is taken, and what the run says of sun and geometry otherwise than the file.
    """

    inputs: Inputs
    readout: Readout
    exposure_s: float
    light: SceneLight
    moved: tuple[str, ...]
    settings: Settings | None = None

    def predictions(self, values: FloatArray) -> dict[str, RegionPrediction]:
        """Return what the model says of each region, at values of the inputs.

        Raises
        ------
        ConfigError
            The values do not go together.
        """
        scene = self.inputs.at(values)
        errors = rig_errors(scene)
        try:
            scenario = build_scenario(
                scene, readout=self.readout, exposure_s=self.exposure_s, light=self.light, settings=self.settings
            )
            return with_ratios(predict(scenario) if errors is None else predict_with_errors(scenario, errors))
        except ValueError as error:
            raise ConfigError(f"scene {scene.name}, its numbers within their uncertainties: {error}") from error

    def lights(self, scene: Scene) -> dict[str, FieldLight]:
        """Return the light of each region that is given by a material."""
        named = [region for region in scene.regions if region.material is not None]
        return {region.name: self.light.region(scene, region, self.settings) for region in named}


def run_predictor(measurement: Measurement, *, scene: SceneFile, noise: NoiseParameters | None) -> RunPredictor:
    """Return what predicts a run from a scene file.

    Parameters
    ----------
    measurement : Measurement
        The run; angles, cycles, exposure, sun and rig are its own.
    scene : SceneFile
        What the model is told.
    noise : NoiseParameters or None
        A noise calibration, in place of the assumed noise.

    Raises
    ------
    DataError
        Exposures differ or are not known.
    """
    stated_file = scene
    scene, moved = scene_of_run(stated_file, measurement.run, measurement.grid.frames)
    stated = with_rig(scene_of_file(scene, noise), scene.rig, cycle_of_run(measurement, scene))
    return RunPredictor(
        inputs=gather(stated),
        readout=run_readout(measurement),
        exposure_s=one_exposure_s(measurement),
        light=SceneLight(),
        moved=(*sun_used(stated_file, scene, measurement.run, measurement.grid.frames), *moved),
    )


def run_readout(measurement: Measurement) -> Readout:
    """Return angles and cycles of a run."""
    grid = measurement.grid
    return Readout(
        angles_rad=grid.polarizer_angles_rad,
        channel_names=grid.channel_names,
        cycles=grid.cycles,
        extinction_ratio=measurement.extinction_ratio,
        noise_factor=measurement.noise_factor if measurement.corrections.is_any else None,
        flat_error=None if measurement.flat is None else measurement.flat.error,
    )


def one_exposure_s(measurement: Measurement) -> float:
    """Return the exposure of a run's frames [s].

    Raises
    ------
    DataError
        It is not known, or differs between angles.
    """
    exposures = measurement.grid.exposures_s
    if exposures is None:
        raise DataError(f"{measurement.run.path}: its exposure is not known, and a scene cannot be predicted without")
    if not measurement.grid.is_one_exposure:
        raise DataError(f"{measurement.run.path}: its angles have different exposures; a scene needs one for all")
    return float(exposures[0])


def cycle_of_run(measurement: Measurement, scene: SceneFile) -> TakenCycle:
    """Return the cycle of a run, as the errors of its rig act on it."""
    return TakenCycle(
        angle_names=tuple(angle_of(name) for name in measurement.grid.channel_names),
        frame_order=tuple(frame_order(measurement).tolist()),
        # How well the rig file of the run knows the polarizer's offset; 0 where there is none, as of images.
        offset_std_deg=measurement.run.session.polarizer.offset_std_deg,
        exposure_std=exposure_std(scene),
    )
