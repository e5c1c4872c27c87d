"""`rigctl note`: notes on a run, and frames that are excluded from all results. Frames never change."""

import getpass
import re
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from datetime import UTC, date, datetime, timedelta
from datetime import time as time_of_day
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from rigctl.base.numbers import is_utc_text, unix_ns, utc_moment, utc_text
from rigctl.console import Json, warn
from rigctl.errors import ConfigError
from rigctl.verbs.options import Part, Result, RunPath

if TYPE_CHECKING:
    from rigctl.runs.folder import Run as RunRecord
    from rigctl.runs.records import Annotation, FrameRecord

_SPAN = re.compile(r"(\d{1,9})(?:-(\d{1,9}))?")
_SHOWN, _MOST_NAME = 8, 200
_LEAST_ANGLES = 3  # least number of directions to determine S0, S1 and S2


def note(
    run: RunPath,
    text: str | None = None,
    /,
    *,
    exclude: str | None = None,
    include: str | None = None,
    at: str | None = None,
    by: str | None = None,
    utc_ns: Annotated[Callable[[], int], Parameter(parse=False)] = time.time_ns,
) -> "Noted":
    """Write a note about a run, or exclude frames from all results, with a reason.

    Notes appear in the log, the page and the reports of the run, with time and name. They are kept in annotations.jsonl
    of the run; frames never change. Every command leaves out excluded frames and says so, unless --ignore-exclusions is
    given.

    Example: rigctl note runs/2026-05-04 "a cloud passed" --at 10:00 --by ann

    Example: rigctl note runs/2026-05-04 --exclude 12,15-18 "a bird" --by ann

    Parameters
    ----------
    run : path or Run
        Run folder; the session may still be running.
    text : str
        Note, or reason for excluding frames, in quotes.
    exclude : str
        Numbers of frames to exclude, such as 12,15-18; file names have them.
    include : str
        Numbers of frames to use again.
    at : str
        Time of the note, such as 14:10 (UTC) or 2026-05-04T14:10Z; default: now.
    by : str
        Name of the author; default: the login name.
    utc_ns
        Clock [ns since 1970 UTC].
    """
    from rigctl.runs.folder import read_run

    path = Path(run)
    if exclude is not None and include is not None:
        raise ConfigError("--exclude, --include: give one of them")
    if at is not None and (exclude is not None or include is not None):
        raise ConfigError("--at: is the time of a note; frames are excluded now")
    if exclude is not None:
        found = _change_frames(read_run(path), ("--exclude", exclude), text, by=by, utc_ns=utc_ns)
    elif include is not None:
        found = _change_frames(read_run(path), ("--include", include), text, by=by, utc_ns=utc_ns)
    else:
        found = _note(read_run(path), text or "", at=at, by=by, utc_ns=utc_ns)
    for remark in found.remarks:
        warn(remark)
    return found


@dataclass(frozen=True, kw_only=True)
class Noted(Result):
    """Annotations that were written."""

    run: Path
    annotation: "Annotation | None"  #: the line that was written; None if nothing changed
    excluded: tuple[int, ...]  #: frames that are now excluded
    remarks: tuple[str, ...] = ()
    is_of_frames: bool = False  #: frames were excluded or included

    def content(self) -> Iterable[Part]:
        """Return the line, and the frames that are now excluded."""
        from rigctl.runs.records import frames_text

        if self.annotation is not None:
            yield self.annotation.line
        if self.is_of_frames:
            yield f"excluded are now: {frames_text(self.excluded) or 'none'}"

    def as_json(self) -> dict[str, Json]:
        """Return the line, the excluded frames and the remarks."""
        return {
            "run": str(self.run),
            "annotation": None if self.annotation is None else asdict(self.annotation),
            "excluded": list(self.excluded),
            "remarks": list(self.remarks),
        }


def _note(run: "RunRecord", text: str, *, at: str | None, by: str | None, utc_ns: Callable[[], int]) -> Noted:
    from rigctl.runs.folder import annotate, read_annotations
    from rigctl.runs.records import Annotation, excluded_frames

    now = utc_text(utc_ns())
    utc, remarks = (now, ()) if at is None else _moment(at, run.frames)
    line = Annotation(utc=utc, by=_who(by), kind="note", text=_sound("the note", text), written_utc=now)
    excluded = excluded_frames(read_annotations(run.path))
    annotate(run.path, line)
    return Noted(run=run.path, annotation=line, excluded=tuple(excluded), remarks=remarks)


def _change_frames(
    run: "RunRecord", frames: tuple[str, str], reason: str | None, *, by: str | None, utc_ns: Callable[[], int]
) -> Noted:
    """Exclude frames, or include them again."""
    from rigctl.runs.folder import annotate, read_annotations
    from rigctl.runs.records import Annotation, excluded_frames, frames_text

    asked, is_back = _sequences(*frames, run), frames[0] == "--include"
    text = "" if is_back and reason is None else _sound("the reason", reason or "")
    before = excluded_frames(read_annotations(run.path))
    changed = tuple(frame for frame in asked if (frame in before) == is_back)
    rest = frames_text([frame for frame in asked if frame not in changed])
    word = "not excluded" if is_back else "excluded already"
    remarks = [f"frames {rest}: {word}; nothing changes for them"] if rest else []
    if not changed:
        return Noted(run=run.path, annotation=None, excluded=tuple(before), remarks=tuple(remarks), is_of_frames=True)
    now = utc_text(utc_ns())
    line = Annotation(
        utc=now, by=_who(by), kind="include" if is_back else "exclude", frames=changed, text=text, written_utc=now
    )
    annotate(run.path, line)
    excluded = tuple(excluded_frames(read_annotations(run.path)))
    remarks += [] if is_back else _consequences(run, set(excluded), set(changed))
    return Noted(run=run.path, annotation=line, excluded=excluded, remarks=tuple(remarks), is_of_frames=True)


def _sequences(option: str, text: str, run: "RunRecord") -> tuple[int, ...]:
    """Return the frames of a text such as 12,15-18."""
    from rigctl.runs.records import frames_text

    there = [record.sequence for record in run.frames]
    found: dict[int, None] = {}
    unknown = []
    for part in text.split(","):
        span = _SPAN.fullmatch(part.strip())
        if span is None or int(span[2] or span[1]) < int(span[1]):
            raise ConfigError(f"{option}: {part.strip()!r} is not a frame; write numbers and ranges like 12,15-18")
        first, last = int(span[1]), int(span[2] or span[1])
        named = [frame for frame in there if first <= frame <= last]
        if len(named) != last - first + 1:
            unknown.append(part.strip())
        found |= dict.fromkeys(named)
    if unknown:
        has = f"it has {frames_text(there)}" if there else "it has none"
        raise ConfigError(f"{option}: {', '.join(unknown[:_SHOWN])}: not all of them are frames of {run.path}; {has}")
    return tuple(sorted(found))


def _consequences(run: "RunRecord", excluded: set[int], changed: set[int]) -> list[str]:
    """Return texts on what the run loses by the excluded frames."""
    from rigctl.runs.records import frames_text

    scenes = [record for record in run.frames if record.kind == "scene"]
    if scenes and all(record.sequence in excluded for record in scenes):
        return ["no scene frame is left: the run has no results until frames are included again (--include)"]
    left = [record for record in scenes if record.sequence not in excluded]
    gone = sorted(_angles(scenes) - _angles(left))
    found = []
    if gone:
        angles = ", ".join(f"{angle:g}" for angle in gone)
        few = len(_angles(left)) < _LEAST_ANGLES
        found.append(
            f"no frame at {angles} deg is left: "
            + ("the rest does not determine S0, S1 and S2" if few else "the run is measured at the other angles")
        )
    cycles = {(one.round, one.cycle) for one in scenes if one.sequence in changed and one.cycle is not None}
    torn = [one.sequence for one in left if (one.round, one.cycle) in cycles]
    if torn and not gone:
        found.append(f"only complete cycles are used: frames {frames_text(torn)} of the same cycles are left out, too")
    for kind in ("dark", "flat"):
        of_kind = [record.sequence for record in run.frames if record.kind == kind]
        if of_kind and excluded.issuperset(of_kind):
            found.append(f"no {kind} frame is left")
    return found


def _angles(records: "Iterable[FrameRecord]") -> set[float]:
    return {
        round(angle % 180.0, 1) % 180.0
        for one in records
        if (angle := one.polarizer_angle_target_deg or one.polarizer_angle_deg) is not None
    }


def _moment(text: str, frames: "Iterable[FrameRecord]") -> tuple[str, tuple[str, ...]]:
    """Return a time in UTC, and a text on how it was understood."""
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
        raise ConfigError(f"--at: {text!r} is not a time; write it like 14:10, or 2026-05-04T14:10Z") from error
    if moment.tzinfo is None:
        raise ConfigError(f"--at: {text!r} has no zone; write {text}Z for UTC, or {text}+02:00")
    return moment.astimezone(UTC)


def _on_day_of_run(text: str, of_day: time_of_day, starts: list[datetime]) -> datetime:
    """Return the time within the run at a time of day; if there is none, the nearest on its days."""
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


def _sound(name: str, text: str) -> str:
    """Return a text if it may be stored in a line."""
    from rigctl.runs.records import MOST_TEXT

    said = text.strip()
    if not said:
        raise ConfigError(f"{name}: is empty; write it in words")
    if len(said) > MOST_TEXT:
        raise ConfigError(f"{name}: has {len(said)} characters; allowed are {MOST_TEXT}")
    if any(not character.isprintable() and character != "\n" for character in said):
        raise ConfigError(f"{name}: contains control characters, or bytes that are not text")
    return said.replace("\n", " ")


def _who(by: str | None) -> str:
    if by is not None:
        return _sound("--by", by)
    try:
        name = getpass.getuser()
    except (OSError, KeyError):  # a container may have no name for its user
        return "unknown"
    # It may come from the environment, so it is checked.
    return "".join(letter if letter.isprintable() else "?" for letter in name.strip()[:_MOST_NAME]) or "unknown"
