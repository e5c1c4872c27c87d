"""History of a session from its run folder: events, means of every frame, cycles, and change of the light."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from rigctl.base.numbers import percent
from rigctl.files.session_file import PICTURE
from rigctl.runs.folder import Run, files_of
from rigctl.runs.records import FrameRecord, MonitorTrace, RunEvent, monitor_traces, read_events
from rigctl.session.numbers import (
    FrameSummary,
    LightLevels,
    PixelMean,
    RegionMeans,
    drift_of,
    frame_summary,
    of_one_exposure,
    polarizations,
    sum_rule,
)
from rigctl.session.status import Estimate, RegionDrift, RegionPolarization

Means = Mapping[int, Mapping[str, PixelMean]]
_MOST_FRAMES, _MOST_DARKS, _TOGETHER = 24, 4, 4
_THUMBNAIL_PIXELS = 160


@dataclass(frozen=True, kw_only=True, eq=False)
class CycleLook:
    """Numbers of one cycle."""

    round: int | None
    cycle: int | None
    time_s: float  #: Start of its first exposure, in seconds since 1970 (UTC).
    sum_rule: Estimate | None  #: (I0 + I90) / (I45 + I135) of the whole picture.
    regions: Mapping[str, RegionPolarization]  #: Polarization by region; "picture" is the whole.
    #: Drift of the reference region within the cycle, or since the previous cycle of the same round.
    drift: RegionDrift | None


@dataclass(frozen=True, kw_only=True)
class CycleHistory:
    """The cycles of a run."""

    reference: str  #: The region by which drift is measured.
    looks: tuple[CycleLook, ...]  #: In the order of time.


@dataclass(frozen=True, kw_only=True, eq=False)
class SessionHistory:
    """A run with what happened in it."""

    run: Run
    events: Sequence[RunEvent]  #: In the order of time.
    means: Means  #: Mean counts of picture and regions by sequence number.
    cycles: CycleHistory | None  #: None for a run that was imported.
    #: At most 24 frames spread over the run, reduced to about 160 pixels a row.
    thumbnails: tuple[tuple[FrameRecord, NDArray[np.uint16]], ...]
    monitors: tuple[MonitorTrace, ...] = ()


def session_history(run: Run) -> SessionHistory:
    """Return the history of a session; every frame is read once, for its means."""
    events = read_events(run.path)
    means = region_means_of(run)
    return SessionHistory(
        run=run,
        events=events,
        means=means,
        cycles=cycle_history(run, means) if run.session.is_of_session else None,
        monitors=monitor_traces(events),
        thumbnails=tuple((record, _thinned(run.counts(record))) for record in _spread(run.frames)),
    )


def cycle_history(run: Run, means: Means) -> CycleHistory:
    """Return the numbers of each cycle of a session.

    Frames of one round and cycle number belong together; takes that repeat a number at the same exposure count
    as one. A cycle that lacks an angle because a frame is excluded is left out, as in measurements.
    """
    rig_file, session = files_of(run)
    levels = LightLevels(run.session.noise)
    torn = _torn_by_exclusions(run)
    dated = (record for record in run.frames if record.start_utc is not None)
    used = [record for record in dated if record.kind != "scene" or (record.round, record.cycle) not in torn]
    seen = [_seen(record, means[record.sequence]) for record in used]
    for frame in seen:
        if frame.kind == "dark":
            levels.add_dark(frame)
    reference = session.reference_region or PICTURE
    extinction_ratio = rig_file.polarizer.extinction_ratio
    looks = _looks(seen, levels, reference=reference, extinction_ratio=extinction_ratio)
    return CycleHistory(reference=reference, looks=tuple(looks))


def region_means_of(run: Run) -> Means:
    """Return the mean counts of the picture and of the session's regions in every frame, by sequence number."""
    regions = RegionMeans(files_of(run)[1].regions if run.session.is_of_session else ())
    return {record.sequence: regions.of(run.counts(record)) for record in run.frames}


def light_lines(history: CycleHistory, monitors: Sequence[MonitorTrace]) -> Iterator[str]:
    """Yield sentences on the change of the light, and on how much of it the light sensors explain."""
    for trace in monitors:
        found = []
        for look in history.looks if trace.follows_light else ():
            region, reading = look.regions.get(history.reference), trace.at(look.time_s)
            if region is not None and reading is not None and reading > 0.0 and region.light_dn_per_s > 0.0:
                found.append((region.light_dn_per_s, reading))
        if len(found) < 2:
            continue
        first_light, first_reading = found[0]
        light = [one / first_light - 1.0 for one, _ in found]
        left = [one / first_light * first_reading / reading - 1.0 for one, reading in found]
        reading = found[-1][1] / first_reading - 1.0
        yield (
            f"Light of {history.reference} changed by {percent(light[-1], sign=True)} over the run and by "
            f"{percent(max(map(abs, light)))} at most, {trace.monitor} by {percent(reading, sign=True)}; divided "
            f"by it {percent(left[-1], sign=True)} is left, {percent(max(map(abs, left)))} at most"
        )


def _torn_by_exclusions(run: Run) -> set[tuple[int | None, int | None]]:
    """Return the cycles that lack an angle because frames are excluded."""
    excluded = {(one.round, one.cycle) for one in run.excluded if one.kind == "scene" and one.cycle is not None}
    if not excluded:
        return set()
    angles: dict[tuple[int | None, int | None], set[str]] = defaultdict(set)
    for one in run.frames:
        if one.kind == "scene":
            angles[one.round, one.cycle].add(str(one.polarizer_angle_target_deg))
    every = set().union(*angles.values())
    return {cycle for cycle in excluded if angles[cycle] < every}


def _looks(
    seen: Sequence[FrameSummary], levels: LightLevels, *, reference: str, extinction_ratio: float | None
) -> Iterator[CycleLook]:
    before: tuple[FrameSummary, ...] = ()
    for frames in map(of_one_exposure, _cycles(seen)):
        earlier = before if before and before[-1].round == frames[-1].round else ()
        yield CycleLook(
            round=frames[0].round,
            cycle=frames[0].cycle,
            time_s=frames[0].time_s,
            sum_rule=sum_rule(frames, region=PICTURE, levels=levels),
            regions=polarizations(frames, levels=levels, extinction_ratio=extinction_ratio),
            drift=drift_of(frames, earlier, region=reference, levels=levels),
        )
        before = frames


def _cycles(seen: Sequence[FrameSummary]) -> list[list[FrameSummary]]:
    cycles: dict[tuple[int | None, int | None], list[FrameSummary]] = defaultdict(list)
    for frame in seen:
        if frame.kind == "scene" and frame.angle_deg is not None:
            cycles[frame.round, frame.cycle].append(frame)
    return list(cycles.values())


def _seen(record: FrameRecord, means: Mapping[str, PixelMean]) -> FrameSummary:
    time_s = datetime.fromisoformat(record.start_utc or "").timestamp()
    return frame_summary(record, means, time_s=time_s, saturated_fraction=record.saturated_fraction)


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


def _thinned(counts: NDArray[np.uint16]) -> NDArray[np.uint16]:
    step = max(1, counts.shape[1] // _THUMBNAIL_PIXELS)
    return counts[::step, ::step]
