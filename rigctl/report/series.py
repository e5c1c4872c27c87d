"""Many runs compared with one scene: what drifts with time, as tables, JSON, figures, page and files."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

import numpy as np

from model.quantities import FOLLOWED, QUANTITIES
from rigctl.base.numbers import NOTHING, signed
from rigctl.comparison.checks import refusals
from rigctl.comparison.rows import error_of_both, off_prediction
from rigctl.comparison.series import hours_of, mean_row, name_of, start_of, sun_zenith_deg
from rigctl.report.comparison import (
    ROW_COLUMNS,
    measured_text,
    predicted_text,
    provenance_json,
    row_table,
    score_text,
    trend_table,
)
from rigctl.report.document import Column, Picture, Report, Section, Table, Verbatim
from rigctl.report.drawing import (
    MEASURED,
    PREDICTED,
    legend_of_all,
    png,
    subplots,
)
from rigctl.report.prediction import SCHEMA_VERSION

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from rigctl.comparison.compare import Comparison
    from rigctl.comparison.rows import Row
    from rigctl.comparison.series import ComparedSeries, SeriesDrift
    from rigctl.console import Json
    from rigctl.report.files import Content


# Of a drift that is worth a word, in standard errors.
DRIFTS = 4.0

# What is to be known of a run before any of its rows.
_RUN_COLUMNS: tuple[Column[Comparison], ...] = (
    Column(title="run", key="run", value=name_of, left=True),
    Column(
        title="first frame",
        key="first_frame_utc",
        value=lambda comparison: None if (start := start_of(comparison)) is None else start.isoformat(),
        text=lambda comparison: NOTHING if (start := start_of(comparison)) is None else f"{start:%Y-%m-%d %H:%M}",
        left=True,
    ),
    Column(
        title="sun zenith",
        key="sun_zenith_deg",
        value=sun_zenith_deg,
        text=lambda comparison: NOTHING if (zenith := sun_zenith_deg(comparison)) is None else f"{zenith:.1f}",
    ),
)


# A run, and a row of its comparison.
RowOfRun = tuple["Comparison", "Row"]


def series_rows(series: ComparedSeries) -> Table[RowOfRun]:
    """Return the rows of all comparisons for programs, each after its run."""
    columns = (
        *(column.of(lambda one: one[0]) for column in _RUN_COLUMNS),
        *(column.of(lambda one: one[1]) for column in ROW_COLUMNS),
    )
    rows = tuple((comparison, row) for comparison in series.comparisons for row in comparison.rows)
    return Table(columns=columns, rows=rows)


def mean_table(comparisons: Sequence[Comparison]) -> Table[RowOfRun]:
    """Return both sides of the means that people read first, run by run."""
    columns: tuple[Column[RowOfRun], ...] = (
        *(column.of(lambda one: one[0]) for column in _RUN_COLUMNS),
        Column(title="region", text=lambda one: one[1].region, left=True),
        Column(title="quantity", text=lambda one: one[1].quantity, left=True),
        Column(title="predicted", text=lambda one: predicted_text(one[1])),
        Column(title="measured", text=lambda one: measured_text(one[1])),
        Column(title="error", text=lambda one: f"{error_of_both(one[1]):.1e}"),
        Column(title="z", text=lambda one: score_text(one[1])),
    )
    rows = tuple(
        (comparison, row)
        for comparison in comparisons
        for region in comparison.measurement.regions
        for quantity in FOLLOWED
        if (row := mean_row(comparison, region, quantity)) is not None
    )
    return Table(columns=columns, rows=rows, is_off=lambda one: one[1].agrees is False)


def drift_table(drifts: Iterable[SeriesDrift]) -> Table[SeriesDrift]:
    """Return how residuals drift with time."""
    columns: tuple[Column[SeriesDrift], ...] = (
        Column(title="region", text=lambda drift: drift.region, left=True),
        Column(title="quantity", text=lambda drift: drift.quantity, left=True),
        Column(title="drift an hour", text=lambda drift: f"{drift.line.slope:+.3g}"),
        Column(title="its error", text=lambda drift: f"{drift.line.std_error:.2g}"),
        Column(title="z", text=lambda drift: signed(drift.z)),
        Column(
            title="chi-square left",
            text=lambda drift: f"{drift.line.chi_square:.1f} / {drift.line.degrees_of_freedom}",
        ),
    )
    return Table(columns=columns, rows=tuple(drifts), is_off=lambda drift: abs(drift.z) > DRIFTS)


def series_json(series: ComparedSeries) -> dict[str, Json]:
    """Return the content of series.json."""
    return {
        "schema_version": SCHEMA_VERSION,
        "agrees": series.agrees,
        "alpha": series.alpha,
        "scene": series.scene,
        "runs": [_run_json(comparison) for comparison in series.comparisons],
        "drifts": [
            {"region": d.region, "quantity": d.quantity, "z": d.z, "per_hour": asdict(d.line)} for d in series.drifts
        ],
        "trends": [
            {"quantity": t.quantity, "over": t.over, "predicted": t.predicted} | asdict(t.order) for t in series.trends
        ],
        "provenance": [provenance_json(comparison) for comparison in series.comparisons],
    }


def _run_json(comparison: Comparison) -> dict[str, Json]:
    facts = Table(columns=_RUN_COLUMNS, rows=(comparison,)).json()[0]
    return {
        **facts,
        "agrees": comparison.agrees,
        "disagreements": len(comparison.disagreements),
        "points_to": list(comparison.points_to),
        "explanation": None if comparison.attribution is None else comparison.attribution.remark,
        "means": {
            region: {
                quantity: row_table([row]).json()[0]
                for quantity in FOLLOWED
                if (row := mean_row(comparison, region, quantity)) is not None
            }
            for region in comparison.measurement.regions
        },
    }


def series_figure(
    comparisons: Sequence[Comparison],
    at: Sequence[float],
    *,
    region: str,
    quantities: Sequence[str],
    label: str,
    unit: str,
) -> bytes:
    """Return a figure of one region: above, both sides with their errors; below, measured less predicted."""
    shown = [q for q in quantities if all(mean_row(comparison, region, q) is not None for comparison in comparisons)]
    figure, axes = subplots(2, max(len(shown), 1), size=(2.7 * max(len(shown), 1) + 0.4, 4.6))
    for column, quantity in enumerate(shown):
        rows = [
            row for row in (mean_row(comparison, region, quantity) for comparison in comparisons) if row is not None
        ]
        upper, lower = axes[column], axes[len(shown) + column]
        _both(upper, at, rows)
        _residuals(lower, at, rows)
        name = QUANTITIES[quantity].label + (f" [{unit}]" if quantity == "s0" else "")
        upper.set_title(f"{region}: {name}", fontsize=9)
        lower.set_xlabel(label, fontsize=9)
    axes[0].set_ylabel("mean of the region")
    axes[len(shown)].set_ylabel("measured - predicted")
    legend_of_all(figure, axes[0])
    return png(figure)


def _both(ax: Axes, at: Sequence[float], rows: Sequence[Row]) -> None:
    order = np.argsort(at)
    x = np.asarray(at)[order]
    predicted = np.array([rows[k].predicted for k in order])
    if rows[0].quantity == "aolp_deg":
        # From 2 to 179 deg is a way of 3, not of 177.
        predicted = np.unwrap(predicted, period=180.0)
    measured = predicted + [off_prediction(rows[k], rows[k].measured) for k in order]
    error = np.array([rows[k].std_error_inputs or 0.0 for k in order])
    ax.fill_between(x, predicted - error, predicted + error, color=PREDICTED, alpha=0.2, label="its std by the inputs")
    ax.plot(x, predicted, color=PREDICTED, marker="s", markersize=4, linewidth=1.2, label="predicted")
    ax.errorbar(
        x,
        measured,
        yerr=[rows[k].std_error or 0.0 for k in order],
        fmt="o",
        markersize=4,
        color=MEASURED,
        capsize=2,
        label="measured",
    )
    ax.tick_params(labelsize=8)


def _residuals(ax: Axes, at: Sequence[float], rows: Sequence[Row]) -> None:
    ax.axhline(0.0, color="0.5", linewidth=0.8)
    ax.errorbar(
        at,
        [off_prediction(row, row.measured) for row in rows],
        yerr=[error_of_both(row) for row in rows],
        fmt="o",
        markersize=4,
        color=MEASURED,
        capsize=2,
    )
    ax.tick_params(labelsize=8)


_SERIES_VERDICTS = {
    True: "Model and measurement agree.",
    False: "Model and measurement disagree.",
    None: "Not every run can be judged; the others agree.",
}


def series_report(series: ComparedSeries) -> Report:
    """Return what the report of many runs says."""
    comparisons = series.comparisons
    return Report(
        title=f"Measurement versus model: {len(comparisons)} runs",
        source="Each run with its own sun, time and exposure, and one scene file for all.",
        verdict=_SERIES_VERDICTS[series.agrees],
        good=series.agrees is True,
        reasons=tuple(_series_reasons(series)),
        sections=[
            *_figures(comparisons),
            Section(title="All runs", blocks=(mean_table(comparisons),)),
            *_drift_sections(series),
            Section(title="Not tested here", blocks=(_not_tested(comparisons),)),
            Section(
                title="Provenance in full",
                blocks=(
                    Verbatim(
                        json.dumps(
                            [provenance_json(comparison)["files"] for comparison in series.comparisons], indent=2
                        )
                    ),
                ),
                folded=True,
                printed=False,
            ),
        ],
    )


def _series_reasons(series: ComparedSeries) -> Iterable[tuple[str, str]]:
    comparisons = series.comparisons
    off = [comparison for comparison in comparisons if comparison.agrees is False]
    yield (
        "",
        f"{len(comparisons)} runs, {len(off)} of which disagree, at alpha = {series.alpha:g} for all of them together.",
    )
    for comparison in comparisons:
        if comparison.agrees is None:
            yield "Cannot be judged:", f"{name_of(comparison)}: {'; '.join(refusals(comparison.checks))}"
    for comparison in off:
        yield "Disagrees:", f"{name_of(comparison)}: {_why(comparison)}"
    for d in series.drifts:
        if abs(d.z) > DRIFTS:
            drift = f"by {d.line.slope:+.3g} an hour ({d.z:+.1f})"
            yield "Drifts:", f"{d.quantity} of {d.region} against its prediction, {drift}"


def _why(comparison: Comparison) -> str:
    text = f"{len(comparison.disagreements)} numbers; points to {', '.join(comparison.points_to) or 'no cause'}"
    return text if comparison.attribution is None else f"{text}; {comparison.attribution.remark}"


def _figures(comparisons: Sequence[Comparison]) -> Iterable[Section]:
    hours = hours_of(comparisons)
    zeniths = [zenith for zenith in map(sun_zenith_deg, comparisons) if zenith is not None]
    axes: list[tuple[str, list[float], str]] = []
    if hours is None:
        axes.append(("order", [float(k) for k in range(1, len(comparisons) + 1)], "run, as given"))
    else:
        axes.append(("time", hours, "time from the first run [h]"))
    if len(zeniths) == len(comparisons) and len(set(zeniths)) > 1:
        axes.append(("sun", zeniths, "sun from the zenith [deg]"))
    for name, at, label in axes:
        pictures = tuple(
            Picture(
                png=series_figure(
                    comparisons,
                    at,
                    region=region,
                    quantities=FOLLOWED,
                    label=label,
                    unit=comparisons[0].measurement.grid.unit,
                ),
                caption=f"{region}, both sides and residuals against the {name}; bars of residuals: both errors.",
            )
            for region in comparisons[0].measurement.regions
        )
        yield Section(title=f"Against the {name}", blocks=pictures)


def _drift_sections(series: ComparedSeries) -> Iterable[Section]:
    if series.drifts:
        note = (
            "Straight line through measured less predicted, weighted by the errors of the measurement. Errors of "
            "the inputs are common to all runs and no reason for a drift, unless they change with the sun."
        )
        yield Section(title="Drift of the residuals", blocks=(drift_table(series.drifts), note))
    if series.trends:
        yield Section(title="Trends", blocks=(trend_table(series.trends),))


def _not_tested(comparisons: Sequence[Comparison]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(text for comparison in comparisons for text in comparison.not_tested))


def series_files(series: ComparedSeries) -> dict[str, Content]:
    """Return numbers and reports of many runs as files."""
    report = series_report(series)
    return {
        "series.json": series_json(series),
        "series.csv": series_rows(series),
        "series.html": report,
        "series.pdf": report,
    }
