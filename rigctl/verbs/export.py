"""`rigctl export`: a run in a format that other programs read."""

import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Unpack

from rigctl.console.json_text import Json
from rigctl.console.terminal import warn
from rigctl.errors import ConfigError
from rigctl.files.choices import ExportFormat
from rigctl.verbs.options import FilePath, RunOptions, RunPath, Writes
from rigctl.verbs.result import Part, Result

_MOST_NAME = 100  # characters of the name that the unfinished export bears


def export(
    run: RunPath,
    /,
    *,
    to: ExportFormat,
    out: Annotated[FilePath, Writes(kind="absent")],
    **frames: Unpack[RunOptions],
) -> "ExportedRun":
    """Write a run in a format that other programs read; each frame's checksum is verified on the way.

    Example: rigctl export runs/2026-05-04 --to hdf5 --out panels.h5

    Parameters
    ----------
    run : path or Run
        Run folder.
    to : {"tiff", "hdf5", "zarr"}
        TIFF files, one HDF5 file, or a Zarr folder.
    out : path
        File or folder to make; it is complete, or not there at all.
    **frames
        Which frames are read, see `RunOptions`.

    Returns
    -------
    ExportedRun
        What was written.

    Raises
    ------
    ConfigError
        The place is taken, or the library that writes the format is not installed.
    RunFolderError
        A frame is damaged, or frames differ in size where one array holds all.
    """
    from rigctl.base.durable import PART_SUFFIX
    from rigctl.files.rig_file import unset_polarizer
    from rigctl.runs.check import used_run
    from rigctl.runs.export import export_hdf5, export_tiff, export_zarr

    path, place = Path(run), Path(out)
    if place.exists():
        raise ConfigError(f"--out: {place} is there already; name a file or folder that does not exist yet")
    used = used_run(path, **frames)
    write = {"tiff": export_tiff, "hdf5": export_hdf5, "zarr": export_zarr}[to]
    with tempfile.TemporaryDirectory(dir=place.parent, prefix=f".{place.name[:_MOST_NAME]}-", suffix=PART_SUFFIX) as at:
        part = Path(at) / "part"
        write(used, part)
        part.replace(place)
    for doubt in unset_polarizer(path, placeholder=used.session.polarizer.placeholder):
        warn(doubt)
    return ExportedRun(run=path, out=place, to=to, frames=len(used.frames))


@dataclass(frozen=True, kw_only=True)
class ExportedRun(Result):
    """What an export wrote."""

    run: Path
    out: Path
    to: ExportFormat
    frames: int

    def content(self) -> Iterable[Part]:
        """Return how many frames were written, and where."""
        yield f"{self.frames} frames in {self.out}"

    def as_json(self) -> dict[str, Json]:
        """Return run, place, format and number of frames."""
        return {"run": str(self.run), "out": str(self.out), "to": self.to, "frames": self.frames}
