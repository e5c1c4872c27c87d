"""The numbers of a scene file and a noise calibration, with their uncertainties, and the scenario that they make."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.accuracy.evaluation.chain import scenario_of
from model.scene.field_light import Source
from model.scene.scenario import Readout, Scenario
from model.sensor.sensor import Sensor, SensorNoise
from rigctl.calibrations.noise.noise_file import NoiseParameters
from rigctl.errors import ConfigError
from rigctl.files.scene_file import NoiseSection, SceneFile
from rigctl.scene.effect_choice import acting_effects, choice_remarks
from rigctl.scene.lit_scene import file_settings, lit_scene
from rigctl.scene.scene_light import SceneLight
from rigctl.scene.scene_numbers import (
    SUN_AZIMUTH,
    SUN_ZENITH,
    Stated,
    assumed_materials,
    error_numbers,
    light_numbers,
    region_numbers,
    sensor_numbers,
    sun_covariance_deg2,
)

FloatArray = NDArray[np.float64]

NOISE_NAMES = tuple(NoiseSection.model_fields)
# Of these there may be less than nothing in an estimate, and never in a sensor.
_NOT_NEGATIVE = frozenset({"read_noise_e", "dark_current_e_per_s", "prnu", "dsnu_e"})
# A choice of the user's, not a property of a sensor: no calibration gives it.
_CHOSEN = frozenset({"noise.noise_factor"})


@dataclass(frozen=True, kw_only=True, eq=False)
class Inputs:
    """Every number that a prediction rests on.

    Attributes
    ----------
    names : tuple of str
        As in the file, such as "regions.black_panel.stokes_radiance.0".
    values : (k,) array
        In the units of the file.
    cov : (k, k) array
        Their covariance.
    least : (k,) array
        Smallest value that each may take.
    remarks : tuple of str
        What is assumed, and what was set aside, in words.
    """

    names: tuple[str, ...]
    values: FloatArray
    cov: FloatArray
    least: FloatArray
    remarks: tuple[str, ...]

    @property
    def named(self) -> dict[str, float]:
        """The values by their names."""
        return dict(zip(self.names, self.values.tolist(), strict=True))


def gather(scene: SceneFile, noise: NoiseParameters | None) -> Inputs:
    """Return the numbers of a scene file; those of a noise calibration take the place of the assumed noise.

    Parameters
    ----------
    scene : SceneFile
        The scene.
    noise : NoiseParameters or None
        A noise calibration.

    Raises
    ------
    ConfigError
        A material is not found, or does not cover the sensor's wavelength.
    """
    stated = _stated(scene)
    remarks: list[str] = []
    values = {name: number.value for name, number in stated.items()}
    deviations = {name: number.std for name, number in stated.items()}
    calibrated: dict[str, float] = {}
    if noise is not None:
        known = {f"noise.{name}": noise.known[name] for name in NOISE_NAMES if name in noise.known}
        calibrated = {name: one.value for name, one in known.items()}
        deviations |= {name: one.std_error for name, one in known.items()}
    values |= {name: _physical(name, value, remarks) for name, value in calibrated.items()}
    assumed = [name for name in values if name.startswith("noise.") and name not in _CHOSEN.union(calibrated)]
    if assumed:
        remarks.append("assumed, not calibrated: " + ", ".join(f"{n} = {values[n]:g}" for n in assumed))
    names = tuple(values)
    return Inputs(
        names=names,
        values=np.array([values[name] for name in names]),
        cov=_with_site(_covariance(names, deviations, noise), names, scene),
        least=np.array([stated[name].least for name in names]),
        remarks=(*remarks, *assumed_materials(scene), *choice_remarks(scene)),
    )


def build_scenario(
    scene: SceneFile,
    values: Mapping[str, float],
    *,
    readout: Readout,
    exposure_s: float,
    light: SceneLight | None = None,
    source: Source = "total",
) -> Scenario:
    """Return the scenario of a scene file with the given numbers in place of the file's.

    Parameters
    ----------
    scene : SceneFile
        Which regions there are.
    values : mapping
        Every name that `gather` returns, to its number in the units of the file.
    readout : Readout
        Angles and cycles, of a run or of the file.
    exposure_s : float
        Exposure of a frame [s].
    light : SceneLight or None
        Computes the light of materials; whoever asks more than once gives the same one.
    source : str
        Which light of the regions that are given by a material.

    Raises
    ------
    ConfigError
        The light of a material cannot be computed.
    """
    sensor = build_sensor(scene, values, exposure_s)
    lit = lit_scene(scene, values, sensor=sensor, readout=readout, source=source)
    effects = acting_effects(scene)
    if not scene.has_materials:
        return scenario_of(lit, file_settings(scene), effects=effects)
    computer = SceneLight() if light is None else light
    try:
        return scenario_of(lit, file_settings(scene), effects=effects, store=computer.lights)
    except ValueError as error:
        raise ConfigError(f"scene {scene.name}: {error}") from error


def file_readout(scene: SceneFile) -> Readout:
    """Return angles and cycles as the scene file states them, for a prediction without a run."""
    angles_deg = sorted(angle % 180.0 for angle in scene.acquisition.angles_deg)
    return Readout(
        angles_rad=np.deg2rad(angles_deg),
        channel_names=tuple(f"dn_{angle:g}" for angle in angles_deg),
        cycles=scene.acquisition.cycles,
        extinction_ratio=scene.sensor.extinction_ratio.value,
    )


def _stated(scene: SceneFile) -> dict[str, Stated]:
    found = sensor_numbers(scene)
    for name in NOISE_NAMES:
        found[f"noise.{name}"] = Stated.of(getattr(scene.noise, name))
    found |= light_numbers(scene) | error_numbers(scene)
    wavelength_m = found["sensor.wavelength_nm"].value * 1e-9
    for region in scene.regions:
        found |= region_numbers(region, wavelength_m=wavelength_m)
    return found


def _physical(name: str, value: float, remarks: list[str]) -> float:
    if value >= 0.0 or name.removeprefix("noise.") not in _NOT_NEGATIVE:
        return value
    remarks.append(f"{name}: the calibration's estimate {value:.3g} is below 0 by its error; 0 is used")
    return 0.0


def _covariance(names: tuple[str, ...], deviations: Mapping[str, float], noise: NoiseParameters | None) -> FloatArray:
    cov = np.diag([deviations[name] ** 2 for name in names])
    if noise is None:
        return cov
    known = [name for name in NOISE_NAMES if name in noise.known]
    places = [names.index(f"noise.{name}") for name in known]
    cov[np.ix_(places, places)] = noise.covariance_of(known)
    return cov


def _with_site(cov: FloatArray, names: tuple[str, ...], scene: SceneFile) -> FloatArray:
    """Return the covariance with that of the sun's angles, which one place moves together."""
    if scene.sun is None or scene.sun.time is None or scene.site is None or not scene.site.std:
        return cov
    both = [names.index(SUN_ZENITH), names.index(SUN_AZIMUTH)]
    cov[np.ix_(both, both)] = sun_covariance_deg2(scene.site, scene.sun.time)
    return cov


def build_sensor(scene: SceneFile, values: Mapping[str, float], exposure_s: float) -> Sensor:
    """Return the sensor of a scene file with the given numbers, by the names that `gather` returns."""
    along = values["sensor.polarizer_transmittance"]
    return Sensor(
        pixel_pitch_m=values["sensor.pixel_pitch_um"] * 1e-6,
        f_number=values["sensor.f_number"],
        optics_transmittance=values["sensor.optics_transmittance"],
        quantum_efficiency=values["sensor.quantum_efficiency"],
        wavelength_m=values["sensor.wavelength_nm"] * 1e-9,
        exposure_s=exposure_s,
        bit_depth=scene.sensor.bit_depth,
        tau_parallel=along,
        tau_perpendicular=along / values["sensor.extinction_ratio"],
        noise=SensorNoise(
            gain_dn_per_e=values["noise.gain_dn_per_e"],
            read_noise_e=values["noise.read_noise_e"],
            dark_current_e_per_s=values["noise.dark_current_e_per_s"],
            black_level_dn=values["noise.black_level_dn"],
            prnu=values["noise.prnu"],
            dsnu_e=values["noise.dsnu_e"],
            noise_factor=values["noise.noise_factor"],
        ),
    )
