"""Archives of arrays (.npz) that others may have made: judged by their headers before memory is taken."""

import io
import math
import zipfile
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.base.durable import MOST_RECORD_BYTES, read_bounded
from rigctl.errors import DataError

_MOST_HEADER_BYTES = 4096


def read_arrays(path: Path, *, only: Collection[str] | None = None) -> dict[str, NDArray[Any]]:
    """Return the arrays of an archive by their names."""
    try:
        data = read_bounded(path, MOST_RECORD_BYTES)
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        _require_size(data)
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files if only is None or name in only}
    except DataError as error:
        raise DataError(f"{path}: {error}") from error
    except Exception as error:  # whatever zipfile and numpy trip over in an archive that is spoilt
        raise DataError(f"{path}: is no numpy archive (.npz) that can be read: {error}") from error


def _require_size(data: bytes) -> None:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = archive.infolist()
        unpacked = sum(member.file_size for member in members)
        if unpacked > MOST_RECORD_BYTES:
            raise DataError(f"unpacks to {unpacked / 1e6:.4g} MB, and at most {MOST_RECORD_BYTES / 1e6:.4g} are read")
        for member in members:
            with archive.open(member) as file:
                declared = _declared_bytes(file.read(_MOST_HEADER_BYTES))
            if declared > member.file_size:
                raise DataError(f"{member.filename} declares {declared} bytes and has {member.file_size}")


def _declared_bytes(start: bytes) -> int:
    header = io.BytesIO(start)
    version = np.lib.format.read_magic(header)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(header)
    return math.prod(shape) * int(dtype.itemsize)
