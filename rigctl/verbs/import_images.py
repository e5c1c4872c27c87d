"""`rigctl import`: a run made of images that exist, or images added to such a run."""

import math
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from drivers.cameras.raw_planes import Plane
from rigctl.base.durable import MOST_FRAME_MB
from rigctl.console.json_text import Json
from rigctl.errors import ConfigError, DataError, RunFolderError
from rigctl.files.choices import FrameKind
from rigctl.verbs.options import COMMA_SEPARATED, FilePath, MaxFrameMb, Writes
from rigctl.verbs.result import Part, Result

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
    angles: Annotated[Sequence[float] | None, COMMA_SEPARATED] = None,
    angle_key: str | None = None,
    stage_angles: Annotated[Sequence[float | str] | None, COMMA_SEPARATED] = None,
    mosaic: Annotated[Sequence[float] | None, COMMA_SEPARATED] = None,
    kind: FrameKind = "scene",
    exposure_s: float | None = None,
    exposure_key: str | None = None,
    same_exposure: bool = False,
    black_level_dn: float | None = None,
    black_level_key: str | None = None,
    black_level_from_darks: bool = False,
    bit_depth: int | None = None,
    justified: Literal["left", "right"] | None = None,
    saturation_dn: float | None = None,
    missing_dn: float | Literal["none"] | None = None,
    no_border_search: bool = False,
    first_row: Literal["top", "bottom"] | None = None,
    plane: Plane | None = None,
    max_frame_mb: MaxFrameMb = MOST_FRAME_MB,
) -> "ImportedRun":
    """Make a run out of images that exist, or add images of another kind to such a run.

    Angles are those of the transmission axis, counter-clockwise from horizontal in the picture as shown. State what
    the files do not say; what is recognised in them is reported, and noted in every frame. Every file is looked at
    before anything is written. A new run is there when it is complete; frames that are added are named in the manifest
    all at once.

    Examples: rigctl import runs/fruits fruits.png --mosaic 90,45,135,0 --black-level-dn 0

    rigctl import runs/corona a.fits b.fits c.fits --angles 0,60,-60 --exposure-key EXPTIME
    --black-level-key OFFSET --bit-depth 16

    rigctl import runs/sky a.dng b.dng c.dng --angles 0,60,-60 --plane green-1 --exposure-key EXPTIME
    --black-level-key BLACK --bit-depth 12

    Parameters
    ----------
    run : path
        Run folder: new, or imported before.
    files : sequence of path
        FITS, PNG, TIFF or camera RAW images, in the order in which they were taken.
    angles : sequence of float
        Polarizer angle of each file [deg], as in 0,60,-60.
    angle_key : str
        Header keyword with the angle [deg].
    stage_angles : sequence of float, or str
        Stage angles of a polarizer scan [deg]: 0,10,20, a header keyword, or a CSV table (columns file,
        stage_angle_deg).
    mosaic : sequence of float
        Angles of the 2 x 2 cell at the top left, row by row [deg].
    kind : {"scene", "dark", "flat"}
        What the camera saw.
    exposure_s : float
        Exposure of every file [s].
    exposure_key : str
        Header keyword with the exposure [s].
    same_exposure : bool
        One exposure for all files, not known how long.
    black_level_dn : float
        Counts without light [DN as in the files].
    black_level_key : str
        Header keyword with the black level [DN].
    black_level_from_darks : bool
        Dark frames, imported too, give the black level.
    bit_depth : int
        Bits of the camera, 1 to 16.
    justified : {"left", "right"}
        End of a sample at which these bits stand, if the counts do not show it.
    saturation_dn : float
        Saturated at and above this [DN as in the files].
    missing_dn : float or "none"
        Value of pixels not received [DN as in the files], or none.
    no_border_search : bool
        Do not look for constant pixels along the edges.
    first_row : {"top", "bottom"}
        First row in the files. FITS: bottom, unless ROWORDER says.
    plane : {"red", "green-1", "green-2", "blue", "green", "sum", "all"}
        Colour of RAW files; green-1 stands in the rows of red.
    max_frame_mb : int
        Refuse a picture of more MB of samples before memory is taken for it.

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
    from rigctl.imports.images import ImportRequest

    request = ImportRequest(
        run=Path(run),
        files=tuple(map(Path, files)),
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
        justified=justified,
        saturation_dn=saturation_dn,
        missing_dn=None if missing_dn == "none" else missing_dn,
        none_missing=missing_dn == "none",
        no_border_search=no_border_search,
        first_row=first_row,
        plane=plane,
        most_bytes=max_frame_mb * _BYTES_PER_MB,
    )
    return imported(request)


@dataclass(frozen=True, kw_only=True)
class ImportedRun(Result):
    """What an import has made."""

    run: Path
    frames: "tuple[FrameRecord, ...]"  #: the new ones
    remarks: tuple[str, ...]  #: what was recognised in the files, and doubts
    clipped_shares: tuple[float, float]  #: of all pixels, at the upper end of the range and at 0
    diagnosis: "RunDiagnosis"  #: faults that the frames show at a first look

    def content(self) -> Iterable[Part]:
        """Return the number and size of the frames, remarks, and the faults that they show."""
        from rigctl.base.numbers import percent
        from rigctl.measure.faults import fault_lines

        first = self.frames[0]
        size = f"{first.width} x {first.height} pixels, {first.bit_depth} bits"
        high, low = map(percent, self.clipped_shares)
        yield f"clipped: {high} of the pixels at the upper end ({first.saturation_dn:g} DN), {low} at 0"
        yield f"{self.run}: {len(self.frames)} {first.kind} frames of {size}"
        yield from (f"  note: {remark}" for remark in self.remarks)
        if first.kind == "scene":
            yield from (f"  first look: {line}" for line in fault_lines(self.diagnosis.named, self.diagnosis.reason))

    def as_json(self) -> dict[str, Json]:
        """Return the files of the frames, remarks and faults."""
        from rigctl.report.numbers import diagnosis_json

        return {
            "run": str(self.run),
            "frames": [record.file for record in self.frames],
            "remarks": list(self.remarks),
            "diagnosis": diagnosis_json(self.diagnosis),
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
        remarks=(*scale.remarks, *_file_remarks(survey, scale), *_angle_remarks(request, survey)),
        clipped_shares=_clipped_shares(survey, scale),
        diagnosis=_first_look(request, survey),
    )


def _clipped_shares(survey: "Survey", scale: "Scale") -> tuple[float, float]:
    """Return which shares of all pixels are saturated, and at 0 without being missing."""
    total = max(int(survey.levels.sum()), 1)
    at_zero = 0 if scale.missing_dn == 0 else int(survey.levels[: 1 << max(scale.shift_bits - 1, 0)].sum())
    return float(survey.levels[_saturated_from(scale) :].sum()) / total, at_zero / total


def _saturated_from(scale: "Scale") -> int:
    return math.ceil(scale.saturation_dn * (1 << scale.shift_bits))


def _first_look(request: "ImportRequest", survey: "Survey") -> "RunDiagnosis":
    from rigctl.measure.diagnose import quick_diagnosis, undiagnosed
    from rigctl.runs.folder import read_run

    if request.kind != "scene":
        return undiagnosed(f"the files are {request.kind} frames")
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
    unsaid = [*request_problems(request, darks_are_there=has_darks), *survey.unsaid]
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

    angles = request.mosaic_deg or tuple(i.angle_deg for i in survey.images if i.angle_deg is not None)
    axes = {axis_deg(angle) for angle in angles}
    if request.kind != "scene" or len(axes) >= 3:
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
    writer.closing_event("imported", kind=request.kind, frames=len(written), files=[str(f) for f in request.files])
    return written
