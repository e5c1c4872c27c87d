"""Files of a result in its folder."""

from collections.abc import Mapping
from pathlib import Path

from rigctl.storage.durable_file import write_durably


def write_folder(out: Path, contents: Mapping[str, bytes]) -> tuple[str, ...]:
    """Write files into a folder, which is made where it is not there; return their names.

    Files of the same names are replaced.
    """
    out.mkdir(parents=True, exist_ok=True)
    for name, data in contents.items():
        write_durably(out / name, data)
    return tuple(contents)
