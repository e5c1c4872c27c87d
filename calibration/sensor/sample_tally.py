"""Raw samples of a level as integers: range, zeros, unused bits, repeated frames."""

import zlib
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

# As many pixels show it well enough.
_HISTOGRAM_PIXELS = 65536
# A value that its neighbours say should occur this often is missing by chance once in 1e10 (Poisson).
_LEAST_EXPECTED = 25.0
_NEIGHBOURS = 9
_ROWS_APART = 4


@dataclass(frozen=True, kw_only=True)
class SampleTally:
    """Integer facts over all frames of one level.

    Attributes
    ----------
    min_dn, max_dn : int
        Smallest and largest sample.
    zero_fraction : float
        Share of samples that are 0.
    max_fraction : float
        Share of samples that are equal to `max_dn`.
    used_bits : int
        Bitwise or of all samples: a bit that is never set in it is never set in any sample.
    missing_codes : float
        Share of the values that the first frame should have by its neighbouring values, and that never occur in it.
    digests : tuple of (int, int)
        One a frame, its sum and the checksum of every fourth row; frames in which all samples are equal have none.
    """

    min_dn: int
    max_dn: int
    zero_fraction: float
    max_fraction: float
    used_bits: int
    missing_codes: float
    digests: tuple[tuple[int, int], ...]


class SampleCounter:
    """Builds a tally, frame by frame. Its memory grows by two numbers a frame."""

    def __init__(self) -> None:
        self._min_dn = np.iinfo(np.uint16).max
        self._max_dn = -1
        self._at_max = 0
        self._zeros = 0
        self._samples = 0
        self._used_bits = 0
        self._missing_codes: float | None = None
        self._digests: list[tuple[int, int]] = []

    def add(self, frame: NDArray[np.uint16]) -> None:
        """Take one frame into account."""
        low, high = int(frame.min()), int(frame.max())
        self._min_dn = min(self._min_dn, low)
        self._count_maximum(frame, high)
        if low == 0:
            self._zeros += frame.size - int(np.count_nonzero(frame))
        self._samples += frame.size
        self._used_bits |= int(np.bitwise_or.reduce(frame, axis=None))
        if self._missing_codes is None:
            self._missing_codes = _missing_codes(frame)
        if low < high:
            # Both together tell a million frames apart: the sum of a frame alone scatters over thousands.
            some_rows = np.ascontiguousarray(frame[::_ROWS_APART])
            self._digests.append((round(cv2.sumElems(frame)[0]), zlib.crc32(some_rows.data)))

    def _count_maximum(self, frame: NDArray[np.uint16], high: int) -> None:
        if high > self._max_dn:
            self._max_dn, self._at_max = high, 0
        if high == self._max_dn:
            self._at_max += int(np.count_nonzero(frame == high))

    def tally(self) -> SampleTally:
        """Return what has been counted; at least one frame must have been added."""
        return SampleTally(
            min_dn=self._min_dn,
            max_dn=self._max_dn,
            zero_fraction=self._zeros / self._samples,
            max_fraction=self._at_max / self._samples,
            used_bits=self._used_bits,
            missing_codes=self._missing_codes or 0.0,
            digests=tuple(self._digests),
        )


def _missing_codes(frame: NDArray[np.uint16]) -> float:
    low = int(frame.min())
    counts = np.bincount(frame.ravel()[:_HISTOGRAM_PIXELS] - low)
    if len(counts) < _NEIGHBOURS:
        return 0.0
    expected = np.convolve(counts, np.full(_NEIGHBOURS, 1.0 / _NEIGHBOURS), mode="same")
    filled = expected >= _LEAST_EXPECTED
    return float(np.count_nonzero(filled & (counts == 0))) / max(int(np.count_nonzero(filled)), 1)
