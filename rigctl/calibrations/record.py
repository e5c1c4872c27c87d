"""Calibration files in JSON: written whole or not at all, read once all that the program uses has been found right."""

import functools
import json
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from pydantic import TypeAdapter, ValidationError

from rigctl.base.durable import MOST_RECORD_BYTES, read_bounded, sha256_of, write_durably
from rigctl.base.numbers import utc_text
from rigctl.calibrations.made_for import MadeFor, made_for
from rigctl.console.anonymity import told_content
from rigctl.console.json_text import Json
from rigctl.errors import ConfigError, DataError
from rigctl.files.toml import describe, other_schema
from rigctl.runs.folder import MANIFEST_FILE, Run
from rigctl.runs.records import FrameRecord
from rigctl.version import VERSION

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Record = TypeVar("Record")
Body = TypeVar("Body", bound="DataclassInstance")


@dataclass(frozen=True, kw_only=True)
class Source:
    """A file that a calibration was made from; of a run, its folder and the hash of its manifest."""

    path: str
    sha256: str


@dataclass(frozen=True, kw_only=True)
class CalibrationHeader:
    """What every calibration file says of itself, in the order in which it stands there."""

    schema_version: int  #: Of this kind of file.
    kind: str  #: "flat", "polarizer", "radiometric" or "registration".
    created_by: str  #: Program and time.
    created_utc: str
    #: What it was made from; a mapping has it by what it is.
    source: Source | tuple[Source, ...] | Mapping[str, Source]
    made_for: MadeFor  #: Devices, settings and time.

    def sources(self) -> tuple[Source, ...]:
        """Return all that it was made from."""
        if isinstance(self.source, Source):
            return (self.source,)
        return self.source if isinstance(self.source, tuple) else tuple(self.source.values())


@dataclass(frozen=True, kw_only=True, eq=False)
class CalibrationFile(Generic[Body]):
    """A calibration as its file holds it: the header, and beside it what is measured."""

    header: CalibrationHeader
    body: Body

    def as_json(self) -> dict[str, Json]:
        """Return the content of the file."""
        return asdict(self.header) | asdict(self.body)


def source_of(path: Path) -> Source:
    """Return a file as a source."""
    return Source(path=str(path), sha256=sha256_of(path))


def source_of_run(run: Run) -> Source:
    """Return a run as a source."""
    return Source(path=str(run.path), sha256=sha256_of(run.path / MANIFEST_FILE))


def header_of(
    kind: str,
    version: int,
    *,
    source: Source | tuple[Source, ...] | Mapping[str, Source],
    run: Run,
    records: Sequence[FrameRecord],
    valid_days: float | None,
    utc_ns: Callable[[], int] = time.time_ns,
) -> CalibrationHeader:
    """Return the header of a new file."""
    return CalibrationHeader(
        schema_version=version,
        kind=kind,
        created_by=f"rigctl {VERSION}",
        created_utc=utc_text(utc_ns()),
        source=source,
        made_for=replace(made_for(run, records), valid_days=valid_days),
    )


def write_content(path: Path, content: Mapping[str, Json]) -> None:
    """Write a calibration: whole under its name, or not at all. A file that is there is replaced."""
    write_whole(path, (json.dumps(told_content(content), indent=2, allow_nan=False) + "\n").encode("ascii"))


def write_whole(path: Path, data: bytes) -> None:
    """Write a file of a calibration: whole under its name, or not at all."""
    try:
        write_durably(path, data)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}; its folder has to exist") from error


# To make one takes longer than to read a file, and a store has many files.
_adapter: Callable[..., TypeAdapter[Any]] = functools.cache(TypeAdapter)


def read_record(path: Path, record: type[Record], *, made_by: str) -> Record:
    """Return the record of a calibration file."""
    try:
        text = read_bounded(path, MOST_RECORD_BYTES)
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        found: Record = _adapter(record).validate_json(text)
        return found
    except ValidationError as error:
        other = _other_kind(text, made_by)
        if other is not None:
            raise DataError(f"{path}: this is {other}; {made_by}") from error
        later = other_schema(json.loads(text), record)
        if later is not None:
            raise DataError(f"{path}: {later}\n  {made_by}") from error
        raise DataError(f"{describe(path, error)}\n  {made_by}") from error


def _other_kind(text: bytes, made_by: str) -> str | None:
    """Return which kind of calibration a file is, or that it is no JSON; None where it says nothing of the kind."""
    try:
        content = json.loads(text)
    except ValueError:
        return "no JSON file"
    kind = content.get("kind") if isinstance(content, dict) else None
    is_known = isinstance(kind, str) and re.fullmatch(r"[a-z_]{3,20}", kind)
    return f"a {kind} calibration" if is_known and f"a {kind} " not in made_by else None
