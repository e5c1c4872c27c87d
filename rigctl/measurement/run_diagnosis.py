"""What a run says of its own faults: the one diagnosis that stokes, compare and summary show."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model.processing.diagnosis import Diagnosis, Term, consequence, diagnose
from model.processing.mosaic import coarse_pictures
from model.processing.reconstruction import Design, design
from rigctl.errors import ConfigError, DataError
from rigctl.measurement.corrections import region_slopes
from rigctl.measurement.fault_terms import FaultTerm, fault_title
from rigctl.measurement.measurement import Measurement, measure, signal_of_cycle
from rigctl.runs.run_folder import Run

FloatArray = NDArray[np.float64]

# Smaller pictures hold no blocks.
_LEAST_SIDE_PIXELS = 8
# Half turns are looked at frame by frame as long as there are no more frames than this.
_MOST_FRAMES = 16
# A first look takes squares of larger pictures as one pixel, and reads no more counts than this.
QUICK_PIXELS, _MOST_COUNTS = 350_000, 60_000_000
# What walks leaves the mean of an even region where it is: its slopes tell.
_OF_EDGES = ("shift", "wobble", "planes of a mosaic")
_OF_PAIRS = "throughput of pairs"
_DEG_PER_RAD = float(np.degrees(1.0))


@dataclass(frozen=True, kw_only=True, eq=False)
class RunDiagnosis:
    """What a run says of itself.

    Attributes
    ----------
    terms : tuple of FaultTerm
        Those named first, the strongest at the front.
    reason : str
        Why nothing is testable; empty otherwise.
    angles_deg : tuple of float
        Of the frames that were looked at.
    found : Diagnosis
        As the model has it.
    """

    terms: tuple[FaultTerm, ...]
    reason: str
    angles_deg: tuple[float, ...]
    found: Diagnosis

    @property
    def named(self) -> tuple[FaultTerm, ...]:
        """The causes that explain the run best."""
        return tuple(term for term in self.terms if term.named)

    @property
    def first(self) -> FaultTerm | None:
        """The strongest of them."""
        return self.named[0] if self.named else None

    def term(self, name: str) -> FaultTerm | None:
        """Return the first term of a name."""
        return next((term for term in self.terms if term.name == name), None)


def diagnose_run(measurement: Measurement, *, most_pixels: int | None = None) -> RunDiagnosis:
    """Return what the redundancy of a run's angles says of its faults.

    Parameters
    ----------
    measurement : Measurement
        Of the run.
    most_pixels : int or None
        Of a picture: squares of larger ones are taken as one pixel, which is faster and sees small shifts less well.
    """
    plan, pictures, angles_rad, times = _frames(measurement)
    usable = ~(measurement.saturated | measurement.missing)
    means, slopes = dict(_means(measurement, pictures, usable)), dict(_slopes(measurement, pictures, usable))
    seen, seen_usable, side = coarse_pictures(pictures, usable, most_pixels=most_pixels or usable.size)
    step = float(measurement.grid.to_unit.max())
    return diagnose_pictures(
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
    """Return what pictures say of their faults.

    Parameters
    ----------
    plan, pictures, usable, angles_rad, times, step
        As the model's `diagnose` takes them.
    means : mapping
        Region to its mean behind each frame.
    slopes : mapping or None
        Region to its mean slopes behind each frame, shape (N, 2) [per pixel of the camera]: what a shift does to it.
    side_pixels : int
        Of a pixel of the pictures, in pixels of the camera.
    """
    angles_deg = tuple(float(angle) for angle in np.degrees(angles_rad).round(6) % 360.0)
    if min(usable.shape) < _LEAST_SIDE_PIXELS:
        return replace(
            undiagnosed("the pictures are too small to hold a dozen tiles of 12 pixels"), angles_deg=angles_deg
        )
    try:
        found = diagnose(plan, pictures, usable, angles_rad=angles_rad, times=times, step=step)
    except (ValueError, ArithmeticError) as error:
        # Frames such as no camera takes; what can be measured of them is measured all the same.
        return replace(undiagnosed(f"these frames give no joint fit: {error}"), angles_deg=angles_deg)
    terms = tuple(_term(term, found, plan, angles_deg, means, slopes or {}, side_pixels) for term in found.terms)
    return RunDiagnosis(
        terms=terms if side_pixels == 1 else _told_coarsely(terms),
        reason=found.reason,
        angles_deg=angles_deg,
        found=found,
    )


def _told_coarsely(terms: tuple[FaultTerm, ...]) -> tuple[FaultTerm, ...]:
    """Return terms of coarse pictures: edges off by part of a pixel blur what tells one throughput from a pair's."""
    if all(term.name != _OF_PAIRS for term in terms):
        return terms
    return tuple(
        replace(term, confused_with=(*term.confused_with, _OF_PAIRS))
        if term.name == "throughput" and term.named and _OF_PAIRS not in term.confused_with
        else term
        for term in terms
    )


def quick_diagnosis(run: Run, *, most_pixels: int = QUICK_PIXELS) -> RunDiagnosis:
    """Return what a run says of its faults at a first look; with a reason where it cannot be looked at.

    Parameters
    ----------
    run : Run
        Frames of any kind.
    most_pixels : int
        As `diagnose_run` takes it.
    """
    scenes = [record for record in run.frames if record.kind == "scene"]
    if not scenes:
        return undiagnosed("there are no scene frames")
    if sum(record.width * record.height for record in scenes) > _MOST_COUNTS:
        return undiagnosed("so many frames of this size are not read for a first look; rigctl stokes does")
    try:
        return diagnose_run(measure(run, regions=[]), most_pixels=most_pixels)
    except (DataError, ConfigError, ValueError, ArithmeticError) as error:
        return undiagnosed(str(error))


def undiagnosed(reason: str) -> RunDiagnosis:
    """Return that nothing can be said of a run, and why."""
    nothing = Diagnosis(terms=(), first=None, reason=reason, faults=None, light=0.0)
    return RunDiagnosis(terms=(), reason=reason, angles_deg=(), found=nothing)


def _frames(measurement: Measurement) -> tuple[Design, FloatArray, FloatArray, list[float]]:
    """Return design, pictures, angles over the whole turn and times; half turns one by one, other repeats as means."""
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
    """Give the mean behind each frame, of every region, or of the whole picture where there are none."""
    repeats = len(pictures) // measurement.grid.angles
    for name, region in measurement.regions.items():
        yield name, np.tile(region.channels_mean.mean, repeats)
    if not measurement.regions and usable.any():
        yield "picture", pictures[:, usable].mean(axis=1)


def _slopes(
    measurement: Measurement, pictures: FloatArray, usable: NDArray[np.bool_]
) -> Iterable[tuple[str, FloatArray]]:
    """Give the mean slopes behind each frame, x and y, of every region, or of the picture where there are none."""
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
    moved = consequence(plan.system, means, term.parameters, light=found.light, slopes=slopes)
    aolp = moved.aolp_shift_rad
    return moved.dolp_shift, None if aolp is None else aolp * _DEG_PER_RAD


def _largest(shifts: Iterable[float | None]) -> float | None:
    return max((shift for shift in shifts if shift is not None), key=abs, default=None)
