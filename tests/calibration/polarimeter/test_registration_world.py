"""Registration of pictures as people have them: with borders, and with what is no plain shift."""

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.polarimeter.pictures import register
from tests.worldlike import Faults, World, expose

WORLD = World(height=240, width=260, texture=0.3, texture_pixels=3.0, electrons=60000.0)


def moved(picture: NDArray[np.float64], x: float, y: float) -> NDArray[np.float64]:
    motion = np.array([[1.0, 0.0, x], [0.0, 1.0, y]])
    return np.asarray(cv2.warpAffine(picture, motion, picture.shape[::-1], borderMode=cv2.BORDER_REFLECT))


def pictures(*shifts: tuple[float, float]) -> NDArray[np.float64]:
    """Return noisy pictures of one light, each moved."""
    draws = np.random.default_rng(21)
    light = expose(WORLD, Faults(), draws)[0].astype(np.float64)
    return np.array([moved(light, *shift) + draws.normal(0.0, 4.0, light.shape) for shift in shifts])


def test_a_border_that_is_masked_makes_no_shift() -> None:
    frames = pictures((0, 0), (0, 0), (0, 0))
    usable = np.ones(frames.shape[1:], dtype=bool)
    frames[1, :9], frames[2, :, -7:] = 0.0, 0.0
    usable[:9], usable[:, -7:] = False, False
    assert np.max(np.abs(register(frames, usable).shift_pixels)) < 0.1


def test_a_plain_shift_lets_the_edges_of_other_tiles_fall_on_one_another() -> None:
    found = register(pictures((0, 0), (0, 0), (1.4, -0.9)))
    np.testing.assert_allclose(found.shift_pixels[2], [1.4, -0.9], atol=0.1)
    assert found.is_plain(2)
    before, after = found.edge_residual[2]
    assert after < before


def test_parts_that_moved_each_in_their_own_way_scatter() -> None:
    frames = pictures((0, 0), (0, 0), (0, 0))
    draws = np.random.default_rng(5)
    for row in range(3):
        for column in range(3):
            part = slice(row * 80, row * 80 + 80), slice(column * 86, column * 86 + 86)
            frames[1][part] = moved(frames[1][part], *draws.choice([-1.5, 1.5], 2))
    assert np.max(register(frames).std_error_pixels[1]) > 0.2
