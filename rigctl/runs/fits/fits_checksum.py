"""The checksums that a FITS file carries in itself."""

import numpy as np

ALL_ONES = 0xFFFF_FFFF
NO_CHECKSUM = "0" * 16
# Encoded sums are letters and digits only: these ASCII codes lie between them.
_PUNCTUATION = frozenset(range(0x3A, 0x41)) | frozenset(range(0x5B, 0x61))


def ones_complement_sum(data: bytes) -> int:
    """Return the 32-bit sum with end-around carry of big-endian words.

    Parameters
    ----------
    data : bytes
        A whole number of words of four bytes, at most 2**34 bytes (so that the sum fits 64 bits).

    References
    ----------
    FITS standard 4.0 (doi:10.1051/0004-6361/201015362), appendix J.
    """
    total = int(np.frombuffer(data, dtype=">u4").sum(dtype=np.uint64))
    while total >> 32:
        total = (total & ALL_ONES) + (total >> 32)
    return total


def encode_checksum(total: int) -> str:
    """Return the sixteen letters and digits that bring a header-and-data sum to all ones.

    Parameters
    ----------
    total : int
        ``ones_complement_sum`` of the whole unit with ``NO_CHECKSUM`` in the place of the checksum.

    References
    ----------
    FITS standard 4.0 (doi:10.1051/0004-6361/201015362), appendix J: each byte of the complement is shared
    out over four characters, which stand four apart; the whole is turned right by one, since a card's value
    begins one byte before a word does.
    """
    complement = ALL_ONES - total
    columns = [_share_out(byte) for byte in complement.to_bytes(4, "big")]
    text = "".join(chr(columns[i][j]) for j in range(4) for i in range(4))
    return text[-1] + text[:-1]


def _share_out(byte: int) -> list[int]:
    quarter, rest = divmod(byte, 4)
    codes = [ord("0") + quarter + rest] + [ord("0") + quarter] * 3
    while any(code in _PUNCTUATION for code in codes):
        for i in (0, 2):
            if codes[i] in _PUNCTUATION or codes[i + 1] in _PUNCTUATION:
                codes[i] += 1
                codes[i + 1] -= 1
    return codes
