"""Makes a run out of images that exist, or adds images to such a run."""

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rigctl.errors import ConfigError, DataError, RunFolderError
from rigctl.images.image_file import STALE
from rigctl.imports.image_levels import odd_pattern
from rigctl.imports.image_scale import Scale, find_scale
from rigctl.imports.image_survey import Survey, SurveyedImage, survey_images
from rigctl.imports.import_request import ImportRequest, request_problems
from rigctl.imports.imported_frames import JPEG, axis_deg, frames_of
from rigctl.measurement.run_diagnosis import RunDiagnosis, quick_diagnosis, undiagnosed
from rigctl.runs.frame_record import FrameRecord
from rigctl.runs.run_folder import Run, read_run
from rigctl.runs.run_writer import RunWriter
from rigctl.storage.durable_file import flush_folder

ORIGIN = "import"
# Share of saturated pixels of a file that is said.
_CLIPPED_SAID = 1e-3


@dataclass(frozen=True, kw_only=True)
class Imported:
    """What an import has made.

    Attributes
    ----------
    frames : tuple of FrameRecord
        The new frames.
    remarks : tuple of str
        What was recognised in the files and what the user should know.
    diagnosis : RunDiagnosis
        What the frames say of their own faults at a first look.
    """

    frames: tuple[FrameRecord, ...]
    remarks: tuple[str, ...]
    diagnosis: RunDiagnosis


def import_images(request: ImportRequest) -> Imported:
    """Return what was imported, once all of it is on the disk.

    Parameters
    ----------
    request : ImportRequest
        What the user says.

    Raises
    ------
    ConfigError
        Something is not said, or said wrongly: one message with every problem.
    DataError
        The files are unfit, or contradict what is said: one message with every problem.

    Notes
    -----
    Every file is looked at before anything is written. A new run is made under another name and renamed when it is
    complete; frames that are added to a run are named in its manifest all at once.
    """
    present = _present_run(request.run)
    survey = survey_images(request)
    scale = _checked_scale(request, survey, present)
    if present is None:
        frames = _write_new(request, survey, scale)
    else:
        with RunWriter.append(request.run) as writer:
            frames = _write(writer, request, survey, scale, present.frames)
    return Imported(
        frames=frames,
        remarks=(*scale.remarks, *_file_remarks(survey, scale), *_angle_remarks(request, survey)),
        diagnosis=_first_look(request, survey),
    )


def _first_look(request: ImportRequest, survey: Survey) -> RunDiagnosis:
    if request.kind != "scene":
        return undiagnosed(f"the files are {request.kind} frames")
    return (
        undiagnosed("fewer than three axes")
        if _angle_remarks(request, survey)
        else quick_diagnosis(read_run(request.run))
    )


def _present_run(path: Path) -> Run | None:
    if not path.exists() or (path.is_dir() and not any(path.iterdir())):
        return None
    run = read_run(path)
    if run.session.origin != ORIGIN:
        raise RunFolderError(f"{path}: holds frames that were taken, not imported; import into a folder of its own")
    return run


def _checked_scale(request: ImportRequest, survey: Survey, present: Run | None) -> Scale:
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


def _scale(request: ImportRequest, survey: Survey, present: Run | None) -> Scale:
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


def _with_depth_of(present: Run | None, request: ImportRequest) -> tuple[ImportRequest, tuple[str, ...]]:
    if request.bit_depth is not None or present is None or not present.frames:
        return request, ()
    # The frames of one run come from one camera.
    depth = present.frames[0].bit_depth
    return replace(request, bit_depth=depth), (f"{depth} bits, as the other frames of this run",)


def _contradictions(request: ImportRequest, survey: Survey, scale: Scale, present: Run | None) -> Iterator[str]:
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


def _frame_shape(request: ImportRequest, image: SurveyedImage) -> tuple[int, int]:
    height, width = image.shape
    return (height, width) if request.mosaic_deg is None else (height // 2, width // 2)


def _file_remarks(survey: Survey, scale: Scale) -> Iterator[str]:
    """Give what was recognised in single files, and in how many."""
    saturated = int(np.ceil(scale.saturation_dn * 2**scale.shift_bits))
    shares = {i.path.name: float(i.levels[saturated:].sum() / max(i.levels.sum(), 1)) for i in survey.images}
    clipped = [f"{share:.2%} of {name}" for name, share in shares.items() if share > _CLIPPED_SAID]
    if clipped:
        yield f"saturated pixels, where nothing is measured: {', '.join(clipped)}"
    odd = {image.path.name: text for image in survey.images if (text := odd_pattern(image.levels))}
    if odd:
        yield f"odd bits in {len(odd)} of {len(survey.images)} files ({', '.join(odd)}): {next(iter(odd.values()))}"
    coded = [image.path.name for image in survey.images if image.is_jpeg]
    if coded:
        yield f"{len(coded)} of {len(survey.images)} files ({', '.join(coded)}): {JPEG}"
    yield from dict.fromkeys(remark for image in survey.images for remark in image.remarks if STALE in remark)


def _angle_remarks(request: ImportRequest, survey: Survey) -> tuple[str, ...]:
    angles = request.mosaic_deg or tuple(i.angle_deg for i in survey.images if i.angle_deg is not None)
    axes = {axis_deg(angle) for angle in angles}
    if request.kind != "scene" or len(axes) >= 3:
        return ()
    return (f"{len(axes)} different axes only: Stokes parameters need three or more, modulo 180 degrees",)


def _write_new(request: ImportRequest, survey: Survey, scale: Scale) -> tuple[FrameRecord, ...]:
    parent = request.run.absolute().parent
    try:
        parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=parent, prefix=f".{request.run.name}-", suffix=".part") as scratch:
            unfinished = Path(scratch) / "run"
            with RunWriter.create(unfinished, {"origin": ORIGIN}) as writer:
                frames = _write(writer, request, survey, scale, ())
            unfinished.replace(request.run)
        flush_folder(parent)
    except OSError as error:
        raise RunFolderError(f"{request.run}: cannot be written: {error.strerror}") from error
    return frames


def _write(
    writer: RunWriter,
    request: ImportRequest,
    survey: Survey,
    scale: Scale,
    present: tuple[FrameRecord, ...],
) -> tuple[FrameRecord, ...]:
    frames = frames_of(request, survey.images, scale, first_sequence=writer.next_sequence, present=present)
    written = writer.write_frames(frames)
    writer.closing_event("imported", kind=request.kind, frames=len(written), files=[str(f) for f in request.files])
    return written
