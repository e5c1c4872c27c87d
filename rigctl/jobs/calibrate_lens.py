"""Calibrating a lens: pictures of a chessboard in; focal length, principal point and distortion out."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.pointing.pose import LensCalibration, calibrate_lens
from rigctl.calibrations.lens import lens_json
from rigctl.calibrations.record import write_content
from rigctl.console.json_text import Json
from rigctl.errors import ConfigError
from rigctl.images import ImageFile, read_image

_BOARD = re.compile(r"(\d{1,3})x(\d{1,3})")
_LEAST_CORNERS = 3


def calibrate_lens_of(
    pictures: Sequence[Path], *, board: str, square_mm: float, out: Path
) -> tuple[LensCalibration, dict[str, Json]]:
    """Return the lens that pictures of a chessboard were taken with, and the content of its file, once it is written.

    Parameters
    ----------
    pictures : sequence of Path
        Image files, three or more.
    board : str
        Inner corners along its sides, such as ``9x6``.
    square_mm : float
        Side of a square [mm].
    out : Path
        File to write.

    Raises
    ------
    ConfigError, DataError, CalibrationError
        A picture cannot be read, or too few show the board.
    """
    sides = _BOARD.fullmatch(board)
    if sides is None or min(int(sides[1]), int(sides[2])) < _LEAST_CORNERS:
        raise ConfigError(f"--board: is {board!r}; write its inner corners like 9x6, 3 or more along each side")
    read = [_upright(read_image(path)) for path in pictures]
    found = calibrate_lens(read, columns=int(sides[1]), rows=int(sides[2]), square_m=square_mm / 1000.0)
    content = lens_json(found, pictures)
    write_content(out, content)
    return found, content


def _upright(image: ImageFile) -> NDArray[np.generic]:
    return image.counts if image.first_row == "top" else image.counts[::-1]
