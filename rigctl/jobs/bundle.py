"""Bundling a run for somebody who shall find a fault: its log, versions, check-up and a few frames, no secrets."""

import json
import platform
import tempfile
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from rigctl.console.json_text import Json, json_text
from rigctl.console.scrubbing import Scrubber
from rigctl.errors import ConfigError, DataError
from rigctl.jobs.doctor import DoctorRequest, check_up
from rigctl.jobs.verify import verify
from rigctl.live.live_status import STATUS_FILE
from rigctl.runs.fits.fits_frame import encode_frame
from rigctl.runs.fits.frame_header import header_cards
from rigctl.runs.frame_record import FrameRecord
from rigctl.runs.run_description import SESSION_FILE
from rigctl.runs.run_events import EVENTS_FILE
from rigctl.runs.run_folder import (
    ANNOTATIONS_FILE,
    INPUTS_FOLDER,
    MANIFEST_FILE,
    Run,
    read_contents,
    read_frame,
    read_run,
)
from rigctl.storage.bounded_file import MOST_RECORD_BYTES, read_bounded
from rigctl.version import VERSION

_PACKAGES = ("rigctl", "numpy", "scipy", "pyserial", "opencv-contrib-python-headless", "pydantic", "astropy")
_README = """\
A run, bundled by rigctl {version} for somebody who shall look for a fault.

{files}
Left out or replaced: addresses on the web, tables [notify], commands and questions of monitors, what keys and words
call a token, a password or a secret, e-mail addresses, folders of users and their names, the name of the machine. What
people wrote (comments, notes, names of rigs and regions) is kept: read it before you pass this on. Serial numbers and
the site stay.
Lines of {manifest} and {events} are as they are told here and carry no checksums; frames bear new headers.
"""


@dataclass(frozen=True, kw_only=True)
class Bundled:
    """A bundle: its file, what is in it, and the frames among that."""

    path: Path
    names: tuple[str, ...]
    frames: int


def bundle(run_path: Path, *, out: Path, frames: int) -> Bundled:
    """Return what was packed of a run.

    Parameters
    ----------
    run_path : Path
        Run folder; it may be unfinished or damaged.
    out : Path
        File to make (.zip); whole, or not at all.
    frames : int
        How many frames are packed, spread over the run; at least 0.

    Raises
    ------
    RunFolderError
        It is no run folder.
    ConfigError
        The file cannot be written.
    """
    read_contents(run_path)
    scrubber = Scrubber.of_this_machine()
    packed: dict[str, bytes] = {}
    for name in (SESSION_FILE, EVENTS_FILE, MANIFEST_FILE, ANNOTATIONS_FILE, STATUS_FILE):
        if (run_path / name).is_file():
            packed[name] = _told_lines(run_path / name, scrubber)
    for file in sorted((run_path / INPUTS_FOLDER).glob("*.toml")):
        packed[f"{INPUTS_FOLDER}/{file.name}"] = scrubber.toml(_text(file)).encode()
    packed["versions.json"] = json_text(_versions()).encode()
    packed["verify.txt"] = scrubber.text("\n".join(_verified(run_path))).encode()
    packed["doctor.txt"] = scrubber.text("\n".join(_checked())).encode()
    chosen = dict(_frames(run_path, scrubber, frames))
    packed |= chosen
    packed["README.txt"] = _readme(packed).encode()
    _write(out, packed)
    return Bundled(path=out, names=tuple(packed), frames=len(chosen))


def _text(file: Path) -> str:
    return read_bounded(file, MOST_RECORD_BYTES).decode("utf-8", errors="replace")


def _told_lines(file: Path, scrubber: Scrubber) -> bytes:
    """Return a file of JSON, or of lines of it, without secrets; a line that is none is told as text."""
    if file.suffix == ".json":
        return _told(_text(file), scrubber).encode()
    return "".join(f"{_told(line, scrubber)}\n" for line in _text(file).splitlines()).encode()


def _told(text: str, scrubber: Scrubber) -> str:
    try:
        content: Json = json.loads(text)
    except (ValueError, RecursionError):
        return scrubber.text(text)
    return json.dumps(scrubber.content(content))


def _versions() -> dict[str, Json]:
    found: dict[str, Json] = {
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.release()}",
    }
    found |= {"machine": platform.machine(), "rigctl": VERSION}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = None
    return found


def _verified(run_path: Path) -> Iterator[str]:
    """Give what `rigctl verify` finds."""
    try:
        found = verify(run_path)
    except DataError as error:
        yield str(error)
        return
    yield f"{found.frames} frames, {found.state}"
    for finding in (*found.bad, *found.leftovers):
        yield f"{finding.file}: {finding.problem}"
    yield from found.gaps


def _checked() -> Iterator[str]:
    """Give what the doctor says of the machine alone: no device is touched."""
    with tempfile.TemporaryDirectory() as folder:
        for finding in check_up(DoctorRequest(rig=None, session=None, folder=Path(folder), frames=1)):
            yield f"{finding.what}: {finding.found}"
            yield from () if finding.advice is None else (f"  change: {finding.advice}",)


def _frames(run_path: Path, scrubber: Scrubber, count: int) -> Iterator[tuple[str, bytes]]:
    """Give some frames of a run with headers anew; those that cannot be read are left out."""
    try:
        run = read_run(run_path)
    except DataError:
        return
    for record in _spread(run, count):
        try:
            counts = read_frame(run.path, record).counts
        except DataError:
            continue
        yield record.file, encode_frame(counts, header_cards(_without_names(record, scrubber)))


def _without_names(record: FrameRecord, scrubber: Scrubber) -> FrameRecord:
    source = record.source_file
    return replace(
        record,
        source_file=None if source is None else scrubber.text(source),
        remarks=tuple(map(scrubber.text, record.remarks)),
    )


def _spread(run: Run, count: int) -> Sequence[FrameRecord]:
    frames = run.frames
    if count <= 0 or not frames:
        return ()
    places = {round(k * (len(frames) - 1) / max(count - 1, 1)) for k in range(min(count, len(frames)))}
    return [frames[place] for place in sorted(places)]


def _readme(packed: dict[str, bytes]) -> str:
    files = "".join(f"  {name} ({len(content)} bytes)\n" for name, content in packed.items())
    return _README.format(version=VERSION, files=files, manifest=MANIFEST_FILE, events=EVENTS_FILE)


def _write(out: Path, packed: dict[str, bytes]) -> None:
    part = out.with_name(f".{out.name}.part")
    try:
        with zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, content in packed.items():
                archive.writestr(name, content)
        part.replace(out)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise ConfigError(f"--out: {out} cannot be written: {error.strerror}") from error
