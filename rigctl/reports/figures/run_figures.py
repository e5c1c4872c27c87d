"""Pictures of how a session went: its frames, their mean counts, the sun."""

from collections import defaultdict
from collections.abc import Sequence
from datetime import datetime

from rigctl.files.session_file import PICTURE
from rigctl.live.cycle_history import Means
from rigctl.live.session_history import Thumbnail
from rigctl.reports.figures.figure_style import png, subplots
from rigctl.runs.frame_record import FrameRecord
from rigctl.runs.run_folder import Run

# From here on times are in hours, below in minutes.
_LONG_S = 5400.0


def contact_sheet(thumbnails: Sequence[Thumbnail]) -> bytes:
    """Return some frames of a run, small."""
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


def count_plot(run: Run, means: Means) -> bytes:
    """Return mean counts against time, by kind of frame and angle."""
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
