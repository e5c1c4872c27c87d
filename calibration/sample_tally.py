"""What the raw samples of a level look like as integers: range, zeros, unused bits, repeated frames."""

import hashlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


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
    digests : tuple of bytes
        One digest a frame, of its samples; frames in which all samples are equal have none.
    """

    min_dn: int
    max_dn: int
    zero_fraction: float
    max_fraction: float
    used_bits: int
    digests: tuple[bytes, ...]


class SampleCounter:
    """Builds a tally, frame by frame. Its memory grows by 16 bytes a frame."""

    def __init__(self) -> None:
        self._min_dn = np.iinfo(np.uint16).max
        self._max_dn = -1
        self._at_max = 0
        self._zeros = 0
        self._samples = 0
        self._used_bits = 0
        self._digests: list[bytes] = []

    def add(self, frame: NDArray[np.uint16]) -> None:
        """Take one frame into account."""
        low, high = int(frame.min()), int(frame.max())
        self._min_dn = min(self._min_dn, low)
        self._count_maximum(frame, high)
        self._zeros += frame.size - int(np.count_nonzero(frame))
        self._samples += frame.size
        self._used_bits |= int(np.bitwise_or.reduce(frame, axis=None))
        if low < high:
            digest = hashlib.blake2b(np.ascontiguousarray(frame).data, digest_size=16)
            self._digests.append(digest.digest())

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
            digests=tuple(self._digests),
        )
