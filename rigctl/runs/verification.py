"""Verification of a run folder: every checksum again, and manifest against headers."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from rigctl.durable_file import PART_SUFFIX
from rigctl.errors import DataError
from rigctl.runs.fits.fits_frame import decode_frame
from rigctl.runs.fits.frame_header import record_from_header
from rigctl.runs.run_folder import (
    FRAMES_FOLDER,
    MANIFEST_FILE,
    FrameRecord,
    file_checksum,
    read_contents,
    read_frame_file,
)

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
    """

    ok: bool
    frames: int
    bad: tuple[Finding, ...]
    leftovers: tuple[Finding, ...]


def verify_run(path: Path, *, watch: Watch = iter) -> Verification:
    """Return what is wrong with a run folder.

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
    bad = [Finding(file=file, problem=problem) for file, problem in contents.problems]
    for record in watch(contents.frames):
        bad += [Finding(file=record.file, problem=text) for text in frame_problems(path, record)]
    unnamed = _unnamed_files(path, contents.frames)
    damaged = {file: problem for file in unnamed if (problem := _unnamed_problem(path, file))}
    bad += [Finding(file=file, problem=problem) for file, problem in damaged.items()]
    leftovers = [_leftover(file) for file in unnamed if file not in damaged]
    if contents.torn_manifest_line:
        leftovers.append(Finding(file=MANIFEST_FILE, problem="its last line has no end: not acknowledged"))
    return Verification(ok=not bad, frames=len(contents.frames), bad=tuple(bad), leftovers=tuple(leftovers))


def frame_problems(path: Path, record: FrameRecord) -> list[str]:
    """Return what is wrong with the file of one frame that the manifest names."""
    if not (path / record.file).is_file():
        return ["missing"]
    try:
        data = read_frame_file(path, record)
        stated = record_from_header(decode_frame(data), file=record.file, checksum=record.checksum)
    except DataError as error:
        return [str(error)]
    other = [f.name for f in fields(record) if getattr(record, f.name) != getattr(stated, f.name)]
    return [f"manifest and header contradict each other: {', '.join(other)}"] if other else []


def _unnamed_files(path: Path, frames: Iterable[FrameRecord]) -> list[str]:
    named = {record.file for record in frames}
    present = sorted((path / FRAMES_FOLDER).rglob("*")) + sorted(path.glob(f"*{PART_SUFFIX}"))
    files = [file.relative_to(path).as_posix() for file in present if file.is_file()]
    return [file for file in files if file not in named]


def _unnamed_problem(path: Path, file: str) -> str | None:
    if file.endswith(PART_SUFFIX):
        return None
    data = (path / file).read_bytes()
    try:
        record_from_header(decode_frame(data), file=file, checksum=file_checksum(data))
    except DataError as error:
        return f"not in the manifest, and no whole frame: {error}"
    return None


def _leftover(file: str) -> Finding:
    if file.endswith(PART_SUFFIX):
        return Finding(file=file, problem="begun and not finished")
    return Finding(file=file, problem="a whole frame that the manifest does not name: not acknowledged")
