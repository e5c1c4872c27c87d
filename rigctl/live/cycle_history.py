"""The cycles of a run one after the other: light, polarization, sum rule and drift, from the frames themselves."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

from rigctl.files.session_file import PICTURE
from rigctl.live.cycle_numbers import polarization, sum_rule
from rigctl.live.drift import Drift, drift_of
from rigctl.live.frame_summary import FrameSummary, frame_summary, of_one_exposure
from rigctl.live.light_levels import LightLevels
from rigctl.live.live_status import Estimate, RegionPolarization
from rigctl.live.mean_noise import mean_noise
from rigctl.live.region_means import PixelMean, RegionMeans
from rigctl.runs.frame_record import FrameRecord
from rigctl.runs.run_folder import Run
from rigctl.runs.run_inputs import files_of

Means = Mapping[int, Mapping[str, PixelMean]]


@dataclass(frozen=True, kw_only=True, eq=False)
class CycleLook:
    """Numbers of one cycle.

    Attributes
    ----------
    round, cycle : int or None
        Which.
    time_s : float
        When its first exposure began, in seconds since 1970 (UTC).
    sum_rule : Estimate or None
        (I0 + I90) / (I45 + I135) of the whole picture.
    regions : mapping
        Polarization by region; "picture" is the whole.
    drift : Drift or None
        Of the reference region, within the cycle or since the one before it in the same round.
    """

    round: int | None
    cycle: int | None
    time_s: float
    sum_rule: Estimate | None
    regions: Mapping[str, RegionPolarization]
    drift: Drift | None


@dataclass(frozen=True, kw_only=True)
class CycleHistory:
    """The cycles of a run.

    Attributes
    ----------
    reference : str
        The region by which drift is measured.
    looks : tuple of CycleLook
        In the order in which they were taken.
    """

    reference: str
    looks: tuple[CycleLook, ...]


def is_session(run: Run) -> bool:
    """Return whether a run was taken by a session, and not imported."""
    return run.session.is_of_session


def region_means_of(run: Run) -> Means:
    """Return the mean counts of the picture and of the session's regions in every frame, by sequence number.

    Raises
    ------
    RunFolderError
        A frame is damaged.
    """
    regions = RegionMeans(files_of(run)[1].regions if is_session(run) else ())
    return {record.sequence: regions.of(run.counts(record)) for record in run.frames}


def cycle_history(run: Run, means: Means) -> CycleHistory:
    """Return what the cycles of a session show.

    Parameters
    ----------
    run : Run
        Taken by a session.
    means : mapping
        As `region_means_of` gives them.

    Notes
    -----
    Frames of one round and cycle number belong together; takes that repeat a number at the same exposure are one. A
    cycle that lacks an angle since a frame of it is excluded is left out, as measuring leaves it out.
    """
    rig_file, session = files_of(run)
    noise = run.session.noise
    levels = LightLevels(noise=None if noise is None else mean_noise(noise))
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


def _torn_by_exclusions(run: Run) -> set[tuple[int | None, int | None]]:
    """Return the cycles that lack an angle, of those that the rest of the run has, since frames are excluded."""
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
        found = {
            name: polarization(frames, region=name, levels=levels, extinction_ratio=extinction_ratio)
            for name in frames[-1].means
        }
        yield CycleLook(
            round=frames[0].round,
            cycle=frames[0].cycle,
            time_s=frames[0].time_s,
            sum_rule=sum_rule(frames, region=PICTURE, levels=levels),
            regions={name: shown for name, shown in found.items() if shown is not None},
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
