"""Calibration files in JSON: written whole or not at all, and checked when read."""

import functools
import json
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Self, TypeVar

from pydantic import TypeAdapter, ValidationError
from pydantic_core import from_json

from rigctl.base.durable import MOST_RECORD_BYTES, read_bounded, sha256_of, write_durably
from rigctl.base.numbers import utc_text
from rigctl.calibrations.kinds import (
    CalibrationKind,
    MadeFor,
    Measured,
    UtcText,
    made_for,
    made_for_of_file,
    require_fit,
)
from rigctl.console import Json, anonymized_content
from rigctl.errors import ConfigError, DataError
from rigctl.files.toml import describe, other_schema
from rigctl.runs.folder import MANIFEST_FILE, Run
from rigctl.runs.records import FrameRecord
from rigctl.version import VERSION

Record = TypeVar("Record")


@dataclass(frozen=True, kw_only=True)
class CalibrationRecord:
    """Content of a calibration file; each kind adds its own numbers."""

    KIND: ClassVar[CalibrationKind]
    MADE_BY: ClassVar[str]  #: how such a file is made, for messages

    made_for: MadeFor | None  #: devices, settings and time
    created_utc: UtcText | None = None  #: time at which the file was written

    @property
    def origin(self) -> MadeFor:
        """Devices, settings, time and validity of the calibration."""
        return made_for_of_file(self.KIND, self.made_for, created_utc=self.created_utc)

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of its contents in the list of a store."""
        return (self.KIND,)

    @property
    def history(self) -> Mapping[str, Measured[float]]:
        """Numbers that are followed through time."""
        return {}

    @classmethod
    def read(cls, path: Path) -> Self:
        """Return the calibration of a file; DataError names every problem."""
        return read_record(path, cls, made_by=cls.MADE_BY)

    @classmethod
    def read_fitting(cls, path: Path, run: Run) -> tuple[Self, tuple[str, ...]]:
        """Return the calibration for the scene frames of a run, and doubts about it."""
        found = cls.read(path)
        return found, found.doubts(made_for_scene(run))

    def doubts(self, used: MadeFor) -> tuple[str, ...]:
        """Return doubts about its use for frames; DataError for other devices or settings."""
        return require_fit(self.KIND, self.origin, used)


def made_for_scene(run: Run) -> MadeFor:
    """Return devices, settings and time of the scene frames of a run."""
    return made_for(run, [record for record in run.frames if record.kind == "scene"])


def source_of_run(run: Run) -> dict[str, Json]:
    """Return the folder of a run, and the hash of its manifest."""
    return {"path": str(run.path), "sha256": sha256_of(run.path / MANIFEST_FILE)}


def header_of(
    kind: str,
    version: int,
    *,
    source: Json,
    run: Run,
    records: Sequence[FrameRecord],
    valid_days: float | None,
) -> dict[str, Json]:
    """Return the first keys of a calibration file of any kind."""
    return {
        "schema_version": version,
        "kind": kind,
        "created_by": f"rigctl {VERSION}",
        "created_utc": utc_text(time.time_ns()),
        "source": source,
        "made_for": replace(made_for(run, records), valid_days=valid_days).as_json(),
    }


def write_content(path: Path, content: Mapping[str, Json]) -> None:
    """Write a calibration whole, or not at all. A file of that name is replaced."""
    write_whole(path, (json.dumps(anonymized_content(content), indent=2, allow_nan=False) + "\n").encode("ascii"))


def write_whole(path: Path, data: bytes) -> None:
    """Write a file of a calibration whole, or not at all."""
    try:
        write_durably(path, data)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}; its folder must exist") from error


# Kept, as making one takes longer than reading a file.
_adapter: Callable[..., TypeAdapter[Any]] = functools.cache(TypeAdapter)


def read_record(path: Path, record: type[Record], *, made_by: str) -> Record:
    """Return the record of a calibration file."""
    try:
        text = read_bounded(path, MOST_RECORD_BYTES)
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror}") from error
    return checked_record(path, text, record, made_by=made_by)


def checked_record(path: Path, text: bytes, record: type[Record], *, made_by: str) -> Record:
    """Return the record of a JSON text; DataError names every problem, or the kind of the file."""
    try:
        found: Record = _adapter(record).validate_json(text)
        return found
    except ValidationError as error:
        other = _other_kind(text, made_by)
        if other is not None:
            raise DataError(f"{path}: this is {other}; {made_by}") from error
        later = other_schema(from_json(text), record)
        if later is not None:
            raise DataError(f"{path}: {later}\n  {made_by}") from error
        raise DataError(f"{describe(path, error)}\n  {made_by}") from error


def _other_kind(text: bytes, made_by: str) -> str | None:
    """Return the kind of calibration in a text, or that it is not JSON; None if it states no kind."""
    try:
        content = from_json(text)  # too deep is a ValueError of it
    except ValueError:
        return "no JSON file"
    kind = content.get("kind") if isinstance(content, dict) else None
    is_known = isinstance(kind, str) and re.fullmatch(r"[a-z_]{3,20}", kind)
    return f"a {kind} calibration" if is_known and f"a {kind} " not in made_by else None
