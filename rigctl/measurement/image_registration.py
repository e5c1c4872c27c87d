"""Frames moved back to where the first polarizer angle sees the scene, and what that does to noise."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.polarimeter.pictures import edges_left, moved_back
from rigctl.calibrations.registration.register_run import angle_deg, usable_pixels
from rigctl.calibrations.registration.registration_file import ImageRegistration
from rigctl.measurement.frame_grid import FrameGrid
from rigctl.runs.frame_record import FrameRecord
from rigctl.runs.run_folder import Run

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

# Smaller shifts are none; edges of which more is left than this are mostly noise, and tell nothing [share].
_SHIFTED_PIXELS, _MOSTLY_NOISE = 0.05, 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameShifts:
    """Shifts of frames against the first angle of the first cycle.

    Attributes
    ----------
    shifts_pixels : mapping
        Sequence number of a frame to its shift (x, y).
    variance_factor : (N,) array
        What interpolation makes of the variance of white noise, by channel; the mean over cycles.
    margin_pixels : int
        Rows and columns along the border of the picture that not every frame shows.
    """

    shifts_pixels: dict[int, FloatArray]
    variance_factor: FloatArray
    margin_pixels: int

    def signal(self, record: FrameRecord, signal: FloatArray) -> FloatArray:
        """Return a frame moved back."""
        return moved_back(signal, self.shifts_pixels[record.sequence])[0]

    def touched(self, record: FrameRecord, bad: BoolArray) -> BoolArray:
        """Return which pixels of the frame moved back have any part of a bad one."""
        if not bad.any():
            return bad
        parts, _ = moved_back(bad.astype(np.float64), self.shifts_pixels[record.sequence])
        return np.asarray(parts > 0.0)

    def beyond(self, shape: tuple[int, int]) -> BoolArray:
        """Return which pixels of a picture lie in the margin."""
        outside = np.ones(shape, dtype=np.bool_)
        inner = slice(self.margin_pixels, -self.margin_pixels or None)
        outside[inner, inner] = False
        return outside


def frame_shifts(run: Run, grid: FrameGrid, registration: ImageRegistration) -> FrameShifts:
    """Return how the frames of a run are to be moved, by a registration.

    Raises
    ------
    DataError
        A frame has no angle, or the registration none for it.
    """
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


@dataclass(frozen=True, kw_only=True)
class MovedEdges:
    """Edges of the pictures of a run before and after they were moved.

    Attributes
    ----------
    text : str
        In words, angle by angle; empty where nothing was moved.
    is_better : bool
        They lie better on one another, or tell nothing.
    """

    text: str
    is_better: bool


def moved_edges(run: Run, grid: FrameGrid, shifts: FrameShifts) -> MovedEdges:
    """Return what moving the frames of the first cycle does to their edges."""
    records = grid.records[0]
    moves = np.array([shifts.shifts_pixels[record.sequence] for record in records])
    off = np.flatnonzero(np.linalg.norm(moves, axis=1) > _SHIFTED_PIXELS)
    if not off.size:
        return MovedEdges(text="", is_better=True)
    pictures = np.array([run.counts(record).astype(np.float64) for record in records])
    usable = np.all([usable_pixels(record, counts) for record, counts in zip(records, pictures, strict=True)], axis=0)
    if not usable.any():
        return MovedEdges(text="no pixel is usable in all frames", is_better=True)
    left = edges_left(pictures, moves, usable)
    text = "; ".join(
        f"at {records[index].polarizer_angle_deg or 0.0:g} deg {before:.2%} before, {after:.2%} moved back"
        for index, (before, after) in zip(off.tolist(), left[off].tolist(), strict=True)
    )
    before, after = left[off].sum(axis=0)
    is_better = bool(after < before or left[off, 0].min() > _MOSTLY_NOISE)
    return MovedEdges(text=f"left of edges that do not lie on one another {text}", is_better=is_better)
