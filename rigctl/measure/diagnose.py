"""Faults of a run from the redundancy of its angles, and the run corrected for them.

Four angles or more over-determine the Stokes parameters. `diagnose_run` tells faults apart that leave a residual:
throughput, dark level, shift, response and others (`model.processing.diagnosis`). `measure_run` measures a run with its
calibrations, diagnoses it, and corrects it for the faults that were found, on request. `recalibrated` is a run as if it
had been taken with other calibrations.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.polarimeter.pictures import Registration, moved_back, register
from calibration.results import CalibrationError
from model.processing.diagnosis import Diagnosis, Term, consequence, diagnose
from model.processing.fault_fit import PER_FRAME
from model.processing.mosaic import coarse_pictures
from model.processing.reconstruction import Design, design
from rigctl.calibrations.kinds import CalibrationKind
from rigctl.calibrations.polarizer import PolarizerParameters, read_polarizer_file
from rigctl.errors import ConfigError, DataError
from rigctl.files.regions import Region
from rigctl.measure.faults import FaultTerm, fault_lines, fault_title
from rigctl.measure.frames import (
    CalibrationPaths,
    FoundCorrections,
    FrameGrid,
    FrameShifts,
    RunCalibrations,
    SelectedCalibrations,
    Throughput,
    flat_remarks,
    moved_edges,
    region_slopes,
    selected_for_run,
)
from rigctl.measure.measure import Measurement, measure, signal_of_cycle
from rigctl.runs.folder import Run
from rigctl.runs.records import PolarizerAsTaken, RigAsTaken

FloatArray = NDArray[np.float64]

# Least size of a picture with blocks.
_LEAST_SIDE_PIXELS = 8
# Most frames for which half turns are treated frame by frame.
_MOST_FRAMES = 16
# Pixels above which a first look averages squares, and most counts that it reads.
QUICK_PIXELS, _MOST_COUNTS = 350_000, 60_000_000
# Shifts change the mean of a region by its slopes.
_OF_EDGES = ("shift", "wobble", "planes of a mosaic")
_OF_PAIRS = "throughput of pairs"
# Change of DoLP that four decimals do not show, for a whole picture without an error.
_UNSEEN_SHIFT = 5e-5
_DEG_PER_RAD = float(np.degrees(1.0))
# Distance below which angles are equal.
_SAME_RAD = float(np.radians(1.0))


@dataclass(frozen=True, kw_only=True, eq=False)
class RunDiagnosis:
    """Faults that a run shows."""

    terms: tuple[FaultTerm, ...]  #: the named ones first, in order of strength
    reason: str  #: reason if nothing is testable
    angles_deg: tuple[float, ...]  #: of the frames
    found: Diagnosis  #: in the units of the model
    dolp_errors: Mapping[str, float] = field(default_factory=dict)  #: standard error of each region's DoLP

    @property
    def named(self) -> tuple[FaultTerm, ...]:
        """The causes that explain the run best."""
        return tuple(term for term in self.terms if term.named)

    @property
    def mentioned(self) -> tuple[FaultTerm, ...]:
        """The named causes that move the DoLP of some region by more than its error."""
        return tuple(term for term in self.named if not self._is_harmless(term))

    @property
    def lines(self) -> list[str]:
        """The faults in words, line by line."""
        return fault_lines(self.mentioned, self.reason, harmless=len(self.named) - len(self.mentioned))

    def _is_harmless(self, term: FaultTerm) -> bool:
        shifts = {region: shift for region, (shift, _) in term.by_region.items()}
        return bool(shifts) and all(
            shift is not None and abs(shift) < self.dolp_errors.get(region, _UNSEEN_SHIFT)
            for region, shift in shifts.items()
        )

    @property
    def first(self) -> FaultTerm | None:
        """The strongest of the named causes."""
        return self.named[0] if self.named else None

    def term(self, name: str) -> FaultTerm | None:
        """Return the first term of a name."""
        return next((term for term in self.terms if term.name == name), None)


def diagnose_run(measurement: Measurement, *, most_pixels: int | None = None) -> RunDiagnosis:
    """Return the faults of a run from the redundancy of its angles."""
    plan, pictures, angles_rad, times = _frames(measurement)
    usable = measurement.frames.usable
    means, slopes = dict(_means(measurement, pictures, usable)), dict(_slopes(measurement, pictures, usable))
    seen, seen_usable, side = coarse_pictures(pictures, usable, most_pixels=most_pixels or usable.size)
    step = float(measurement.grid.to_unit.max())
    found = diagnose_pictures(
        plan,
        seen,
        seen_usable,
        angles_rad=angles_rad,
        times=times,
        step=step,
        means=means,
        slopes=slopes,
        side_pixels=side,
    )
    numbers = {name: region.quantities.get("dolp") for name, region in measurement.regions.items()}
    return replace(found, dolp_errors={name: one["mean"].std_error for name, one in numbers.items() if one})


def diagnose_pictures(
    plan: Design,
    pictures: FloatArray,
    usable: NDArray[np.bool_],
    *,
    angles_rad: FloatArray,
    times: Sequence[float],
    step: float,
    means: Mapping[str, FloatArray],
    slopes: Mapping[str, FloatArray] | None = None,
    side_pixels: int = 1,
) -> RunDiagnosis:
    """Return the faults that pictures show."""
    angles_deg = tuple(float(angle) for angle in np.degrees(angles_rad).round(6) % 360.0)
    if min(usable.shape) < _LEAST_SIDE_PIXELS:
        return replace(undiagnosed("the pictures are too small for a dozen tiles of 12 pixels"), angles_deg=angles_deg)
    try:
        found = diagnose(plan, pictures, usable, angles_rad=angles_rad, times=times, step=step)
    except (ValueError, ArithmeticError) as error:
        # Frames that no camera takes; they are measured anyway.
        return replace(undiagnosed(f"the joint fit of these frames failed: {error}"), angles_deg=angles_deg)
    found = replace(found, terms=_as_half_turns_show(found.terms, pictures, usable, angles_rad))
    terms = tuple(_term(term, found, plan, angles_deg, means, slopes or {}, side_pixels) for term in found.terms)
    return RunDiagnosis(
        terms=terms if side_pixels == 1 else _told_coarsely(terms),
        reason=found.reason,
        angles_deg=angles_deg,
        found=found,
    )


# Relative difference, and three errors, beyond which shifts from half turns replace fitted ones.
_AS_SHOWN = 0.2


def _as_half_turns_show(
    terms: tuple[Term, ...], pictures: FloatArray, usable: NDArray[np.bool_], angles_rad: FloatArray
) -> tuple[Term, ...]:
    """Return terms whose shifts have the size that half turns show directly.

    Frames half a turn apart show the same light, so their shift needs no fit. Edges from rounding and noise make fitted
    shifts too large.
    """
    frames = len(pictures)
    pairs = [
        (k, j)
        for k in range(frames)
        for j in range(k + 1, frames)
        if abs(abs(angles_rad[j] - angles_rad[k]) - np.pi) < _SAME_RAD
    ]
    moving = [term for term in terms if term.is_named and term.unit == "pixel" and term.value]
    if not pairs or not moving:
        return terms
    first = PER_FRAME.index("shift x") * frames
    shifts = np.sum([term.parameters[first : first + 2 * frames] for term in moving], axis=0).reshape(2, frames).T
    fitted = np.array([shifts[j] - shifts[k] for k, j in pairs])
    window = cv2.createHanningWindow(usable.shape[::-1], cv2.CV_64F)
    filled = [np.where(usable, picture, picture[usable].mean()) for picture in pictures]
    shown = np.array([cv2.phaseCorrelate(filled[k], filled[j], window)[0] for k, j in pairs])
    is_seen = np.linalg.norm(fitted, axis=1) > 0.0
    if not is_seen.any():
        return terms
    weight = float(np.sum(fitted**2))
    ratio = float(np.sum(fitted * shown)) / weight
    left = (shown - ratio * fitted)[is_seen]
    error = float(np.sqrt(np.sum(left**2) / (left.size - 1) / weight))
    if abs(ratio - 1.0) < max(_AS_SHOWN, 3.0 * error):
        return terms
    scale = np.ones(terms[0].parameters.size)
    scale[first : first + 2 * frames] = ratio
    return tuple(
        replace(
            term,
            value=term.value * ratio,
            std_error=float(np.hypot(term.std_error or 0.0, term.value * error)),
            parameters=term.parameters * scale,
        )
        if term in moving and term.value
        else term
        for term in terms
    )


def _told_coarsely(terms: tuple[FaultTerm, ...]) -> tuple[FaultTerm, ...]:
    """Return terms of coarse pictures, in which subpixel shifts of edges hide differences between throughputs."""
    if all(term.name != _OF_PAIRS for term in terms):
        return terms
    return tuple(
        replace(term, confused_with=(*term.confused_with, _OF_PAIRS))
        if term.name == "throughput" and term.named and _OF_PAIRS not in term.confused_with
        else term
        for term in terms
    )


def quick_diagnosis(run: Run, *, most_pixels: int = QUICK_PIXELS) -> RunDiagnosis:
    """Return the faults of a run at a first look, or the reason why it cannot be read."""
    scenes = [record for record in run.frames if record.kind == "scene"]
    if not scenes:
        return undiagnosed("there are no scene frames")
    if sum(record.width * record.height for record in scenes) > _MOST_COUNTS:
        return undiagnosed("too many frames of this size for a first look; use rigctl stokes")
    try:
        return diagnose_run(measure(run, regions=[]), most_pixels=most_pixels)
    except (DataError, ConfigError, ValueError, ArithmeticError) as error:
        return undiagnosed(str(error))


def undiagnosed(reason: str) -> RunDiagnosis:
    """Return a diagnosis without terms, with the reason."""
    nothing = Diagnosis(terms=(), reason=reason, light=0.0)
    return RunDiagnosis(terms=(), reason=reason, angles_deg=(), found=nothing)


def _frames(measurement: Measurement) -> tuple[Design, FloatArray, FloatArray, list[float]]:
    """Return design, pictures, angles over the whole turn and times; half turns separate, other repeats averaged."""
    grid = measurement.grid
    whole = np.array([[record.polarizer_angle_deg or 0.0 for record in cycle] for cycle in grid.records])
    sequence = [[float(record.sequence) for record in cycle] for cycle in grid.records]
    half_turns = np.any(np.abs((whole - whole[0] + 90.0) % 360.0 - 90.0) > 90.0)
    if not half_turns or whole.size > _MOST_FRAMES:
        times = np.argsort(np.argsort(sequence[0])).astype(np.float64).tolist()
        return measurement.plan, measurement.channels, np.radians(whole[0] % 360.0), times
    pictures = np.concatenate([signal_of_cycle(measurement, cycle) for cycle in range(grid.cycles)])
    angles_rad = np.radians(whole.ravel() % 360.0)
    times = np.argsort(np.argsort(np.ravel(sequence))).astype(np.float64).tolist()
    return design(angles_rad, measurement.extinction_ratio), pictures, angles_rad, times


def _means(
    measurement: Measurement, pictures: FloatArray, usable: NDArray[np.bool_]
) -> Iterable[tuple[str, FloatArray]]:
    """Yield the mean of each frame, for every region, or for the whole picture without regions."""
    repeats = len(pictures) // measurement.grid.angles
    for name, region in measurement.regions.items():
        yield name, np.tile(region.channels_mean.mean, repeats)
    if not measurement.regions and usable.any():
        yield "picture", pictures[:, usable].mean(axis=1)


def _slopes(
    measurement: Measurement, pictures: FloatArray, usable: NDArray[np.bool_]
) -> Iterable[tuple[str, FloatArray]]:
    """Yield the mean slopes of each frame, x and y, for every region, or for the picture without regions."""
    inside = {name: region.inside for name, region in measurement.regions.items()}
    if not inside and usable.any():
        inside = {"picture": usable}
    for name, mask in inside.items():
        if mask.any():
            yield name, region_slopes(pictures, mask)


def _term(
    term: Term,
    found: Diagnosis,
    plan: Design,
    angles_deg: tuple[float, ...],
    means: Mapping[str, FloatArray],
    slopes: Mapping[str, FloatArray],
    side_pixels: int,
) -> FaultTerm:
    is_turn = term.unit == "rad"
    factor = _DEG_PER_RAD if is_turn else side_pixels if term.unit == "pixel" else 1.0
    steep = {name: slope * side_pixels for name, slope in slopes.items()}
    shifts = {
        name: _moved(term, found, plan, mean, steep.get(name)) for name, mean in means.items() if term.is_testable
    }
    return FaultTerm(
        name=term.name,
        angle_deg=None if term.frame is None else angles_deg[term.frame],
        value=None if term.value is None else term.value * factor,
        std_error=None if term.std_error is None else term.std_error * factor,
        unit="deg" if is_turn else term.unit,
        testable=term.is_testable,
        reason=term.reason,
        confused_with=tuple(
            fault_title(name, None if frame is None else angles_deg[frame]) for name, frame in term.confused_with
        ),
        dolp_shift=_largest(shift for shift, _ in shifts.values()),
        aolp_shift_deg=_largest(shift for _, shift in shifts.values()),
        named=term.is_named,
        by_region=shifts,
    )


def _moved(
    term: Term, found: Diagnosis, plan: Design, means: FloatArray, slopes: FloatArray | None
) -> tuple[float | None, float | None]:
    is_unknown = term.name in _OF_EDGES and slopes is None
    if is_unknown or not means.mean() > 0.0 or not np.all(np.isfinite(term.parameters)):
        return None, None
    degree, angle_rad = consequence(plan.system, means, term.parameters, light=found.light, slopes=slopes)
    return degree, None if angle_rad is None else angle_rad * _DEG_PER_RAD


def _largest(shifts: Iterable[float | None]) -> float | None:
    return max((shift for shift in shifts if shift is not None), key=abs, default=None)


# Least faults that are corrected.
_NOTHING = 1e-12


def found_faults(grid: FrameGrid, diagnosis: RunDiagnosis, names: Sequence[str]) -> FoundCorrections:
    """Return the corrections for a diagnosis."""
    sizes, errors = _sizes(grid, diagnosis)
    throughput, dark = sizes[0], sizes[2]
    moved = sizes[3:5].T - sizes[3:5].T[0]
    is_done = {
        "throughput": bool(np.any(np.abs(throughput) > _NOTHING)),
        "dark-level": bool(np.any(np.abs(dark) > _NOTHING)),
        "shift": bool(np.any(np.abs(moved) > _NOTHING)),
    }
    taken = {name: name in names and done for name, done in is_done.items()}
    return FoundCorrections(
        throughput=Throughput(value=1.0 + throughput, error=errors[0]) if taken["throughput"] else None,
        dark=dark if taken["dark-level"] else None,
        shifts=_shifts(grid, moved) if taken["shift"] else None,
        dark_error=errors[2] * taken["dark-level"],
        shift_error=errors[3:5].T * taken["shift"],
        remarks=tuple(_remarks(names, taken, sizes, moved)),
    )


def _sizes(grid: FrameGrid, diagnosis: RunDiagnosis) -> tuple[FloatArray, FloatArray]:
    """Return the size of each kind of fault by angle, and its error, shape (kinds, N); repeats are averaged."""
    frames = len(diagnosis.angles_deg)
    kinds = len(PER_FRAME)
    total, variance = np.zeros((kinds, frames)), np.zeros((kinds, frames))
    for term in diagnosis.found.terms:
        if term.is_named and term.value:
            own = term.parameters[: kinds * frames].reshape(kinds, frames)
            total += own
            variance += np.square(own / term.value * (term.std_error or 0.0))
    by_cycle = (kinds, frames // grid.angles, grid.angles)
    return total.reshape(by_cycle).mean(axis=1), np.sqrt(variance.reshape(by_cycle).mean(axis=1))


def _shifts(grid: FrameGrid, moved: FloatArray) -> FrameShifts:
    by_frame = {record.sequence: moved[angle] for cycle in grid.records for angle, record in enumerate(cycle)}
    one_pixel = np.zeros((4, 4))
    return FrameShifts(
        shifts_pixels=by_frame,
        variance_factor=np.array([moved_back(one_pixel, shift)[1] for shift in moved]),
        margin_pixels=int(np.ceil(np.max(np.abs(moved)))),
    )


def _remarks(names: Sequence[str], taken: dict[str, bool], sizes: FloatArray, moved: FloatArray) -> Iterable[str]:
    said = {
        "throughput": f"frames were divided by {_numbers(1.0 + sizes[0], '.4f')}",
        "dark-level": f"{_numbers(sizes[2], '+.3g')} were subtracted in addition to the dark level",
        "shift": f"frames were shifted back by {_numbers(np.linalg.norm(moved, axis=1), '.2f')} pixel",
    }
    for name in names:
        done = said[name] if taken[name] else "there was nothing to correct"
        yield f"corrected for faults of the run, {name}: {done}"


def _numbers(values: FloatArray, digits: str) -> str:
    return ", ".join(format(value, digits) for value in values.tolist())


_MOVED = (
    "frames were shifted by bilinear interpolation: the prediction of temporal noise accounts for this, that of "
    "texture and fixed pattern of single pixels does not"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredRun:
    """A run that was measured in regions with its calibrations, and diagnosed."""

    measurement: Measurement  #: after all corrections
    regions: list[Region]  #: as they were drawn
    calibrations: RunCalibrations
    diagnosis: RunDiagnosis
    remarks: tuple[str, ...]  #: doubts about the calibrations, and how frames were corrected

    @cached_property
    def registration(self) -> Registration | str:
        """Shifts of the pictures against the first, or why they cannot be measured."""
        measurement = self.measurement
        try:
            return register(measurement.channels, measurement.frames.usable)
        except CalibrationError as error:
            return str(error)


def measure_run(
    run: Run, regions: list[Region], calibrations: RunCalibrations | None = None, *, correct: Sequence[str] = ()
) -> MeasuredRun:
    """Measure a run with its calibrations, diagnose it, and correct it for the faults of some names."""
    given = RunCalibrations() if calibrations is None else calibrations
    is_forced = given.selected.paths.force_registration

    measurement = measure(run, regions=regions, calibrations=given, may_measure_none=True)
    remarks, diagnosis = _registered(measurement, force=is_forced), diagnose_run(measurement)
    if correct:
        found = _helpful(measurement, found_faults(measurement.grid, diagnosis, correct), force=is_forced)
        measurement = measure(run, regions=regions, calibrations=given, found=found, may_measure_none=True)
        remarks, diagnosis = (*remarks, *found.remarks), diagnose_run(measurement)
    return MeasuredRun(
        measurement=measurement,
        regions=regions,
        calibrations=given,
        diagnosis=diagnosis,
        remarks=(*given.doubts, *remarks, *_correction_remarks(measurement, regions)),
    )


def _correction_remarks(measurement: Measurement, regions: list[Region]) -> tuple[str, ...]:
    """Return what was done to frames by calibrations and to regions by their repeats, in words."""
    done = measurement.frames.corrections
    return (
        *_of_repeats(measurement),
        *(() if done.throughput is None else (_of_throughput(done.throughput),)),
        *(() if done.flat is None else flat_remarks(done.flat, regions)),
        *(() if done.shifts is None else (_MOVED,)),
    )


# Least drift per cycle that is reported, as a share of the light.
_SMALL_DRIFT = 1e-3


def _of_repeats(measurement: Measurement) -> Iterable[str]:
    """Return which pixels the repeats of a run show to be hit, and what light that drifts was divided by."""
    for name, region in measurement.regions.items():
        if region.hit and measurement.grid.cycles > 1:
            yield (
                f"{name}: {region.hit} of {region.hit + region.pixels} pixels were hit in single frames, by cosmic "
                "rays or jumping pixels; they are left out"
            )
        drift = region.repeatability.drift
        if abs(drift) > _SMALL_DRIFT:
            yield f"{name}: the light drifts by {drift:+.2%} per cycle; this is divided out"


def _of_throughput(throughput: Throughput) -> str:
    values = throughput.value.tolist()
    return (
        f"frames were divided by the throughput of their angle, {min(values):.4f} to {max(values):.4f}, known to "
        f"{throughput.error.max():.2%}"
    )


def _registered(measurement: Measurement, *, force: bool) -> tuple[str, ...]:
    """Return the effect of a given registration on the edges of a run in words; it must improve them."""
    if measurement.shifts is None:
        return ()
    text, is_better = moved_edges(measurement.run, measurement.grid, measurement.shifts)
    if not (is_better or force):
        raise DataError(
            f"--register: it does not improve the edges of this run: {text}; not applied (--force-registration applies "
            "it)"
        )
    return (text,) if text else ()


def _helpful(measurement: Measurement, found: FoundCorrections, *, force: bool) -> FoundCorrections:
    """Return corrections without shifts that do not improve edges, unless forced."""
    if found.shifts is None:
        return found
    text, is_better = moved_edges(measurement.run, measurement.grid, found.shifts)
    if is_better or force:
        return replace(found, remarks=(*found.remarks, text))
    said = f"shift: not applied, because it does not improve edges: {text} (--force-registration applies it)"
    return replace(found, shifts=None, remarks=(*(text for text in found.remarks if ", shift:" not in text), said))


# Calibrations that a measurement can use.
MEASURED_WITH: tuple[CalibrationKind, ...] = ("noise", "polarizer", "flat", "registration")


def recalibrated(run: Run, paths: CalibrationPaths) -> tuple[Run, SelectedCalibrations]:
    """Return a run with the axis of its polarizer calibration, if any, and all its calibrations."""
    # The axis in the rig file may be wrong, so no calibration is refused for it.
    open_axis = _with_polarizer(run, replace(run.session.polarizer, sense=None, offset_deg=None))
    selected = selected_for_run(paths, open_axis, MEASURED_WITH)
    named = selected.paths.files.get("polarizer")
    return (run if named is None else with_axis(run, read_polarizer_file(named))), selected


def with_axis(run: Run, polarizer: PolarizerParameters) -> Run:
    """Return a run with polarizer angles from its stage angles by a calibration."""
    frames = []
    for record in run.frames:
        if record.stage_angle_deg is not None:
            angle = polarizer.sense * record.stage_angle_deg + polarizer.offset_deg.value
            frames.append(replace(record, polarizer_angle_deg=angle))
        elif record.kind == "scene":
            raise DataError(f"{run.path}: {record.file} has no stage angle: its axis stays unchanged")
        else:
            frames.append(record)
    known = run.session.polarizer
    offset = polarizer.offset_deg
    taken = replace(known, sense=polarizer.sense, offset_deg=offset.value, offset_std_deg=offset.std_error)
    return replace(
        _with_polarizer(run, taken),
        frames=tuple(frames),
        written_angles_deg={record.sequence: record.polarizer_angle_deg for record in run.frames},
    )


def _with_polarizer(run: Run, polarizer: PolarizerAsTaken) -> Run:
    rig = replace(run.session.rig or RigAsTaken(), polarizer=polarizer)
    return replace(run, session=replace(run.session, rig=rig))
