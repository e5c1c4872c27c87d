"""Small files that are either whole under their name, or not there: power cuts and full disks included."""

import os
from pathlib import Path

PART_SUFFIX = ".part"


def write_durably(path: Path, data: bytes) -> None:
    """Return once the data are on the disk under their name.

    Parameters
    ----------
    path : Path
        The file's final name; an existing file is replaced in one step. Its folder must exist.
    data : bytes
        The whole content.

    Raises
    ------
    OSError
        The data could not be written (disk full, no permission). Nothing is left behind, and a file that was
        there before is untouched.

    Notes
    -----
    Written beside its place as ``NAME.part``, flushed to the disk, renamed, and the folder flushed too. Without
    the first flush a rename can leave an empty file under a good name; without the second the last file may be
    missing after a power cut.
    """
    part = path.with_name(path.name + PART_SUFFIX)
    try:
        _write_and_flush(part, data)
        part.replace(path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    flush_folder(path.parent)


def flush_folder(folder: Path) -> None:
    """Return once the names in a folder are on the disk."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _write_and_flush(path: Path, data: bytes) -> None:
    with path.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
