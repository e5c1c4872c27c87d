"""An address as a QR code of characters, for the telephone of whoever stands before the terminal."""

import cv2
import numpy as np
from numpy.typing import NDArray

_QUIET = 2
_HALVES = {(False, False): " ", (True, False): "▀", (False, True): "▄", (True, True): "█"}


def qr_text(text: str) -> str:
    """Return a text as a QR code, two rows of it a line: light on dark, as terminals are.

    Raises
    ------
    ValueError
        It is too long for one.
    """
    try:
        found = cv2.QRCodeEncoder.create().encode(text)
    except cv2.error as error:
        raise ValueError(f"{len(text)} characters are too many for a QR code") from error
    code = np.asarray(found, dtype=np.uint8)
    if code.size == 0:
        raise ValueError(f"{len(text)} characters are too many for a QR code")
    is_light = np.pad(_trimmed(code) > 0, _QUIET, constant_values=True)
    if len(is_light) % 2:
        is_light = np.pad(is_light, ((0, 1), (0, 0)), constant_values=True)
    pairs = zip(is_light[::2], is_light[1::2], strict=True)
    return "\n".join("".join(_HALVES[bool(a), bool(b)] for a, b in zip(*pair, strict=True)) for pair in pairs)


def _trimmed(code: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a code without its light rim, which differs from version to version of its maker."""
    rows, columns = np.nonzero(code == 0)
    return code[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
