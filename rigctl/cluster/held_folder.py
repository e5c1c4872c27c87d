"""Folders into which results come bit by bit, by one command at a time."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rigctl.errors import DataError

PARTS_FOLDER = "parts"
_LOCK_FILE = ".lock"


@contextmanager
def held_folder(out: Path) -> Iterator[None]:
    """Hold a folder of results, which is made where it is not there: no other command writes into it meanwhile.

    Raises
    ------
    DataError
        Another command holds it.
    """
    (out / PARTS_FOLDER).mkdir(parents=True, exist_ok=True)
    descriptor = os.open(out / _LOCK_FILE, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise DataError(f"{out}: another command computes into this folder now; name another --out") from error
        yield
    finally:
        os.close(descriptor)
