"""The report of many runs beside one scene."""

import json
from collections.abc import Iterable, Sequence

from model.quantities import FOLLOWED
from rigctl.comparison.series import ComparedSeries, SeriesPoint, hours_of
from rigctl.comparison.verdict import refusals
from rigctl.reports.figures.comparison_figures import series_figure
from rigctl.reports.report import Bullets, Paragraph, Picture, Report, Section, Verbatim, Verdict
from rigctl.reports.tables.comparison_tables import trend_table
from rigctl.reports.tables.provenance import provenance_json
from rigctl.reports.tables.series_tables import DRIFTS, drift_table, mean_table

_VERDICTS = {
    True: "Model and measurement agree.",
    False: "Model and measurement disagree.",
    None: "Not every run can be judged; the others agree.",
}


def series_report(series: ComparedSeries) -> Report:
    """Return what the report of many runs says."""
    points = series.points
    return Report(
        title=f"{len(points)} runs beside the model",
        source="Each run with its own sun, time and exposure, and one scene file for all.",
        verdict=Verdict(
            good=series.agrees is True,
            text=_VERDICTS[series.agrees],
            reasons=tuple(_reasons(series)),
        ),
        sections=[
            *_figures(points),
            Section(title="All runs", blocks=(mean_table(points),)),
            *_drift_sections(series),
            Section(title="What this does not test", blocks=(Bullets(items=_not_tested(points)),)),
            Section(
                title="Provenance in full",
                blocks=(
                    Verbatim(
                        text=json.dumps(
                            [provenance_json(point.comparison)["files"] for point in series.points], indent=2
                        )
                    ),
                ),
                folded=True,
                printed=False,
            ),
        ],
    )


def _reasons(series: ComparedSeries) -> Iterable[tuple[str, str]]:
    points = series.points
    off = [point for point in points if point.comparison.agrees is False]
    yield "", f"{len(points)} runs, {len(off)} of which disagree, at alpha = {series.alpha:g} for all of them together."
    for point in points:
        if point.comparison.agrees is None:
            yield "Cannot be judged:", f"{point.name}: {'; '.join(refusals(point.comparison.checks))}"
    for point in off:
        yield "Disagrees:", f"{point.name}: {_why(point)}"
    for d in series.drifts:
        if abs(d.z) > DRIFTS:
            drift = f"by {d.line.slope:+.3g} an hour ({d.z:+.1f})"
            yield "Drifts:", f"{d.quantity} of {d.region} against its prediction, {drift}"


def _why(point: SeriesPoint) -> str:
    comparison = point.comparison
    text = (
        f"{len(comparison.disagreements)} numbers; points to {', '.join(comparison.diagnosis.points_to) or 'no cause'}"
    )
    return text if comparison.attribution is None else f"{text}; {comparison.attribution.remark}"


def _figures(points: Sequence[SeriesPoint]) -> Iterable[Section]:
    hours = hours_of(points)
    zeniths = [point.sun_zenith_deg for point in points if point.sun_zenith_deg is not None]
    axes: list[tuple[str, list[float], str]] = []
    if hours is None:
        axes.append(("order", [float(k) for k in range(1, len(points) + 1)], "run, as given"))
    else:
        axes.append(("time", hours, "time from the first run [h]"))
    if len(zeniths) == len(points) and len(set(zeniths)) > 1:
        axes.append(("sun", zeniths, "sun from the zenith [deg]"))
    for name, at, label in axes:
        pictures = tuple(
            Picture(
                png=series_figure(
                    points,
                    at,
                    region=region,
                    quantities=FOLLOWED,
                    label=label,
                    unit=points[0].comparison.measurement.grid.unit,
                ),
                caption=f"{region}, both sides and residuals against the {name}; bars of residuals: both errors.",
            )
            for region in points[0].comparison.measurement.regions
        )
        yield Section(title=f"Against the {name}", blocks=pictures)


def _drift_sections(series: ComparedSeries) -> Iterable[Section]:
    if series.drifts:
        note = Paragraph(
            text="Straight line through measured less predicted, weighted by the errors of the measurement. Errors of "
            "the inputs are common to all runs and no reason for a drift, unless they change with the sun."
        )
        yield Section(title="Drift of the residuals", blocks=(drift_table(series.drifts), note))
    if series.trends:
        yield Section(title="Trends", blocks=(trend_table(series.trends),))


def _not_tested(points: Sequence[SeriesPoint]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(text for point in points for text in point.comparison.not_tested))
