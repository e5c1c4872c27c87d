"""`rigctl import`: makes a run from existing images, or adds images to such a run."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Unpack, cast, get_type_hints

from rigctl.console import Json
from rigctl.imports.options import ImportOptions, PictureOptions
from rigctl.verbs.options import FilePath, FrameOptions, Part, Result, Writes, extend_help
from rigctl.verbs.stokes import FILES as STOKES_FILES
from rigctl.verbs.stokes import StokesResult
from rigctl.verbs.stokes import stokes as measure_stokes

if TYPE_CHECKING:
    from rigctl.files.choices import FrameKind
    from rigctl.measure.diagnose import RunDiagnosis
    from rigctl.runs.records import FrameRecord


class MeasuredImportOptions(ImportOptions, FrameOptions, total=False):
    """Facts about imported pictures, and calibrations for their measurement."""


extend_help(MeasuredImportOptions, PictureOptions, ImportOptions, FrameOptions)


def import_images(
    run: Annotated[FilePath, Writes(kind="run", is_argument=True)],
    files: Sequence[FilePath],
    /,
    *,
    stokes: Annotated[FilePath | None, Writes(kind="folder", names=STOKES_FILES)] = None,
    **options: Unpack[MeasuredImportOptions],
) -> "ImportedRun":
    """Make a run from images of other programs, or add images of another kind to such a run.

    Polarizer angles are those of the transmission axis, counter-clockwise from horizontal in the picture as shown.
    They, the exposure and the black level are read from headers and file names; give by option what these do not say.
    Pictures are cut to TRIMSEC or DATASEC. RETANG is read as the angle of a half-wave plate, which turns the axis by
    twice its angle. The command prints what it recognised. If one file is refused, nothing is written.

    Example: rigctl import runs/panels panel_0.png panel_45.png panel_90.png panel_135.png --same-exposure
    --black-level-dn 15 --stokes panels

    Example: rigctl import runs/fruits fruits.png --mosaic 90,45,135,0 --black-level-dn 0

    Example: rigctl import runs/corona a.fits b.fits c.fits --angles 0,60,-60 --exposure-key EXPTIME
    --black-level-key OFFSET --bit-depth 16

    Example: rigctl import runs/sky a.dng b.dng c.dng --angles 0,60,-60 --plane green-1 --exposure-key EXPTIME
    --black-level-key BLACK --bit-depth 12

    Parameters
    ----------
    run : path
        New run folder, or one that was imported before.
    files : sequence of path
        FITS, PNG, TIFF or camera RAW images in the order in which they were taken, folders of them, and arrays in HDF5
        and NetCDF files, as in scan.h5:/entry/data. Each picture of a stack is a frame.
    stokes : path
        Folder for results: also measure the run, as rigctl stokes does.
    **options
        Facts about the files, see `ImportOptions`, and calibrations for their measurement, see `FrameOptions`.
    """
    from rigctl.images import image_files
    from rigctl.imports.images import axis_remarks
    from rigctl.imports.images import import_images as import_into

    frames, remarks, clipped_shares = import_into(Path(run), image_files(list(map(Path, files))), options)
    kinds = {frame.kind for frame in frames}
    found = ImportedRun(
        run=Path(run),
        frames=frames,
        remarks=remarks,
        clipped_shares=clipped_shares,
        diagnosis=_first_look(Path(run), kinds, has_axes=not axis_remarks(options, frames)),
    )
    if stokes is None:
        return found
    of_files = get_type_hints(ImportOptions)
    frame_options = cast("FrameOptions", {name: one for name, one in options.items() if name not in of_files})
    return replace(found, measured=measure_stokes(run, out=stokes, **frame_options))


@dataclass(frozen=True, kw_only=True)
class ImportedRun(Result):
    """Result of an import."""

    run: Path
    frames: "tuple[FrameRecord, ...]"  #: the new ones
    remarks: tuple[str, ...]  #: recognised properties of the files, and doubts
    clipped_shares: tuple[float, float]  #: shares of all pixels at the upper end of the range and at 0
    diagnosis: "RunDiagnosis"  #: faults found at a first look
    measured: StokesResult | None = None  #: Stokes parameters, if requested

    @property
    def exit_code(self) -> int:
        """4 if the run was measured and is unsound."""
        return 0 if self.measured is None else self.measured.exit_code

    def content(self) -> Iterable[Part]:
        """Return the number and size of the frames, remarks, and faults."""
        from rigctl.base.numbers import percent

        first = self.frames[0]
        size = f"{first.width} x {first.height} pixels, {first.bit_depth} bits"
        high, low = map(percent, self.clipped_shares)
        yield f"clipped: {high} of the pixels at the upper end ({first.saturation_dn:g} DN), {low} at 0"
        kinds = Counter(record.kind for record in self.frames)
        yield f"{self.run}: {', '.join(f'{number} {kind}' for kind, number in kinds.items())} frames of {size}"
        yield from (f"  note: {remark}" for remark in self.remarks)
        if "scene" in kinds:
            yield from (f"  first look: {line}" for line in self.diagnosis.lines)
        if self.measured is not None:
            yield from self.measured.content()

    def as_json(self) -> dict[str, Json]:
        """Return the files of the frames, remarks and faults."""
        from rigctl.report.measurement import diagnosis_json

        return {
            "run": str(self.run),
            "frames": [record.file for record in self.frames],
            "remarks": list(self.remarks),
            "diagnosis": diagnosis_json(self.diagnosis),
            **({} if self.measured is None else {"stokes": self.measured.as_json()}),
        }


def _first_look(run: Path, kinds: set["FrameKind"], *, has_axes: bool) -> "RunDiagnosis":
    from rigctl.measure.diagnose import quick_diagnosis, undiagnosed
    from rigctl.runs.folder import read_run

    if "scene" not in kinds:
        return undiagnosed(f"the files are {' and '.join(sorted(kinds))} frames")
    if not has_axes:
        return undiagnosed("fewer than three axes")
    return quick_diagnosis(read_run(run))
