"""The rows that an attribution is sought from, and the covariance of their measurement."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from model.processing.agreement import deviations_cov
from rigctl.prediction.propagated_inputs import NumberKey

if TYPE_CHECKING:
    from rigctl.comparison.rows import Row
    from rigctl.measurement.measurement import Measurement

FloatArray = NDArray[np.float64]

_STOKES = ("s0", "s1", "s2")


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """Rows that are not functions of one another.

    Attributes
    ----------
    places : (n,) array
        Positions among the rows of the comparison: mean counts of every channel, their temporal deviations, and the
        spatial deviations of the Stokes parameters. All other rows follow from these.
    cov : (n, n) array
        Covariance of the measurement.
    """

    places: NDArray[np.intp]
    cov: FloatArray


def gather_evidence(rows: Sequence["Row"], measurement: "Measurement") -> Evidence:
    """Return the rows that an attribution is sought from.

    Notes
    -----
    Sample means and deviations of Gaussian pixels are independent. Means of one region share pixels; those of all
    regions share the error of the dark level. Temporal deviations are of frames that are independent; spatial ones of
    Stokes parameters go together as far as their pixels do.
    """
    place = {row.key: k for k, row in enumerate(rows)}
    groups = [
        (names, statistic)
        for region in measurement.regions
        for names, statistic in (
            ([(region, name) for name in measurement.grid.channel_names], "mean"),
            ([(region, name) for name in measurement.grid.channel_names], "std_temporal"),
            ([(region, name) for name in _STOKES], "std_spatial_mean"),
        )
    ]
    wanted = [NumberKey(*name, statistic) for names, statistic in groups for name in names]
    found = [key for key in wanted if key in place]
    position = {key: k for k, key in enumerate(found)}
    cov = np.diag([(rows[place[key]].std_error or 0.0) ** 2 for key in found])
    _fill_means(cov, position, measurement)
    _fill_deviations(cov, position, measurement)
    return Evidence(places=np.array([place[key] for key in found], dtype=np.intp), cov=cov)


def _fill_means(cov: FloatArray, position: dict[NumberKey, int], measurement: "Measurement") -> None:
    names = measurement.grid.channel_names
    level = measurement.dark_level.std_error_dn * measurement.grid.to_unit
    at = {
        region: [position[NumberKey(region, name, "mean")] for name in names]
        for region in measurement.regions
        if NumberKey(region, names[0], "mean") in position
    }
    for one, here in at.items():
        for other, there in at.items():
            cov[np.ix_(here, there)] = (
                measurement.regions[one].channels_mean.cov if one == other else np.outer(level, level)
            )


def _fill_deviations(cov: FloatArray, position: dict[NumberKey, int], measurement: "Measurement") -> None:
    for name, region in measurement.regions.items():
        keys = [NumberKey(name, quantity, "std_spatial_mean") for quantity in _STOKES]
        if any(key not in position for key in keys):
            continue
        here = [position[key] for key in keys]
        errors = np.sqrt(np.diag(cov))[here]
        # Without any spread of some parameter there is no correlation to speak of.
        if np.all(np.ptp(region.stokes_pixels_mean, axis=1) > 0.0):
            cov[np.ix_(here, here)] = deviations_cov(errors, np.corrcoef(region.stokes_pixels_mean))
