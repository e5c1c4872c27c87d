"""`rigctl bundle`: packs a run for a fault report: log, versions, check-up, a few frames, no secrets."""

import getpass
import json
import platform
import re
import tempfile
import zipfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from rigctl.console import LEFT_OUT, Json, json_text, rewritten
from rigctl.errors import ConfigError, DataError
from rigctl.verbs.options import FilePath, Part, Result, RunPath, Writes
from rigctl.verbs.verify import verification_of
from rigctl.version import VERSION

if TYPE_CHECKING:
    from rigctl.runs.folder import Run as RunRecord
    from rigctl.runs.records import FrameRecord

_PACKAGES = ("rigctl", "numpy", "scipy", "pyserial", "opencv-contrib-python-headless", "pydantic", "astropy")
_README = """\
A run, bundled by rigctl {version} for a report of a fault.

{files}
Left out or replaced: addresses on the web, tables [notify], commands and questions of monitors, what keys and words
call a token, a password or a secret, e-mail addresses, folders of users and their names, the name of the machine. What
people wrote (comments, notes, names of rigs and regions) is kept: read it before you pass this on. Serial numbers and
the site stay.
Lines of {manifest} and {events} are edited as said above and carry no checksums; frames bear new headers.
"""


def bundle(
    run: RunPath,
    /,
    *,
    out: Annotated[FilePath, Writes(kind="file")],
    frames: Annotated[int, Parameter(validator=Number(gte=0))] = 3,
    trace: FilePath | None = None,
) -> "Bundle":
    """Pack log, versions, check-up and a few frames of a run into one file for a bug report, without secrets.

    Web addresses, [notify], commands of monitors, tokens, passwords, e-mail addresses, user names and the name of this
    machine are left out. Comments, notes, serial numbers and the site stay: read the file before you send it.

    Example: rigctl bundle runs/2026-05-04 --out fault.zip --frames 5

    Parameters
    ----------
    run : path or Run
        Run folder; it may be unfinished or damaged.
    out : path
        File to write (.zip).
    frames : int
        Number of frames to pack, spread over the run.
    trace : path
        Trace file to pack, written by `rigctl acquire --trace`.
    """
    from rigctl.runs.folder import ANNOTATIONS_FILE, INPUTS_FOLDER, MANIFEST_FILE, read_contents
    from rigctl.runs.records import EVENTS_FILE, SESSION_FILE
    from rigctl.session.status import STATUS_FILE

    path = Path(run)
    read_contents(path)
    scrubber = Scrubber.of_this_machine()
    packed: dict[str, bytes] = {}
    for name in (SESSION_FILE, EVENTS_FILE, MANIFEST_FILE, ANNOTATIONS_FILE, STATUS_FILE):
        if (path / name).is_file():
            packed[name] = _scrubbed_lines(path / name, scrubber)
    for file in sorted((path / INPUTS_FOLDER).glob("*.toml")):
        packed[f"{INPUTS_FOLDER}/{file.name}"] = scrubber.toml(_text(file)).encode()
    packed["versions.json"] = json_text(_versions()).encode()
    packed["verify.txt"] = scrubber.text("\n".join(_verified(path))).encode()
    packed["doctor.txt"] = scrubber.text("\n".join(_checked())).encode()
    if trace is not None:
        packed["trace.txt"] = scrubber.text(_readable(Path(trace))).encode()
    chosen = dict(_frames(path, scrubber, frames))
    packed |= chosen
    files = "".join(f"  {name} ({len(content)} bytes)\n" for name, content in packed.items())
    readme = _README.format(version=VERSION, files=files, manifest=MANIFEST_FILE, events=EVENTS_FILE)
    packed["README.txt"] = readme.encode()
    _write(Path(out), packed)
    return Bundle(path=Path(out), names=tuple(packed), frames=len(chosen))


@dataclass(frozen=True, kw_only=True)
class Bundle(Result):
    """A bundle: its file, the names in it, and the number of frames."""

    path: Path
    names: tuple[str, ...]
    frames: int

    def content(self) -> Iterable[Part]:
        """Return the file, and the number of files in it."""
        yield f"{self.path}: {len(self.names)} files, {self.frames} frames among them"

    def as_json(self) -> dict[str, Json]:
        """Return the file, the names in it and the number of frames."""
        return {"path": str(self.path), "names": list(self.names), "frames": self.frames}


def _text(file: Path) -> str:
    from rigctl.base.durable import MOST_RECORD_BYTES, read_bounded

    return read_bounded(file, MOST_RECORD_BYTES).decode("utf-8", errors="replace")


def _readable(file: Path) -> str:
    try:
        return _text(file)
    except OSError as error:
        raise ConfigError(f"--trace: {file} cannot be read: {error.strerror}") from error


def _scrubbed_lines(file: Path, scrubber: "Scrubber") -> bytes:
    """Return a file of JSON, or of lines of it, without secrets; lines that are not valid JSON are kept as text."""
    if file.suffix == ".json":
        return _scrubbed(_text(file), scrubber).encode()
    return "".join(f"{_scrubbed(line, scrubber)}\n" for line in _text(file).splitlines()).encode()


def _scrubbed(text: str, scrubber: "Scrubber") -> str:
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
    try:
        found = verification_of(run_path)
    except DataError as error:
        yield str(error)
        return
    yield f"{found.frames} frames, {found.state}"
    for finding in (*found.bad, *found.leftovers):
        yield f"{finding.file}: {finding.problem}"
    yield from found.gaps


def _checked() -> Iterator[str]:
    """Check the machine without its devices."""
    from rigctl.verbs.doctor import check_up

    with tempfile.TemporaryDirectory() as folder:
        for finding in check_up(None, None, folder=Path(folder), frames=1):
            yield f"{finding.what}: {finding.found}"
            yield from () if finding.advice is None else (f"  change: {finding.advice}",)


def _frames(run_path: Path, scrubber: "Scrubber", count: int) -> Iterator[tuple[str, bytes]]:
    """Yield some frames of a run with new headers; unreadable ones are left out."""
    from rigctl.runs.fits import encode_frame, header_cards
    from rigctl.runs.folder import read_frame, read_run

    try:
        run = read_run(run_path)
    except DataError:
        return
    for record in _spread(run, count):
        try:
            counts = read_frame(run.path, record)
        except DataError:
            continue
        yield record.file, encode_frame(counts, header_cards(_without_names(record, scrubber)))


def _without_names(record: "FrameRecord", scrubber: "Scrubber") -> "FrameRecord":
    source = record.source_file
    return replace(
        record,
        source_file=None if source is None else scrubber.text(source),
        remarks=tuple(map(scrubber.text, record.remarks)),
    )


def _spread(run: "RunRecord", count: int) -> "Sequence[FrameRecord]":
    frames = run.frames
    if count <= 0 or not frames:
        return ()
    places = {round(k * (len(frames) - 1) / max(count - 1, 1)) for k in range(min(count, len(frames)))}
    return [frames[place] for place in sorted(places)]


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


# Names that identify nobody.
_PLAIN_NAMES = frozenset({"root", "user", "pi", "home", "admin", "localhost", ""})
_LEAST_NAME = 3
_URL = re.compile(r"\b[a-zA-Z][a-zA-Z0-9+.-]*://[^\s\"'<>]+")
_MAIL = re.compile(r"\b[\w.+-]+@[\w-]+(?:\.[\w-]+)+\b")
_HOME = re.compile(r"(/(?:home|Users|media|run/media)/)[^/\s\"',:;]+")
# A word for a secret, and its value: token=..., "password": "...", Authorization: Bearer ...
_NAMED_SECRET = re.compile(
    r"(?i)([\"']?[\w.-]*(?:token|passw(?:or)?d|passphrase|secret|api[_-]?key|authorization|credential|cookie)[\w.-]*"
    r"[\"']?\s*(?:=|:|\s)\s*)(?:(?:bearer|basic|token)\s+)?(\"[^\"]*\"|'[^']*'|[^\s,;&\"')\]}]+)"
)
_BEARER = re.compile(r"(?i)\b(bearer|basic)\s+[\w.~+/=-]{6,}")
# Keys whose whole value is left out.
_SECRET_KEY = re.compile(r"(?i)token|passw|passphrase|secret|api_?key|authorization|credential|cookie")
_SECRET_TABLES = frozenset({"notify"})
_SECRET_OPTIONS = frozenset({"command", "webhook", "ask"})
_HEADER = re.compile(r"^\s*\[{1,2}\s*([\w.\"-]+)\s*\]{1,2}")
_ASSIGNED = re.compile(r"^(\s*)([\w.\"-]+)(\s*=)")


@dataclass(frozen=True, kw_only=True)
class Scrubber:
    """Removes secrets and names from texts: web addresses, tokens, users, the machine."""

    names: tuple[tuple[str, str], ...] = ()  #: names of this machine and its users, and their replacements

    @classmethod
    def of_this_machine(cls) -> "Scrubber":
        """Return a scrubber with the names of this machine and its user."""
        try:
            user = getpass.getuser()
        except (KeyError, OSError):
            user = ""
        host = platform.node()
        known = {Path.home().name: "USER", user: "USER", host: "MACHINE", host.partition(".")[0]: "MACHINE"}
        told = ((word, instead) for word, instead in known.items() if len(word) >= _LEAST_NAME)
        return cls(names=tuple(sorted((one for one in told if one[0] not in _PLAIN_NAMES), key=lambda p: -len(p[0]))))

    def text(self, text: str) -> str:
        """Return a text without secrets and names."""
        text = _URL.sub(LEFT_OUT, text)
        text = _NAMED_SECRET.sub(rf"\g<1>{LEFT_OUT}", text)
        text = _BEARER.sub(LEFT_OUT, text)
        text = _MAIL.sub(LEFT_OUT, text)
        text = _HOME.sub(r"\g<1>USER", text)
        for word, instead in self.names:
            text = re.sub(rf"(?<![A-Za-z0-9]){re.escape(word)}(?![A-Za-z0-9])", instead, text)
        return text

    def content(self, content: Json) -> Json:
        """Return JSON content without secrets and names."""
        found: Json = rewritten(content, text=self.text, value=_without_secret)
        return found

    def toml(self, text: str) -> str:
        """Return a TOML file without secrets and names; its comments are kept."""
        lines, table, depth = [], "", 0
        for line in text.splitlines():
            header = _HEADER.match(line)
            if header is not None and depth == 0:
                table = header[1]
            assigned = _ASSIGNED.match(line)
            is_secret = depth > 0 or (assigned is not None and header is None and _is_secret(table, assigned[2]))
            if not is_secret:
                lines.append(self.text(line))
                continue
            if depth == 0 and assigned is not None:
                lines.append(f'{assigned[1]}{assigned[2]}{assigned[3]} "{LEFT_OUT}"')
            # A value may continue on the next lines, which are left out, too.
            depth = max(0, depth + sum(line.count(one) for one in "[{") - sum(line.count(one) for one in "]}"))
        return "\n".join([*lines, ""])


def _without_secret(key: str, value: Json) -> Json:
    is_secret = key in _SECRET_TABLES or key in _SECRET_OPTIONS or _SECRET_KEY.search(key)
    return LEFT_OUT if value is not None and is_secret else value


def _is_secret(table: str, key: str) -> bool:
    last = table.rpartition(".")[2].strip('"')
    if last in _SECRET_TABLES or table.partition(".")[0] in _SECRET_TABLES:
        return True
    # The options of a monitor may be on one line with its commands and addresses.
    is_options = table.partition(".")[0] == "monitors" and key in ("options", *_SECRET_OPTIONS)
    return is_options or key in _SECRET_TABLES or bool(_SECRET_KEY.search(key)) or key in ("command", "webhook")
