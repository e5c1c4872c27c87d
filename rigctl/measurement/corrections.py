"""Corrections of a frame once its dark level is off: throughput, flat field, image registration, in this order."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.measurement.flat_division import FlatDivision
from rigctl.measurement.image_registration import FrameShifts
from rigctl.measurement.throughput_division import Throughput
from rigctl.runs.frame_record import FrameRecord

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


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
            signal = self.flat.divided(signal, channel)
        return signal if self.shifts is None else self.shifts.signal(record, signal)

    def touched(self, bad: BoolArray, record: FrameRecord) -> BoolArray:
        """Return which pixels of the corrected frame have any part of a bad one."""
        return bad if self.shifts is None else self.shifts.touched(record, bad)

    def missing(self, record: FrameRecord, shape: tuple[int, int]) -> BoolArray:
        """Return which pixels of the corrected frame show nothing of the scene."""
        dead = np.zeros(shape, dtype=np.bool_) if self.flat is None else self.touched(self.flat.dead, record)
        return dead if self.shifts is None else dead | self.shifts.beyond(shape)

    def noise_factor(self, channels: int) -> FloatArray:
        """Return what all of it makes of the variance of temporal noise, by channel.

        Notes
        -----
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
    """What a run's own diagnosis has frames corrected by; None is not corrected.

    Attributes
    ----------
    throughput : Throughput or None
        Frames are divided by it.
    dark : (N,) array or None
        Taken off the frames of each angle beside the dark level [unit of the measurement].
    shifts : FrameShifts or None
        Frames are moved back by them.
    dark_error : (N,) array
        Standard error of the level taken off [unit of the measurement].
    shift_error : (N, 2) array
        Standard error of the shifts, x and y [pixel].
    remarks : tuple of str
        What was done, or that there was nothing to do, in words.
    """

    throughput: Throughput | None
    dark: FloatArray | None
    shifts: FrameShifts | None
    dark_error: FloatArray
    shift_error: FloatArray
    remarks: tuple[str, ...]

    def level_error(self, channels: FloatArray, inside: BoolArray) -> FloatArray:
        """Return the standard error that dark levels and shifts add to a region's mean, each angle by itself, (N,).

        Parameters
        ----------
        channels : (N, H, W) array
            Pictures, corrected.
        inside : (H, W) array of bool
            The region.
        """
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
