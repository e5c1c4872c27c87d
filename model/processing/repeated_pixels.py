"""The pixels of a region over many cycles, as far as its numbers need them: held at once, or cycle by cycle."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.processing.repeatability import Repeatability, repeatability, repeatability_of
from model.processing.sample_moments import Sample, deviation_of_squares, temporal_deviation

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class RepeatedPixels:
    """Pixels of a region over all cycles.

    Attributes
    ----------
    cycles : int
        How many.
    first, mean : (N, P) array
        Of the first cycle, and the mean over all.
    stokes_first, stokes_mean : (3, P) array
        Stokes parameters of the same.
    repeatability : Repeatability
        What the means over the pixels do not repeat.
    temporal, temporal_stokes : tuple of Sample
        Deviation of a pixel from cycle to cycle, of each channel and each Stokes parameter; none with one cycle.
    """

    cycles: int
    first: FloatArray
    mean: FloatArray
    stokes_first: FloatArray
    stokes_mean: FloatArray
    repeatability: Repeatability
    temporal: tuple[Sample, ...]
    temporal_stokes: tuple[Sample, ...]


def repeated(pixels: FloatArray, inverse: FloatArray, *, noise_inflation: float = 1.0) -> RepeatedPixels:
    """Return what the numbers of a region need of its pixels, all of which are held at once.

    Parameters
    ----------
    pixels
        Cycles, angles, pixels, shape (C, N, P), P >= 4; dark level off.
    inverse
        From the angles to Stokes parameters, shape (3, N).
    noise_inflation
        As of `repeatability`.
    """
    stokes = np.einsum("kn,cnp->ckp", inverse, pixels)
    many = pixels.shape[0] > 1
    return RepeatedPixels(
        cycles=pixels.shape[0],
        first=pixels[0],
        mean=pixels.mean(axis=0),
        stokes_first=stokes[0],
        stokes_mean=stokes.mean(axis=0),
        repeatability=repeatability(pixels, noise_inflation=noise_inflation),
        temporal=tuple(temporal_deviation(pixels[:, k]) for k in range(pixels.shape[1]) if many),
        temporal_stokes=tuple(temporal_deviation(stokes[:, k]) for k in range(3) if many),
    )


class RunningPixels:
    """Takes cycle after cycle, and keeps what does not grow with them but for the means over the pixels.

    Some 50 numbers a pixel at four angles. What it gives differs from `repeated` by rounding alone.
    """

    def __init__(self, inverse: FloatArray, *, noise_inflation: float = 1.0) -> None:
        self._inverse, self._noise_inflation = inverse, noise_inflation
        self._means: list[FloatArray] = []
        self._channels, self._stokes = _Running(), _Running()
        self._squares: FloatArray | None = None

    def add(self, pixels: FloatArray) -> None:
        """Take the next cycle, shape (N, P)."""
        self._means.append(pixels.mean(axis=1))
        off = None if self._squares is None else pixels - self._channels.mean
        self._channels.add(pixels)
        self._stokes.add(np.asarray(self._inverse @ pixels))
        if off is None or self._squares is None:
            self._squares = np.zeros_like(pixels)
        else:
            # Welford's: the sum of squares about a mean that moves.
            self._squares += off * (pixels - self._channels.mean)

    def result(self) -> RepeatedPixels:
        """Return what the numbers of a region need.

        Raises
        ------
        ValueError
            Nothing was taken.
        """
        if self._squares is None:
            raise ValueError("there are no cycles")
        means, pixels = np.array(self._means), self._squares.shape[1]
        cycles = len(means)
        noise = self._squares.mean(axis=1) / max(cycles - 1, 1) / pixels
        return RepeatedPixels(
            cycles=cycles,
            first=self._channels.first,
            mean=self._channels.mean,
            stokes_first=self._stokes.first,
            stokes_mean=self._stokes.mean,
            repeatability=repeatability_of(means, noise * self._noise_inflation),
            temporal=self._channels.temporal(cycles),
            temporal_stokes=self._stokes.temporal(cycles),
        )


class _Running:
    """First, mean and squared steps of vectors of pixels."""

    def __init__(self) -> None:
        self._cycles = 0
        self.first = self.mean = self._before = self._steps = np.empty((0, 0))

    def add(self, values: FloatArray) -> None:
        self._cycles += 1
        if self._cycles == 1:
            self.first, self.mean, self._steps = values, values.copy(), np.zeros_like(values)
        else:
            step = values - self._before
            step -= step.mean(axis=1, keepdims=True)
            self._steps += np.square(step, out=step)
            self.mean += (values - self.mean) / self._cycles
        self._before = values

    def temporal(self, cycles: int) -> tuple[Sample, ...]:
        if cycles < 2:
            return ()
        return tuple(deviation_of_squares(steps / (cycles - 1) / 2.0) for steps in self._steps)
