"""The file ``session.json`` of a run folder: what was to be done, and which program made the folder."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pydantic import ConfigDict, TypeAdapter, ValidationError, with_config

from rigctl.errors import DataError
from rigctl.runs.session_record import session_record

SCHEMA_VERSION = 1
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
    session : dict
        The resolved session; ``origin`` is "simulated", "device" or "import".
    """

    schema_version: int
    created_by: str
    created_utc: str
    session: dict[str, Any]


_DESCRIPTION = TypeAdapter(RunDescription)


def encode_description(description: RunDescription) -> bytes:
    """Return the content of the file."""
    return (json.dumps(asdict(description), indent=2, allow_nan=False) + "\n").encode("ascii")


def read_description(file: Path) -> RunDescription:
    """Return what a run folder says of itself.

    Raises
    ------
    DataError
        The file cannot be read, is no description, or comes from another version of the layout.
    """
    try:
        description = _DESCRIPTION.validate_json(file.read_bytes())
    except OSError as error:
        raise DataError(f"cannot be read: {error.strerror}") from error
    except ValidationError as error:
        raise DataError(explain_invalid(error)) from error
    if description.schema_version != SCHEMA_VERSION:
        raise DataError(
            f"schema_version is {description.schema_version}, this program reads {SCHEMA_VERSION}. "
            f"The folder was made by {description.created_by}: try that"
        )
    try:
        session_record(description.session)
    except ValidationError as error:
        raise DataError(explain_invalid(error, within="session")) from error
    return description


def explain_invalid(error: ValidationError, *, within: str = "") -> str:
    """Return in one line what is wrong with a record: each field, inside the part that was read, and why."""
    outer = (within,) if within else ()
    return "; ".join(
        f"{'.'.join(map(str, (*outer, *item['loc'])))}: {item['msg']}".removeprefix(": ") for item in error.errors()
    )
