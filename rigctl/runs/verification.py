"""Verification of a run folder: every checksum again, and manifest against headers."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rigctl.errors import DataError
from rigctl.runs.fits.fits_frame import decode_frame
from rigctl.runs.fits.frame_header import record_from_header
from rigctl.runs.frame_record import EXPOSURE_PARTS, FrameRecord
from rigctl.runs.run_folder import FRAMES_FOLDER, MANIFEST_FILE, Contents, file_checksum, read_contents, read_frame
from rigctl.runs.wholeness import State, wholeness
from rigctl.storage.bounded_file import MOST_OWN_FRAME_BYTES, read_bounded
from rigctl.storage.durable_file import PART_SUFFIX

_WHOLE = "a whole frame that the manifest does not name: not acknowledged"

Watch = Callable[[Sequence[FrameRecord]], Iterable[FrameRecord]]


@dataclass(frozen=True, kw_only=True)
class Finding:
    """Something about one file of a run folder.

    Attributes
    ----------
    file : str
        Path relative to the run folder.
    problem : str
        What there is to say of it.
    """

    file: str
    problem: str


@dataclass(frozen=True, kw_only=True)
class Verification:
    """Findings of a verification.

    Attributes
    ----------
    ok : bool
        Nothing is bad.
    frames : int
        How many frames the manifest names.
    bad : tuple of Finding
        Damaged, missing, or contradicting files.
    leftovers : tuple of Finding
        What a killed writer leaves: never acknowledged, so no data are lost by it.
    state : {"whole", "unfinished", "damaged"}
        Whole: nothing is bad, and the session has noted its end over these very frames.
    gaps : tuple of str
        Steps of the session's plan that have no frame.
    unchecked : tuple of str
        What cannot be checked, since an older program made the run.
    """

    ok: bool
    frames: int
    bad: tuple[Finding, ...]
    leftovers: tuple[Finding, ...]
    state: State = "whole"
    gaps: tuple[str, ...] = ()
    unchecked: tuple[str, ...] = ()


def verify_run(path: Path, *, watch: Watch = iter) -> Verification:
    """Return what is wrong with a run folder; what its session planned is not looked at.

    Parameters
    ----------
    path : Path
        The run folder.
    watch : callable, optional
        Hands on the records one by one, for a progress bar.

    Raises
    ------
    RunFolderError
        There is no such folder, or it is no run folder at all.
    """
    contents = read_contents(path)
    found = wholeness(path, contents)
    bad = [Finding(file=file, problem=problem) for file, problem in found.problems]
    for record in watch(contents.frames):
        bad += [Finding(file=record.file, problem=text) for text in frame_problems(path, record)]
    unnamed = _unnamed_files(path, contents.frames)
    damaged = {file: problem for file in unnamed if (problem := _unnamed_problem(path, file))}
    bad += [Finding(file=file, problem=problem) for file, problem in damaged.items()]
    leftovers = [_leftover(file) for file in unnamed if file not in damaged]
    if contents.torn_manifest_line:
        leftovers.append(Finding(file=MANIFEST_FILE, problem="its last line has no end: not acknowledged"))
    bad += _too_many(contents, found.state, [finding for finding in leftovers if finding.problem == _WHOLE])
    return Verification(
        ok=not bad,
        frames=len(contents.frames),
        bad=tuple(bad),
        leftovers=tuple(leftovers),
        state="damaged" if bad else found.state,
        unchecked=found.unchecked,
    )


def _too_many(contents: Contents, state: State, whole: list[Finding]) -> list[Finding]:
    """Return what a kill cannot have left: whole frames without a line beyond the one that was in hand."""
    description = contents.description
    if description is None or not whole:
        return []
    if state == "whole" and description.is_sealed:
        return [Finding(file=finding.file, problem="not of this run, which has finished") for finding in whole]
    may_be_left = 1 if description.record.cell_deg is None else EXPOSURE_PARTS
    if len(whole) > may_be_left and description.record.is_of_session:
        text = f"{len(whole)} whole frames have no line, and a kill leaves {may_be_left} at most: lines were taken out"
        return [Finding(file=MANIFEST_FILE, problem=text)]
    return []


def frame_problems(path: Path, record: FrameRecord) -> list[str]:
    """Return what is wrong with the file of one frame that the manifest names."""
    if not (path / record.file).is_file():
        return ["missing"]
    try:
        read_frame(path, record)
    except DataError as error:
        return [str(error)]
    return []


def _unnamed_files(path: Path, frames: Iterable[FrameRecord]) -> list[str]:
    named = {record.file for record in frames}
    present = sorted((path / FRAMES_FOLDER).rglob("*")) + sorted(path.glob(f"*{PART_SUFFIX}"))
    files = [file.relative_to(path).as_posix() for file in present if file.is_file()]
    return [file for file in files if file not in named]


def _unnamed_problem(path: Path, file: str) -> str | None:
    if file.endswith(PART_SUFFIX):
        return None
    try:
        data = read_bounded(path / file, MOST_OWN_FRAME_BYTES)
        record_from_header(decode_frame(data), file=file, checksum=file_checksum(data))
    except (DataError, OSError) as error:
        text = error.strerror if isinstance(error, OSError) else error
        return f"not in the manifest, and no whole frame: {text}"
    return None


def _leftover(file: str) -> Finding:
    if file.endswith(PART_SUFFIX):
        return Finding(file=file, problem="begun and not finished")
    return Finding(file=file, problem=_WHOLE)
