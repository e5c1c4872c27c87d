"""The file ``session.json`` of a run folder: what was to be done, and which program made the folder."""

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

from pydantic import ConfigDict, Field, JsonValue, TypeAdapter, ValidationError, with_config

from rigctl.errors import DataError
from rigctl.files.config import newer_schema
from rigctl.runs.session_record import SessionRecord, session_record
from rigctl.storage.bounded_file import MOST_RECORD_BYTES, read_bounded

SCHEMA_VERSION = 2
"""Version of the layout: from 2 on every line and this file carry checksums."""
_UNSEALED_VERSION = 1
SESSION_FILE = "session.json"


@with_config(ConfigDict(extra="forbid", strict=True))
@dataclass(frozen=True, kw_only=True)
class RunDescription:
    """A run folder by its own word.

    Attributes
    ----------
    schema_version : int
        Which layout the folder has.
    created_by : str
        Program and version that made it.
    created_utc : str
        When it was made.
    session : mapping
        The resolved session; ``origin`` is "simulated", "device" or "import".
    checksum : str or None
        ``sha256:`` and 64 hexadecimal digits over the rest of the file; None in runs of layout 1, which have none.
    """

    schema_version: Annotated[int, Field(le=SCHEMA_VERSION)]
    created_by: str
    created_utc: str
    session: dict[str, JsonValue]
    checksum: str | None = None

    @property
    def record(self) -> SessionRecord:
        """The session as far as the program asks."""
        return session_record(self.session)

    @property
    def is_sealed(self) -> bool:
        """True where the lines of manifest and events carry their checksums and a chain."""
        return self.schema_version > _UNSEALED_VERSION


_DESCRIPTION = TypeAdapter(RunDescription)


def encode_description(description: RunDescription) -> bytes:
    """Return the content of the file."""
    content = asdict(description) | {"checksum": _checksum(description)}
    return (json.dumps(content, indent=2, allow_nan=False) + "\n").encode("ascii")


def first_link(description: RunDescription) -> str | None:
    """Return what the chains of a run begin with; None where its lines have no seal."""
    return description.checksum if description.is_sealed else None


def read_description(file: Path) -> RunDescription:
    """Return what a run folder says of itself.

    Raises
    ------
    DataError
        The file cannot be read, is no description, is not the one that was written, or comes from another version of
        the layout.
    """
    try:
        text = read_bounded(file, MOST_RECORD_BYTES)
    except OSError as error:
        raise DataError(f"cannot be read: {error.strerror}") from error
    try:
        description = _DESCRIPTION.validate_json(text)
    except ValidationError as error:
        later = _later_layout(text)
        raise DataError(later if later is not None else explain_invalid(error)) from error
    if description.schema_version < _UNSEALED_VERSION:
        raise DataError(f"schema_version is {description.schema_version}; it begins with {_UNSEALED_VERSION}")
    if description.checksum != (_checksum(description) if description.is_sealed else None):
        raise DataError("damaged or edited: its checksum is another")
    try:
        _ = description.record
    except ValidationError as error:
        raise DataError(explain_invalid(error, within="session")) from error
    return description


def _later_layout(text: bytes) -> str | None:
    """Return in words that a session file is of a later layout than this program reads; None where it is not."""
    try:
        return newer_schema(json.loads(text), RunDescription)
    except (ValueError, RecursionError):
        return None


def _checksum(description: RunDescription) -> str:
    content = asdict(description)
    del content["checksum"]
    return "sha256:" + hashlib.sha256(json.dumps(content, allow_nan=False).encode("ascii")).hexdigest()


def explain_invalid(error: ValidationError, *, within: str = "") -> str:
    """Return in one line what is wrong with a record: each field, inside the part that was read, and why."""
    outer = (within,) if within else ()
    return "; ".join(
        f"{'.'.join(map(str, (*outer, *item['loc'])))}: {item['msg']}".removeprefix(": ") for item in error.errors()
    )
