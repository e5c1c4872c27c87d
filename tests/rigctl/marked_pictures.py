"""Pictures of panels with printed markers on them, seen by a camera that may have moved."""

from pathlib import Path

import cv2
import numpy as np

from rigctl.runs.folder import Run
from tests.rigctl.made_runs import at, make_run

WIDTH, HEIGHT = 480, 360
# Of a small turn about the camera's axis and a shift.
MOVED = np.array([[0.9997, -0.0244, 14.3], [0.0244, 0.9997, -6.8]])


def panels(*, markers: dict[int, tuple[int, int]]) -> np.ndarray:
    """Return a picture with a bright panel and markers of 48 pixels at the given top left pixels, in DN."""
    picture = np.full((HEIGHT, WIDTH), 900, dtype=np.uint16)
    picture[120:240, 150:330] = 2400
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    for number, (x, y) in markers.items():
        picture[y - 10 : y + 58, x - 10 : x + 58] = 2600
        picture[y : y + 48, x : x + 48] = 300 + 9 * cv2.aruco.generateImageMarker(family, number, 48).astype(np.uint16)
    return picture


def run_of(picture: np.ndarray, path: Path) -> Run:
    """Return a run of four angles of that picture, with noise of 5 DN, blurred a little as a lens does."""
    generator, blurred = np.random.default_rng(5), cv2.GaussianBlur(picture.astype(np.float32), (0, 0), 0.8)
    frames = [
        (at(angle), np.clip(blurred + 5.0 * generator.standard_normal(picture.shape), 0, 4095))
        for angle in (0.0, 45.0, 90.0, 135.0)
    ]
    return make_run(path, frames)


def seen_after_move(picture: np.ndarray) -> np.ndarray:
    """Return the picture as a camera sees it that moved by `MOVED`."""
    return cv2.warpAffine(picture, MOVED, (WIDTH, HEIGHT), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
