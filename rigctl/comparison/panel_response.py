"""Counts per radiance from a run: a panel of known reflectance under the run's own sun."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.radiometric import PanelScale, panel_scale
from model.prediction import predict
from model.processing.agreement import input_jacobian
from rigctl.calibrations.radiometric import SCHEMA_VERSION
from rigctl.calibrations.record import header_of, source_of, source_of_run
from rigctl.comparison.predict_run import differences, one_exposure_s, run_readout, scene_of_run
from rigctl.comparison.scale import modelled_response, without_throughput
from rigctl.console import Json
from rigctl.errors import ConfigError, DataError
from rigctl.measure.measure import MeasuredRegion, Measurement
from rigctl.scene.light import SceneLight, build_scenario
from rigctl.scene.scene import Inputs, Scene, assumed_materials, gather, with_geometry

FloatArray = NDArray[np.float64]

# Saturated pixels that are left out make the rest look darker than the panel is.
_MOST_SATURATED = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class PanelResponse:
    """The counts that a radiance makes, by a panel."""

    panel: str  #: Its region.
    exposure_s: float  #: Of each frame [s].
    f_number: float  #: As the scene file has it.
    channel_names: tuple[str, ...]  #: Of the N polarizer angles.
    polarizer_angles_rad: FloatArray  #: Those [rad].
    #: Counts per unit of unpolarized radiance as the scene file's sensor has it [DN per W m-2 sr-1].
    modelled_dn_per_radiance: float
    scale: PanelScale  #: Measured over that, by channel and for all.
    radiance: float  #: S0 of the panel at the aperture as it was predicted, and its standard error [W m-2 sr-1].
    radiance_error: float
    #: Uncertain input to the share of the variance of the common scale that comes from it alone; "measurement" is one
    #: of them. Where inputs are correlated they do not add up to 1.
    shares: dict[str, float]
    pixels: int  #: Of the panel.
    remarks: tuple[str, ...]  #: What was assumed, overruled or found on the way.


def panel_response(measurement: Measurement, scene: Scene, *, panel: str) -> PanelResponse:
    """Return the counts that a radiance makes, by a panel of known reflectance."""
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
    return PanelResponse(
        panel=panel,
        exposure_s=exposure_s,
        f_number=inputs.scene.sensor.f_number.value,
        channel_names=measurement.grid.channel_names,
        polarizer_angles_rad=measurement.grid.polarizer_angles_rad,
        modelled_dn_per_radiance=modelled_response(inputs.scene, exposure_s=exposure_s),
        scale=scale,
        radiance=float(radiance),
        radiance_error=float(np.sqrt(cov[-1, -1])),
        shares=_shares(scale, predicted_dn, inputs, jacobian[:-1]),
        pixels=measured.pixels,
        remarks=(
            *assumed_materials(alone.regions),
            *differences(alone, used),
            *light.remarks(inputs.scene),
            *_of_channels(scale),
        ),
    )


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
            f"{_MOST_SATURATED:.1%}): what is left is not its mean; expose shorter, or draw the region within the panel"
        )
    return region


def radiometric_content(
    found: PanelResponse, measurement: Measurement, *, files: Mapping[str, Path], valid_days: float | None = None
) -> dict[str, Json]:
    """Return the content of radiometric.json; files are what else it was made from, such as {"scene": path}."""
    run, records = measurement.run, [record for cycle in measurement.grid.records for record in cycle]
    source = {"run": source_of_run(run)} | {what: source_of(path) for what, path in files.items()}
    header = header_of("radiometric", SCHEMA_VERSION, source=source, run=run, records=records, valid_days=valid_days)
    scale, unit, cycles = found.scale, found.modelled_dn_per_radiance, measurement.grid.cycles

    def response(ratio: float, error: float, frames: int) -> dict[str, Json]:
        return {"value": ratio * unit, "std_error": error * unit, "n": frames}

    channels: list[Json] = [
        {
            "name": name,
            "polarizer_angle_deg": float(np.degrees(angle)) % 180.0,
            "response_dn_per_radiance": response(ratio, error, cycles),
        }
        for name, angle, ratio, error in zip(
            found.channel_names,
            found.polarizer_angles_rad.tolist(),
            scale.channel.tolist(),
            scale.channel_error.tolist(),
            strict=True,
        )
    ]
    return header | {
        "panel": {
            "name": found.panel,
            "pixels": found.pixels,
            "radiance_w_per_m2_sr": {"value": found.radiance, "std_error": found.radiance_error},
        },
        "exposure_s": found.exposure_s,
        "f_number": found.f_number,
        "response": "counts of a pixel and frame per W m-2 sr-1 of unpolarized light in band, dark level off",
        "response_dn_per_radiance": response(scale.common, scale.common_error, cycles * measurement.grid.angles),
        "channels": channels,
        "channels_agree": scale.channels_agree,
        "over_scene_file": {"value": scale.common, "std_error": scale.common_error},
        "variance_shares": found.shares,
        "remarks": found.remarks,
    }


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
