"""What a run folder holds, at a glance."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from rigctl.files.rig_file import unset_polarizer
from rigctl.numbers.angles import wrapped
from rigctl.runs.annotation_record import Annotation
from rigctl.runs.frame_record import FrameRecord, start_time_texts
from rigctl.runs.run_events import host_clock_text, read_events
from rigctl.runs.run_folder import Run

GroupKey = tuple[str, float | None, float | None, float | None]


@dataclass(frozen=True, kw_only=True)
class FrameGroup:
    """Frames that are of one kind and were taken alike.

    Attributes
    ----------
    kind : str
        "scene", "dark" or "flat".
    polarizer_angle_target_deg : float or None
        Angle that was asked for [deg].
    polarizer_angle_deg : (lowest, highest) or None
        Angles by readback [deg].
    exposure_s, gain_db : float or None
        Settings of the camera.
    frames, cycles : int
        How many.
    saturated_fraction : (lowest, highest)
        Share of saturated pixels in a frame.
    """

    kind: str
    polarizer_angle_target_deg: float | None
    polarizer_angle_deg: tuple[float, float] | None
    exposure_s: float | None
    gain_db: float | None
    frames: int
    cycles: int
    saturated_fraction: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class RunSummary:
    """What a run folder holds.

    Attributes
    ----------
    run : str
        The folder.
    origin : str
        "simulated", "device" or "import"; "not stated" where the session does not say.
    created_by, created_utc : str
        Which program made it, and when.
    frames : int
        How many frames there are.
    sizes : tuple of (width, height)
        In pixels.
    bit_depths : tuple of int
        Bits of a sample.
    black_levels_dn, saturations_dn, missing_dn : tuple of float
        Values that occur [DN].
    start_utc, end_utc : str or None
        First start and last end of an exposure.
    cameras, stages : tuple of str
        Model and serial number.
    groups : tuple of FrameGroup
        The frames, by kind, angle, exposure and gain.
    remarks : mapping
        What is noted in frames, and in how many.
    events : mapping
        What happened, and how often.
    doubts : tuple of str
        What is to be known before its numbers are used.
    start_times : tuple of str
        By what the starts of exposures were found, and by how much they may be off.
    host_clock : str or None
        How well this machine's clock was synchronised; None where the run does not say.
    excluded : tuple of int
        Frames that people have left out; they are not counted above.
    annotations : tuple of Annotation
        What people have noted.
    """

    run: str
    origin: str
    created_by: str
    created_utc: str
    frames: int
    sizes: tuple[tuple[int, int], ...]
    bit_depths: tuple[int, ...]
    black_levels_dn: tuple[float, ...]
    saturations_dn: tuple[float, ...]
    missing_dn: tuple[float, ...]
    start_utc: str | None
    end_utc: str | None
    cameras: tuple[str, ...]
    stages: tuple[str, ...]
    groups: tuple[FrameGroup, ...]
    remarks: dict[str, int]
    events: dict[str, int]
    doubts: tuple[str, ...] = ()
    start_times: tuple[str, ...] = ()
    host_clock: str | None = None
    excluded: tuple[int, ...] = ()
    annotations: tuple[Annotation, ...] = ()


def summarize_run(run: Run) -> RunSummary:
    """Return what a run holds, without opening its frames.

    Raises
    ------
    RunFolderError
        The events cannot be read.
    """
    frames, events = run.frames, read_events(run.path)
    return RunSummary(
        run=str(run.path),
        origin=run.session.origin or "not stated",
        created_by=run.created_by,
        created_utc=run.created_utc,
        frames=len(frames),
        sizes=tuple(sorted({(r.width, r.height) for r in frames})),
        bit_depths=tuple(sorted({r.bit_depth for r in frames})),
        black_levels_dn=_values(r.black_level_dn for r in frames),
        saturations_dn=_values(r.saturation_dn for r in frames),
        missing_dn=_values(r.missing_dn for r in frames),
        start_utc=min((r.start_utc for r in frames if r.start_utc), default=None),
        end_utc=max((r.end_utc for r in frames if r.end_utc), default=None),
        cameras=_devices((r.camera_model, r.camera_serial) for r in frames),
        stages=_devices((r.stage_model, r.stage_serial) for r in frames),
        groups=_groups(frames),
        remarks=dict(Counter(remark for r in frames for remark in r.remarks)),
        events=dict(Counter(event.event for event in events)),
        doubts=unset_polarizer(run.path, placeholder=run.session.polarizer.placeholder),
        start_times=start_time_texts(frames),
        host_clock=host_clock_text(events),
        excluded=tuple(record.sequence for record in run.excluded),
        annotations=run.annotations,
    )


def _values(values: Iterable[float | None]) -> tuple[float, ...]:
    return tuple(sorted({value for value in values if value is not None}))


def _devices(names: Iterable[tuple[str | None, str | None]]) -> tuple[str, ...]:
    return tuple(sorted({" ".join(filter(None, pair)) for pair in names if any(pair)}))


def _groups(frames: Iterable[FrameRecord]) -> tuple[FrameGroup, ...]:
    members: dict[GroupKey, list[FrameRecord]] = {}
    for record in frames:
        key = (record.kind, record.polarizer_angle_target_deg, record.exposure_s, record.gain_db)
        members.setdefault(key, []).append(record)
    return tuple(_group(key, records) for key, records in members.items())


def _group(key: GroupKey, records: list[FrameRecord]) -> FrameGroup:
    kind, angle_deg, exposure_s, gain_db = key
    angles = [_near(r.polarizer_angle_deg, angle_deg) for r in records if r.polarizer_angle_deg is not None]
    fractions = [r.saturated_fraction for r in records]
    return FrameGroup(
        kind=kind,
        polarizer_angle_target_deg=angle_deg,
        polarizer_angle_deg=(min(angles), max(angles)) if angles else None,
        exposure_s=exposure_s,
        gain_db=gain_db,
        frames=len(records),
        cycles=len({r.cycle for r in records if r.cycle is not None}),
        saturated_fraction=(min(fractions), max(fractions)),
    )


def _near(readback_deg: float, target_deg: float | None) -> float:
    """Return a readback on the half turn around its target: 179.999 deg is -0.001 beside 0 deg."""
    if target_deg is None:
        return readback_deg
    return target_deg + wrapped(readback_deg - target_deg, turn=180.0)
