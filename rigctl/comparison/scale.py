"""Scale of the counts of a prediction: by the scene file, by a radiometric calibration, or fitted to the run.

`panel_response` measures the counts per radiance for a radiometric calibration, `scale_inputs` uses them.

Some numbers of a scene only say how many counts a radiance makes. A measured scale takes their place: it stands under
the quantum efficiency, with the transmittance at 1, and its errors go together with those of the inputs behind it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.radiometric import FreeScale, PanelScale, fit_free_scale, panel_scale
from model.prediction import RegionPrediction, predict
from model.processing.agreement import input_jacobian
from model.sensor import counts_per_radiance
from rigctl.base.durable import source_of
from rigctl.base.numbers import percent, plus_minus
from rigctl.calibrations.radiometric import SCHEMA_VERSION, RadiometricResponse
from rigctl.calibrations.record import header_of, source_of_run
from rigctl.comparison.predict_run import differences, one_exposure_s, run_readout, scene_of_run
from rigctl.errors import ConfigError, DataError
from rigctl.files.choices import ScaleKind
from rigctl.measure.measure import MeasuredRegion, Measurement
from rigctl.scene.light import SceneLight, build_scenario, sensor_of
from rigctl.scene.scene import EFFICIENCY, GAIN, TRANSMITTANCE, Inputs, Scene, assumed_materials, gather, with_geometry

FloatArray = NDArray[np.float64]

# A scale that is measured holds all of them; the gain is not one, since noise rests on it too.
_THROUGHPUT = (
    EFFICIENCY,
    TRANSMITTANCE,
    "sensor.pixel_pitch_um",
    "sensor.f_number",
    "sensor.wavelength_nm",
    "sensor.polarizer_transmittance",
)


def modelled_response(scene: Scene, *, exposure_s: float) -> float:
    """Return the counts per unit of unpolarized radiance by the sensor of a scene [DN per W m-2 sr-1]."""
    return counts_per_radiance(sensor_of(scene, exposure_s))


def without_throughput(inputs: Inputs, *, gain: bool = False) -> Inputs:
    """Return the inputs with the numbers of the throughput taken as exact, and with `gain` that of the gain too."""
    exact = (*_THROUGHPUT, GAIN) if gain else _THROUGHPUT
    keep = np.array([0.0 if name in exact else 1.0 for name in inputs.names])
    return replace(inputs, cov=inputs.cov * np.outer(keep, keep))


def rescaled(inputs: Inputs, factor: float, *, variance: float, common: FloatArray) -> Inputs:
    """Return the inputs with a factor on the counts per radiance in place of what the scene file says of it.

    Transmittance and quantum efficiency are only known as their product, which stands under the latter's name.
    """
    place = {name: k for k, name in enumerate(inputs.names)}
    efficiency = inputs.values[place[EFFICIENCY]] * inputs.values[place[TRANSMITTANCE]] * factor
    if efficiency > 1.0:
        raise DataError(
            f"the scale of the counts needs {efficiency:.3g} electrons per photon, more than there can be: check gain, "
            "exposure, f-number and pixel pitch of scene file and calibrations, and the radiance of the panel"
        )
    fixed = without_throughput(inputs)
    values, cov = fixed.values.copy(), fixed.cov.copy()
    values[place[TRANSMITTANCE]], values[place[EFFICIENCY]] = 1.0, efficiency
    row = efficiency * common * np.array([0.0 if name in _THROUGHPUT else 1.0 for name in inputs.names])
    cov[place[EFFICIENCY], :] = cov[:, place[EFFICIENCY]] = row
    cov[place[EFFICIENCY], place[EFFICIENCY]] = efficiency**2 * variance
    return replace(fixed, scene=fixed.at(values), values=values, cov=cov, fitted=(EFFICIENCY,))


Predicted = Callable[[FloatArray], Mapping[str, RegionPrediction]]

# A lens that was stopped down since is another one.
_F_NUMBER_STEP = 0.01


@dataclass(frozen=True, kw_only=True)
class Scale:
    """Scale of the counts of a prediction."""

    #: By the optics and efficiency of the scene file; by a radiometric calibration; fitted to the run.
    kind: ScaleKind
    #: Factor on the counts per radiance of the scene file, and its standard error: as far as the file itself knows it
    #: (absolute), of the calibration, or of the fit.
    value: float
    std_error: float
    source: str  #: Where it comes from, in words for a report.

    @property
    def remark(self) -> str:
        """The scale in a line."""
        if self.kind == "absolute":
            return f"Scale of the counts: from the scene file, known to {percent(self.std_error)} ({self.source})"
        return f"Scale of the counts: {plus_minus(self.value, self.std_error)} times the scene file's ({self.source})"


def scale_inputs(
    kind: ScaleKind,
    inputs: Inputs,
    *,
    measurement: Measurement,
    radiometric: RadiometricResponse | None,
    predicted: Predicted,
) -> tuple[Inputs, Scale]:
    """Return the inputs of a prediction with the counts scaled, and the scale.

    A scale acts on the electrons that a radiance makes, so that noise follows. The errors of a fitted scale go together
    with those of the inputs that it makes up for: both are in the covariance that is returned.
    """
    if (kind == "panel") != (radiometric is not None):
        raise ConfigError("--scale panel and --radiometric FILE (rigctl calibrate radiometric) go together")
    if kind == "panel" and radiometric is not None:
        return panel_scaled(inputs, radiometric, exposure_s=one_exposure_s(measurement))
    if kind == "free":
        return _by_run(inputs, measurement, predicted)
    return inputs, _of_file(inputs, one_exposure_s(measurement))


def _of_file(inputs: Inputs, exposure_s: float) -> Scale:
    def logarithm(values: FloatArray) -> FloatArray:
        return np.log([modelled_response(inputs.at(values), exposure_s=exposure_s)])

    slopes = input_jacobian(logarithm, inputs.values, np.sqrt(np.diag(inputs.cov)), least=tuple(inputs.least))[0]
    error = float(np.sqrt(slopes @ inputs.cov @ slopes))
    return Scale(kind="absolute", value=1.0, std_error=error, source="optics and efficiency of the scene file")


def with_panel_scale(inputs: Inputs, *, radiometric: RadiometricResponse) -> Inputs:
    """Return the inputs of a prediction without a run, scaled by a radiometric calibration, which a remark says."""
    scaled, scale = panel_scaled(inputs, radiometric, exposure_s=inputs.scene.exposure_s)
    return replace(scaled, scene=replace(scaled.scene, changed=(*scaled.scene.changed, scale.remark)))


def panel_scaled(inputs: Inputs, radiometric: RadiometricResponse, *, exposure_s: float) -> tuple[Inputs, Scale]:
    """Return the inputs of a prediction with the counts scaled by a radiometric calibration, and the scale."""
    f_number, gain = inputs.scene.sensor.f_number.value, inputs.scene.noise.gain_dn_per_e.value
    response = radiometric.response_dn_per_radiance
    if abs(radiometric.f_number / f_number - 1.0) > _F_NUMBER_STEP:
        raise DataError(
            f"the radiometric calibration was made at f/{radiometric.f_number:g}, the scene file says "
            f"f/{f_number:g}: calibrate at the stop that is used"
        )
    counts = response.value * exposure_s / radiometric.exposure_s
    factor = counts / modelled_response(inputs.scene, exposure_s=exposure_s)
    relative = response.std_error / response.value
    # Counts are what is known: with a larger gain there are fewer electrons.
    common = -inputs.cov[inputs.names.index(GAIN)] / gain
    variance = relative**2 + inputs.cov[inputs.names.index(GAIN), inputs.names.index(GAIN)] / gain**2
    found = rescaled(inputs, factor, variance=variance, common=common)
    return found, Scale(
        kind="panel",
        value=factor,
        std_error=factor * relative,
        source=f"radiometric calibration on {radiometric.panel.name}",
    )


def _by_run(inputs: Inputs, measurement: Measurement, predicted: Predicted) -> tuple[Inputs, Scale]:
    fixed = without_throughput(inputs)
    s0 = {name: region.quantities["s0"]["mean"] for name, region in measurement.regions.items()}

    def modelled(values: FloatArray) -> FloatArray:
        regions = predicted(values)
        return np.array([regions[name].quantities["s0"]["mean"] for name in s0])

    found: FreeScale = fit_free_scale(
        measured=np.array([sample.value for sample in s0.values()]),
        measured_error=np.array([sample.std_error for sample in s0.values()]),
        predicted=modelled(fixed.values),
        jacobian=input_jacobian(modelled, fixed.values, np.sqrt(np.diag(fixed.cov)), least=tuple(fixed.least)),
        input_cov=fixed.cov,
    )
    error = found.value * found.variance**0.5
    plural = "region" if len(s0) == 1 else "regions"
    scale = Scale(kind="free", value=found.value, std_error=error, source=f"fitted to S0 of {len(s0)} {plural}")
    return rescaled(inputs, found.value, variance=found.variance, common=found.common), scale


# A panel of known reflectance under the run's own sun gives the counts per radiance.

# Saturated pixels that are left out make the rest look darker than the panel is.
_MOST_SATURATED = 1e-3


def panel_response(
    measurement: Measurement,
    scene: Scene,
    *,
    panel: str,
    files: Mapping[str, Path] | None = None,
    valid_days: float | None = None,
) -> dict[str, Any]:
    """Return the counts that a radiance makes, by a panel of known reflectance, as radiometric.json holds them.

    `files` are what else it was made from, such as {"scene": path}. The shares of the variance are those of each
    uncertain input alone; where inputs are correlated they do not add up to 1.
    """
    alone = _alone(scene, panel)
    used = scene_of_run(alone, measurement.run, measurement.grid.frames)
    measured = _unsaturated(measurement, panel)
    # Counts are compared with the radiance: what the sensor makes of it is what is sought.
    inputs = without_throughput(gather(used), gain=True)
    light, exposure_s = SceneLight(), one_exposure_s(measurement)

    def at(values: FloatArray) -> FloatArray:
        return _prediction(measurement, inputs.at(values), light)

    *channels, radiance = at(inputs.values)
    jacobian = input_jacobian(at, inputs.values, np.sqrt(np.diag(inputs.cov)), least=tuple(inputs.least))
    cov = jacobian @ inputs.cov @ jacobian.T
    predicted_dn = np.array(channels)
    scale = panel_scale(measured.channels_mean.mean, measured.channels_mean.cov, predicted_dn, cov[:-1, :-1])
    run, grid = measurement.run, measurement.grid
    source = {"run": source_of_run(run)} | {what: source_of(path) for what, path in (files or {}).items()}
    header = header_of(
        "radiometric", SCHEMA_VERSION, source=source, run=run, records=grid.frames, valid_days=valid_days
    )
    unit = modelled_response(inputs.scene, exposure_s=exposure_s)

    def response(ratio: float, error: float, frames: int) -> dict[str, float]:
        return {"value": float(ratio * unit), "std_error": float(error * unit), "n": frames}

    of_channels = zip(grid.channel_names, grid.polarizer_angles_rad, scale.channel, scale.channel_error, strict=True)
    return header | {
        "panel": {
            "name": panel,
            "pixels": measured.pixels,
            "radiance_w_per_m2_sr": {"value": float(radiance), "std_error": float(np.sqrt(cov[-1, -1]))},
        },
        "exposure_s": exposure_s,
        "f_number": inputs.scene.sensor.f_number.value,
        "response": "counts of a pixel and frame per W m-2 sr-1 of unpolarized light in band, dark level off",
        "response_dn_per_radiance": response(scale.common, scale.common_error, grid.cycles * grid.angles),
        "channels": [
            {
                "name": name,
                "polarizer_angle_deg": float(np.degrees(angle)) % 180.0,
                "response_dn_per_radiance": response(ratio, error, grid.cycles),
            }
            for name, angle, ratio, error in of_channels
        ],
        "channels_agree": scale.channels_agree,
        "over_scene_file": {"value": scale.common, "std_error": scale.common_error},
        "variance_shares": _shares(scale, predicted_dn, inputs, jacobian[:-1]),
        "remarks": (
            *assumed_materials(alone.regions),
            *differences(alone, used),
            *light.remarks(inputs.scene),
            *_of_channels(scale),
        ),
    }


def _alone(scene: Scene, panel: str) -> Scene:
    """Return the scene of the panel alone, taken by a rig as it is recorded."""
    named = tuple(region for region in scene.regions if region.name == panel)
    if not named:
        known = ", ".join(region.name for region in scene.regions)
        raise ConfigError(f"--panel: {panel!r} is no region of {scene.name}; there are {known}")
    return with_geometry(replace(scene, regions=named, rig=None), scene.geometry, scene.pointing)


def _unsaturated(measurement: Measurement, panel: str) -> MeasuredRegion:
    if panel in measurement.unmeasured:
        raise DataError(measurement.unmeasured[panel])
    region = measurement.regions[panel]
    share = max(region.excluded / (region.excluded + region.pixels), region.at_ends[1])
    if share > _MOST_SATURATED:
        raise DataError(
            f"{measurement.run.path}: {share:.1%} of the panel's pixels are saturated or missing (allowed are "
            f"{_MOST_SATURATED:.1%}): the other pixels do not give its mean; expose for less, or "
            "draw the region within the panel"
        )
    return region


def _prediction(measurement: Measurement, scene: Scene, light: SceneLight) -> FloatArray:
    """Return the counts of the panel's channels, and S0 of its light at the aperture."""
    scenario = build_scenario(
        scene, readout=run_readout(measurement), exposure_s=one_exposure_s(measurement), light=light
    )
    (prediction,) = predict(scenario).values()
    return np.append(prediction.channels.mean_dn, scenario.regions[0].aperture_moments().mean[0])


def _shares(scale: PanelScale, predicted_dn: FloatArray, inputs: Inputs, jacobian: FloatArray) -> dict[str, float]:
    """Return how much of the common scale's variance each uncertain number makes alone."""
    slopes = scale.common * jacobian.sum(axis=0) / predicted_dn.sum()
    parts = np.square(slopes) * np.diag(inputs.cov) / scale.common_error**2
    found = {name: float(part) for name, part in zip(inputs.names, parts, strict=True) if part > 0.0}
    found["measurement"] = (scale.measurement_error / scale.common_error) ** 2
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def _of_channels(scale: PanelScale) -> tuple[str, ...]:
    if scale.channels_agree:
        return ()
    spread = (scale.channel.max() - scale.channel.min()) / scale.common
    remark = (
        f"channels differ by {spread:.2%}, more than their errors allow (chi-squared {scale.chi2:.3g}): the throughput "
        "depends on the angle, the light drifted, or the panel's polarization is not as predicted; see "
        "rigctl calibrate axis"
    )
    return (remark,)
