"""Many runs beside one scene, as tables and as JSON."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass

from model.quantities import FOLLOWED
from rigctl.comparison.rows import Row
from rigctl.comparison.series import ComparedSeries, SeriesDrift, SeriesPoint, mean_row
from rigctl.console.json_text import Json
from rigctl.numbers.number_text import NOTHING, signed
from rigctl.reports.table import Column, Table
from rigctl.reports.tables.numbers_json import SCHEMA_VERSION
from rigctl.reports.tables.provenance import provenance_json
from rigctl.reports.tables.row_table import ROW_COLUMNS, error_of, measured_text, predicted_text, row_table
from rigctl.reports.writers.data_files import json_rows

# Of a drift that is worth a word, in standard errors.
DRIFTS = 4.0

# What is to be known of a run before any of its rows.
_POINT_COLUMNS: tuple[Column[SeriesPoint], ...] = (
    Column(title="run", key="run", value=lambda point: point.name, left=True),
    Column(
        title="first frame",
        key="first_frame_utc",
        value=lambda point: None if point.start is None else point.start.isoformat(),
        text=lambda point: NOTHING if point.start is None else point.start.strftime("%Y-%m-%d %H:%M"),
        left=True,
    ),
    Column(
        title="sun zenith",
        key="sun_zenith_deg",
        text=lambda point: NOTHING if point.sun_zenith_deg is None else f"{point.sun_zenith_deg:.1f}",
    ),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class RowOfRun:
    """A row of a comparison, and the run that it is of."""

    point: SeriesPoint
    row: Row


def series_rows(series: ComparedSeries) -> Table[RowOfRun]:
    """Return the rows of all comparisons for programs, each after its run."""
    columns = (
        *(column.of(lambda one: one.point) for column in _POINT_COLUMNS),
        *(column.of(lambda one: one.row) for column in ROW_COLUMNS),
    )
    rows = tuple(RowOfRun(point=point, row=row) for point in series.points for row in point.comparison.rows)
    return Table(columns=columns, rows=rows)


def mean_table(points: Sequence[SeriesPoint]) -> Table[RowOfRun]:
    """Return both sides of the means that people read first, run by run."""
    columns: tuple[Column[RowOfRun], ...] = (
        *(column.of(lambda one: one.point) for column in _POINT_COLUMNS),
        Column(title="region", text=lambda one: one.row.region, left=True),
        Column(title="quantity", text=lambda one: one.row.quantity, left=True),
        Column(title="predicted", text=lambda one: predicted_text(one.row)),
        Column(title="measured", text=lambda one: measured_text(one.row)),
        Column(title="error", text=lambda one: f"{error_of(one.row):.1e}"),
        Column(title="z, both", text=lambda one: signed(one.row.z)),
    )
    rows = tuple(
        RowOfRun(point=point, row=row)
        for point in points
        for region in point.comparison.measurement.regions
        for quantity in FOLLOWED
        if (row := mean_row(point, region, quantity)) is not None
    )
    return Table(columns=columns, rows=rows, is_off=lambda one: one.row.agrees is False)


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
        "scene": {"path": str(series.scene.path), "sha256": series.scene.sha256},
        "runs": [_point_json(point) for point in series.points],
        "drifts": [
            {"region": d.region, "quantity": d.quantity, "z": d.z, "per_hour": asdict(d.line)} for d in series.drifts
        ],
        "trends": [
            {"quantity": t.quantity, "over": t.over, "predicted": t.predicted} | asdict(t.order) for t in series.trends
        ],
        "provenance": [provenance_json(point.comparison) for point in series.points],
    }


def _point_json(point: SeriesPoint) -> dict[str, Json]:
    comparison = point.comparison
    facts = json_rows(Table(columns=_POINT_COLUMNS, rows=(point,)))[0]
    return {
        **facts,
        "agrees": comparison.agrees,
        "disagreements": len(comparison.disagreements),
        "points_to": list(comparison.diagnosis.points_to),
        "explanation": None if comparison.attribution is None else comparison.attribution.remark,
        "means": {
            region: {
                quantity: json_rows(row_table([row]))[0]
                for quantity in FOLLOWED
                if (row := mean_row(point, region, quantity)) is not None
            }
            for region in point.comparison.measurement.regions
        },
    }
