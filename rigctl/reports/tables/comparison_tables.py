"""The tables of a comparison's report: rows, explanation, trends, checks, law of DoLP, detection."""

from collections.abc import Iterable, Sequence

import numpy as np

from model.prediction.performance import PolarizationStrength
from model.prediction.prediction import RegionPrediction
from rigctl.comparison.checks import Check
from rigctl.comparison.comparison import Comparison
from rigctl.comparison.explanation import Explanation, InputMove
from rigctl.comparison.performance import STATED_RATES, Performance
from rigctl.comparison.rows import Row
from rigctl.comparison.trends import Trend
from rigctl.comparison.uncertainty_budget import RegionBudget
from rigctl.measurement.measurement import Measurement
from rigctl.reports.number_text import signed, to_digits
from rigctl.reports.report import NOTHING, Table

_SUMMARY = (("dolp", "mean"), ("aolp_deg", "mean"), ("dolp_snr", "mean"))
_VERDICTS = {True: "agrees", False: "DISAGREES", None: "no test"}
# More names than this say no more than that an input is hardly seen.
_NAMED = 4
# No number of a report is known so well.
_ROUNDING = 1e-12
_SHOWN_MOVES = 12


def row_table(rows: Sequence[Row], *, with_region: bool = False) -> Table:
    """Return rows with both errors, both scores and the verdict."""
    return Table(
        header=(
            "quantity",
            "statistic",
            "predicted",
            "measured",
            "error, measured",
            "error, inputs",
            "z, measured",
            "z, both",
            "verdict",
        ),
        rows=tuple(_row(row, with_region=with_region) for row in rows),
        off=tuple(row.agrees is False for row in rows),
        left=(0, 1, 8),
    )


def summary_table(comparison: Comparison, measurement: Measurement) -> Table:
    """Return a line a region: DoLP, AoLP and SNR of DoLP on both sides, and how many numbers disagree."""
    lines, off = [], []
    for name, region in measurement.regions.items():
        rows = [row for row in comparison.rows if row.region == name]
        cells: list[str] = []
        for quantity, statistic in _SUMMARY:
            row = next((r for r in rows if (r.quantity, r.statistic) == (quantity, statistic)), None)
            cells += [NOTHING, NOTHING] if row is None else [_predicted(row), _measured(row)]
        wrong, tests = sum(row.agrees is False for row in rows), sum(row.agrees is not None for row in rows)
        lines.append((name, str(region.pixels), *cells, f"{wrong} of {tests}"))
        off.append(wrong > 0)
    header = (
        "region",
        "pixels",
        "DoLP predicted",
        "measured",
        "AoLP predicted [deg]",
        "measured [deg]",
        "DoLP SNR predicted",
        "measured",
        "disagree",
    )
    return Table(header=header, rows=tuple(lines), off=tuple(off))


def move_table(explanation: Explanation) -> Table:
    """Return the inputs as explanations, the likeliest first."""
    return Table(
        header=(
            "input",
            "stated",
            "would move by [its std]",
            "to",
            "score",
            "chance of the rest",
            "seen by the data",
            "cannot be told from",
        ),
        rows=tuple(_move(move) for move in explanation.moves[:_SHOWN_MOVES]),
        left=(0, 7),
        wide=7,
    )


def fitted_table(explanation: Explanation) -> Table:
    """Return all inputs after the joint update."""
    return Table(
        header=("input", "fitted value", "its std", "moved by [stated std]"),
        rows=tuple(
            (f.name, to_digits(f.value, f.std), f"{f.std:.2g}", f"{f.moved_std:+.2f}") for f in explanation.fitted
        ),
    )


def trend_table(trends: Sequence[Trend]) -> Table:
    """Return whether the order of numbers is as predicted."""
    return Table(
        header=("quantity", "over", "numbers", "pairs known", "in order", "Kendall's tau", "chance", "trend"),
        rows=tuple(
            (
                found.quantity,
                found.over,
                str(found.order.numbers),
                f"{found.order.known_pairs} of {found.order.pairs}",
                str(found.order.concordant),
                f"{found.order.tau:+.2f}",
                f"{found.order.p_value:.2g}",
                {True: "predicted", False: "NOT predicted", None: "not known"}[found.predicted],
            )
            for found in trends
        ),
        off=tuple(found.predicted is False for found in trends),
        left=(0, 1, 7),
    )


def check_table(checks: Sequence[Check]) -> Table:
    """Return what the run says of itself."""
    return Table(
        header=("check", "verdict", "found"),
        rows=tuple((check.name, check.verdict, check.text) for check in checks),
        off=tuple(check.verdict in ("flagged", "refused") for check in checks),
        left=(0, 1, 2),
        wide=2,
    )


def budget_table(budgets: Sequence[RegionBudget], quantity: str) -> Table:
    """Return the standard uncertainty of a quantity by region and cause."""
    causes = list(dict.fromkeys(cause for found in budgets for cause in found.parts.get(quantity, {})))
    return Table(
        header=("region", *causes, "all"),
        rows=tuple(
            (found.region, *(_share(found.parts[quantity].get(cause, 0.0)) for cause in causes), _all(found, quantity))
            for found in budgets
            if quantity in found.parts
        ),
    )


def strength_table(comparison: Comparison, performance: Performance) -> Table:
    """Return the law of each region's DoLP in a few numbers."""
    return Table(
        header=("region", "DoLP 2.5 %", "median", "97.5 %", "NEDoLP", "moments by", "error"),
        rows=tuple(
            _strength(name, prediction, performance.strengths[name])
            for name, prediction in comparison.predictions.items()
        ),
        left=(0, 5),
    )


def detection_table(performance: Performance) -> Table:
    """Return the probability of detection of every pair of regions."""
    return Table(
        header=("target", "background", *(f"{rate:g}" for rate in STATED_RATES), "area under ROC"),
        rows=tuple(
            (
                pair.target,
                pair.background,
                *(NOTHING if np.isnan(p) else f"{p:.4f}" for p in (*pair.p_detection, pair.auc)),
            )
            for pair in performance.detections
        ),
        left=(0, 1),
    )


def _row(row: Row, *, with_region: bool) -> tuple[str, ...]:
    return (
        f"{row.region}: {row.quantity}" if with_region else row.quantity,
        row.statistic,
        _predicted(row),
        _measured(row),
        NOTHING if row.std_error is None else f"{row.std_error:.2g}",
        NOTHING if row.std_error_inputs is None else f"{row.std_error_inputs:.2g}",
        signed(row.z_measurement),
        signed(row.z),
        _VERDICTS[row.agrees],
    )


def _error(row: Row) -> float:
    return float(np.hypot(row.std_error or 0.0, row.std_error_inputs or 0.0))


def _predicted(row: Row) -> str:
    return to_digits(row.predicted, _error(row))


def _measured(row: Row) -> str:
    return to_digits(row.measured, _error(row))


def _move(move: InputMove) -> tuple[str, ...]:
    return (
        move.name,
        f"{to_digits(move.value, move.std)} ± {move.std:.2g}",
        f"{move.move_std:+.1f}",
        to_digits(move.moved_value, move.std),
        f"{move.score:+.1f}",
        f"{move.p_value_left:.2g}" + (" (removed)" if move.removes else ""),
        f"{move.seen:.0%}",
        _confused(move.indistinguishable_from),
    )


def _confused(names: tuple[str, ...]) -> str:
    if not names:
        return NOTHING
    return ", ".join(names) if len(names) <= _NAMED else f"{len(names)} others: hardly seen"


def _share(std: float) -> str:
    """Return a part of a budget; what is left of rounding is nothing."""
    return f"{std:.1e}" if std > _ROUNDING else "0"


def _all(found: RegionBudget, quantity: str) -> str:
    return f"{np.linalg.norm(list(found.parts[quantity].values())):.1e}"


def _strength(name: str, prediction: RegionPrediction, found: PolarizationStrength | None) -> tuple[str, ...]:
    method = (prediction.dolp_method, f"{prediction.dolp_error:.1e}")
    if found is None:
        return (name, *[NOTHING] * 4, *method)
    return (name, *(f"{quantile:.4f}" for quantile in found.quantiles), f"{found.nedolp:.4f}", *method)


def disagreeing(comparison: Comparison, most: int) -> Iterable[Row]:
    """Return the rows that disagree, the farthest first."""
    return sorted(comparison.disagreements, key=lambda row: -abs(row.z or 0.0))[:most]
