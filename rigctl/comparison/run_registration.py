"""How far the pictures of a run lie from one another, and what that does to the means of its regions."""

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.polarimeter.registration import Registration, register
from model.prediction.uncertainty_budget import budget, shift_cause
from rigctl.comparison.uncertainty_budget import RegionBudget
from rigctl.files.regions import Region, inner_masks, masks
from rigctl.measurement.measurement import Measurement


def registration_of(measurement: Measurement) -> Registration | str:
    """Return the shifts of a run's pictures against the first, or why they cannot be told."""
    try:
        return register(measurement.channels)
    except CalibrationError as error:
        return str(error)


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
    inside = inner_masks(regions, masks(regions, width=measurement.grid.width, height=measurement.grid.height))
    sizes = np.hypot(found.shift_pixels, found.std_error_pixels)
    return tuple(_with(one, measurement, inside[one.region], sizes, means[one.region]) for one in budgets)


def _with(
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
