"""The light of a scene as sessions see it: what one cycle of frames shows of each region."""

from dataclasses import replace

from model.acquisition import CycleLight, Scheme, Session, cycle_light
from model.moments import Moments
from model.processing.reconstruction import equispaced_rad
from model.sensor import Sensor
from rigctl.calibrations.noise.noise_file import NoiseParameters
from rigctl.errors import as_config_error
from rigctl.files.scene_file import SceneFile
from rigctl.scene.model_scene import build_scenario, readout_of
from rigctl.scene.scene_light import SceneLight
from rigctl.scene.scene_reading import scene_of_file

# The brightest counts go up to this share of the largest that the sensor gives.
_FILLING = 0.8


class SceneSessions:
    """Makes the schemes of a scene: what one cycle shows of its regions at given angles and exposure."""

    def __init__(self, scene: SceneFile, noise: NoiseParameters | None, *, light: SceneLight | None = None) -> None:
        self._scene = scene_of_file(scene, noise)
        scenario = build_scenario(
            self._scene,
            readout=readout_of(self._scene),
            exposure_s=self._scene.exposure_s,
            light=SceneLight() if light is None and scene.has_materials else light,
        )
        self._sensor: Sensor = scenario.sensor
        self._apertures: dict[str, Moments] = {region.name: region.aperture_moments() for region in scenario.regions}
        self._lights: dict[tuple[tuple[float, ...], float], dict[str, CycleLight]] = {}

    @property
    def regions(self) -> tuple[str, ...]:
        """Names of the regions."""
        return tuple(self._apertures)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Assumptions on scene and sensor."""
        return self._scene.remarks

    def scheme(self, session: Session) -> Scheme:
        """Return what a cycle of a session shows of each region.

        Raises
        ------
        ConfigError
            Angles or exposure are outside their range.
        """
        key = (session.angles_rad, session.exposure_s)
        if key not in self._lights:
            with as_config_error(f"scene {self._scene.name}"):
                self._lights[key] = self._seen(session)
        return Scheme(session=session, lights=self._lights[key])

    def filling_exposure_s(self, *, share: float = _FILLING) -> float:
        """Return the exposure at which the brightest region's mean behind any angle is a share of full scale [s]."""
        trial = Session(angles_rad=tuple(equispaced_rad(8)), exposure_s=self._sensor.exposure_s)
        brightest_dn = max(float(light.channels_dn.max()) for light in self.scheme(trial).lights.values())
        full_scale_dn = float(2**self._sensor.bit_depth - 1)
        return share * full_scale_dn / brightest_dn * self._sensor.exposure_s

    def _seen(self, session: Session) -> dict[str, CycleLight]:
        sensor = replace(self._sensor, exposure_s=session.exposure_s)
        ratio = self._scene.sensor.extinction_ratio.value
        return {
            name: cycle_light(aperture, sensor=sensor, angles_rad=session.angles_rad, extinction_ratio=ratio)
            for name, aperture in self._apertures.items()
        }
