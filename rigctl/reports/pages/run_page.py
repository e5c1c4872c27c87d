"""The page on how a session went: its frames, the sun, light and polarization by cycle, counts, events."""

from collections import Counter
from collections.abc import Iterable, Sequence

from rigctl.comparison.remarks import NOT_OF_SIMULATION
from rigctl.files.rig_file import PLACEHOLDER
from rigctl.live.light_followed import light_lines
from rigctl.live.session_history import SessionHistory
from rigctl.measurement.fault_terms import fault_lines
from rigctl.measurement.run_diagnosis import RunDiagnosis
from rigctl.reports.figures.run_figures import (
    contact_sheet,
    count_plot,
    cycle_figure,
    drift_line,
    monitor_figure,
    sun_plot,
)
from rigctl.reports.report import Bullets, Picture, Report, Section
from rigctl.reports.table import Column, Table, text_columns
from rigctl.reports.tables.annotation_tables import annotation_sections
from rigctl.reports.tables.comparison_tables import fault_table
from rigctl.runs.frame_record import start_time_texts
from rigctl.runs.monitor_readings import READINGS_EVENT, monitor_line
from rigctl.runs.run_events import RunEvent, event_facts, host_clock_text, pictures_lost
from rigctl.runs.session_record import SessionRecord

_SHOWN_EVENTS = 200


def run_report(session: SessionHistory, diagnosis: RunDiagnosis) -> Report:
    """Return the report on how a session went, with what its frames say of their faults."""
    pictures = [Section(title=title, blocks=(Picture(png=png),)) for title, png in _pictures(session)]
    counts = Counter(event.event for event in session.events).most_common()
    times = Table(
        columns=text_columns("event", "times", left=(0, 1)), rows=tuple((name, str(count)) for name, count in counts)
    )
    told = [event for event in session.events if event.event != READINGS_EVENT]
    events = Section(title="Events", blocks=(times, _event_table(told[-_SHOWN_EVENTS:])))
    noted = annotation_sections(session.run.annotations)
    faults, beside = _faults(session.run.session, diagnosis), _monitors(session)
    way = (*_way(session.events), *_times(session))
    sections = [*_simulation(session.run.session), *noted, *pictures, *beside, faults, *way, events]
    return Report(title=session.run.path.name, source=_source(session), sections=sections)


def _simulation(session: SessionRecord) -> Iterable[Section]:
    """Yield what a simulated run proves and what not, and which light it had."""
    if session.origin != "simulated":
        return
    light = session.simulated_light
    said = [] if light is None else [*(f"{text[0].upper()}{text[1:]}." for text in light.caution), *light.remarks]
    said += [f"It says nothing of {text}." for text in NOT_OF_SIMULATION]
    yield Section(title="What this simulated run proves and what not", blocks=(Bullets(items=tuple(said)),))


def _faults(session: SessionRecord, found: RunDiagnosis) -> Section:
    """Return what the frames say of their own faults."""
    unset = (f"{PLACEHOLDER[0].upper()}{PLACEHOLDER[1:]}.",) if session.polarizer.placeholder else ()
    said = Bullets(items=(*unset, *fault_lines(found.named, found.reason)))
    table = (fault_table(found.terms),) if found.terms else ()
    return Section(title="The frames by themselves", blocks=(said, *table))


def _way(events: Sequence[RunEvent]) -> Iterable[Section]:
    """Yield what became of pictures on their way from the camera, where it counts them."""
    if lines := pictures_lost(events):
        yield Section(title="Pictures on their way", blocks=(Bullets(items=lines),))


def _times(session: SessionHistory) -> Iterable[Section]:
    """Yield how well the starts of exposures are known."""
    texts = (*start_time_texts(session.run.frames), *filter(None, [host_clock_text(session.events)]))
    if texts:
        lines = tuple(f"{text[0].upper()}{text[1:]}." for text in texts)
        yield Section(title="Starts of exposures", blocks=(Bullets(items=lines),))


def _monitors(session: SessionHistory) -> Iterable[Section]:
    """Yield what sensors beside the frames said, and what is left of the light's change where one follows it."""
    if not session.monitors:
        return
    lines = [monitor_line(trace) for trace in session.monitors]
    lines += [] if session.cycles is None else [f"{text}." for text in light_lines(session.cycles, session.monitors)]
    read = [trace for trace in session.monitors if trace.values]
    pictures = (Picture(png=monitor_figure(read)),) if read else ()
    yield Section(title="Beside the frames", blocks=(Bullets(items=tuple(lines)), *pictures))


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
