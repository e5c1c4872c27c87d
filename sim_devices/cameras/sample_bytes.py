"""Samples of a simulated GigE camera in bytes, written from the standard."""

import numpy as np
from numpy.typing import NDArray

MONO8, MONO10, MONO12, MONO16 = 0x01080001, 0x01100003, 0x01100005, 0x01100007
MONO12_PACKED, MONO12P = 0x010C0006, 0x010C0047
BAYER_RG12 = 0x01100011
# As LUCID numbers them.
POLARIZE_MONO8, POLARIZE_MONO12, POLARIZE_MONO12P = 0x81080001, 0x81100008, 0x810C0047
FORMATS = {
    "Mono8": MONO8,
    "Mono10": MONO10,
    "Mono12": MONO12,
    "Mono16": MONO16,
    "Mono12Packed": MONO12_PACKED,
    "Mono12p": MONO12P,
    "BayerRG12": BAYER_RG12,  # what the source has is taken for a mosaic
    "PolarizeMono8": POLARIZE_MONO8,
    "PolarizeMono12": POLARIZE_MONO12,
    "PolarizeMono12p": POLARIZE_MONO12P,
}
_BITS = {
    MONO8: 8,
    MONO10: 10,
    MONO12: 12,
    MONO16: 16,
    MONO12_PACKED: 12,
    MONO12P: 12,
    BAYER_RG12: 12,
    POLARIZE_MONO8: 8,
    POLARIZE_MONO12: 12,
    POLARIZE_MONO12P: 12,
}


def bytes_of(counts: NDArray[np.uint16], *, bit_depth: int, pixel_format: int) -> bytes:
    """Return a picture as a camera sends it.

    Parameters
    ----------
    counts : (H, W) array of uint16
        Of `bit_depth` bits, right-justified.
    bit_depth : int
        Of the detector. A format of fewer bits drops the lowest ones, one of more has the detector's at its top.
    pixel_format : int
        Number of the format.

    Raises
    ------
    ValueError
        There is no such format here.
    """
    if pixel_format not in _BITS:
        raise ValueError(f"pixel format {pixel_format:#010x}: not one that this camera sends")
    spare = _BITS[pixel_format] - bit_depth
    samples = (np.left_shift(counts, spare) if spare >= 0 else np.right_shift(counts, -spare)).ravel()
    if pixel_format in (MONO8, POLARIZE_MONO8):
        return samples.astype(np.uint8).tobytes()
    if pixel_format in (MONO12_PACKED, MONO12P, POLARIZE_MONO12P):
        return _in_threes(samples, lowest_first=pixel_format != MONO12_PACKED)
    return samples.astype("<u2").tobytes()


def _in_threes(samples: NDArray[np.uint16], *, lowest_first: bool) -> bytes:
    """Return two samples of 12 bits in three bytes, the last of an odd number in two."""
    padded = np.append(samples, np.uint16(0)) if samples.size % 2 else samples
    first, second = padded[0::2], padded[1::2]
    triples = np.empty((first.size, 3), dtype=np.uint8)
    if lowest_first:
        triples[:, 0] = first & 0xFF
        triples[:, 1] = (first >> 8) | (second & 0xF) << 4
    else:
        triples[:, 0] = first >> 4
        triples[:, 1] = (first & 0xF) | (second & 0xF) << 4
    triples[:, 2] = second >> 4
    return triples.tobytes()[: -(-12 * samples.size // 8)]
