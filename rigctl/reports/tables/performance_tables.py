"""Tables of what predictions are worth: the law of each region's DoLP, and detection of each region on every other."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from model.prediction.prediction import RegionPrediction
from model.prediction.region_performance import PairDetection, PolarizationStrength
from rigctl.prediction.performance import STATED_RATES, Performance
from rigctl.reports.table import NOTHING, Column, Table

# Probabilities at which the law of DoLP is stated.
_QUANTILES = ("DoLP 2.5 %", "median", "97.5 %")


@dataclass(frozen=True, kw_only=True)
class _Strength:
    region: str
    prediction: RegionPrediction
    found: PolarizationStrength | None


def strength_table(predictions: Mapping[str, RegionPrediction], performance: Performance) -> Table[_Strength]:
    """Return the law of each region's DoLP in a few numbers."""
    columns: tuple[Column[_Strength], ...] = (
        Column(title="region", text=lambda row: row.region, left=True),
        *(Column(title=title, text=partial(_quantile, k=k)) for k, title in enumerate(_QUANTILES)),
        Column(title="NEDoLP", text=lambda row: NOTHING if row.found is None else f"{row.found.nedolp:.4f}"),
        Column(title="moments by", text=lambda row: row.prediction.dolp_method, left=True),
        Column(title="error", text=lambda row: f"{row.prediction.dolp_error:.1e}"),
    )
    rows = tuple(
        _Strength(region=name, prediction=prediction, found=performance.strengths[name])
        for name, prediction in predictions.items()
    )
    return Table(columns=columns, rows=rows)


def detection_table(performance: Performance) -> Table[PairDetection]:
    """Return the probability of detection of every pair of regions."""
    columns: tuple[Column[PairDetection], ...] = (
        Column(title="target", text=lambda pair: pair.target, left=True),
        Column(title="background", text=lambda pair: pair.background, left=True),
        *(Column(title=f"{rate:g}", text=partial(_detected, k=k)) for k, rate in enumerate(STATED_RATES)),
        Column(title="area under ROC", text=lambda pair: _probability(pair.auc)),
    )
    return Table(columns=columns, rows=tuple(performance.detections))


def _quantile(row: _Strength, k: int) -> str:
    return NOTHING if row.found is None else f"{row.found.quantiles[k]:.4f}"


def _detected(pair: PairDetection, k: int) -> str:
    return _probability(pair.p_detection[k])


def _probability(found: float) -> str:
    return NOTHING if np.isnan(found) else f"{found:.4f}"
