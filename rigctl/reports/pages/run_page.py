"""A page on how a session went: its frames, the sun, light and polarization by cycle, counts, events."""

import base64
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import asdict
from datetime import datetime

from jinja2 import Environment, StrictUndefined

from rigctl.files.session_file import PICTURE
from rigctl.live.cycle_history import Means
from rigctl.live.session_history import SessionHistory, Thumbnail
from rigctl.reports.figures.cycle_figure import cycle_figure, drift_line
from rigctl.reports.figures.figure_style import png, subplots
from rigctl.runs.run_events import event_facts
from rigctl.runs.run_folder import FrameRecord, Run

_SHOWN_EVENTS = 200
# From here on times are in hours, below in minutes.
_LONG_S = 5400.0
_TEMPLATE = """<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{{ title }}</title>
<style>body{font:15px/1.5 sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem}img{max-width:100%}
td,th{padding:.1rem .6rem;text-align:left;vertical-align:top}</style></head><body>
<h1>{{ title }}</h1>
<p>{{ frames }} frames, {{ start }} to {{ end }}, {{ origin }}. Made by {{ made_by }}.</p>
<p>{{ drift }}</p>
{% for heading, picture in pictures %}<h2>{{ heading }}</h2>
<img alt="{{ heading }}" src="data:image/png;base64,{{ picture }}">{% endfor %}
<h2>Events</h2><table><tr><th>event</th><th>times</th></tr>
{% for name, times in counts %}<tr><td>{{ name }}</td><td>{{ times }}</td></tr>{% endfor %}</table>
<table>{% for event in events %}<tr><td>{{ event.utc[:19] }}Z</td><td>{{ event.event }}</td>
<td>{{ event.facts }}</td></tr>{% endfor %}</table>
</body></html>"""


def run_page(session: SessionHistory) -> str:
    """Return the page as HTML that needs no other file."""
    run, history, events = session.run, session.cycles, session.events
    pictures = []
    if run.frames:
        pictures += [("Frames", _contact_sheet(session.thumbnails)), ("Mean counts", _count_plot(run, session.means))]
    if any(record.sun_elevation_deg is not None for record in run.frames):
        pictures.append(("Sun", _sun_plot(run)))
    if history is not None and any(look.regions for look in history.looks):
        pictures.append(("Light and polarization by cycle", cycle_figure(history)))
    template = Environment(autoescape=True, undefined=StrictUndefined).from_string(_TEMPLATE)
    return template.render(
        title=run.path.name,
        frames=len(run.frames),
        start=(run.frames[0].start_utc or "")[:19] if run.frames else "",
        end=(run.frames[-1].end_utc or "")[:19] if run.frames else "",
        origin=run.session.origin or "not stated",
        made_by=run.created_by,
        drift="" if history is None else drift_line(history),
        pictures=[(title, base64.b64encode(data).decode("ascii")) for title, data in pictures],
        counts=Counter(event.event for event in events).most_common(),
        events=[asdict(event) | {"facts": event_facts(event)} for event in events[-_SHOWN_EVENTS:]],
    )


def _contact_sheet(thumbnails: Sequence[Thumbnail]) -> bytes:
    columns = min(6, len(thumbnails))
    rows = -(-len(thumbnails) // columns)
    figure, axes = subplots(rows, columns, size=(1.9 * columns, 1.9 * rows))
    for ax in axes:
        ax.set_axis_off()
    for ax, thumbnail in zip(axes, thumbnails, strict=False):
        ax.imshow(thumbnail.counts, cmap="gray", vmin=0.0, vmax=thumbnail.record.saturation_dn)
        ax.set_title(_label(thumbnail.record), fontsize=7)
    return png(figure)


def _label(record: FrameRecord) -> str:
    angle = "" if record.polarizer_angle_target_deg is None else f" {record.polarizer_angle_target_deg:g} deg"
    return f"{record.sequence}: {record.kind}{angle}"


def _count_plot(run: Run, means: Means) -> bytes:
    figure, axes = subplots(1, 1, size=(8.0, 3.6))
    groups: dict[str, list[FrameRecord]] = defaultdict(list)
    for record in run.frames:
        groups[_label(record).partition(": ")[2]].append(record)
    for label, records in groups.items():
        axes[0].plot(_times(records, run), [means[r.sequence][PICTURE].mean_dn for r in records], ".-", label=label)
    axes[0].set_xlabel(_time_label(run))
    axes[0].set_ylabel("mean count [DN]")
    axes[0].legend(fontsize=7)
    return png(figure)


def _sun_plot(run: Run) -> bytes:
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
    """Return when frames were taken, in the unit of `_time_label`; their numbers in a run that has no times."""
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
    is_long = first is None or last is None or abs((last - first).total_seconds()) > _LONG_S
    return (3600.0, "h") if is_long else (60.0, "min")


def _start(record: FrameRecord) -> datetime | None:
    return None if record.start_utc is None else datetime.fromisoformat(record.start_utc)
