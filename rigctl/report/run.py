"""The page on a session: its frames, the sun, light and polarization by cycle, counts, events."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from datetime import datetime
from typing import TYPE_CHECKING

import numpy as np

from rigctl.base.numbers import percent
from rigctl.comparison.compare import NOT_OF_SIMULATION
from rigctl.files.rig_file import PLACEHOLDER
from rigctl.files.session_file import PICTURE
from rigctl.report.comparison import fault_table
from rigctl.report.document import Column, Picture, Report, Section, Table, text_columns
from rigctl.report.drawing import legend_beside, png, subplots
from rigctl.report.measurement import annotation_sections
from rigctl.runs.records import (
    READINGS_EVENT,
    event_facts,
    host_clock_text,
    pictures_lost,
    start_time_texts,
)
from rigctl.session.history import light_lines

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from rigctl.measure.diagnose import RunDiagnosis
    from rigctl.runs.folder import Run
    from rigctl.runs.records import FrameRecord, MonitorTrace, RunEvent, SessionRecord
    from rigctl.session.history import CycleHistory, CycleLook, Means, SessionHistory
    from rigctl.session.status import Estimate


# Time above which hours are used, and below which seconds.
_LONG_S, _SHORT_S = 5400.0, 120.0


def contact_sheet(thumbnails: Sequence[tuple[FrameRecord, NDArray[np.uint16]]]) -> bytes:
    """Return some frames of a run, small."""
    columns = min(6, len(thumbnails))
    rows = -(-len(thumbnails) // columns)
    figure, axes = subplots(rows, columns, size=(1.9 * columns, 1.9 * rows))
    for ax in axes:
        ax.set_axis_off()
    for ax, (record, counts) in zip(axes, thumbnails, strict=False):
        ax.imshow(counts, cmap="gray", vmin=0.0, vmax=record.saturation_dn)
        ax.set_title(_label(record), fontsize=7)
    return png(figure)


def _label(record: FrameRecord) -> str:
    angle = "" if record.polarizer_angle_target_deg is None else f" {record.polarizer_angle_target_deg:g} deg"
    return f"{record.sequence}: {record.kind}{angle}"


def count_plot(run: Run, means: Means) -> bytes:
    """Return mean counts against time, by kind of frame and angle, with a separate axis for darks."""
    groups: dict[str, list[FrameRecord]] = defaultdict(list)
    for record in run.frames:
        groups[_label(record).partition(": ")[2]].append(record)
    dark = {label: records for label, records in groups.items() if records[0].kind == "dark"}
    panels = [part for part in ({k: v for k, v in groups.items() if k not in dark}, dark) if part]
    figure, axes = subplots(len(panels), 1, size=(8.8, 3.4 * len(panels)))
    for ax, part in zip(axes, panels, strict=True):
        for label, records in part.items():
            ax.plot(_times(records, run), [means[r.sequence][PICTURE].mean_dn for r in records], ".-", label=label)
        ax.set_ylabel("mean count [DN]")
        ax.ticklabel_format(axis="y", useOffset=False)
        legend_beside(ax)
    axes[-1].set_xlabel(_time_label(run))
    return png(figure)


def sun_plot(run: Run) -> bytes:
    """Return where the sun stood, against time."""
    known = [record for record in run.frames if record.sun_elevation_deg is not None]
    figure, axes = subplots(1, 2, size=(8.0, 3.2))
    times = _times(known, run)
    axes[0].plot(times, [90.0 - (record.sun_elevation_deg or 0.0) for record in known], ".")
    axes[0].set_ylabel("solar zenith angle [deg]")
    axes[1].plot(times, [record.sun_azimuth_deg or 0.0 for record in known], ".")
    axes[1].set_ylabel("solar azimuth [deg]")
    for ax in axes:
        ax.set_xlabel(_time_label(run))
    return png(figure)


def _times(records: Sequence[FrameRecord], run: Run) -> list[float]:
    """Return the times of frames in the unit of `_time_label`, or their numbers in a run without times."""
    starts = [_start(record) for record in records]
    first, (unit_s, _) = _start(run.frames[0]), _time_unit(run)
    return [
        float(record.sequence) if first is None or start is None else (start - first).total_seconds() / unit_s
        for record, start in zip(records, starts, strict=True)
    ]


def _time_label(run: Run) -> str:
    return f"time since the first frame [{_time_unit(run)[1]}]" if _start(run.frames[0]) else "number of the frame"


def _time_unit(run: Run) -> tuple[float, str]:
    first, last = _start(run.frames[0]), _start(run.frames[-1])
    return unit_of_time(_LONG_S) if first is None or last is None else unit_of_time((last - first).total_seconds())


def unit_of_time(span_s: float) -> tuple[float, str]:
    """Return a suitable unit for a span of time, in seconds and by name."""
    if abs(span_s) < _SHORT_S:
        return 1.0, "s"
    return (3600.0, "h") if abs(span_s) >= _LONG_S else (60.0, "min")


def _start(record: FrameRecord) -> datetime | None:
    return None if record.start_utc is None else datetime.fromisoformat(record.start_utc)


def cycle_figure(history: CycleHistory) -> bytes:
    """Return a PNG over the cycles: light of the reference region, DoLP of each region, and the sum rule.

    Panels that the angles of a run do not allow are left out.
    """
    looks = history.looks
    sums = {look: look.sum_rule for look in looks if look.sum_rule is not None}
    panels = [_draw_light, _draw_dolp, *([_draw_sums] if sums else [])]
    figure, axes = subplots(len(panels), 1, size=(8.8, 0.4 + 2.2 * len(panels)))
    for ax, draw in zip(axes, panels, strict=True):
        draw(ax, history)
        ax.ticklabel_format(axis="y", useOffset=False)
    axes[-1].set_xlabel(f"time since the first cycle [{_cycle_unit(history)[1]}]")
    return png(figure)


def monitor_figure(traces: Sequence[MonitorTrace]) -> bytes:
    """Return the readings of sensors against time, one panel each."""
    first_s = min(trace.times_s[0] for trace in traces)
    unit_s, unit = unit_of_time(max(trace.times_s[-1] for trace in traces) - first_s)
    figure, axes = subplots(len(traces), 1, size=(8.8, 0.4 + 2.0 * len(traces)))
    for ax, trace in zip(axes, traces, strict=True):
        ax.plot([(time_s - first_s) / unit_s for time_s in trace.times_s], trace.values, ".-", markersize=4)
        ax.set_ylabel(f"{trace.monitor} [{trace.unit}]")
        ax.ticklabel_format(axis="y", useOffset=False)
    axes[-1].set_xlabel(f"time since the first reading [{unit}]")
    return png(figure)


def drift_line(history: CycleHistory) -> str:
    """Return the drift of the light from cycle to cycle in words."""
    drifts = [look.drift for look in history.looks if look.drift is not None]
    if not drifts:
        return "Drift within rounds: not known, because no angle was taken twice in a round."
    per_min = np.array([drift.per_min for drift in drifts])
    change = np.array([drift.change for drift in drifts])
    sigmas = [drift.sigma for drift in drifts if drift.sigma is not None]
    noise = f"; noise alone causes {percent(float(np.sqrt(np.mean(np.square(sigmas)))))}" if sigmas else ""
    median = percent(float(np.median(per_min)), sign=True)
    return (
        f"Drift of {history.reference}, within rounds: median {median} per minute; between consecutive frames of an "
        f"angle {percent(float(np.sqrt(np.mean(change**2))))} rms, {percent(float(np.max(np.abs(change))))} at "
        f"most{noise}."
    )


def _draw_light(ax: Axes, history: CycleHistory) -> None:
    looks = [look for look in history.looks if history.reference in look.regions]
    light = np.array([look.regions[history.reference].light_dn_per_s for look in looks])
    if light.size:
        ax.plot([_time(look, history) for look in looks], 100.0 * (light / light[0] - 1.0), ".-", markersize=4)
    ax.set_ylabel(f"light of {history.reference},\nchange since the first [%]")


def _draw_dolp(ax: Axes, history: CycleHistory) -> None:
    names = list(dict.fromkeys(name for look in history.looks for name in look.regions))
    for name in names:
        _draw(ax, history, {look: look.regions[name].dolp for look in history.looks if name in look.regions}, name)
    ax.set_ylabel("DoLP" if len(names) > 1 else f"DoLP of {names[0]}")
    if len(names) > 1:
        legend_beside(ax)


def _draw_sums(ax: Axes, history: CycleHistory) -> None:
    _draw(ax, history, {look: look.sum_rule for look in history.looks if look.sum_rule is not None}, PICTURE)
    ax.set_ylabel("(I0 + I90) / (I45 + I135)")


def _draw(ax: Axes, history: CycleHistory, found: dict[CycleLook, Estimate], label: str) -> None:
    times = [_time(look, history) for look in found]
    values = [estimate.value for estimate in found.values()]
    sigmas = [0.0 if estimate.sigma is None else estimate.sigma for estimate in found.values()]
    ax.errorbar(times, values, yerr=sigmas, fmt=".-", markersize=4, linewidth=1.0, label=label)


def _time(look: CycleLook, history: CycleHistory) -> float:
    return (look.time_s - history.looks[0].time_s) / _cycle_unit(history)[0]


def _cycle_unit(history: CycleHistory) -> tuple[float, str]:
    return unit_of_time(history.looks[-1].time_s - history.looks[0].time_s)


_SHOWN_EVENTS = 200


def run_report(session: SessionHistory, diagnosis: RunDiagnosis) -> Report:
    """Return the report on a session, with faults found in its frames."""
    pictures = [Section(title=title, blocks=(Picture(png=png),)) for title, png in _pictures(session)]
    counts = Counter(event.event for event in session.events).most_common()
    times = Table(
        columns=text_columns("event", "times", left=(0, 1)), rows=tuple((name, str(count)) for name, count in counts)
    )
    shown = [event for event in session.events if event.event != READINGS_EVENT]
    events = Section(title="Events", blocks=(times, _event_table(shown[-_SHOWN_EVENTS:])))
    noted = annotation_sections(session.run.annotations)
    faults, beside = _faults(session.run.session, diagnosis), _monitors(session)
    way = (*_way(session.events), *_times_of_run(session))
    sections = [*_simulation(session.run.session), *noted, *pictures, *beside, faults, *way, events]
    return Report(title=session.run.path.name, source=_source(session), sections=sections)


def _simulation(session: SessionRecord) -> Iterable[Section]:
    """Yield what a simulated run can prove, and its light."""
    if session.origin != "simulated":
        return
    light = session.simulated_light
    said = [] if light is None else [*(f"{text[0].upper()}{text[1:]}." for text in light.caution), *light.remarks]
    said += [f"It does not test {text}." for text in NOT_OF_SIMULATION]
    yield Section(title="Limits of a simulated run", blocks=(tuple(said),))


def _faults(session: SessionRecord, found: RunDiagnosis) -> Section:
    """Return the faults that the frames show."""
    unset = (f"{PLACEHOLDER[0].upper()}{PLACEHOLDER[1:]}.",) if session.polarizer.placeholder else ()
    said = (*unset, *found.lines)
    table = (fault_table(found.terms),) if found.terms else ()
    return Section(title="Frames", blocks=(said, *table))


def _way(events: Sequence[RunEvent]) -> Iterable[Section]:
    """Yield the fate of pictures on their way from the camera, if it counts them."""
    if lines := pictures_lost(events):
        yield Section(title="Pictures on their way", blocks=(lines,))


def _times_of_run(session: SessionHistory) -> Iterable[Section]:
    """Yield the errors of the starts of exposures."""
    texts = (*start_time_texts(session.run.frames), *filter(None, [host_clock_text(session.events)]))
    if texts:
        lines = tuple(f"{text[0].upper()}{text[1:]}." for text in texts)
        yield Section(title="Starts of exposures", blocks=(lines,))


def _monitors(session: SessionHistory) -> Iterable[Section]:
    """Yield the readings of sensors, and the change of the light that they do not explain."""
    if not session.monitors:
        return
    lines = [trace.line for trace in session.monitors]
    lines += [] if session.cycles is None else [f"{text}." for text in light_lines(session.cycles, session.monitors)]
    read = [trace for trace in session.monitors if trace.values]
    pictures = (Picture(png=monitor_figure(read)),) if read else ()
    yield Section(title="Monitors", blocks=(tuple(lines), *pictures))


def _source(session: SessionHistory) -> str:
    run = session.run
    start = (run.frames[0].start_utc or "")[:19] if run.frames else ""
    end = (run.frames[-1].end_utc or "")[:19] if run.frames else ""
    made = (
        f"{len(run.frames)} frames, {start} to {end}, {run.session.origin or 'not stated'}. Made by {run.created_by}."
    )
    return made if session.cycles is None else f"{made} {drift_line(session.cycles)}"


def _pictures(session: SessionHistory) -> Iterable[tuple[str, bytes]]:
    run, cycles = session.run, session.cycles
    if run.frames:
        yield "Frames", contact_sheet(session.thumbnails)
        yield "Mean counts", count_plot(run, session.means)
    if any(record.sun_elevation_deg is not None for record in run.frames):
        yield "Sun", sun_plot(run)
    if cycles is not None and any(look.regions for look in cycles.looks):
        yield "Light and polarization by cycle", cycle_figure(cycles)


def _event_table(events: Sequence[RunEvent]) -> Table[RunEvent]:
    columns: tuple[Column[RunEvent], ...] = (
        Column(text=lambda event: f"{event.utc[:19]}Z", left=True),
        Column(text=lambda event: event.event, left=True),
        Column(text=event_facts, left=True, wide=True),
    )
    return Table(columns=columns, rows=tuple(events))
