"""Frames of a run by cycle and angle, their calibrations, and their corrections.

`arrange` finds which frame is which. `calibrations_of_run` reads the calibrations that are named or selected from the
store, with doubts in words. `find_dark_level` says what is subtracted. `Corrections` are, in this order: the throughput
of the polarizer at an angle, flat fields, and a registration that moves frames to lie on one another; each says what it
does to noise. `corrected_frames` gives the frames with all of this applied.
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.polarimeter.pictures import edges_left, moved_back
from model.counts import ROUNDING_VAR_DN2
from model.processing.mosaic import Interpolation, variance_factor
from model.quantities import counts_name
from rigctl.base.durable import sha256_of
from rigctl.base.numbers import wrapped
from rigctl.calibrations.flat import FlatFields
from rigctl.calibrations.kinds import KINDS, CalibrationKind, made_for, record_of
from rigctl.calibrations.noise import NoiseParameters
from rigctl.calibrations.polarizer import Channel, PolarizerParameters
from rigctl.calibrations.radiometric import RadiometricResponse
from rigctl.calibrations.registration import ImageRegistration, angle_deg, usable_pixels
from rigctl.calibrations.store import NONE, STORE_FOLDER, Choice, RigSelection, Selection, choose, read_store
from rigctl.errors import DataError
from rigctl.files.regions import Region, masks
from rigctl.files.rig_file import PLACEHOLDER
from rigctl.runs.folder import Run
from rigctl.runs.records import FrameRecord, left_out_texts

FloatArray = NDArray[np.float64]

# Targets are written with a few decimals at most; what is closer than this is one angle.
_ANGLE_DECIMALS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameGrid:
    """The scene frames of a run by cycle and angle."""

    records: tuple[tuple[FrameRecord, ...], ...]  #: records[cycle][angle], angles in ascending order.
    #: "dn_45" and so on, by the angle that was asked for, modulo 180 deg; a second frame at an angle within one cycle
    #: is "dn_45_2".
    channel_names: tuple[str, ...]
    #: The angles that were asked for, modulo 180 deg; those of the readback where nobody asked [deg].
    target_angles_deg: FloatArray
    polarizer_angles_rad: FloatArray  #: By the stage's readback, the mean over the cycles [rad].
    #: Exposure of each angle [s]; None where nobody knows and one shot gave all of them.
    exposures_s: FloatArray | None
    left_out: tuple[str, ...]  #: Frames that are not used, with the reason.

    @property
    def frames(self) -> tuple[FrameRecord, ...]:
        """All of them, cycle by cycle."""
        return tuple(record for cycle in self.records for record in cycle)

    @property
    def cycles(self) -> int:
        """Number of whole cycles."""
        return len(self.records)

    @property
    def angles(self) -> int:
        """Number of frames of a cycle."""
        return len(self.channel_names)

    @property
    def width(self) -> int:
        """Columns of a picture."""
        return self.records[0][0].width

    @property
    def height(self) -> int:
        """Rows of a picture."""
        return self.records[0][0].height

    @property
    def is_one_exposure(self) -> bool:
        """All angles have the same exposure, so that counts can be compared as they are."""
        return self.exposures_s is None or bool(np.ptp(self.exposures_s) <= 1e-9 * self.exposures_s.max())

    @property
    def reads(self) -> FloatArray:
        """Of how many reads of the camera each angle's frames are the mean, shape (N,)."""
        return np.asarray(np.mean([[record.reads or 1 for record in cycle] for cycle in self.records], axis=0))

    @property
    def rounding_dn2(self) -> FloatArray:
        """Variance that the rounding of such means adds to each angle, shape (N,) [DN^2]."""
        return np.array([ROUNDING_VAR_DN2 if one.reads and not one.real_counts else 0.0 for one in self.records[0]])

    @property
    def is_whole(self) -> bool:
        """Counts are whole numbers of single reads, none of them below 0."""
        return not any(record.reads or record.real_counts for record in self.frames)

    @property
    def unit(self) -> str:
        """Unit of what is made of the counts."""
        return "DN" if self.is_one_exposure else "DN/s"

    @cached_property
    def times(self) -> FloatArray | None:
        """When each frame was taken, in cycles, shape (cycles, angles), by the order of exposures.

        None where cycles were not taken one after the other, as of images that were imported angle by angle.
        """
        order = np.array(
            [[one.sequence if one.exposure_id is None else one.exposure_id for one in cycle] for cycle in self.records]
        )
        if np.any(order[1:].min(axis=1) <= order[:-1].max(axis=1)):
            return None
        places = np.array([np.searchsorted(np.unique(cycle), cycle) / len(np.unique(cycle)) for cycle in order])
        return np.asarray(np.arange(self.cycles)[:, None] + places)

    @property
    def frame_order(self) -> NDArray[np.intp]:
        """Place of each angle's frame in the first cycle, from 0."""
        return np.argsort(np.argsort([record.sequence for record in self.records[0]]))

    @property
    def to_unit(self) -> FloatArray:
        """Factor from the counts of each angle to `unit`, shape (N,)."""
        if self.is_one_exposure or self.exposures_s is None:
            return np.ones(self.angles)
        return np.asarray(1.0 / self.exposures_s)


def arrange(run: Run) -> FrameGrid:
    """Return the scene frames of a run by cycle and angle."""
    scene = [record for record in run.frames if record.kind == "scene"]
    _refuse_unusable(run, scene)
    # Cycles are counted over all frames that were taken: one that is excluded moves no other into its cycle.
    excluded = {
        one.sequence: one for one in run.excluded if one.kind == "scene" and one.polarizer_angle_deg is not None
    }
    by_cycle: dict[int, dict[str, FrameRecord]] = defaultdict(dict)
    for cycle, name, record in _named(sorted((*scene, *excluded.values()), key=lambda record: record.sequence)):
        if record.sequence not in excluded:
            by_cycle[cycle][name] = record
    sets = Counter(frozenset(channels) for channels in by_cycle.values())
    names = max(sets, key=lambda found: (len(found), sets[found]))
    whole = [by_cycle[cycle] for cycle in sorted(by_cycle) if frozenset(by_cycle[cycle]) == names]
    partial = [cycle for cycle in sorted(by_cycle) if frozenset(by_cycle[cycle]) != names]
    ordered = sorted(names, key=lambda name: (_target_deg(whole[0][name]), name))
    records = tuple(tuple(channels[name] for name in ordered) for channels in whole)
    return FrameGrid(
        records=records,
        channel_names=tuple(ordered),
        target_angles_deg=np.array([_target_deg(record) for record in records[0]]),
        polarizer_angles_rad=_mean_angles_rad(records),
        exposures_s=_exposures_s(run, records),
        left_out=(
            *left_out_texts(run.annotations, excluded.values()),
            *(f"cycle {cycle}: incomplete, {len(by_cycle[cycle].keys() & names)} of {len(names)}" for cycle in partial),
        ),
    )


def _refuse_unusable(run: Run, scene: list[FrameRecord]) -> None:
    if not scene:
        gone = sum(record.kind == "scene" for record in run.excluded)
        raise DataError(f"{run.path}: holds no scene frames{f': all {gone} are excluded' if gone else ''}")
    unknown = [record.file for record in scene if record.polarizer_angle_deg is None]
    sizes = {(record.width, record.height) for record in scene}
    problems = [f"the polarizer angle of {len(unknown)} frames is not known ({unknown[0]}, ...)"] if unknown else []
    if len(sizes) > 1:
        problems.append("frames differ in size: " + ", ".join(f"{w} x {h}" for w, h in sorted(sizes)))
    if problems:
        raise DataError(f"{run.path}: " + "; ".join(problems))


def _target_deg(record: FrameRecord) -> float:
    target = record.polarizer_angle_target_deg
    angle = record.polarizer_angle_deg if target is None else target
    return round((angle or 0.0) % 180.0, _ANGLE_DECIMALS) % 180.0


def _named(scene: list[FrameRecord]) -> list[tuple[int, str, FrameRecord]]:
    """Return each frame with its cycle and channel; without a cycle the n-th frame at an angle is of cycle n."""
    seen: Counter[tuple[int | None, float]] = Counter()
    found = []
    for record in scene:
        angle = _target_deg(record)
        before = seen[record.cycle, angle]
        seen[record.cycle, angle] += 1
        name = counts_name(f"{angle:g}")
        if record.cycle is None:
            found.append((before, name, record))
        else:
            found.append((record.cycle, name if before == 0 else f"{name}_{before + 1}", record))
    return found


def _mean_angles_rad(records: tuple[tuple[FrameRecord, ...], ...]) -> FloatArray:
    degrees = np.array([[record.polarizer_angle_deg for record in cycle] for cycle in records], dtype=np.float64)
    # An axis is the same after half a turn: average what is near the target, 179.998 deg as -0.002 beside 0.
    targets = np.array([_target_deg(record) for record in records[0]])
    near = targets + wrapped(degrees - targets, turn=180.0)
    return np.asarray(np.deg2rad(near.mean(axis=0)))


def _exposures_s(run: Run, records: tuple[tuple[FrameRecord, ...], ...]) -> FloatArray | None:
    known = {record.exposure_s is not None for cycle in records for record in cycle}
    if known == {False}:
        return None
    if len(known) == 2:
        raise DataError(f"{run.path}: the exposure of some scene frames is known and of others not")
    exposures = np.array([[record.exposure_s for record in cycle] for cycle in records], dtype=np.float64)
    if np.any(np.ptp(exposures, axis=0) > 1e-9 * exposures.max()):
        raise DataError(f"{run.path}: the exposure of an angle differs from cycle to cycle; this is not supported")
    return np.asarray(exposures[0])


@dataclass(frozen=True, kw_only=True)
class CalibrationPaths:
    """Files of calibrations that somebody names, and where the others are selected from."""

    named: Mapping[CalibrationKind, Path] = field(default_factory=dict)  #: `NONE` for a kind that is not to be used
    uses_store: bool = False  #: select calibrations that are not named from the store, if there is one
    store: Path | None = None  #: the store; None is the one next to the rig file
    force_registration: bool = False  #: use a registration that helps no edges too

    @property
    def files(self) -> dict[CalibrationKind, Path]:
        """Files that are named, by their kind."""
        return {kind: self.named[kind] for kind in KINDS if self.named.get(kind, NONE) != NONE}


@dataclass(frozen=True, kw_only=True)
class SelectedCalibrations(RigSelection):
    """Calibrations of a run: those that were named, and those that were selected from the store."""

    paths: CalibrationPaths = field(default_factory=CalibrationPaths)  #: all of them


@dataclass(frozen=True, kw_only=True, eq=False)
class RunCalibrations:
    """Calibrations of a run: which they are, their contents, and doubts about using them for it, in words."""

    selected: SelectedCalibrations = field(default_factory=SelectedCalibrations)
    noise: NoiseParameters | None = None
    radiometric: RadiometricResponse | None = None
    registration: ImageRegistration | None = None
    flat: FlatFields | None = None
    polarizer: PolarizerParameters | None = None
    doubts: tuple[str, ...] = ()


def calibrations_of_run(paths: CalibrationPaths, run: Run, kinds: Sequence[CalibrationKind]) -> RunCalibrations:
    """Return the calibrations of a run; of some kinds, those that are not named are selected from the store."""
    selected = selected_for_run(paths, run, kinds)
    files = selected.paths.files
    doubts = [f"{run.path}: {PLACEHOLDER}"] if run.session.polarizer.placeholder and "polarizer" not in files else []
    found: dict[str, Any] = {}
    for kind in KINDS:
        if kind in files:
            found[kind], more = record_of(kind).read_fitting(files[kind], run)
            doubts.extend(more)
    return RunCalibrations(selected=selected, doubts=tuple(doubts), **found)


# As many folders above a run are looked into for its rig file.
_ABOVE = 3


def selected_for_run(paths: CalibrationPaths, run: Run, kinds: Sequence[CalibrationKind]) -> SelectedCalibrations:
    """Return the calibrations of a run, those that are not named selected from the store."""
    folder = (paths.store or store_of_run(run)) if paths.uses_store else None
    if folder is None:
        return SelectedCalibrations(paths=paths)
    store, grid = read_store(folder), arrange(run)
    used = made_for(run, grid.frames)
    choices = tuple(
        Choice(kind=kind, selection=Selection(file=named, sha256=sha256_of(named), why="named on the command line"))
        if (named := paths.named.get(kind)) is not None
        else choose(store, kind, used, require_usable=_usable(kind, run, grid))
        for kind in kinds
        if paths.named.get(kind) != NONE
    )
    selected = {choice.kind: choice.selection.file for choice in choices if choice.selection is not None}
    chosen = replace(paths, named=dict(paths.named) | selected)
    return SelectedCalibrations(paths=chosen, store=folder, choices=choices, damaged=store.damaged)


def store_of_run(run: Run) -> Path | None:
    """Return the store beside the rig file of a run, or None.

    The rig file is sought where it was, then by its name in the folders above the run and in the current one, as runs
    are moved to other machines.
    """
    files = run.session_json.get("files")
    rig = files.get("rig") if isinstance(files, dict) else None
    if not isinstance(rig, dict) or not isinstance(rig.get("name"), str):
        return None
    stated = run.session_json.get("host_folder")
    folders = [Path(stated)] if isinstance(stated, str) else []
    folders += [*run.path.absolute().parents][:_ABOVE]
    for folder in (*folders, Path.cwd()):
        if (folder / str(rig["name"])).is_file() and (folder / STORE_FOLDER).is_dir():
            return folder / STORE_FOLDER
    return None


def _usable(kind: CalibrationKind, run: Run, grid: FrameGrid) -> Callable[[Path], object]:
    """Return what tries a file on the frames of a run, as measuring will."""
    also: dict[str, Callable[[Any], object]] = {
        "polarizer": partial(throughput_of, grid),
        "flat": partial(flat_division, grid),
        "registration": partial(frame_shifts, run, grid),
    }

    def try_file(path: Path) -> None:
        found, _ = record_of(kind).read_fitting(path, run)
        if kind in also:
            also[kind](found)

    return try_file


@dataclass(frozen=True, kw_only=True, eq=False)
class DarkLevel:
    """One number per polarizer angle that is taken off every pixel."""

    level_dn: FloatArray  #: [DN].
    std_error_dn: float  #: Standard error of it, common to all angles [DN].
    source: str  #: Its source, in words.


def find_dark_level(run: Run, grid: FrameGrid, noise: NoiseParameters | None) -> DarkLevel:
    """Return the dark level from the best source.

    In this order: dark frames of the run at the exposure of its scene frames; the black level that the frames
    state; black level and dark current of a noise calibration.
    """
    darks = _matching_darks(run, grid)
    if darks:
        return _from_dark_frames(run, grid, darks)
    stated = [record.black_level_dn for record in grid.records[0]]
    known = [level for level in stated if level is not None]
    if len(known) == len(stated):
        return DarkLevel(
            level_dn=np.array(known), std_error_dn=0.0, source="the black level stated by the frames, taken as exact"
        )
    if noise is not None:
        return _from_calibration(grid, noise)
    raise DataError(
        f"{run.path}: the counts without light are not known: add dark frames of the same exposure (rigctl import "
        "--kind dark), a black level (--black-level-dn), or a calibration (--noise)"
    )


def _matching_darks(run: Run, grid: FrameGrid) -> list[FrameRecord]:
    """Return the dark frames of the scene frames' exposure and gain, where that is one."""
    first = grid.records[0][0]
    if not grid.is_one_exposure:
        return []
    return [
        record
        for record in run.frames
        if record.kind == "dark"
        and record.gain_db == first.gain_db
        and (record.width, record.height) == (first.width, first.height)
        and _same_exposure(record.exposure_s, first.exposure_s)
    ]


def _same_exposure(one_s: float | None, other_s: float | None) -> bool:
    if one_s is None or other_s is None:
        return one_s is other_s
    return abs(one_s - other_s) <= 1e-6 * other_s


def _from_dark_frames(run: Run, grid: FrameGrid, darks: list[FrameRecord]) -> DarkLevel:
    mean = np.zeros((grid.height, grid.width))
    for record in darks:
        mean += run.counts(record)
    mean /= len(darks)
    error = float(mean.std() / np.sqrt(mean.size))
    plural = "frame" if len(darks) == 1 else "frames"
    return DarkLevel(
        level_dn=np.full(grid.angles, mean.mean()),
        std_error_dn=error,
        source=f"{len(darks)} dark {plural} of this run at the same exposure (black level and dark current)",
    )


def _from_calibration(grid: FrameGrid, noise: NoiseParameters) -> DarkLevel:
    black, dark_current = noise.black_level_dn, noise.dark_current_e_per_s
    level = np.full(grid.angles, black.value)
    known = dark_current is not None and grid.exposures_s is not None
    if dark_current is not None and grid.exposures_s is not None:
        level += noise.gain_dn_per_e.value * dark_current.value * grid.exposures_s
    what = "black level and dark current" if known else "black level (the dark current is not known and not subtracted)"
    return DarkLevel(level_dn=level, std_error_dn=black.std_error, source=f"the noise calibration: {what}")


# Least response of a usable pixel, relative to the others.
_DEAD = 0.1
# Deviation of a region from the mean of the flat field at which its noise differs from the prediction.
_UNLIKE = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class FlatDivision:
    """The flat field of each channel."""

    response: FloatArray  #: What frames are divided by, mean 1; 1 where a pixel is dead.
    dead: NDArray[np.bool_]  #: Pixels that hardly respond to light.
    variance_factor: FloatArray  #: Factor on the variance of noise, mean over the pixels.
    error: FloatArray  #: Standard deviation over the pixels of the flat field's own error, relative.


def flat_division(grid: FrameGrid, flats: FlatFields) -> FlatDivision:
    """Return the flat fields for the frames of a run."""
    places = [flats.place(angle_deg) for angle_deg in np.degrees(grid.polarizer_angles_rad)]
    response, errors = flats.response[places], flats.std_error[places]
    dead = np.any(response < _DEAD, axis=0)
    response = np.where(dead, 1.0, response)
    alive = ~dead
    return FlatDivision(
        response=response,
        dead=dead,
        variance_factor=np.mean(response[:, alive] ** -2.0, axis=1),
        error=np.sqrt(np.mean(np.square(errors[:, alive] / response[:, alive]), axis=1)),
    )


def flat_remarks(flat: FlatDivision, regions: list[Region]) -> Iterable[str]:
    """Return notable effects of the division by flat fields on the prediction of each region."""
    for name, inside in masks(regions, width=flat.dead.shape[1], height=flat.dead.shape[0]).items():
        response = float(flat.response[:, inside].mean())
        if abs(response - 1.0) > _UNLIKE:
            yield (
                f"{name}: the flat field is {response:.2f} of its mean there; its noise is predicted as for 1, "
                f"{'smaller' if response < 1.0 else 'larger'} than it is by {abs(response**-0.5 - 1.0):.0%}"
            )
    worst = float(flat.error.max())
    yield f"frames were divided by flat fields, whose own error adds a pattern of up to {worst:.2%} to single pixels"


# Largest distance of a frame from a calibrated stage angle for using its throughput.
_NEAR_DEG = 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Throughput:
    """Response to unpolarized light by channel, mean over the calibrated angles 1, and its standard error, (N,)."""

    value: FloatArray
    error: FloatArray


def _together(one: Throughput | None, other: Throughput | None) -> Throughput | None:
    """Return two throughputs as one; None where there is none."""
    if one is None or other is None:
        return one or other
    return Throughput(value=one.value * other.value, error=np.hypot(one.error, other.error))


def throughput_of(grid: FrameGrid, polarizer: PolarizerParameters) -> Throughput | None:
    """Return the throughput of each channel of a run; None where the calibration did not measure it."""
    if polarizer.channels is None:
        return None
    found = [_nearest(polarizer.channels, record).throughput for record in grid.records[0]]
    return Throughput(
        value=np.array([one.value for one in found]),
        error=np.array([one.std_error for one in found]),
    )


def _nearest(channels: Sequence[Channel], record: FrameRecord) -> Channel:
    known = np.array([one.stage_angle_deg for one in channels])
    if record.stage_angle_deg is None:
        raise DataError(f"{record.file} has no stage angle; the throughput of a polarizer goes by it")
    apart = np.abs(wrapped(known - record.stage_angle_deg, turn=360.0))
    if apart.min() > _NEAR_DEG:
        raise DataError(
            f"{record.file} was taken at stage angle {record.stage_angle_deg:.2f} deg; the polarizer calibration has "
            f"throughput at {', '.join(f'{angle:.1f}' for angle in known)} deg: calibrate at the angles that are used"
        )
    return channels[int(np.argmin(apart))]


BoolArray = NDArray[np.bool_]

# Least shift; and residual of edges above which they are mostly noise [share].
_SHIFTED_PIXELS, _MOSTLY_NOISE = 0.05, 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameShifts:
    """Shifts of frames against the first angle of the first cycle."""

    shifts_pixels: dict[int, FloatArray]  #: Sequence number of a frame to its shift (x, y).
    #: What interpolation makes of the variance of white noise, by channel; the mean over cycles.
    variance_factor: FloatArray
    margin_pixels: int  #: Rows and columns along the border of the picture that not every frame shows.

    def signal(self, record: FrameRecord, signal: FloatArray) -> FloatArray:
        """Return a frame moved back."""
        return moved_back(signal, self.shifts_pixels[record.sequence])[0]

    def touched(self, record: FrameRecord, bad: BoolArray) -> BoolArray:
        """Return the pixels of the shifted frame with any part of a bad one."""
        if not bad.any():
            return bad
        parts, _ = moved_back(bad.astype(np.float64), self.shifts_pixels[record.sequence])
        return np.asarray(parts > 0.0)

    def beyond(self, shape: tuple[int, int]) -> BoolArray:
        """Return the pixels in the margin of a picture."""
        outside = np.ones(shape, dtype=np.bool_)
        inner = slice(self.margin_pixels, -self.margin_pixels or None)
        outside[inner, inner] = False
        return outside


def frame_shifts(run: Run, grid: FrameGrid, registration: ImageRegistration) -> FrameShifts:
    """Return the shifts of the frames of a run from a registration."""
    first = angle_deg(run, grid.records[0][0])
    shifts = {
        record.sequence: registration.shift_pixels(angle_deg(run, record), against_deg=first)
        for cycle in grid.records
        for record in cycle
    }
    one_pixel = np.zeros((4, 4))
    factors = [[moved_back(one_pixel, shifts[record.sequence])[1] for record in cycle] for cycle in grid.records]
    return FrameShifts(
        shifts_pixels=shifts,
        variance_factor=np.mean(factors, axis=0),
        margin_pixels=int(np.ceil(max(np.max(np.abs(shift)) for shift in shifts.values()))),
    )


def moved_edges(run: Run, grid: FrameGrid, shifts: FrameShifts) -> tuple[str, bool]:
    """Return the effect of shifting the frames of the first cycle on their edges, and whether it is acceptable.

    The text has one part per angle and is empty without shifts; edges that are mostly noise are acceptable.
    """
    records = grid.records[0]
    moves = np.array([shifts.shifts_pixels[record.sequence] for record in records])
    off = np.flatnonzero(np.linalg.norm(moves, axis=1) > _SHIFTED_PIXELS)
    if not off.size:
        return "", True
    pictures = np.array([run.counts(record).astype(np.float64) for record in records])
    usable = np.all([usable_pixels(record, counts) for record, counts in zip(records, pictures, strict=True)], axis=0)
    if not usable.any():
        return "no pixel is usable in all frames", True
    left = edges_left(pictures, moves, usable)
    text = "; ".join(
        f"at {records[index].polarizer_angle_deg or 0.0:g} deg {before:.2%} before, {after:.2%} after"
        for index, (before, after) in zip(off.tolist(), left[off].tolist(), strict=True)
    )
    before, after = left[off].sum(axis=0)
    is_better = bool(after < before or left[off, 0].min() > _MOSTLY_NOISE)
    return f"mismatch of edges {text}", is_better


@dataclass(frozen=True, kw_only=True, eq=False)
class Corrections:
    """Corrections of frames; None is not corrected.

    `interpolated` is what the interpolation of a mosaic has made of the variance of noise before frames were stored.
    """

    throughput: Throughput | None = None
    flat: FlatDivision | None = None
    shifts: FrameShifts | None = None
    interpolated: float = 1.0

    def corrected(self, signal: FloatArray, record: FrameRecord, channel: int) -> FloatArray:
        """Return the frame of a channel, dark level off, corrected."""
        if self.throughput is not None:
            signal = signal / self.throughput.value[channel]
        if self.flat is not None:
            signal = signal / self.flat.response[channel]
        return signal if self.shifts is None else self.shifts.signal(record, signal)

    def touched(self, bad: BoolArray, record: FrameRecord) -> BoolArray:
        """Return the pixels of the corrected frame with any part of a bad one."""
        return bad if self.shifts is None else self.shifts.touched(record, bad)

    def missing(self, record: FrameRecord, shape: tuple[int, int]) -> BoolArray:
        """Return the pixels of the corrected frame without information on the scene."""
        dead = np.zeros(shape, dtype=np.bool_) if self.flat is None else self.touched(self.flat.dead, record)
        return dead if self.shifts is None else dead | self.shifts.beyond(shape)

    def noise_factor(self, channels: int) -> FloatArray:
        """Return the factor on the variance of temporal noise, by channel.

        That of light whose mean after the division is known: a frame that got less of it had less noise too, so that
        the throughput enters once and not squared. Read noise is enlarged by another factor of it, some per cent.
        """
        factor = np.full(channels, self.interpolated)
        if self.throughput is not None:
            factor /= self.throughput.value
        if self.flat is not None:
            factor *= self.flat.variance_factor
        return factor if self.shifts is None else factor * self.shifts.variance_factor

    def relative_error(self, channels: int) -> FloatArray:
        """Return the standard error that it adds to the mean of each channel, relative and independent."""
        return np.zeros(channels) if self.throughput is None else self.throughput.error

    @property
    def is_any(self) -> bool:
        """Any correction is made, or was."""
        return self.interpolated != 1.0 or any(part is not None for part in (self.throughput, self.flat, self.shifts))


@dataclass(frozen=True, kw_only=True, eq=False)
class FoundCorrections:
    """Corrections of frames by a run's own diagnosis; None for none."""

    throughput: Throughput | None  #: Frames are divided by it.
    dark: FloatArray | None  #: Subtracted in addition to the dark level, by angle [unit of the measurement].
    shifts: FrameShifts | None  #: Frames are moved back by them.
    dark_error: FloatArray  #: Standard error of the subtracted level [unit of the measurement].
    shift_error: FloatArray  #: Standard error of the shifts, x and y [pixel].
    remarks: tuple[str, ...]  #: The corrections in words.

    def level_error(self, channels: FloatArray, inside: BoolArray) -> FloatArray:
        """Return the standard error that dark levels and shifts add to a region's mean, each angle by itself, (N,)."""
        square = np.square(self.dark_error)
        if np.any(self.shift_error > 0.0) and inside.any():
            slopes = region_slopes(channels, inside)
            square = square + np.sum(np.square(self.shift_error * slopes), axis=1)
        return np.asarray(np.sqrt(square))


def region_slopes(channels: FloatArray, inside: BoolArray) -> FloatArray:
    """Return the mean slopes of a region behind each angle, x and y, shape (N, 2); nothing along one pixel."""
    rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    part = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    slopes = np.zeros((len(channels), 2))
    for way, (axis, length) in enumerate(((2, len(columns)), (1, len(rows)))):
        if length > 1:
            steep = np.gradient(channels[(slice(None), *part)], axis=axis)
            slopes[:, way] = steep[:, inside[part]].mean(axis=1)
    return slopes


NOTHING = Corrections()


class CorrectedFrames:
    """The frames of a run, corrected. Once `read`, they have their means and the pixels that cannot be used."""

    def __init__(self, run: Run, grid: FrameGrid, dark_level: DarkLevel, corrections: Corrections) -> None:
        """Set run, grid and corrections; nothing is read yet."""
        shape = (grid.height, grid.width)
        self.run, self.grid = run, grid
        self.dark_level = dark_level  #: subtracted from the counts, with its source
        self.corrections = corrections  #: applied after the dark level
        self.channels = np.zeros((grid.angles, *shape))  #: mean of each angle over the cycles [grid.unit]
        self.light = np.zeros(grid.cycles)  #: mean of all pixels of all angles, cycle by cycle [grid.unit]
        self.saturated = np.zeros(shape, dtype=np.bool_)  #: pixels that are saturated in any frame
        self.missing = np.zeros(shape, dtype=np.bool_)  #: pixels that are missing in any frame
        self.at_zero = np.zeros(shape, dtype=np.bool_)  #: pixels of 0 counts, the lower end, in any frame

    @property
    def usable(self) -> BoolArray:
        """Pixels that are neither saturated nor missing in any frame."""
        return ~(self.saturated | self.missing)

    @property
    def interpolation(self) -> Interpolation:
        """How the pictures of a mosaic were interpolated before they were stored."""
        return self.run.session.interpolation

    @property
    def are_counts(self) -> bool:
        """What is read stands for single counts of the camera, up to a factor for each angle."""
        done = self.corrections
        return self.grid.is_whole and done.flat is None and done.shifts is None and done.interpolated == 1.0

    def read(self, inside: Mapping[str, BoolArray]) -> dict[str, FloatArray]:
        """Read every frame once; return the signal in each region, shape (cycles, N, P)."""
        places = {name: np.flatnonzero(mask) for name, mask in inside.items()}
        pixels = {name: np.empty((self.grid.cycles, self.grid.angles, of.size)) for name, of in places.items()}
        for cycle, records in enumerate(self.grid.records):
            for angle, record in enumerate(records):
                counts = self.run.counts(record)
                self._note_unusable(record, counts)
                signal = self._corrected(counts, record, angle)
                self.channels[angle] += signal
                self.light[cycle] += float(signal.mean()) / self.grid.angles
                for name, of in places.items():
                    pixels[name][cycle, angle] = signal.ravel()[of]
        self.channels /= self.grid.cycles
        return pixels

    def signals(self, cycle: int) -> Iterator[FloatArray]:
        """Yield the frames of one cycle, each of shape (H, W) [grid.unit]."""
        for angle, record in enumerate(self.grid.records[cycle]):
            yield self._corrected(self.run.counts(record), record, angle)

    def _corrected(self, counts: NDArray[np.uint16], record: FrameRecord, angle: int) -> FloatArray:
        signal = (counts - self.dark_level.level_dn[angle]) * self.grid.to_unit[angle]
        return np.asarray(self.corrections.corrected(signal, record, angle))

    def _note_unusable(self, record: FrameRecord, counts: NDArray[np.uint16]) -> None:
        received = np.ones(counts.shape, dtype=np.bool_)
        if self.corrections.is_any:
            self.missing |= self.corrections.missing(record, self.missing.shape)
        if record.missing_dn is not None:
            received = counts != record.missing_dn
            self.missing |= self.corrections.touched(~received, record)
        self.saturated |= self.corrections.touched(received & (counts >= record.saturation_dn), record)
        self.at_zero |= received & (counts == 0)


def corrected_frames(
    run: Run,
    grid: FrameGrid,
    given: RunCalibrations,
    found: FoundCorrections | None,
) -> CorrectedFrames:
    """Return a reader of a run's frames, corrected by calibrations and by the faults that the run itself shows."""
    dark_level = find_dark_level(run, grid, given.noise)
    throughput = None if given.polarizer is None else throughput_of(grid, given.polarizer)
    shifts = None if found is None else found.shifts
    if shifts is None and given.registration is not None:
        shifts = frame_shifts(run, grid, given.registration)
    if found is not None and found.dark is not None:
        dark_level = replace(
            dark_level,
            level_dn=dark_level.level_dn + found.dark / grid.to_unit,
            source=f"{dark_level.source}; and corrections of single angles from the run itself",
        )
    corrections = Corrections(
        throughput=_together(throughput, None if found is None else found.throughput),
        flat=None if given.flat is None else flat_division(grid, given.flat),
        shifts=shifts,
        interpolated=variance_factor(run.session.interpolation),
    )
    return CorrectedFrames(run, grid, dark_level, corrections)
