"""Annotating a run: a note, or frames that are left out of every number; frames themselves never change."""

import getpass
import re
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from datetime import UTC, date, datetime, timedelta
from datetime import time as time_of_day
from pathlib import Path

from rigctl.console.json_text import Json
from rigctl.errors import ConfigError
from rigctl.numbers.utc_time import is_utc_text, unix_ns, utc_moment, utc_text
from rigctl.runs.annotation_record import MOST_TEXT, Annotation, excluded_frames, frames_text
from rigctl.runs.annotations import annotate, read_annotations
from rigctl.runs.frame_record import FrameRecord
from rigctl.runs.run_folder import Run, read_run

_SPAN = re.compile(r"(\d{1,9})(?:-(\d{1,9}))?")
_SHOWN, _MOST_NAME = 8, 200
# The fewest directions that tell S0, S1 and S2.
_LEAST_ANGLES = 3
Clock = Callable[[], int]


@dataclass(frozen=True, kw_only=True)
class Annotated:
    """What was written into a run's annotations.

    Attributes
    ----------
    run : Path
        Its folder.
    annotation : Annotation or None
        The line; None where there was nothing to change.
    excluded : tuple of int
        Frames that are excluded now.
    remarks : tuple of str
        What is to be known about that.
    """

    run: Path
    annotation: Annotation | None
    excluded: tuple[int, ...]
    remarks: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Json]:
        """Return the answer of `rigctl note` and `rigctl exclude`."""
        return {
            "run": str(self.run),
            "annotation": None if self.annotation is None else asdict(self.annotation),
            "excluded": list(self.excluded),
            "remarks": list(self.remarks),
        }


def note_run(path: Path, text: str, *, at: str | None, by: str | None, utc_ns: Clock = time.time_ns) -> Annotated:
    """Return what was noted of a run, once it is on the disk.

    Parameters
    ----------
    path : Path
        Run folder; a session may still write into it.
    text : str
        The note, 1 to 2000 characters.
    at : str or None
        When it was: ``14:10`` on the day of the run (UTC where it has no zone), or a whole time with its zone; None
        is now.
    by : str or None
        Who says it; None is the login name.
    utc_ns : callable
        The clock [ns].

    Raises
    ------
    ConfigError, RunFolderError
        A text cannot be taken, or the folder is no sound run.
    """
    run = read_run(path)
    now_ns = utc_ns()
    utc, remarks = (utc_text(now_ns), ()) if at is None else _moment(at, run.frames)
    note = Annotation(utc=utc, by=_who(by), kind="note", text=_said("the note", text), written_utc=utc_text(now_ns))
    excluded = excluded_frames(read_annotations(path))
    annotate(path, note)
    return Annotated(run=path, annotation=note, excluded=tuple(excluded), remarks=remarks)


def exclude_frames(
    path: Path, frames: str, *, reason: str | None, undo: bool, by: str | None, utc_ns: Clock = time.time_ns
) -> Annotated:
    """Return which frames of a run are left out of every number from now on, once that is on the disk.

    Parameters
    ----------
    path : Path
        Run folder.
    frames : str
        Sequence numbers, such as ``12,15-18``.
    reason : str or None
        Why; has to be said unless they are taken in again.
    undo : bool
        Take them in again.
    by : str or None
        Who says so; None is the login name.
    utc_ns : callable
        The clock [ns].

    Raises
    ------
    ConfigError, RunFolderError
        There are no such frames, no reason, or the folder is no sound run.
    """
    run = read_run(path)
    asked = _sequences(frames, run)
    text = "" if undo and reason is None else _said("--reason", reason or "")
    before = excluded_frames(read_annotations(path))
    changed = tuple(frame for frame in asked if (frame in before) == undo)
    word = "not excluded" if undo else "excluded already"
    rest = frames_text([frame for frame in asked if frame not in changed])
    remarks = [f"frames {rest}: {word}; nothing changes for them"] if rest else []
    if not changed:
        return Annotated(run=path, annotation=None, excluded=tuple(before), remarks=tuple(remarks))
    now = utc_text(utc_ns())
    line = Annotation(
        utc=now, by=_who(by), kind="include" if undo else "exclude", frames=changed, text=text, written_utc=now
    )
    annotate(path, line)
    excluded = tuple(excluded_frames((*read_annotations(path),)))
    remarks += [] if undo else _consequences(run, set(excluded), set(changed))
    return Annotated(run=path, annotation=line, excluded=excluded, remarks=tuple(remarks))


def _sequences(text: str, run: Run) -> tuple[int, ...]:
    """Return the frames that a text names.

    Raises
    ------
    ConfigError
        It is no list of frames, or names frames that the run does not have.
    """
    there = [record.sequence for record in run.frames]
    found: dict[int, None] = {}
    unknown = []
    for part in text.split(","):
        span = _SPAN.fullmatch(part.strip())
        if span is None or int(span[2] or span[1]) < int(span[1]):
            raise ConfigError(f"--frames: {part.strip()!r} is no frame; write numbers and ranges like 12,15-18")
        first, last = int(span[1]), int(span[2] or span[1])
        named = [frame for frame in there if first <= frame <= last]
        if len(named) != last - first + 1:
            unknown.append(part.strip())
        found |= dict.fromkeys(named)
    if unknown:
        has = f"it has {frames_text(there)}" if there else "it has none"
        raise ConfigError(f"--frames: {', '.join(unknown[:_SHOWN])}: not all of them are frames of {run.path}; {has}")
    return tuple(sorted(found))


def _consequences(run: Run, excluded: set[int], changed: set[int]) -> list[str]:
    """Return what a run cannot give any more without some frames, in words."""
    scenes = [record for record in run.frames if record.kind == "scene"]
    if scenes and all(record.sequence in excluded for record in scenes):
        return ["no scene frame is left: the run has no numbers until frames are taken in again (--undo)"]
    left = [record for record in scenes if record.sequence not in excluded]
    gone = sorted(_angles(scenes) - _angles(left))
    found = []
    if gone:
        angles = ", ".join(f"{angle:g}" for angle in gone)
        few = len(_angles(left)) < _LEAST_ANGLES
        found.append(
            f"no frame at {angles} deg is left: "
            + ("the rest does not tell S0, S1 and S2" if few else "the run is measured at the other angles")
        )
    cycles = {(one.round, one.cycle) for one in scenes if one.sequence in changed and one.cycle is not None}
    torn = [one.sequence for one in left if (one.round, one.cycle) in cycles]
    if torn and not gone:
        found.append(f"cycles are used whole: frames {frames_text(torn)} of the same cycles go with them")
    for kind in ("dark", "flat"):
        of_kind = [record.sequence for record in run.frames if record.kind == kind]
        if of_kind and excluded.issuperset(of_kind):
            found.append(f"no {kind} frame is left")
    return found


def _angles(records: Iterable[FrameRecord]) -> set[float]:
    return {
        round(angle % 180.0, 1) % 180.0
        for one in records
        if (angle := one.polarizer_angle_target_deg or one.polarizer_angle_deg) is not None
    }


def _moment(text: str, frames: Iterable[FrameRecord]) -> tuple[str, tuple[str, ...]]:
    """Return a time as it is kept, and how it was understood."""
    starts = [utc_moment(one.start_utc) for one in frames if one.start_utc is not None and is_utc_text(one.start_utc)]
    try:
        of_day = time_of_day.fromisoformat(text)
    except ValueError:
        moment = _whole_time(text)
    else:
        moment = _on_day_of_run(text, of_day, starts)
    utc = utc_text(unix_ns(moment))
    remarks = [f"--at {text} is taken as {utc[:19]}Z"] if "-" not in text[:8] else []
    if starts and not min(starts) <= moment <= max(starts) + timedelta(minutes=1):
        remarks.append(f"{utc[:19]}Z lies outside the run, {min(starts):%Y-%m-%dT%H:%M:%SZ} to {max(starts):%H:%M:%SZ}")
    return utc, tuple(remarks)


def _whole_time(text: str) -> datetime:
    try:
        moment = datetime.fromisoformat(text)
    except ValueError as error:
        raise ConfigError(f"--at: {text!r} is no time; write it like 14:10, or 2026-05-04T14:10Z") from error
    if moment.tzinfo is None:
        raise ConfigError(f"--at: {text!r} has no zone; write {text}Z for UTC, or {text}+02:00")
    return moment.astimezone(UTC)


def _on_day_of_run(text: str, of_day: time_of_day, starts: list[datetime]) -> datetime:
    """Return the moment of a run's own days that a time of day means: the one inside the run, else the nearest."""
    if not starts:
        raise ConfigError(f"--at: {text!r}: the frames do not say when they were taken; write it with its day")
    zone = of_day.tzinfo or UTC
    first, last = min(starts), max(starts)
    days = range(first.astimezone(zone).toordinal(), last.astimezone(zone).toordinal() + 1)
    moments = [datetime.combine(date.fromordinal(day), of_day.replace(tzinfo=zone)).astimezone(UTC) for day in days]
    inside = [moment for moment in moments if first <= moment <= last]
    if len(inside) > 1:
        raise ConfigError(f"--at: {text!r} occurs {len(inside)} times in this run; write it with its day")
    return min(inside or moments, key=lambda moment: max(first - moment, moment - last))


def _said(name: str, text: str) -> str:
    said = text.strip()
    if not said:
        raise ConfigError(f"{name}: is empty; say it in words")
    if len(said) > MOST_TEXT:
        raise ConfigError(f"{name}: has {len(said)} characters; allowed are {MOST_TEXT}")
    if any(not character.isprintable() and character != "\n" for character in said):
        raise ConfigError(f"{name}: holds control characters, or bytes that are no text")
    return said.replace("\n", " ")


def _who(by: str | None) -> str:
    if by is not None:
        return _said("--by", by)
    try:
        name = getpass.getuser()
    except (OSError, KeyError):  # a container may know no name for its user
        return "unknown"
    # The environment may say anything for it.
    return "".join(letter if letter.isprintable() else "?" for letter in name.strip()[:_MOST_NAME]) or "unknown"
