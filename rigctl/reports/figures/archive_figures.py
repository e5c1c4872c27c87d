"""The picture of a job over an archive: numbers of the regions against time."""

from collections.abc import Callable, Sequence
from datetime import datetime

from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

from rigctl.archive.run_rows import RegionNumbers, RunRow, Verb
from rigctl.numbers.angles import wrapped
from rigctl.reports.figures.figure_style import legend_of_all, png, subplots

# More regions no one tells apart; the tables have all.
_MOST_REGIONS = 7
_Points = list[tuple[datetime, RegionNumbers]]
# What is drawn: its label, its value, its error.
_Panel = tuple[str, Callable[[RegionNumbers], float | None], Callable[[RegionNumbers], float | None]]


def archive_figure(rows: Sequence[RunRow], verb: Verb) -> bytes | None:
    """Return the regions' numbers against time; None where no run has a time and a number.

    Parameters
    ----------
    rows : sequence of RunRow
        What came of the runs.
    verb : str
        The job, by which is chosen what is drawn.
    """
    points: dict[str, _Points] = {}
    for row in rows:
        for region in row.regions if row.utc else ():
            points.setdefault(region.region, []).append((datetime.fromisoformat(row.utc), region))
    if verb == "verify" or not points:
        return None
    panels = _PANELS[verb]
    figure, axes = subplots(len(panels), 1, size=(8.0, 2.6 * len(panels)))
    for ax, panel in zip(axes, panels, strict=True):
        for name in sorted(points)[:_MOST_REGIONS]:
            _draw(ax, name, points[name], panel)
        ax.set_ylabel(panel[0])
        ax.xaxis.set_major_locator(locator := AutoDateLocator())  # type: ignore[no-untyped-call]
        ax.xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]
    axes[-1].set_xlabel("begun, UTC")
    legend_of_all(figure, axes[0])
    return png(figure)


def _draw(ax: Axes, name: str, points: _Points, panel: _Panel) -> None:
    _, value, error = panel
    known = [(at, found, error(region)) for at, region in points if (found := value(region)) is not None]
    if not known:
        return
    times, values, errors = zip(*known, strict=True)
    bars = [0.0 if one is None else one for one in errors]
    ax.errorbar(times, values, yerr=bars if any(bars) else None, fmt="o", markersize=3, label=name, linewidth=0.8)


def _change_of_dolp(region: RegionNumbers) -> float | None:
    return None if region.dolp is None or region.dolp_before is None else region.dolp - region.dolp_before


def _change_of_aolp(region: RegionNumbers) -> float | None:
    if region.aolp_deg is None or region.aolp_before_deg is None:
        return None
    return float(wrapped(region.aolp_deg - region.aolp_before_deg, turn=180.0))


def _no_error(_: RegionNumbers) -> None:
    return None


_DOLP: _Panel = ("DoLP", lambda region: region.dolp, lambda region: region.dolp_sigma)
_PANELS: dict[Verb, tuple[_Panel, ...]] = {
    "compare": (_DOLP, ("z of DoLP", lambda region: region.dolp_z, _no_error)),
    "stokes": (_DOLP, ("AoLP [deg]", lambda region: region.aolp_deg, lambda region: region.aolp_sigma_deg)),
    "recalibrate": (
        ("change of DoLP", _change_of_dolp, _no_error),
        ("change of AoLP [deg]", _change_of_aolp, _no_error),
    ),
}
