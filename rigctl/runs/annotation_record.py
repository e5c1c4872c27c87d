"""What people note of a run, and which frames they leave out: the record of it, and what follows from many."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from rigctl.numbers.utc_time import is_utc_text
from rigctl.runs.frame_record import FrameRecord

MOST_TEXT = 2000
_UTC_DIGITS = 19


@dataclass(frozen=True, kw_only=True)
class Annotation:
    """Something that somebody says of a run.

    Attributes
    ----------
    utc : str
        When it was, as `rigctl.numbers.utc_time.utc_text` writes it; of an exclusion, when it was made.
    by : str
        Who says it.
    kind : {"note", "exclude", "include"}
        An exclusion takes frames out of every number, an inclusion takes them in again.
    frames : tuple of int
        Their sequence numbers; a note may be of none.
    text : str
        What there is to say.
    written_utc : str or None
        When the line was written.
    """

    utc: str
    by: str
    kind: Literal["note", "exclude", "include"]
    frames: tuple[Annotated[int, Field(ge=0)], ...] = ()
    text: str = ""
    written_utc: str | None = None

    def __post_init__(self) -> None:
        if not is_utc_text(self.utc):
            raise ValueError(f"utc is {self.utc!r}, which is no time")
        if self.kind != "note" and not self.frames:
            raise ValueError(f"kind is {self.kind}, and no frames are named")

    @property
    def facts(self) -> str:
        """What it says, in words."""
        frames = f"frames {frames_text(self.frames)}" if self.frames else ""
        return f"{': '.join(filter(None, (frames, self.text)))} ({self.by})"

    @property
    def line(self) -> str:
        """The whole of it as a line that a person reads."""
        return f"{self.utc[:_UTC_DIGITS]}Z  {self.kind:<14}  {self.facts}"


def left_out_texts(annotations: Sequence[Annotation], records: Iterable[FrameRecord]) -> tuple[str, ...]:
    """Return which frames are excluded and why, each in words."""
    excluded = excluded_frames(annotations)
    return tuple(
        f"frame {record.sequence}: excluded: {excluded[record.sequence].text} ({excluded[record.sequence].by})"
        for record in records
    )


def excluded_frames(annotations: Iterable[Annotation]) -> dict[int, Annotation]:
    """Return which frames are excluded in the end, by sequence number, and the line that says so."""
    found: dict[int, Annotation] = {}
    for one in annotations:
        for frame in one.frames:
            if one.kind == "exclude":
                found[frame] = one
            elif one.kind == "include":
                found.pop(frame, None)
    return dict(sorted(found.items()))


def exclusions_text(excluded: Mapping[int, Annotation]) -> str:
    """Return what is excluded in a line: frames by reason."""
    groups: dict[tuple[str, str], list[int]] = {}
    for frame, one in excluded.items():
        groups.setdefault((one.text, one.by), []).append(frame)
    return "; ".join(f"{frames_text(frames)}: {text} ({by})" for (text, by), frames in groups.items())


def frames_text(frames: Sequence[int]) -> str:
    """Return sequence numbers in short: ``12, 15-18``."""
    spans: list[list[int]] = []
    for frame in sorted(frames):
        if spans and frame == spans[-1][1] + 1:
            spans[-1][1] = frame
        else:
            spans.append([frame, frame])
    return ", ".join(f"{first}" if first == last else f"{first}-{last}" for first, last in spans)
