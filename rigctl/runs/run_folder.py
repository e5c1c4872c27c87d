"""A run folder as it is read: what was done, and the frames that came of it.

::

    RUN/session.json      the resolved session, versions, schema version
    RUN/frames/*.fits     one whole frame each, with all that is known of it in its header
    RUN/manifest.jsonl    one line a frame, appended once the frame is on the disk
    RUN/events.jsonl      what happened, and when

The frames are the truth; the manifest is their table of contents and can be made again from them.
"""

import hashlib
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, TypeAdapter, ValidationError, with_config

from rigctl.choices import FrameKind
from rigctl.errors import DataError, RunFolderError
from rigctl.runs.fits.fits_frame import decode_frame
from rigctl.runs.run_description import SESSION_FILE, RunDescription, explain_invalid, read_description
from rigctl.runs.session_record import SessionRecord, session_record

MANIFEST_FILE = "manifest.jsonl"
FRAMES_FOLDER = "frames"


@with_config(ConfigDict(extra="forbid", strict=True, allow_inf_nan=False))
@dataclass(frozen=True, kw_only=True)
class FrameRecord:
    """All that is known of one frame. ``None`` is "not known" or "does not apply", never a default.

    Attributes
    ----------
    kind : {"scene", "dark", "flat"}
        What the camera looked at.
    sequence : int
        Place in the order in which the frames of this run were taken, from 0; unique in the run.
    cycle : int or None
        Which repeat of the set of angles this is, from 0.
    polarizer_angle_target_deg : float or None
        Transmission axis that was asked for [deg], counter-clockwise from horizontal in the picture.
    polarizer_angle_deg : float or None
        Transmission axis by the stage's readback [deg], same sense. This one is for processing.
    stage_angle_target_deg, stage_angle_deg : float or None
        What the stage was told, and what its encoder said [deg].
    stage_counts : int or None
        The encoder's own counts.
    exposure_s : float or None
        Integration time [s].
    gain_db : float or None
        The camera's gain setting [dB].
    egain_e_per_dn : float or None
        Electrons per DN, where somebody states it [e-/DN].
    bit_depth : int
        Bits per sample, right-justified.
    black_level_dn : float or None
        Counts without light [DN], where known without dark frames.
    saturation_dn : float
        A pixel at or above this many counts is saturated [DN].
    missing_dn : float or None
        The value that marks pixels which were never received [DN].
    start_utc, end_utc : str or None
        Start and end of the exposure, as ``rigctl.utc_time.utc_text`` writes them.
    start_monotonic_ns : int or None
        Start of the exposure on the host's monotonic clock [ns].
    camera_model, camera_serial, stage_model, stage_serial : str or None
        Which devices these were.
    stage_tries : int or None
        How many times the move was commanded until the readback was within tolerance.
    settle_s : float or None
        From the command of the move to the readback that was accepted [s].
    camera_frame : int or None
        The camera's own frame counter.
    camera_temperature_c : float or None
        What the camera said of its temperature, ten seconds before the exposure at most [deg C].
    round : int or None
        Which round of a schedule this frame belongs to, from 0.
    sun_azimuth_deg, sun_elevation_deg : float or None
        Where the sun stood at the start of the exposure [deg]: azimuth clockwise from north, elevation without
        refraction.
    site_latitude_deg, site_longitude_deg : float or None
        Where the rig stands [deg], north and east positive.
    site_elevation_m : float or None
        How high above the sea it stands [m].
    source_file : str or None
        The file this frame was imported from.
    remarks : tuple of str
        What else one has to know.
    file : str
        Path relative to the run folder, with ``/``. Filled in by the writer, as all that follow.
    height, width : int
        Rows and columns.
    saturated_fraction : float
        Share of pixels at or above ``saturation_dn``, 0 to 1.
    checksum : str
        ``sha256:`` and 64 hexadecimal digits, over the whole file.
    """

    kind: FrameKind
    sequence: int
    bit_depth: int
    saturation_dn: float
    cycle: int | None = None
    polarizer_angle_target_deg: float | None = None
    polarizer_angle_deg: float | None = None
    stage_angle_target_deg: float | None = None
    stage_angle_deg: float | None = None
    stage_counts: int | None = None
    exposure_s: float | None = None
    gain_db: float | None = None
    egain_e_per_dn: float | None = None
    black_level_dn: float | None = None
    missing_dn: float | None = None
    start_utc: str | None = None
    end_utc: str | None = None
    start_monotonic_ns: int | None = None
    camera_model: str | None = None
    camera_serial: str | None = None
    stage_model: str | None = None
    stage_serial: str | None = None
    stage_tries: int | None = None
    settle_s: float | None = None
    camera_frame: int | None = None
    camera_temperature_c: float | None = None
    round: int | None = None
    sun_azimuth_deg: float | None = None
    sun_elevation_deg: float | None = None
    site_latitude_deg: float | None = None
    site_longitude_deg: float | None = None
    site_elevation_m: float | None = None
    source_file: str | None = None
    remarks: tuple[str, ...] = ()
    file: str = ""
    height: int = 0
    width: int = 0
    saturated_fraction: float = 0.0
    checksum: str = ""


FRAME_RECORD = TypeAdapter(FrameRecord)


@dataclass(frozen=True, kw_only=True)
class Run:
    """A run folder's table of contents.

    Attributes
    ----------
    path : Path
        The folder.
    session : SessionRecord
        How it came about.
    session_json : dict
        All that the writer was told of that: rig, session, versions, hashes.
    frames : tuple of FrameRecord
        In the order of their sequence numbers.
    created_by : str
        Program and version that made the folder.
    created_utc : str
        When it was made.
    """

    path: Path
    session: SessionRecord
    session_json: dict[str, Any]
    frames: tuple[FrameRecord, ...]
    created_by: str
    created_utc: str

    def counts(self, record: FrameRecord) -> NDArray[np.uint16]:
        """Return the samples of a frame, once its checksum has been found right.

        Returns
        -------
        (H, W) array of uint16
            Samples in DN; the first row is the top of the picture. The array is the caller's own.

        Raises
        ------
        RunFolderError
            The file is gone, or is not the one that was written.
        """
        return decode_frame(read_frame_file(self.path, record)).counts


def read_frame_file(path: Path, record: FrameRecord) -> bytes:
    """Return the bytes of a frame's file, once their checksum agrees with the manifest.

    Raises
    ------
    RunFolderError
        The file cannot be read, or its checksum differs.
    """
    try:
        data = (path / record.file).read_bytes()
    except OSError as error:
        raise RunFolderError(f"{path / record.file}: cannot be read: {error.strerror}") from error
    found = file_checksum(data)
    if found != record.checksum:
        raise RunFolderError(
            f"{path / record.file}: damaged or replaced: the manifest says {record.checksum}, the file has {found}"
        )
    return data


def file_checksum(data: bytes) -> str:
    """Return the checksum that the manifest keeps for a file of this content."""
    return "sha256:" + hashlib.sha256(data).hexdigest()


@dataclass(frozen=True, kw_only=True)
class Contents:
    """Contents of a run folder, good or bad: the records that could be read, and what is wrong with the rest.

    Attributes
    ----------
    description : RunDescription or None
        What the session file says; ``None`` where it cannot be read.
    frames : tuple of FrameRecord
        Every record of the manifest that could be read, by sequence number.
    problems : tuple of (file, problem)
        What is wrong with the session file and the manifest.
    torn_manifest_line : bool
        The last line of the manifest has no end: the writer was killed in the middle of it.
    """

    description: RunDescription | None
    frames: tuple[FrameRecord, ...]
    problems: tuple[tuple[str, str], ...]
    torn_manifest_line: bool


def read_run(path: Path) -> Run:
    """Return the table of contents of a run folder; the frames themselves are not opened.

    Parameters
    ----------
    path : Path
        The run folder.

    Raises
    ------
    RunFolderError
        There is no such folder, or its session file or manifest is damaged, or frames are gone: every
        problem at once.

    Notes
    -----
    A last line of the manifest without an end is what a killed writer leaves; it is passed over, since its
    frame was never acknowledged. ``rigctl verify`` reports it.
    """
    contents = read_contents(path)
    problems = [f"{file}: {problem}" for file, problem in contents.problems]
    problems += [f"{r.file}: missing" for r in contents.frames if not (path / r.file).is_file()]
    description = contents.description
    if problems or description is None:
        raise RunFolderError(f"{path} cannot be used as a run folder:\n  " + "\n  ".join(problems))
    return Run(
        path=path,
        session=session_record(description.session),
        session_json=description.session,
        frames=contents.frames,
        created_by=description.created_by,
        created_utc=description.created_utc,
    )


def read_contents(path: Path) -> Contents:
    """Return what a run folder's session file and manifest say, whatever state they are in.

    Raises
    ------
    RunFolderError
        There is no such folder, or it is no run folder at all.
    """
    if not path.is_dir():
        raise RunFolderError(f"{path}: there is no such folder; a run folder is made by `rigctl acquire` or `import`")
    if not any((path / name).exists() for name in (SESSION_FILE, MANIFEST_FILE)):
        raise RunFolderError(f"{path}: not a run folder: it has neither {SESSION_FILE} nor {MANIFEST_FILE}")
    frames, problems, torn = _read_manifest(path / MANIFEST_FILE)
    description: RunDescription | None = None
    try:
        description = read_description(path / SESSION_FILE)
    except DataError as error:
        problems.insert(0, (SESSION_FILE, str(error)))
    return Contents(description=description, frames=frames, problems=tuple(problems), torn_manifest_line=torn)


def _read_manifest(file: Path) -> tuple[tuple[FrameRecord, ...], list[tuple[str, str]], bool]:
    try:
        whole, end, rest = file.read_bytes().rpartition(b"\n")
    except OSError as error:
        return (), [(file.name, f"cannot be read: {error.strerror}")], False
    frames: list[FrameRecord] = []
    problems: list[tuple[str, str]] = []
    for number, line in enumerate(whole.split(b"\n") if end else (), start=1):
        try:
            frames.append(parse_record(line))
        except DataError as error:
            problems.append((file.name, f"line {number}: {error}"))
    problems += [(file.name, text) for text in _duplicates(frames)]
    return tuple(sorted(frames, key=lambda record: record.sequence)), problems, bool(rest)


def parse_record(line: bytes) -> FrameRecord:
    """Return the record that one line of a manifest stands for.

    Raises
    ------
    DataError
        The line is no JSON, lacks a key, has an unknown one or a value of the wrong kind: all at once.
    """
    try:
        record = FRAME_RECORD.validate_json(line)
    except ValidationError as error:
        raise DataError(explain_invalid(error)) from error
    inside = Path(record.file).parts[:1] == (FRAMES_FOLDER,) and ".." not in Path(record.file).parts
    if not inside:
        raise DataError(f"file {record.file!r} does not lie in {FRAMES_FOLDER}/")
    return record


def _duplicates(frames: list[FrameRecord]) -> list[str]:
    sequences = Counter(record.sequence for record in frames)
    files = Counter(record.file for record in frames)
    return [f"sequence {value} stands {n} times" for value, n in sequences.items() if n > 1] + [
        f"file {value} stands {n} times" for value, n in files.items() if n > 1
    ]
