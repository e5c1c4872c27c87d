"""Health of a rig over its runs: drifts, losses and changes; one dark frame of each run is opened."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from statistics import median

import numpy as np

from rigctl.base.numbers import is_utc_text, wrapped
from rigctl.console import Json
from rigctl.errors import DataError
from rigctl.runs.folder import Run, read_run
from rigctl.runs.records import TALLY_EVENT, FrameRecord, RunEvent, read_events

_PPM = 1e6
# Least time between events to measure a clock that NTP sets in steps of milliseconds.
_LEAST_CLOCK_S = 10.0
# Distance of an outlier from the others of its device, in scaled median deviations (a choice).
_OFF, _TO_SIGMA, _LEAST_RUNS = 6.0, 1.4826, 4
_LOST = ("damaged", "too old", "never came")


@dataclass(frozen=True, kw_only=True)
class RunHealth:
    """Numbers of a run that should stay constant."""

    run: str  #: Its folder, from the archive's root.
    utc: str  #: Start of its first frame.
    camera: str  #: Serial numbers.
    stage: str
    stage_error_deg: float | None  #: Rms difference between stage angles and targets [deg].
    stage_tries: float | None  #: Mean number of moves per angle.
    lost_frames: int | None  #: Pictures counted by the camera and missing in the run.
    dark_dn: float | None  #: Mean of the first dark frame [DN].
    gain_dn_per_e: float | None  #: Of the noise calibration of the session.
    axis_deg: float | None  #: Offset of the polarizer by the rig file [deg].
    clock_ppm: float | None  #: Rate of the host's clock less that of its monotonic one.
    temperature_c: float | None  #: Of the camera, the mean [deg C].


@dataclass(frozen=True, kw_only=True)
class Change:
    """A change since the run before."""

    run: str
    utc: str
    what: str
    before: str
    after: str


@dataclass(frozen=True, kw_only=True)
class OutlyingNumber:
    """A number far from those of the other runs of its device."""

    run: str
    what: str
    value: float
    usual: float


@dataclass(frozen=True, kw_only=True)
class ArchiveHealth:
    """All runs in order of time, changes between them, outliers, and unreadable runs."""

    runs: tuple[RunHealth, ...]
    changes: tuple[Change, ...]
    outlying: tuple[OutlyingNumber, ...]
    unread: Mapping[str, str]

    def as_json(self) -> dict[str, Json]:
        """Return the answer of `rigctl archive health`."""
        return {
            "runs": [asdict(one) for one in self.runs],
            "changes": [asdict(one) for one in self.changes],
            "outlying": [asdict(one) for one in self.outlying],
            "unread": dict(self.unread),
        }


_NUMBERS = ("stage_error_deg", "stage_tries", "lost_frames", "dark_dn", "gain_dn_per_e", "clock_ppm")


def health_of(root: Path, folders: Sequence[Path]) -> ArchiveHealth:
    """Return the health of a rig over runs."""
    found: list[tuple[RunHealth, dict[str, str]]] = []
    unread = {}
    for folder in folders:
        name = folder.relative_to(root).as_posix()
        try:
            run = read_run(folder)
            found.append((_health(name, run), _settings(run)))
        except DataError as error:
            unread[name] = str(error).partition("\n")[0]
    found.sort(key=lambda pair: pair[0].utc)
    runs = tuple(one for one, _ in found)
    return ArchiveHealth(runs=runs, changes=tuple(_changes(found)), outlying=tuple(_outlying(runs)), unread=unread)


def _health(name: str, run: Run) -> RunHealth:
    frames, events = run.frames, read_events(run.path)
    moved = [
        wrapped(one.stage_angle_deg - one.stage_angle_target_deg, turn=360.0)
        for one in frames
        if one.stage_angle_deg is not None and one.stage_angle_target_deg is not None
    ]
    dark = next((one for one in frames if one.kind == "dark"), None)
    polarizer, noise = run.session.polarizer, run.session.noise
    return RunHealth(
        run=name,
        utc=min((one.start_utc for one in frames if one.start_utc), default=run.created_utc),
        camera=_serial(frames, "camera_serial"),
        stage=_serial(frames, "stage_serial"),
        stage_error_deg=float(np.sqrt(np.mean(np.square(moved)))) if moved else None,
        stage_tries=_mean([one.stage_tries for one in frames]),
        lost_frames=_lost(events),
        dark_dn=None if dark is None else float(run.counts(dark).mean()),
        gain_dn_per_e=None if noise is None else noise.gain_dn_per_e,
        axis_deg=polarizer.offset_deg,
        clock_ppm=_clock_ppm(events),
        temperature_c=_mean([one.camera_temperature_c for one in frames]),
    )


def _serial(frames: Sequence[FrameRecord], name: str) -> str:
    return ", ".join(sorted({serial for one in frames if (serial := getattr(one, name)) is not None}))


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _lost(events: Sequence[RunEvent]) -> int | None:
    tallies = [event.facts for event in events if event.event == TALLY_EVENT]
    counts = [value for facts in tallies for key, value in facts.items() if key.replace("_", " ") in _LOST]
    return sum(value for value in counts if isinstance(value, int)) if tallies else None


def _clock_ppm(events: Sequence[RunEvent]) -> float | None:
    """Return the rate of the host's clock less that of its monotonic one, over the longest span of one process."""
    timed = [
        (_to_microsecond(one.utc), one.monotonic_ns) for one in events if one.monotonic_ns and is_utc_text(one.utc)
    ]
    if len(timed) < 2 or timed[-1][1] <= timed[0][1]:
        return None
    spent_s = (timed[-1][1] - timed[0][1]) / 1e9
    return _PPM * ((timed[-1][0] - timed[0][0]).total_seconds() / spent_s - 1.0) if spent_s > _LEAST_CLOCK_S else None


def _to_microsecond(utc: str) -> datetime:
    return datetime.fromisoformat(utc[:26].rstrip("Z") + "+00:00")


def _settings(run: Run) -> dict[str, str]:
    """Return the settings made by people, whose changes explain changes of numbers."""
    polarizer, noise = run.session.polarizer, run.session.noise
    return {
        "camera": _serial(run.frames, "camera_serial"),
        "stage": _serial(run.frames, "stage_serial"),
        "axis": f"sense {polarizer.sense}, offset {polarizer.offset_deg}",
        "noise calibration": "none" if noise is None else f"gain {noise.gain_dn_per_e:.6g} DN/e",
        "camera's gain [dB]": ", ".join(sorted({f"{one.gain_db:g}" for one in run.frames if one.gain_db is not None})),
        "camera's address": run.session.camera_address,
        "program": run.created_by,
    }


def _changes(found: Sequence[tuple[RunHealth, dict[str, str]]]) -> Iterator[Change]:
    for (_, before), (one, after) in pairwise(found):
        for what, value in after.items():
            if value != before[what]:
                yield Change(run=one.run, utc=one.utc, what=what, before=before[what], after=value)


def _outlying(runs: Sequence[RunHealth]) -> Iterator[OutlyingNumber]:
    for what in _NUMBERS:
        of_device: dict[str, list[tuple[RunHealth, float]]] = {}
        for one in runs:
            value = getattr(one, what)
            if value is not None:
                of_device.setdefault(one.stage if what.startswith("stage") else one.camera, []).append((one, value))
        for rows in of_device.values():
            yield from _far(what, rows)


def _far(what: str, rows: Sequence[tuple[RunHealth, float]]) -> Iterator[OutlyingNumber]:
    usual = median(value for _, value in rows)
    spread = _TO_SIGMA * median(abs(value - usual) for _, value in rows)
    # Least relative spread, since nearly equal numbers differ only in their last digits.
    limit = max(_OFF * spread, 1e-3 * abs(usual), 0.5 if what == "lost_frames" else 0.0)
    if len(rows) < _LEAST_RUNS:
        return
    for one, value in rows:
        if abs(value - usual) > limit:
            yield OutlyingNumber(run=one.run, what=what, value=value, usual=usual)
