"""Prediction for a rig that is not quite as recorded: axes turned, exposure off."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model.prediction.prediction import RegionPrediction, as_processed, predict_region
from model.processing.reconstruction import design
from model.scene.scenario import RegionLight, Scenario
from model.sensor.channels import ChannelMoments, channel_moments

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class RigErrors:
    """Errors of a rig against what was recorded of it.

    Parameters
    ----------
    turned_rad
        True angle of the polarizer's axis less the recorded one, by frame of a cycle, shape (N,) [rad].
    exposure_ratio
        True exposure over the recorded one, > 0.
    """

    turned_rad: FloatArray
    exposure_ratio: float


def predict_with_errors(
    scenario: Scenario, errors: RigErrors, *, tolerance: float = 1e-6
) -> dict[str, RegionPrediction]:
    """Return what the model predicts where the light goes through the true rig and the processing takes the recorded.

    Parameters
    ----------
    scenario
        With the recorded angles and exposure.
    errors
        Of the rig.
    tolerance
        Relative tolerance of mean and deviation of the pixels' DoLP.

    Raises
    ------
    ValueError
        Errors do not fit the angles, or leave no light.

    Notes
    -----
    Without errors it is `model.prediction.prediction.predict`; what the session adds acts as there. The frames of
    every cycle have the same errors.

    References
    ----------
    [MK14] eq. (11)-(29).
    """
    angles_rad = scenario.readout.angles_rad
    if errors.turned_rad.shape != angles_rad.shape:
        raise ValueError(
            f"turned_rad {errors.turned_rad.shape} does not fit {angles_rad.size} angles; allowed is one for each"
        )
    if not errors.exposure_ratio > 0.0:
        raise ValueError(f"exposure_ratio = {errors.exposure_ratio}; it has to be above 0")
    plan = design(angles_rad, scenario.readout.extinction_ratio)
    return {
        region.name: predict_region(
            _channels(region, scenario, errors),
            plan=plan,
            channel_names=scenario.readout.channel_names,
            cycles=scenario.readout.cycles,
            tolerance=tolerance,
        )
        for region in scenario.regions
    }


def _channels(region: RegionLight, scenario: Scenario, errors: RigErrors) -> ChannelMoments:
    sensor = replace(scenario.sensor, exposure_s=scenario.sensor.exposure_s * errors.exposure_ratio)
    angles_rad = scenario.readout.angles_rad + errors.turned_rad
    seen = channel_moments(
        region.aperture_moments(),
        angles_rad=angles_rad,
        sensor=sensor,
        flat_fielded=scenario.readout.flat_error is not None,
        imperfections=scenario.imperfections,
        smooth_cov=region.smooth_cov(),
    )
    return as_processed(seen, scenario.readout)
