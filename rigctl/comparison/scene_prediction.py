"""What the model says of a scene file without a run: predictions, and where the light of each region comes from."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from model.accuracy.evaluation.chain import Clock
from model.accuracy.predict_to_tolerance import SMALLEST, AccuratePrediction
from model.accuracy.predict_to_tolerance import predict as predict_to
from model.effects.planner import EffectPlan, plan
from model.prediction.prediction import RegionPrediction, predict
from model.prediction.rig_errors import RigErrors, predict_with_errors
from model.scene.field_light import FieldLight, Source
from model.scene.lit_scene import LitScene
from rigctl.calibrations.noise.noise_file import NoiseParameters
from rigctl.calibrations.radiometric_file import RadiometricResponse
from rigctl.comparison.rig_inputs import IDEAL_RIG, cycle_of_file, rig_errors, with_rig
from rigctl.comparison.scale import panel_scaled
from rigctl.errors import ConfigError
from rigctl.files.scene_file import SceneFile
from rigctl.scene.effect_choice import acting_effects, forced_effects
from rigctl.scene.effect_plan import SHARE
from rigctl.scene.lit_scene import lit_scene
from rigctl.scene.scene_inputs import Inputs, build_scenario, build_sensor, file_readout, gather
from rigctl.scene.scene_light import SceneLight
from rigctl.scene.scene_records import camera_view

_MS_PER_S = 1000.0
EXPOSURE = "acquisition.exposure_ms"


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneGeometry:
    """Where sun and camera stand, and what the sun sends [deg, W m-2 in band]."""

    sun_zenith_deg: float
    sun_azimuth_deg: float
    camera_zenith_deg: float
    camera_azimuth_deg: float
    phi_deg: float
    direct_irradiance: float
    sky_irradiance: float


@dataclass(frozen=True, kw_only=True, eq=False)
class ScenePrediction:
    """What the model says of a scene.

    Attributes
    ----------
    predictions : dict
        Region to prediction.
    lights : dict
        Region to its light, for the regions that are given by a material.
    geometry : SceneGeometry or None
        For a scene with such a region.
    remarks : tuple of str
        What is assumed, and what is least known.
    """

    predictions: dict[str, RegionPrediction]
    lights: dict[str, FieldLight]
    geometry: SceneGeometry | None
    remarks: tuple[str, ...]


class ScenePredictor:
    """A scene file with a noise calibration, ready to be predicted with any of its numbers changed."""

    def __init__(
        self,
        scene: SceneFile,
        noise: NoiseParameters | None,
        *,
        light: SceneLight | None = None,
        source: Source = "total",
        radiometric: RadiometricResponse | None = None,
    ) -> None:
        if source != "total" and not scene.has_materials:
            raise ConfigError(f"--light {source}: no region of {scene.name} is given by its material")
        self._scene, self._source = scene, source
        self._light = SceneLight() if light is None else light
        self._cycle = cycle_of_file(scene)
        self._inputs = with_rig(gather(scene, noise), scene.rig, self._cycle)
        if radiometric is not None:
            exposure_s = scene.acquisition.exposure_ms / _MS_PER_S
            scaled, scale = panel_scaled(self._inputs, radiometric, scene=scene, exposure_s=exposure_s)
            self._inputs = replace(scaled, remarks=(*scaled.remarks, scale.remark))

    @property
    def inputs(self) -> Inputs:
        """The numbers as file and calibration have them."""
        return self._inputs

    @property
    def numbers(self) -> dict[str, float]:
        """Every number that may be changed, by its name."""
        return IDEAL_RIG | self._inputs.named | {EXPOSURE: self._scene.acquisition.exposure_ms}

    def rig_errors(self, changed: Mapping[str, float] | None = None) -> RigErrors | None:
        """Return how far the rig is from what is stated of it, with some numbers changed; None where it is not."""
        return rig_errors(self.numbers | dict(changed or {}), self._cycle)

    def predictions(self, changed: Mapping[str, float] | None = None) -> dict[str, RegionPrediction]:
        """Return what the model says with some numbers changed.

        Raises
        ------
        ConfigError
            A number is outside its range.
        """
        values = self.numbers | dict(changed or {})
        try:
            scenario = build_scenario(
                self._scene,
                values,
                readout=file_readout(self._scene),
                exposure_s=values[EXPOSURE] / _MS_PER_S,
                light=self._light,
                source=self._source,
            )
            errors = rig_errors(values, self._cycle)
            return predict(scenario) if errors is None else predict_with_errors(scenario, errors)
        except ValueError as error:
            raise ConfigError(f"scene {self._scene.name}: {error}") from error

    def lit_scene(self, changed: Mapping[str, float] | None = None) -> LitScene:
        """Return all that the scene is, as one record of the model, with some numbers changed.

        Raises
        ------
        ConfigError
            A number is outside its range.
        """
        values = self.numbers | dict(changed or {})
        try:
            sensor = build_sensor(self._scene, values, values[EXPOSURE] / _MS_PER_S)
        except ValueError as error:
            raise ConfigError(f"scene {self._scene.name}: {error}") from error
        return lit_scene(self._scene, values, sensor=sensor, readout=file_readout(self._scene), source=self._source)

    def effect_plan(self, tolerance: float) -> EffectPlan:
        """Return which effects the scene calls for, of a tolerance of which leaving out may take a half.

        Raises
        ------
        ConfigError
            The tolerance, or a number, is outside its range.
        """
        # The least tolerance has nothing to share.
        share = SHARE * tolerance if tolerance * (1.0 - SHARE) >= SMALLEST else 0.0
        try:
            return plan(self.lit_scene(), tolerance=share, forced=forced_effects(self._scene))
        except ValueError as error:
            raise ConfigError(f"scene {self._scene.name}: {error}") from error

    def to_tolerance(
        self, tolerance: float, *, effects: EffectPlan | None = None, clock: Clock = time.perf_counter
    ) -> AccuratePrediction:
        """Return what the model says of the scene, to a stated numerical error.

        Parameters
        ----------
        tolerance : float
            Of effects that are left out and numerical settings together.
        effects : EffectPlan or None
            From `effect_plan`; settings have what that did not spend. None: all that the scene file does not leave out.
        clock : callable
            Seconds, rising.

        Raises
        ------
        ConfigError
            The tolerance, or a number, is outside its range; or [rig] states a rig that is not as recorded, which is
            no part of such a prediction.
        """
        if self.rig_errors() is not None:
            raise ConfigError(
                f"scene {self._scene.name}: --tolerance is of a rig as it is recorded; leave the values of [rig] at "
                "polarizer_offset_deg = 0, exposure_ratio = 1, light_drift = 0 (uncertainties may stay)"
            )
        active = acting_effects(self._scene) if effects is None else effects.active
        spent = 0.0 if effects is None else effects.spent.largest
        try:
            return predict_to(
                self.lit_scene(),
                tolerance=tolerance - spent,
                effects=active,
                store=self._light.lights,
                clock=clock,
            )
        except ValueError as error:
            raise ConfigError(f"scene {self._scene.name}: {error}") from error

    def predict(self) -> ScenePrediction:
        """Return what the model says of the scene as it is."""
        values = self._inputs.named
        predictions = self.predictions()
        materials = [region for region in self._scene.regions if region.material is not None]
        return ScenePrediction(
            predictions=predictions,
            lights={region.name: self._light.region(self._scene, region, values) for region in materials},
            geometry=self._geometry(values) if materials else None,
            remarks=(*self._inputs.remarks, *self._light.remarks(self._scene, values)),
        )

    def _geometry(self, values: Mapping[str, float]) -> SceneGeometry:
        illumination, view = self._light.illumination(self._scene, values), camera_view(self._scene, values)
        phi_deg = np.degrees(illumination.sun_azimuth_rad - view.azimuth_rad)
        return SceneGeometry(
            sun_zenith_deg=float(np.degrees(illumination.sun_zenith_rad)),
            sun_azimuth_deg=float(np.degrees(illumination.sun_azimuth_rad)) % 360.0,
            camera_zenith_deg=float(np.degrees(view.zenith_rad)),
            camera_azimuth_deg=float(np.degrees(view.azimuth_rad)) % 360.0,
            phi_deg=180.0 - float(180.0 - phi_deg) % 360.0,
            direct_irradiance=illumination.lighting.direct_irradiance,
            sky_irradiance=illumination.sky_irradiance,
        )
