"""The uncertainty budget of a comparison: how much each cause makes of the error of a region's polarization."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.polarimeter.pictures import Registration
from model.prediction import RegionPrediction, budget, noise_causes, shift_cause
from model.processing.agreement import Propagation
from model.processing.mosaic import reach_px
from model.sensor import ChannelMoments
from rigctl.comparison.rows import Row
from rigctl.files.regions import Region, inner_masks, masks
from rigctl.measurement.measurement import Measurement
from rigctl.measurement.region_numbers import MeasuredRegion
from rigctl.measurement.run_diagnosis import RunDiagnosis
from rigctl.prediction.propagated_inputs import NumberKey
from rigctl.scene.parameter_table import ANGLE, DRIFT, OFFSET
from rigctl.scene.scene_inputs import Inputs

FloatArray = NDArray[np.float64]


# Name of the cause: what the faults that a run shows of itself could do, all of them together.
FAULTS = "faults of the run"


@dataclass(frozen=True, kw_only=True)
class RegionBudget:
    """Standard uncertainties of one region's polarization.

    Attributes
    ----------
    region : str
        Its name.
    parts : mapping
        Quantity ("s0" relative, "s1n", "s2n", "dolp", "aolp_deg") to cause to standard uncertainty.
    """

    region: str
    parts: dict[str, dict[str, float]]


def scene_budget(
    predictions: Mapping[str, RegionPrediction],
    measurement: Measurement,
    *,
    inputs: Inputs,
    rows: tuple[Row, ...],
    propagation: Propagation,
    uncertain: Inputs,
) -> tuple[RegionBudget, ...]:
    """Return the budget of every region of a comparison with a scene.

    Parameters
    ----------
    predictions, measurement
        Both sides.
    inputs : Inputs
        All of them.
    rows, propagation, uncertain
        What the uncertain inputs do to the mean counts.
    """
    found = []
    for name, prediction in predictions.items():
        if name not in measurement.regions:
            continue
        region = measurement.regions[name]
        causes = noise_causes(
            prediction.channels,
            gain_dn_per_e=inputs.scene.noise.gain_dn_per_e.value,
            noise_factor=inputs.scene.noise.noise_factor.value,
            pixels=region.independent_pixels,
            cycles=measurement.grid.cycles,
        )
        causes["dark level"] = _dark_level(measurement)
        causes |= _repeats(region)
        causes |= _inputs(name, rows, propagation, uncertain, measurement.grid.channel_names)
        found.append(_region(name, prediction.channels, causes, measurement))
    return tuple(found)


def run_budget(
    predictions: Mapping[str, RegionPrediction], measurement: Measurement, *, gain_dn_per_e: float | None
) -> tuple[RegionBudget, ...]:
    """Return the budget of every region of a comparison with the run's own moments.

    Without a calibration noise and texture cannot be told apart and stand as one.
    """
    found = []
    for name, prediction in predictions.items():
        region = measurement.regions[name]
        causes = _run_causes(prediction.channels, region, measurement, gain_dn_per_e) | _repeats(region)
        found.append(_region(name, prediction.channels, causes | {"dark level": _dark_level(measurement)}, measurement))
    return tuple(found)


def with_registration(
    budgets: tuple[RegionBudget, ...],
    measurement: Measurement,
    *,
    regions: list[Region],
    found: Registration | str,
    means: dict[str, NDArray[np.float64]],
) -> tuple[RegionBudget, ...]:
    """Return budgets with what misregistration does to each region; as they are where that cannot be told.

    Frames that were moved by a registration that was given are taken as registered.
    """
    if isinstance(found, str) or measurement.shifts is not None:
        return budgets
    outer = masks(regions, width=measurement.grid.width, height=measurement.grid.height)
    inside = inner_masks(regions, outer, least_px=reach_px(measurement.run.session.interpolation))
    sizes = np.hypot(found.shift_pixels, found.std_error_pixels)
    return tuple(_registered(one, measurement, inside[one.region], sizes, means[one.region]) for one in budgets)


def _run_causes(
    channels: ChannelMoments, region: MeasuredRegion, measurement: Measurement, gain_dn_per_e: float | None
) -> dict[str, FloatArray]:
    if gain_dn_per_e is None or not measurement.grid.is_one_exposure:
        return {"noise and texture": region.scatter_cov}
    causes = noise_causes(
        channels,
        gain_dn_per_e=gain_dn_per_e,
        noise_factor=1.0,
        pixels=region.independent_pixels,
        cycles=measurement.grid.cycles,
    )
    pattern = causes.pop("fixed pattern")
    texture = causes.pop("texture")
    return causes | {"texture and fixed pattern": pattern + texture}


def _region(
    name: str, channels: ChannelMoments, causes: Mapping[str, FloatArray], measurement: Measurement
) -> RegionBudget:
    if not (measurement.plan.inverse @ channels.mean_dn)[0] > 0.0:
        return RegionBudget(region=name, parts={})
    return RegionBudget(region=name, parts=budget(channels.mean_dn, causes, plan=measurement.plan))


def _repeats(region: MeasuredRegion) -> dict[str, FloatArray]:
    """Return the cause of what the rig does not repeat; none where nothing was repeated."""
    cov = region.repeatability.cov(region.channels_mean.mean)
    return {"repeatability": cov} if np.any(cov) else {}


def _dark_level(measurement: Measurement) -> FloatArray:
    level = measurement.dark_level.std_error_dn * measurement.grid.to_unit
    return np.outer(level, level)


def _inputs(
    region: str, rows: tuple[Row, ...], propagation: Propagation, uncertain: Inputs, channels: tuple[str, ...]
) -> dict[str, FloatArray]:
    """Return what the inputs do to the mean counts of a region: angle, drift of the light, and all others."""
    place = {row.key: k for k, row in enumerate(rows)}
    effects = propagation.effects[[place[NumberKey(region, channel, "mean")] for channel in channels]]
    std = np.sqrt(np.diag(uncertain.cov))
    correlation = uncertain.cov / np.outer(std, std)
    found = {}
    kinds = [_kind(name) for name in uncertain.names]
    for kind in dict.fromkeys(kinds):
        chosen = np.array([k == kind for k in kinds])
        own = effects[:, chosen]
        found[kind] = np.asarray(own @ correlation[np.ix_(chosen, chosen)] @ own.T)
    return found


def _kind(name: str) -> str:
    if name.startswith((OFFSET, ANGLE)):
        return "angle"
    if name == DRIFT:
        return "drift"
    return "inputs"


def _registered(
    found: RegionBudget,
    measurement: Measurement,
    inside: NDArray[np.bool_],
    sizes: NDArray[np.float64],
    mean_dn: NDArray[np.float64],
) -> RegionBudget:
    if not found.parts:
        return found
    causes = {"registration": shift_cause(measurement.channels, inside, shift_pixels=sizes)}
    own = budget(mean_dn, causes, plan=measurement.plan)
    return RegionBudget(
        region=found.region, parts={quantity: parts | own[quantity] for quantity, parts in found.parts.items()}
    )


def with_diagnosis(
    budgets: tuple[RegionBudget, ...], diagnosis: RunDiagnosis, measurement: Measurement
) -> tuple[RegionBudget, ...]:
    """Return budgets with what each fault that the run shows could do to the polarization of a region."""
    return tuple(_with_faults(found, diagnosis, measurement) for found in budgets)


def _with_faults(found: RegionBudget, diagnosis: RunDiagnosis, measurement: Measurement) -> RegionBudget:
    if not found.parts or found.region not in measurement.regions:
        return found
    parts = {quantity: dict(causes) for quantity, causes in found.parts.items()}
    moved = [term.by_region.get(found.region, (None, None)) for term in diagnosis.named]
    for place, quantity in enumerate(("dolp", "aolp_deg")):
        if moved and quantity in parts:
            parts[quantity][FAULTS] = float(np.linalg.norm([shifts[place] or 0.0 for shifts in moved]))
    return RegionBudget(region=found.region, parts=parts)
