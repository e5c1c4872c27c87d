"""`rigctl export`: a run in a format for other programs."""

import tempfile
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Unpack

from rigctl.console import Json, warn
from rigctl.errors import ConfigError
from rigctl.files.choices import ExportFormat
from rigctl.verbs.options import (
    FilePath,
    FrameOptions,
    Part,
    RegionsPath,
    Result,
    RunPath,
    Writes,
    calibrations_of,
    regions_of,
)

if TYPE_CHECKING:
    from rigctl.files.regions import Region
    from rigctl.runs.folder import Run

_MOST_NAME = 100  # characters of the name that an unfinished export keeps


def export(
    run: RunPath,
    /,
    *,
    to: ExportFormat,
    out: Annotated[FilePath, Writes(kind="absent")],
    of: Literal["frames", "stokes"] = "frames",
    regions: RegionsPath | None = None,
    **frames: Unpack[FrameOptions],
) -> "ExportedRun":
    """Write a run in a format that other programs read; each frame's checksum is verified on the way.

    csv has the numbers of regions, one row for each cycle, region and quantity. fits has all frames and a table of
    their metadata in one file, tiff one file per frame, hdf5 and zarr one array. With --of stokes, the Stokes
    parameters, DoLP and AoLP of every pixel are written with their errors and mask, as in stokes.fits.

    Example: rigctl export runs/2026-05-04 --to hdf5 --out panels.h5

    Example: rigctl export runs/2026-05-04 --to csv --regions regions.toml --out panels.csv

    Example: rigctl export runs/2026-05-04 --of stokes --to hdf5 --noise noise.json --out stokes.h5

    Parameters
    ----------
    run : path or Run
        Run folder.
    to : {"csv", "fits", "tiff", "hdf5", "zarr"}
        Format; tiff, hdf5 and zarr need pip install 'rigctl[export]'.
    out : path
        File or folder to write; a failed export leaves nothing.
    of : {"frames", "stokes"}
        Frames as they were taken, or the Stokes parameters of every pixel.
    regions : path or sequence of Region
        Regions file, for csv; with --of stokes, only pixels of the regions are written.
    **frames
        Calibrations and corrections, for csv and stokes, and which frames are read, see `FrameOptions`.
    """
    from rigctl.base.durable import PART_SUFFIX
    from rigctl.files.rig_file import unset_polarizer
    from rigctl.runs import export as formats
    from rigctl.runs.check import run_to_measure

    path, place = Path(run), Path(out)
    if place.exists():
        raise ConfigError(f"--out: {place} exists already; give a file or folder that does not exist yet")
    if of == "stokes" and (to == "tiff" or (to != "csv" and regions is not None)):
        raise ConfigError(f"--of stokes --to {to}: say --to fits, hdf5, zarr or csv; --regions is for csv")
    if of == "frames" and to == "csv" and regions is None:
        raise ConfigError("--to csv: has the numbers of regions: give --regions FILE")
    if of == "frames" and to != "csv" and (regions is not None or set(frames) - {"ignore_exclusions"}):
        raise ConfigError(f"--to {to}: frames are written as they are; --regions and calibrations are for --to csv")
    used = run_to_measure(path, ignore_exclusions=frames.get("ignore_exclusions", False))
    with tempfile.TemporaryDirectory(dir=place.parent, prefix=f".{place.name[:_MOST_NAME]}-", suffix=PART_SUFFIX) as at:
        part = Path(at) / "part"
        if of == "stokes":
            _stokes(used, regions_of(regions), frames, to, part)
        elif to == "csv":
            part.write_bytes(_cycles_csv(used, regions_of(regions), frames))
        else:
            getattr(formats, f"export_{to}")(used, part)
        part.replace(place)
    for doubt in unset_polarizer(path, placeholder=used.session.polarizer.placeholder):
        warn(doubt)
    return ExportedRun(run=path, out=place, of=of, to=to, frames=len(used.frames))


def _stokes(run: "Run", regions: "list[Region]", frames: FrameOptions, to: ExportFormat, out: Path) -> None:
    """Measure a run, and write the result pixel by pixel."""
    from rigctl.files.regions import masks
    from rigctl.report import stokes_file
    from rigctl.verbs.stokes import stokes_of

    found = stokes_of(run, regions, calibrations_of(frames), correct=tuple(frames.get("correct", ())))
    measurement, errors, files = found.measurement, found.errors, found.calibration_files
    if to == "fits":
        out.write_bytes(stokes_file.stokes_fits(measurement, errors, files))
    elif to == "csv":
        inside = masks(regions, width=measurement.grid.width, height=measurement.grid.height)
        stokes_file.stokes_csv(measurement, errors, inside, out)
    else:
        (stokes_file.stokes_hdf5 if to == "hdf5" else stokes_file.stokes_zarr)(measurement, errors, files, out)


def _cycles_csv(run: "Run", regions: "list[Region]", frames: FrameOptions) -> bytes:
    """Return the means of regions by cycle, each cycle measured like a run."""
    from rigctl.measure.frames import arrange
    from rigctl.report.document import Table, value_columns
    from rigctl.verbs.stokes import stokes_of

    paths, correct = calibrations_of(frames), tuple(frames.get("correct", ()))
    names = ("cycle", "start_utc", "region", "quantity", "value", "std_error")
    rows: list[tuple[Any, ...]] = []
    for number, records in enumerate(arrange(run).records):
        others = tuple(record for record in run.frames if record.kind != "scene")
        found = stokes_of(replace(run, frames=(*others, *records)), regions, paths, correct=correct)
        for region, measured in found.measurement.regions.items():
            for quantity, statistics in measured.quantities.items():
                mean = statistics["mean"]
                rows.append((number, records[0].start_utc or "", region, quantity, mean.value, mean.std_error))
    return Table(columns=value_columns(*names), rows=tuple(rows)).csv().encode()


def _item(row: tuple[Any, ...], place: int) -> Any:
    return row[place]


@dataclass(frozen=True, kw_only=True)
class ExportedRun(Result):
    """The files of an export."""

    run: Path
    out: Path
    of: Literal["frames", "stokes"]
    to: ExportFormat
    frames: int

    def content(self) -> Iterable[Part]:
        """Return the content of the file, and the number of frames."""
        numbers = "Stokes parameters of pixels" if self.of == "stokes" else "means of regions, cycle by cycle,"
        has_frames = self.of == "frames" and self.to != "csv"
        yield (
            f"{self.frames} frames in {self.out}" if has_frames else f"{numbers} from {self.frames} frames: {self.out}"
        )

    def as_json(self) -> dict[str, Json]:
        """Return run, file, format and number of frames."""
        return {"run": str(self.run), "out": str(self.out), "to": self.to, "frames": self.frames}
