"""`rigctl import`: a run made of images that exist, or images added to such a run."""

import math
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Unpack

from drivers.cameras.raw_planes import Plane
from rigctl.base.durable import MOST_FRAME_MB
from rigctl.console.json_text import Json
from rigctl.errors import ConfigError, DataError, RunFolderError
from rigctl.files.choices import FrameKind
from rigctl.verbs.options import COMMA_SEPARATED, FilePath, FrameOptions, MaxFrameMb, Writes
from rigctl.verbs.result import Part, Result
from rigctl.verbs.stokes import FILES as STOKES_FILES
from rigctl.verbs.stokes import StokesResult
from rigctl.verbs.stokes import stokes as measure_stokes

if TYPE_CHECKING:
    from rigctl.imports.images import ImportRequest, Scale, Survey, SurveyedImage
    from rigctl.measure.diagnose import RunDiagnosis
    from rigctl.runs.folder import Run as RunRecord
    from rigctl.runs.records import FrameRecord
    from rigctl.runs.writer import RunWriter

_ORIGIN = "import"
_BYTES_PER_MB = 1_000_000
_CLIPPED_SHARE = 1e-3  # of the pixels of a file, beyond which it is reported


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

    Returns
    -------
    ImportedRun
        The new frames, and what was recognised in the files.

    Raises
    ------
    ConfigError
        Something is not stated, or stated wrongly: one message with every problem.
    DataError
        The files are unfit, or contradict what is stated: one message with every problem.
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
    """What an import has made."""

    run: Path
    frames: "tuple[FrameRecord, ...]"  #: the new ones
    remarks: tuple[str, ...]  #: what was recognised in the files, and doubts
    clipped_shares: tuple[float, float]  #: of all pixels, at the upper end of the range and at 0
    diagnosis: "RunDiagnosis"  #: faults that the frames show at a first look
    measured: StokesResult | None = None  #: Stokes parameters, where they were asked for

    @property
    def exit_code(self) -> int:
        """4 where the run was measured and is unsound."""
        return 0 if self.measured is None else self.measured.exit_code

    def content(self) -> Iterable[Part]:
        """Return the number and size of the frames, remarks, and the faults that they show."""
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
    """Import images as a request says."""
    from rigctl.imports.images import survey_images
    from rigctl.runs.writer import RunWriter

    present = _present_run(request.run)
    survey = survey_images(request)
    scale = _checked_scale(request, survey, present)
    if present is None:
        frames = _write_new(request, survey, scale)
    else:
        with RunWriter.append(request.run) as writer:
            frames = _write(writer, request, survey, scale, present.frames)
    return ImportedRun(
        run=request.run,
        frames=frames,
        remarks=(*survey.remarks, *scale.remarks, *_file_remarks(survey, scale), *_angle_remarks(request, survey)),
        clipped_shares=_clipped_shares(survey, scale, frames),
        diagnosis=_first_look(request, survey),
    )


def _clipped_shares(survey: "Survey", scale: "Scale", frames: "Sequence[FrameRecord]") -> tuple[float, float]:
    """Return which shares of all pixels are saturated, and at 0 without being missing."""
    half = 1 << max(scale.shift_bits - 1, 0)
    at_zero = sum(i.at_zero if i.is_wide else int(i.levels[:half].sum()) for i in survey.images)
    total = sum(i.shape[0] * i.shape[1] for i in survey.images)
    high = sum(record.saturated_fraction for record in frames) / len(frames)
    return high, 0.0 if scale.missing_dn == 0 else at_zero / total


def _saturated_from(scale: "Scale") -> int:
    return math.ceil(scale.saturation_dn * (1 << scale.shift_bits))


def _first_look(request: "ImportRequest", survey: "Survey") -> "RunDiagnosis":
    from rigctl.measure.diagnose import quick_diagnosis, undiagnosed
    from rigctl.runs.folder import read_run

    kinds = {image.kind for image in survey.images}
    if "scene" not in kinds:
        return undiagnosed(f"the files are {' and '.join(sorted(kinds))} frames")
    return (
        undiagnosed("the axes are not known" if request.stage_angles is not None else "fewer than three axes")
        if _angle_remarks(request, survey)
        else quick_diagnosis(read_run(request.run))
    )


def _present_run(path: Path) -> "RunRecord | None":
    from rigctl.runs.folder import read_run

    if not path.exists() or (path.is_dir() and not any(path.iterdir())):
        return None
    run = read_run(path)
    if run.session.origin != _ORIGIN:
        raise RunFolderError(f"{path}: holds frames that were taken, not imported; import into a folder of its own")
    return run


def _checked_scale(request: "ImportRequest", survey: "Survey", present: "RunRecord | None") -> "Scale":
    from rigctl.imports.images import request_problems

    has_darks = present is not None and any(record.kind == "dark" for record in present.frames)
    unsaid = [*request_problems(request, survey.images, darks_are_there=has_darks), *survey.unsaid]
    unfit = [*survey.unfit]
    scale: Scale | None = None
    if survey.images:
        try:
            scale = _scale(request, survey, present)
            unfit += _contradictions(request, survey, scale, present)
        except ConfigError as error:
            unsaid.append(str(error))
        except DataError as error:
            unfit.append(str(error))
    problems = "\n  ".join(["nothing was imported:", *unsaid, *unfit])
    if unsaid:
        raise ConfigError(problems)
    if unfit or scale is None:
        raise DataError(problems)
    return scale


def _scale(request: "ImportRequest", survey: "Survey", present: "RunRecord | None") -> "Scale":
    from rigctl.imports.images import find_scale

    black_levels = [image.black_level_dn for image in survey.images if image.black_level_dn is not None]
    said, remarks = _with_depth_of(present, request)
    scale = find_scale(
        said,
        survey.levels,
        sample_bits=max(image.sample_bits for image in survey.images),
        black_level_dn=min(black_levels, default=None),
        levels_by_file=tuple(image.levels for image in survey.images),
        borders=tuple(image.border for image in survey.images if image.border is not None),
        wide=tuple(image for image in survey.images if image.is_wide),
        unset=sum(image.unset for image in survey.images),
    )
    return replace(scale, remarks=(*remarks, *scale.remarks))


def _with_depth_of(present: "RunRecord | None", request: "ImportRequest") -> "tuple[ImportRequest, tuple[str, ...]]":
    if request.bit_depth is not None or present is None or not present.frames:
        return request, ()
    # The frames of one run come from one camera.
    depth = present.frames[0].bit_depth
    return replace(request, bit_depth=depth), (f"{depth} bits, as the other frames of this run",)


def _contradictions(
    request: "ImportRequest", survey: "Survey", scale: "Scale", present: "RunRecord | None"
) -> Iterator[str]:
    if present is None or not present.frames:
        return
    height, width = _frame_shape(request, survey.images[0])
    record = present.frames[0]
    if (record.height, record.width) != (height, width):
        yield (
            f"frames of {width} x {height} pixels do not fit {request.run}, whose frames have "
            f"{record.width} x {record.height}"
        )
    if record.bit_depth != scale.bit_depth:
        yield f"--bit-depth {scale.bit_depth}: the frames of {request.run} have {record.bit_depth}"


def _frame_shape(request: "ImportRequest", image: "SurveyedImage") -> tuple[int, int]:
    height, width = image.shape
    return (height, width) if request.mosaic_deg is None else (height // 2, width // 2)


def _file_remarks(survey: "Survey", scale: "Scale") -> Iterator[str]:
    """Yield what was recognised in single files, and in how many."""
    from rigctl.images import STALE
    from rigctl.imports.images import JPEG
    from rigctl.imports.levels import odd_pattern

    saturated = _saturated_from(scale)
    shares = {i.path.name: float(i.levels[saturated:].sum() / max(i.levels.sum(), 1)) for i in survey.images}
    clipped = [f"{share:.2%} of {name}" for name, share in shares.items() if share > _CLIPPED_SHARE]
    if clipped:
        yield f"saturated pixels, where nothing is measured: {', '.join(clipped)}"
    odd = {image.path.name: text for image in survey.images if (text := odd_pattern(image.levels))}
    if odd:
        yield f"odd bits in {len(odd)} of {len(survey.images)} files ({', '.join(odd)}): {next(iter(odd.values()))}"
    coded = [image.path.name for image in survey.images if image.is_jpeg]
    if coded:
        yield f"{len(coded)} of {len(survey.images)} files ({', '.join(coded)}): {JPEG}"
    yield from dict.fromkeys(remark for image in survey.images for remark in image.remarks if STALE in remark)


def _angle_remarks(request: "ImportRequest", survey: "Survey") -> tuple[str, ...]:
    from rigctl.imports.images import axis_deg

    angles = request.mosaic_deg or tuple(
        i.angle_deg for i in survey.images if i.kind == "scene" and i.angle_deg is not None
    )
    axes = {axis_deg(angle) for angle in angles}
    if all(image.kind != "scene" for image in survey.images) or len(axes) >= 3:
        return ()
    if not axes and request.stage_angles is not None:
        return ("stage angles only: `rigctl calibrate axis` takes these frames, Stokes parameters need the axis",)
    return (f"{len(axes)} different axes only: Stokes parameters need three or more, modulo 180 degrees",)


def _write_new(request: "ImportRequest", survey: "Survey", scale: "Scale") -> "tuple[FrameRecord, ...]":
    from rigctl.base.durable import flush_folder
    from rigctl.runs.writer import RunWriter

    parent = request.run.absolute().parent
    try:
        parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=parent, prefix=f".{request.run.name}-", suffix=".part") as scratch:
            unfinished = Path(scratch) / "run"
            with RunWriter.create(unfinished, {"origin": _ORIGIN}) as writer:
                frames = _write(writer, request, survey, scale, ())
            unfinished.replace(request.run)
        flush_folder(parent)
    except OSError as error:
        raise RunFolderError(f"{request.run}: cannot be written: {error.strerror}") from error
    return frames


def _write(
    writer: "RunWriter",
    request: "ImportRequest",
    survey: "Survey",
    scale: "Scale",
    present: "tuple[FrameRecord, ...]",
) -> "tuple[FrameRecord, ...]":
    from rigctl.imports.images import frames_of

    frames = frames_of(request, survey.images, scale, first_sequence=writer.next_sequence, present=present)
    written = writer.write_frames(frames)
    kinds = " and ".join(sorted({image.kind for image in survey.images}))
    writer.closing_event("imported", kind=kinds, frames=len(written), files=[str(f) for f in request.files])
    return written
