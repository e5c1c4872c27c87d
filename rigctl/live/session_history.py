"""History of a session from its run folder: events, mean counts of every frame, cycles, and some frames to look at."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.live.cycle_history import CycleHistory, Means, cycle_history, is_session, region_means_of
from rigctl.runs.frame_record import FrameRecord
from rigctl.runs.monitor_readings import MonitorTrace, monitor_traces
from rigctl.runs.run_events import RunEvent, read_events
from rigctl.runs.run_folder import Run

_MOST_FRAMES, _MOST_DARKS, _TOGETHER = 24, 4, 4
_THUMBNAIL_PIXELS = 160


@dataclass(frozen=True, kw_only=True, eq=False)
class Thumbnail:
    """A frame, thinned out to some 160 pixels a row."""

    record: FrameRecord
    counts: NDArray[np.uint16]


@dataclass(frozen=True, kw_only=True, eq=False)
class SessionHistory:
    """History of a session.

    Attributes
    ----------
    run : Run
        Its folder's content.
    events : sequence of RunEvent
        What happened, in its order.
    means : mapping
        Mean counts of picture and regions by sequence number.
    cycles : CycleHistory or None
        None for a run that was imported.
    thumbnails : tuple of Thumbnail
        Frames spread over the run, 24 at most.
    monitors : tuple of MonitorTrace
        What sensors beside the frames said.
    """

    run: Run
    events: Sequence[RunEvent]
    means: Means
    cycles: CycleHistory | None
    thumbnails: tuple[Thumbnail, ...]
    monitors: tuple[MonitorTrace, ...] = ()


def session_history(run: Run) -> SessionHistory:
    """Return how a session went; every frame is read once, for its means.

    Raises
    ------
    RunFolderError
        A frame is damaged, or the events cannot be read.
    """
    events = read_events(run.path)
    means = region_means_of(run)
    return SessionHistory(
        run=run,
        events=events,
        means=means,
        cycles=cycle_history(run, means) if is_session(run) else None,
        monitors=monitor_traces(events),
        thumbnails=tuple(_thumbnail(run, record) for record in _spread(run.frames)),
    )


def _spread(frames: Sequence[FrameRecord]) -> list[FrameRecord]:
    if not frames:
        return []
    # In runs of several frames, one after the other, so that every angle is seen; darks all look the same.
    lit = [frame for frame in frames if frame.kind != "dark"]
    darks = [frame for frame in frames if frame.kind == "dark"][: _MOST_DARKS if lit else _MOST_FRAMES]
    most = _MOST_FRAMES - len(darks)
    groups = -(-min(most, len(lit)) // _TOGETHER)
    starts = np.unique(np.linspace(0, max(len(lit) - _TOGETHER, 0), groups).astype(int)).tolist()
    places = sorted({place for start in starts for place in range(start, start + _TOGETHER) if place < len(lit)})
    return [*darks, *(lit[place] for place in places[:most])]


def _thumbnail(run: Run, record: FrameRecord) -> Thumbnail:
    counts = run.counts(record)
    step = max(1, counts.shape[1] // _THUMBNAIL_PIXELS)
    return Thumbnail(record=record, counts=counts[::step, ::step])
