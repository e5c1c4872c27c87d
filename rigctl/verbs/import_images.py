"""`rigctl import`: makes a run from existing images, or adds images to such a run."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Unpack

from drivers.cameras.raw_planes import Plane
from rigctl.base.durable import MOST_FRAME_MB
from rigctl.console import Json
from rigctl.files.choices import FrameKind
from rigctl.verbs.options import COMMA_SEPARATED, FilePath, FrameOptions, MaxFrameMb, Part, Result, Writes
from rigctl.verbs.stokes import FILES as STOKES_FILES
from rigctl.verbs.stokes import StokesResult
from rigctl.verbs.stokes import stokes as measure_stokes

if TYPE_CHECKING:
    from rigctl.imports.images import ImportRequest
    from rigctl.measure.diagnose import RunDiagnosis
    from rigctl.runs.records import FrameRecord

_BYTES_PER_MB = 1_000_000


def import_images(
    run: Annotated[FilePath, Writes(kind="run", is_argument=True)],
    files: Sequence[FilePath],
    /,
    *,
    angles: Annotated[Sequence[float | str] | None, COMMA_SEPARATED] = None,
    angle_key: str | None = None,
    stage_angles: Annotated[Sequence[float | str] | None, COMMA_SEPARATED] = None,
    mosaic: Annotated[Sequence[float] | None, COMMA_SEPARATED] = None,
    kind: FrameKind | None = None,
    exposure_s: float | None = None,
    exposure_key: str | None = None,
    same_exposure: bool = False,
    black_level_dn: float | None = None,
    black_level_key: str | None = None,
    black_level_from_darks: bool = False,
    bit_depth: int | None = None,
    coadds: int | None = None,
    averaged: int | None = None,
    justified: Literal["left", "right"] | None = None,
    saturation_dn: float | None = None,
    missing_dn: float | Literal["none"] | None = None,
    no_border_search: bool = False,
    first_row: Literal["top", "bottom"] | None = None,
    plane: Plane | None = None,
    max_frame_mb: MaxFrameMb = MOST_FRAME_MB,
    stokes: Annotated[FilePath | None, Writes(kind="folder", names=STOKES_FILES)] = None,
    **frames: Unpack[FrameOptions],
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
        and NetCDF files, as in scan.h5:/entry/data.
    angles : sequence of float, or str
        Polarizer angle of each file [deg], such as 0,60,-60, or a CSV table with the columns file and angle_deg;
        default: from headers or file names.
    angle_key : str
        Header keyword with the angle [deg].
    stage_angles : sequence of float, or str
        Stage angles of a polarizer scan [deg]: 0,10,20, a header keyword, or a CSV table (columns file,
        stage_angle_deg).
    mosaic : sequence of float
        Angles of the 2 x 2 cell at the top left, row by row [deg].
    kind : {"scene", "dark", "flat"}
        Kind of frames; default: from headers or file names, otherwise scene.
    exposure_s : float
        Exposure of every file [s].
    exposure_key : str
        Header keyword with the exposure [s]; default: EXPTIME if all files have it.
    same_exposure : bool
        All files have the same exposure, of unknown length.
    black_level_dn : float
        Counts without light [DN as in the files]; default: mean of the overscan if headers have BIASSEC.
    black_level_key : str
        Header keyword with the black level [DN].
    black_level_from_darks : bool
        Take the black level from dark frames that are imported too.
    bit_depth : int
        Bits per sample of the camera, 1 to 32.
    coadds : int
        Number of reads that each file is the sum of; default: COADDS of the header.
    averaged : int
        Number of reads that each file is the mean of; default: NCOMBINE of the header.
    justified : {"left", "right"}
        Position of these bits in a 16-bit sample, if the counts do not show it.
    saturation_dn : float
        Count from which a pixel is saturated [DN as in the files].
    missing_dn : float or "none"
        Value of missing pixels [DN as in the files], or none. NaN and infinite values are always missing.
    no_border_search : bool
        Do not look for constant pixels along the edges.
    first_row : {"top", "bottom"}
        First row in the files; default for FITS: bottom, unless ROWORDER says otherwise.
    plane : {"red", "green-1", "green-2", "blue", "green", "sum", "all"}
        Colour to take from colour images and RAW files; green-1 is the green in the rows of red.
    max_frame_mb : int
        Largest picture that is read [MB of samples].
    stokes : path
        Folder for results: also measure the run, as rigctl stokes does.
    **frames
        Calibrations and corrections for that, see `FrameOptions`.
    """
    from rigctl.images import image_files
    from rigctl.imports.images import ImportRequest

    request = ImportRequest(
        run=Path(run),
        files=tuple(image_files(list(map(Path, files)))),
        kind=kind,
        angles_deg=None if angles is None else tuple(angles),
        angle_key=angle_key,
        stage_angles=None if stage_angles is None else tuple(stage_angles),
        mosaic_deg=None if mosaic is None else tuple(mosaic),
        exposure_s=exposure_s,
        exposure_key=exposure_key,
        same_exposure=same_exposure,
        black_level_dn=black_level_dn,
        black_level_key=black_level_key,
        black_level_from_darks=black_level_from_darks,
        bit_depth=bit_depth,
        coadds=coadds,
        averaged=averaged,
        justified=justified,
        saturation_dn=saturation_dn,
        missing_dn=None if missing_dn == "none" else missing_dn,
        none_missing=missing_dn == "none",
        no_border_search=no_border_search,
        first_row=first_row,
        plane=plane,
        most_bytes=max_frame_mb * _BYTES_PER_MB,
    )
    found = imported(request)
    return found if stokes is None else replace(found, measured=measure_stokes(run, out=stokes, **frames))


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
        from rigctl.report.numbers import diagnosis_json

        return {
            "run": str(self.run),
            "frames": [record.file for record in self.frames],
            "remarks": list(self.remarks),
            "diagnosis": diagnosis_json(self.diagnosis),
            **({} if self.measured is None else {"stokes": self.measured.as_json()}),
        }


def imported(request: "ImportRequest") -> ImportedRun:
    """Import the images of a request."""
    from rigctl.imports.images import import_images

    frames, remarks, clipped_shares = import_images(request)
    return ImportedRun(
        run=request.run,
        frames=frames,
        remarks=remarks,
        clipped_shares=clipped_shares,
        diagnosis=_first_look(request, frames),
    )


def _first_look(request: "ImportRequest", frames: "Sequence[FrameRecord]") -> "RunDiagnosis":
    from rigctl.imports.images import axis_remarks
    from rigctl.measure.diagnose import quick_diagnosis, undiagnosed
    from rigctl.runs.folder import read_run

    kinds = {frame.kind for frame in frames}
    if "scene" not in kinds:
        return undiagnosed(f"the files are {' and '.join(sorted(kinds))} frames")
    if axis_remarks(request, frames):
        return undiagnosed("the axes are not known" if request.stage_angles is not None else "fewer than three axes")
    return quick_diagnosis(read_run(request.run))
