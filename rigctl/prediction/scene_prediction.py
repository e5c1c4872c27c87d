"""Prediction of a scene file without a run, and where the light of each region comes from."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from model.prediction import RegionPrediction, predict
from rigctl.errors import ConfigError, as_config_error
from rigctl.scene.effect_choice import acting_effects, forced_effects
from rigctl.scene.model_records import camera_view
from rigctl.scene.model_scene import build_scenario, lit_scene, readout_of, sensor_of
from rigctl.scene.parameters import require_within, with_values
from rigctl.scene.rig_inputs import cycle_of_file, rig_errors, with_rig
from rigctl.scene.scene_inputs import Inputs, gather
from rigctl.scene.scene_light import SceneLight
from rigctl.scene.scene_reading import scene_of_file

if TYPE_CHECKING:
    from model.accuracy.chain import Clock
    from model.accuracy.predict import AccuratePrediction
    from model.accuracy.series import SeriesPrediction
    from model.effects.names import EffectPlan
    from model.scene.field import FieldLight, Source
    from model.scene.scene import LitScene
    from rigctl.calibrations.noise.noise_file import NoiseParameters
    from rigctl.files.choices import EffectRule
    from rigctl.files.scene_file import SceneFile
    from rigctl.scene.scene_record import Scene


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


def _with_changes(scene: "Scene", changed: Mapping[str, float]) -> "Scene":
    """Return a scene as if its file said otherwise, and a remark that it does."""
    found = with_values(scene, changed)
    require_within(scene, changed, option="changed")
    said = ", ".join(f"{key} = {value:g}" for key, value in changed.items())
    return replace(found, remarks=(*scene.remarks, f"changed: {said}, not as the scene file has it"))


@dataclass(frozen=True, kw_only=True, eq=False)
class ScenePrediction:
    """Predictions of a scene.

    Attributes
    ----------
    predictions : mapping
        Region to prediction.
    lights : mapping
        Region to its light, for the regions that are given by a material.
    geometry : SceneGeometry or None
        For a scene with such a region.
    remarks : tuple of str
        What is assumed, and what is least known.
    """

    predictions: dict[str, RegionPrediction]
    lights: dict[str, "FieldLight"]
    geometry: SceneGeometry | None
    remarks: tuple[str, ...]


class ScenePredictor:
    """A scene, ready to be predicted with any of its numbers changed."""

    def __init__(
        self,
        scene: "SceneFile",
        noise: "NoiseParameters | None",
        *,
        light: SceneLight | None = None,
        source: "Source" = "total",
        scaled: Callable[[Inputs], Inputs] | None = None,
        changes: Mapping[str, float] | None = None,
    ) -> None:
        """Take a scene file, a noise calibration, and what else changes its inputs, such as a radiometric calibration.

        `changes` are numbers in the place of those of file and noise calibration, as if the file stated them.

        Raises
        ------
        ConfigError
            The file has no light of this source, or its scene cannot be put together.
        """
        if source != "total" and not scene.has_materials:
            raise ConfigError(f"--light {source}: no region of {scene.name} is given by its material")
        stated = with_rig(scene_of_file(scene, noise), scene.rig, cycle_of_file(scene))
        if changes:
            stated = _with_changes(stated, changes)
        self._light, self._source = SceneLight() if light is None else light, source
        self._inputs = gather(stated) if scaled is None else scaled(gather(stated))
        # The processing takes what is stated, whatever is true.
        self._readout = readout_of(stated)

    @property
    def scene(self) -> "Scene":
        """The scene as file and calibration have it."""
        return self._inputs.scene

    @property
    def inputs(self) -> Inputs:
        """Its numbers with their covariance."""
        return self._inputs

    @property
    def remarks(self) -> tuple[str, ...]:
        """What is assumed, what was set aside, and what is least known of the air."""
        return (*self._inputs.remarks, *self._light.remarks(self.scene))

    def predictions(self, changed: Mapping[str, float] | None = None) -> dict[str, RegionPrediction]:
        """Return what the model says with some numbers changed, by their keys.

        Raises
        ------
        ConfigError
            There is no such number, or it is outside its range.
        """
        return self.predictions_of(with_values(self.scene, changed or {}))

    def predictions_of(self, scene: "Scene") -> dict[str, RegionPrediction]:
        """Return what the model says of this scene with some numbers changed.

        Raises
        ------
        ConfigError
            A number is outside its range.
        """
        with as_config_error(f"scene {scene.name}"):
            scenario = build_scenario(
                scene, readout=self._readout, exposure_s=scene.exposure_s, light=self._light, source=self._source
            )
            errors = rig_errors(scene)
            if errors is None:
                return predict(scenario)
            from model.prediction import predict_with_errors

            return predict_with_errors(scenario, errors)

    def lit_scene(self, scene: "Scene | None" = None) -> "LitScene":
        """Return all that the scene is, as one record of the model.

        Parameters
        ----------
        scene : Scene or None
            This scene with some numbers changed; None: as it is.

        Raises
        ------
        ConfigError
            A number is outside its range.
        """
        of = self.scene if scene is None else scene
        with as_config_error(f"scene {of.name}"):
            sensor = sensor_of(of, of.exposure_s)
        return lit_scene(of, sensor=sensor, readout=self._readout, source=self._source)

    def effect_plan(
        self, tolerance: float, *, rule: "EffectRule" = "safe", of: "LitScene | None" = None
    ) -> "EffectPlan":
        """Return which effects the scene calls for, of a tolerance of which leaving out may take a half.

        By the rule "estimated" effects of the light are estimated, which cost time; the others go by their bounds. Of
        the scene as it is, none is estimated in daylight.

        Parameters
        ----------
        tolerance : float
            Of a prediction.
        rule : {"safe", "estimated", "all"}
            By bounds, by estimates, or not at all.
        of : LitScene or None
            This scene with some numbers changed; None: as it is.

        Raises
        ------
        ConfigError
            The tolerance, or a number, is outside its range.
        """
        # What holds errors to a tolerance takes a quarter of a second to import, and most predictions state none.
        from rigctl.scene.effect_plan import plan_for_prediction

        with as_config_error(f"scene {self.scene.name}"):
            return plan_for_prediction(
                self.lit_scene() if of is None else of,
                tolerance=tolerance,
                forced=forced_effects(self.scene),
                rule=rule,
                store=self._light.lights,
                is_of_many=of is not None,
            )

    def to_tolerance(
        self,
        tolerance: float,
        *,
        effects: "EffectPlan | None" = None,
        estimated_only: bool = False,
        clock: "Clock" = time.perf_counter,
    ) -> "AccuratePrediction":
        """Return what the model says of the scene, to a stated numerical error.

        Parameters
        ----------
        tolerance : float
            Of effects that are left out and numerical settings together.
        effects : EffectPlan or None
            From `effect_plan`; settings have what that did not spend. None: all that the scene file does not leave out.
        estimated_only : bool
            Take errors that nothing promises as they are estimated.
        clock : callable
            Seconds, rising.

        Raises
        ------
        ConfigError
            The tolerance, or a number, is outside its range; or [rig] states a rig that is not as recorded, which is
            no part of such a prediction.
        """
        from model.accuracy import predict as predict_to_tolerance

        _require_recorded_rig(self.scene)
        active = acting_effects(self.scene) if effects is None else effects.active
        spent = 0.0 if effects is None else effects.spent.largest
        with as_config_error(f"scene {self.scene.name}"):
            return predict_to_tolerance.predict(
                self.lit_scene(),
                tolerance=tolerance - spent,
                effects=active,
                estimated_only=estimated_only,
                store=self._light.lights,
                clock=clock,
            )

    def series_to_tolerance(
        self,
        scenes: Sequence["Scene"],
        tolerance: float,
        *,
        shape: tuple[int, ...] | None = None,
        rule: "EffectRule" = "safe",
        estimated_only: bool = False,
    ) -> "SeriesPrediction":
        """Return what the model says of this scene with some numbers changed step by step, to a numerical error.

        Parameters
        ----------
        scenes : sequence of Scene
            In an order in which they change smoothly; of a grid the last axis fastest.
        tolerance : float
            Of effects that are left out and numerical settings together.
        shape : tuple of int or None
            Scenes along each axis of a grid; None for one axis.
        rule : {"safe", "estimated", "all"}
            What decides of effects of the light.
        estimated_only : bool
            Take errors that nothing promises as they are estimated.

        Raises
        ------
        ConfigError
            The tolerance, or a number, is outside its range; or [rig] states a rig that is not as recorded.
        """
        from model.accuracy.series import SeriesEffects, predict_series

        for scene in scenes:
            _require_recorded_rig(scene)
        with as_config_error(f"scene {self.scene.name}"):
            return predict_series(
                [self.lit_scene(scene) for scene in scenes],
                tolerance=tolerance,
                shape=shape,
                effects=SeriesEffects(
                    acting=acting_effects(self.scene),
                    rule=rule,
                    planned=lambda lit: self.effect_plan(tolerance, rule=rule, of=lit),
                ),
                estimated_only=estimated_only,
                store=self._light.lights,
            )

    def predict(self) -> ScenePrediction:
        """Return what the model says of the scene as it is."""
        scene, predictions = self.scene, self.predictions()
        materials = [region for region in scene.regions if region.material is not None]
        return ScenePrediction(
            predictions=predictions,
            lights={region.name: self._light.region(scene, region) for region in materials},
            geometry=self._geometry() if materials else None,
            remarks=self.remarks,
        )

    def _geometry(self) -> SceneGeometry:
        illumination, view = self._light.illumination(self.scene), camera_view(self.scene)
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


def _require_recorded_rig(scene: "Scene") -> None:
    if rig_errors(scene) is not None:
        raise ConfigError(
            f"scene {scene.name}: --tolerance is of a rig as it is recorded; leave the values of [rig] at "
            "polarizer_offset_deg = 0, exposure_ratio = 1 (uncertainties may stay)"
        )
