"""The fixed pattern of a level by spatial frequency, along rows and along columns."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

# Rows that are transformed at a time.
_ROWS_AT_A_TIME = 64
# Below this frequency a pattern is uneven light, and not periodic.
_LOWEST_PERIODIC_PER_PIXEL = 0.02
_LEAST_SHARE, _CHANCE = 0.1, 10.0
_SIGMA = 8.0
# The power of fewer lines scatters too much.
_LEAST_LINES = 16


@dataclass(frozen=True, kw_only=True, eq=False)
class Spectrogram:
    """Amplitude of a picture by frequency; noise that is independent from pixel to pixel has its own deviation at each.

    Attributes
    ----------
    frequency_per_pixel : (n,) array
        Above 0, up to 0.5 [1/pixel].
    amplitude : (n,) array
        Root of the mean power over all lines, in the unit of the picture.
    n_lines : int
        Rows or columns that it is the mean of.
    """

    frequency_per_pixel: FloatArray
    amplitude: FloatArray
    n_lines: int

    @property
    def median(self) -> float:
        """Median of the amplitude, which peaks do not change; 0 for lines of one pixel."""
        return float(np.median(self.amplitude)) if self.amplitude.size else 0.0


@dataclass(frozen=True, kw_only=True)
class SpectralPeak:
    """A frequency that stands out.

    Attributes
    ----------
    frequency_per_pixel : float
        [1/pixel].
    share : float
        Part of the variance of the fixed pattern that it has.
    """

    frequency_per_pixel: float
    share: float


def spectrogram(picture: NDArray[np.float32], *, along: int) -> Spectrogram:
    """Return the spectrogram of a picture.

    Parameters
    ----------
    picture : (M, N) array
        Any unit; its mean is taken off.
    along : {0, 1}
        1: of rows, with horizontal frequencies; 0: of columns, with vertical ones.

    References
    ----------
    EMVA Standard 1288, Release 4.0 Linear, spectrograms: mean over rows of the squared Fourier amplitude over its
    length.
    """
    lines = picture if along == 1 else picture.T
    mean = float(picture.mean(dtype=np.float64))
    size = lines.shape[1]
    power = np.zeros(size // 2 + 1)
    for start in range(0, lines.shape[0], _ROWS_AT_A_TIME):
        block = np.fft.rfft(lines[start : start + _ROWS_AT_A_TIME] - mean, axis=1)
        power += np.square(np.abs(block)).sum(axis=0)
    return Spectrogram(
        frequency_per_pixel=np.arange(1, size // 2 + 1) / size,
        amplitude=np.sqrt(power[1:] / (size * lines.shape[0])),
        n_lines=lines.shape[0],
    )


def spectral_peak(found: Spectrogram, *, variance: float) -> SpectralPeak | None:
    """Return the frequency that has most of a fixed pattern, None where none has a tenth of it.

    Parameters
    ----------
    found : Spectrogram
        Of the pattern.
    variance : float
        Of the pattern, noise in time taken off, in the square of its unit.

    Notes
    -----
    Lines of one pattern (columns) have one power for each frequency, exponentially distributed: the largest of 300 has
    6 times the mean, 2 % of the variance. With few frequencies the limit is higher by so much.
    """
    periodic = found.frequency_per_pixel >= _LOWEST_PERIODIC_PER_PIXEL
    if not periodic.any() or variance <= 0.0 or found.n_lines < _LEAST_LINES:
        return None
    frequencies = len(found.amplitude)
    power = np.square(found.amplitude[periodic]) - found.median**2
    largest = int(np.argmax(power))
    share = float(power[largest]) / (frequencies * variance)
    noise = _SIGMA * found.median**2 / np.sqrt(found.n_lines)
    if share < _LEAST_SHARE + _CHANCE / frequencies or power[largest] < noise:
        return None
    return SpectralPeak(frequency_per_pixel=float(found.frequency_per_pixel[periodic][largest]), share=share)
