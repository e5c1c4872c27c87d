"""A scene as it was when a run was taken: with the run's sun, camera, exposure, angles and rig, ready to be predicted.

What the run says takes the place of what the scene file says; `RunPredictor.remarks` says where they differ.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from model.accuracy.chain import Settings
from model.effects.effect import Effect
from model.prediction import RegionPrediction
from model.quantities import angle_of
from model.scene.field import FieldLight
from model.scene.scene import Readout
from rigctl.base.numbers import wrapped
from rigctl.comparison.rows import with_ratios
from rigctl.errors import ConfigError, DataError
from rigctl.files.place import GeometrySection, Place, PointingSection, SiteSection
from rigctl.files.toml import Uncertain
from rigctl.measure.measure import Measurement
from rigctl.prediction.predict import predict_scene
from rigctl.runs.folder import Run
from rigctl.runs.records import FrameRecord, SimulatedLight
from rigctl.scene.light import SceneLight, sun_text
from rigctl.scene.scene import (
    Inputs,
    Parameter,
    Scene,
    Sun,
    gather,
    parameters,
    with_geometry,
    with_sun,
    without_effects,
)
from rigctl.scene.sun import sun_covariance_deg2, sun_position

FloatArray = NDArray[np.float64]

# Below this a difference is that of rounding, and not worth a word [deg].
_WORTH_A_WORD_DEG = 0.01
# The distance of the sun is the same for all.
_ANYWHERE = Place(latitude_deg=0.0, longitude_deg=0.0, elevation_m=0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class RunPredictor:
    """A scene as it was when a run was taken, ready to be predicted with other values of its inputs."""

    measurement: Measurement  #: Of the run.
    stated: Scene  #: As the scene file has it.
    inputs: Inputs  #: Numbers of the scene of the run.
    light: SceneLight  #: Computes the light of materials, and keeps it.
    settings: Settings | None = None  #: Numerical settings in place of those of the file.

    @property
    def remarks(self) -> tuple[str, ...]:
        """Which sun is taken, and what the run says of sun and geometry otherwise than the file."""
        run, frames, used = self.measurement.run, self.measurement.grid.frames, self.inputs.scene
        return (*sun_used(self.stated, used, run, frames), *differences(self.stated, used))

    @cached_property
    def readout(self) -> Readout:
        """Angles and cycles of the run."""
        return run_readout(self.measurement)

    @cached_property
    def exposure_s(self) -> float:
        """Exposure of each frame [s]."""
        return one_exposure_s(self.measurement)

    def predictions(self, values: FloatArray) -> dict[str, RegionPrediction]:
        """Return what the model says of each region, at values of the inputs."""
        scene = self.inputs.at(values)
        try:
            return with_ratios(
                predict_scene(
                    scene, readout=self.readout, exposure_s=self.exposure_s, light=self.light, settings=self.settings
                )
            )
        except ValueError as error:
            raise ConfigError(f"scene {scene.name}, its numbers within their uncertainties: {error}") from error

    def without(self, effects: frozenset[Effect]) -> "RunPredictor":
        """Return what predicts the run with some effects left out."""
        return replace(self, inputs=gather(without_effects(self.inputs.scene, effects)))

    def lights(self, scene: Scene) -> dict[str, FieldLight]:
        """Return the light of each region that is given by a material."""
        named = [region for region in scene.regions if region.material is not None]
        return {region.name: self.light.region(scene, region, self.settings) for region in named}


def run_predictor(measurement: Measurement, scene: Scene) -> RunPredictor:
    """Return what predicts a run from a scene."""
    used = scene_of_run(scene, measurement.run, measurement.grid.frames)
    if measurement.flat is not None:
        # A flat field takes the falloff of the lens with it.
        used = replace(used, errors=used.errors.model_copy(update={"off_axis_falloff": False}))
    return RunPredictor(
        measurement=measurement, stated=scene, inputs=gather(_with_cycle(used, measurement)), light=SceneLight()
    )


def run_readout(measurement: Measurement) -> Readout:
    """Return angles and cycles of a run."""
    grid = measurement.grid
    return Readout(
        angles_rad=grid.polarizer_angles_rad,
        channel_names=grid.channel_names,
        cycles=grid.cycles,
        extinction_ratio=measurement.extinction_ratio,
        noise_factor=measurement.noise_factor if np.any(measurement.noise_factor != 1.0) else None,
        flat_error=None if measurement.flat is None else measurement.flat.error,
    )


def one_exposure_s(measurement: Measurement) -> float:
    """Return the exposure of a run's frames [s]."""
    exposures = measurement.grid.exposures_s
    if exposures is None:
        raise DataError(f"{measurement.run.path}: its exposure is not known, and a scene cannot be predicted without")
    if not measurement.grid.is_one_exposure:
        raise DataError(f"{measurement.run.path}: its angles have different exposures; a scene needs one for all")
    return float(exposures[0])


def _with_cycle(scene: Scene, measurement: Measurement) -> Scene:
    """Return the scene whose rig takes the cycle of the run, with what its rig file does not know of the axis."""
    if scene.rig is None:
        return scene
    names, offset = measurement.grid.channel_names, scene.rig.polarizer_offset_deg
    # 0 where there is no rig file, as of images.
    std = float(np.hypot(offset.std, measurement.run.session.polarizer.offset_std_deg))
    rig = replace(
        scene.rig,
        polarizer_offset_deg=Uncertain(value=offset.value, std=std),
        angle_deg=scene.rig.angle_deg[:1] * len(names),
        angle_names=tuple(angle_of(name) for name in names),
        frame_order=tuple(measurement.grid.frame_order.tolist()),
    )
    return replace(scene, rig=rig)


def scene_of_run(scene: Scene, run: Run, frames: Iterable[FrameRecord]) -> Scene:
    """Return the scene with the sun and the camera's place that the run states.

    The sun is that of the mean over the frames. A simulated run's clock says nothing of the sun, unless it lit a
    simulated roof. Where the run states a number as exact, the scene file's standard uncertainty of it stays.
    """
    light = run.session.simulated_light
    if not scene.has_materials or (run.session.origin == "simulated" and light is None):
        return scene
    changed = _with_geometry(scene, run)
    if light is not None and not light.is_clocked:
        return _with_stated_sun(changed, light)
    return _with_sun(changed, run, tuple(frames))


def sun_used(stated: Scene, used: Scene, run: Run, frames: Iterable[FrameRecord]) -> tuple[str, ...]:
    """Return in one line which sun a comparison of a run takes, when, and whence; nothing without materials."""
    if not stated.has_materials:
        return ()
    light = run.session.simulated_light
    time = None if stated.sun_time is None else f"{stated.sun_time.astimezone(UTC):%Y-%m-%dT%H:%M:%SZ}"
    if light is not None and not light.is_clocked:
        whence = f"the scene file that lit the roof ({light.scene})"
    elif used.sun is stated.sun:
        whence = "the scene file"
    else:
        whence = "the run's frames" if light is None else "the run's simulated clock"
        time = _time_of_frames(frames)
    return (f"sun used: {sun_text(used, time=time)}; by {whence}",)


def _time_of_frames(frames: Iterable[FrameRecord]) -> str | None:
    starts = [frame.start_utc for frame in frames if frame.start_utc is not None]
    return f"{min(starts)[:19]}Z to {max(starts)[:19]}Z" if starts else None


def _with_stated_sun(scene: Scene, light: SimulatedLight) -> Scene:
    """Return the scene under the sun that lit a simulated roof whose clock moves none."""
    stated, azimuth = scene.sun, light.sun_azimuth_deg
    if light.sun_zenith_deg is None or stated is None:
        return scene
    stds = [0.0 if number is None else number.std for number in (stated.zenith_deg, stated.azimuth_deg)]
    sun = Sun(
        zenith_deg=Uncertain(value=light.sun_zenith_deg, std=stds[0]),
        azimuth_deg=None if azimuth is None else Uncertain(value=azimuth, std=stds[1]),
        distance_factor=Uncertain(value=light.distance_factor or 1.0, std=stated.distance_factor.std),
    )
    is_same = (sun.zenith_deg, sun.azimuth_deg) == (stated.zenith_deg, stated.azimuth_deg)
    return scene if is_same else with_sun(scene, sun)


def _with_geometry(scene: Scene, run: Run) -> Scene:
    geometry = None if run.session.rig is None else run.session.rig.geometry
    if geometry is None:
        return scene
    pointing = scene.pointing
    if scene.geometry is not None:
        pointing = None if pointing is None else _without_angles_of_run(pointing, geometry)
        geometry = _with_stds(geometry, scene.geometry)
    return with_geometry(scene, geometry, pointing)


def _without_angles_of_run(pointing: PointingSection, geometry: GeometrySection) -> PointingSection | None:
    """Return how errors go together without the angles whose errors the run itself states; None where nothing is left.

    An angle of the run without a standard uncertainty has that of the scene file, and goes together as before.
    """
    stated = {f"geometry.{name}" for name in type(geometry).model_fields if _is_stated_otherwise(geometry, name)}
    kept = [k for k, key in enumerate(pointing.parameters) if key not in stated]
    if len(kept) < 2:
        return None
    return PointingSection(
        parameters=tuple(pointing.parameters[k] for k in kept),
        correlation=tuple(tuple(pointing.correlation[i][k] for k in kept) for i in kept),
    )


def _is_stated_otherwise(geometry: GeometrySection, name: str) -> bool:
    number = getattr(geometry, name)
    return number is None or number.std > 0.0


def _with_stds(used: GeometrySection, stated: GeometrySection) -> GeometrySection:
    """Return the geometry that is used; a number without uncertainty takes that of the same number as stated."""
    kept = {}
    for name in type(used).model_fields:
        number, other = getattr(used, name), getattr(stated, name)
        if number is not None and other is not None and number.std == 0.0:
            kept[name] = Uncertain(value=number.value, std=other.std)
    return used.model_copy(update=kept)


def _with_sun(scene: Scene, run: Run, frames: tuple[FrameRecord, ...]) -> Scene:
    site = run.session.site
    directions = [_direction(frame, site) for frame in frames]
    known = [direction for direction in directions if direction is not None]
    if not known or len(known) < len(frames):
        return scene
    east, north, up = np.mean(known, axis=0)
    zenith_std_deg, azimuth_std_deg = _sun_stds_deg(scene.sun, site, frames)
    sun = Sun(
        zenith_deg=Uncertain(value=math.degrees(math.atan2(math.hypot(east, north), up)), std=zenith_std_deg),
        azimuth_deg=Uncertain(value=math.degrees(math.atan2(east, north)) % 360.0, std=azimuth_std_deg),
        distance_factor=_distance_factor(frames[0], scene.sun),
    )
    return with_sun(scene, sun)


def _sun_stds_deg(sun: Sun | None, site: SiteSection | None, frames: tuple[FrameRecord, ...]) -> tuple[float, float]:
    """Return the standard uncertainty of the sun's angles, by scene file or by the run's site; of both the larger."""
    numbers = () if sun is None else (sun.zenith_deg, sun.azimuth_deg)
    stds = [0.0 if number is None else number.std for number in numbers] or [0.0, 0.0]
    time = frames[0].start_utc
    if site is not None and site.is_uncertain and time is not None:
        by_site = np.sqrt(np.diag(sun_covariance_deg2(site, datetime.fromisoformat(time))))
        stds = np.maximum(stds, by_site).tolist()
    return stds[0], stds[1]


def _distance_factor(frame: FrameRecord, stated: Sun | None) -> Uncertain:
    """Irradiance of the sun over that at its mean distance when a frame was taken, as well as the file knows it."""
    factor = Uncertain(value=1.0) if stated is None else stated.distance_factor
    if frame.start_utc is None:
        return factor
    value = sun_position(datetime.fromisoformat(frame.start_utc), _ANYWHERE).distance_factor
    return Uncertain(value=value, std=factor.std)


def _direction(frame: FrameRecord, site: SiteSection | None) -> tuple[float, float, float] | None:
    """Direction to the sun as the frame recorded it, or by its time at the site."""
    if frame.sun_azimuth_deg is not None and frame.sun_elevation_deg is not None:
        zenith_rad, azimuth_rad = math.radians(90.0 - frame.sun_elevation_deg), math.radians(frame.sun_azimuth_deg)
    elif frame.start_utc is not None and site is not None:
        found = sun_position(datetime.fromisoformat(frame.start_utc), site.place)
        zenith_rad, azimuth_rad = found.zenith_rad, found.azimuth_rad
    else:
        return None
    level = math.sin(zenith_rad)
    return level * math.sin(azimuth_rad), level * math.cos(azimuth_rad), math.cos(zenith_rad)


def differences(scene: Scene, changed: Scene) -> Iterable[str]:
    """Yield in words where the scene of a run differs from that of its file."""
    yield from _pointing_set_aside(scene, changed)
    stated, used = _directions(scene), _directions(changed)
    for name, number in used.items():
        before = stated.get(name)
        if before is None:
            yield f"{name}: {number.value:.2f} of the run; the scene file states none"
        elif abs(wrapped(number.value - before.value, turn=360.0)) > _WORTH_A_WORD_DEG:
            yield f"{name}: {number.value:.2f} of the run, not {before.value:.2f} of the scene file"
    if "geometry.phi_deg" in used and used.get("sun.azimuth_deg") != stated.get("sun.azimuth_deg"):
        yield "geometry.phi_deg: kept as stated, though the run has another sun: no camera azimuth is known"


def _pointing_set_aside(scene: Scene, changed: Scene) -> Iterable[str]:
    kept = () if changed.pointing is None else changed.pointing.parameters
    gone = [key for key in (() if scene.pointing is None else scene.pointing.parameters) if key not in kept]
    if gone:
        yield f"pointing: set aside for {', '.join(gone)}: the run has errors of its own for angles of [pointing]"


def _directions(scene: Scene) -> dict[str, Parameter]:
    """Angles of sun and camera, by their keys."""
    return {
        number.key: number
        for number in parameters(scene)
        if number.key.startswith(("sun.", "geometry.")) and number.unit == "deg"
    }
