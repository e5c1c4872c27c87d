"""The file ``status.json`` of a run folder: how the session stands now, for whoever looks from another terminal."""

import json
from pathlib import Path
from typing import Any

from rigctl.errors import RunFolderError

STATUS_FILE = "status.json"


def write_status(run: Path, status: dict[str, Any]) -> None:
    """Replace the status, in one step and without waiting for the disk: it is of no worth after a power cut.

    Raises
    ------
    OSError
        It cannot be written.
    """
    beside = run / f".{STATUS_FILE}"
    beside.write_text(json.dumps(status, allow_nan=False) + "\n", encoding="ascii")
    beside.replace(run / STATUS_FILE)


def read_status(run: Path) -> dict[str, Any] | None:
    """Return the status, or None where the session never wrote one.

    Raises
    ------
    RunFolderError
        It cannot be read.
    """
    file = run / STATUS_FILE
    if not file.exists():
        return None
    try:
        status: dict[str, Any] = json.loads(file.read_text(encoding="ascii"))
    except (OSError, ValueError) as error:
        raise RunFolderError(f"{file}: cannot be read: {error}") from error
    return status
