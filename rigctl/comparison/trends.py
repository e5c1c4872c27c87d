"""Trends: the order of numbers over angles, regions or runs by the model and by the frames, whatever their scale."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.processing.agreement import RankCorrelation, rank_correlation
from model.quantities import ORDERED
from rigctl.comparison.rows import Row
from rigctl.measurement.measurement import Measurement

FloatArray = NDArray[np.float64]

_LEAST_NUMBERS = 3


@dataclass(frozen=True, kw_only=True)
class Trend:
    """One row of numbers in order, by the model and by the frames.

    Attributes
    ----------
    quantity : str
        Of what, such as "dolp".
    over : str
        Along what: "angles of black_panel", "regions", "runs of asphalt".
    order : RankCorrelation
        Kendall's tau, pairs that are known in spite of their errors, and the chance of so good an order.
    """

    quantity: str
    over: str
    order: RankCorrelation

    @property
    def predicted(self) -> bool | None:
        """Whether every pair whose order is known is in the predicted order; None where none is known."""
        share = self.order.share_concordant
        return None if share is None else share == 1.0


def trends_of(rows: Sequence[Row], cov: FloatArray | None, measurement: Measurement) -> tuple[Trend, ...]:
    """Return the trends within one run: of counts over angles, and of each scale-free quantity over regions.

    Parameters
    ----------
    rows : sequence of Row
        Of the comparison.
    cov : (m, m) array or None
        Covariance of their predictions.
    measurement : Measurement
        The run.
    """
    predicted_cov = np.zeros((len(rows), len(rows))) if cov is None else cov
    return (*_over_angles(rows, predicted_cov, measurement), *_over_regions(rows, predicted_cov))


def trend(rows: Sequence[Row], *, over: str, predicted_cov: FloatArray, measured_cov: FloatArray) -> Trend:
    """Return the trend of one quantity along rows."""
    order = rank_correlation(
        [row.predicted for row in rows],
        [row.measured for row in rows],
        predicted_cov=predicted_cov,
        measured_cov=measured_cov,
    )
    return Trend(quantity=rows[0].quantity, over=over, order=order)


def _over_angles(rows: Sequence[Row], cov: FloatArray, measurement: Measurement) -> Iterable[Trend]:
    for name, region in measurement.regions.items():
        places = [
            k
            for k, row in enumerate(rows)
            if row.region == name and row.statistic == "mean" and row.quantity in measurement.grid.channel_names
        ]
        if len(places) == measurement.grid.angles >= _LEAST_NUMBERS:
            found = trend(
                [rows[k] for k in places],
                over=f"angles of {name}",
                predicted_cov=cov[np.ix_(places, places)],
                measured_cov=region.channels_mean.cov,
            )
            yield Trend(quantity="counts", over=found.over, order=found.order)


def _over_regions(rows: Sequence[Row], cov: FloatArray) -> Iterable[Trend]:
    for quantity in ORDERED:
        places = [k for k, row in enumerate(rows) if (row.quantity, row.statistic) == (quantity, "mean")]
        if len(places) >= _LEAST_NUMBERS:
            chosen = [rows[k] for k in places]
            yield trend(
                chosen,
                over="regions",
                predicted_cov=cov[np.ix_(places, places)],
                measured_cov=np.diag([(row.std_error or 0.0) ** 2 for row in chosen]),
            )
