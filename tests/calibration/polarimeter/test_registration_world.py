"""Registration of pictures as people have them: with borders and clipped pixels, and with what is no plain shift."""

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.polarimeter.registration import register
from tests.worldlike import Faults, World, expose

WORLD = World(height=200, width=220, texture=0.15, texture_pixels=2.0)


def frames(faults: Faults) -> NDArray[np.float64]:
    return expose(WORLD, faults, np.random.default_rng(21)).astype(np.float64)


def test_a_border_that_is_masked_makes_no_shift() -> None:
    pictures = frames(Faults())
    moved = np.array([cv2.warpAffine(one, np.array([[1.0, 0, 0], [0, 1.0, 0]]), one.shape[::-1]) for one in pictures])
    usable = np.ones(moved.shape[1:], dtype=bool)
    moved[1, :9], moved[2, :, -7:] = 0.0, 0.0
    usable[:9], usable[:, -7:] = False, False
    assert np.max(np.abs(register(moved, usable).shift_pixels)) < 0.1


def test_a_plain_shift_lets_the_edges_of_other_tiles_fall_on_one_another() -> None:
    found = register(frames(Faults(shift_pixels={2: (1.4, -0.9)})))
    np.testing.assert_allclose(found.shift_pixels[2], [1.4, -0.9], atol=0.1)
    assert found.is_plain(2)
    before, after = found.edge_residual[2]
    assert after < before


def test_a_picture_of_something_else_is_no_plain_shift() -> None:
    pictures = frames(Faults())
    draws = np.random.default_rng(5)
    # One picture whose parts moved each in their own way.
    for row in range(3):
        for column in range(3):
            part = slice(row * 66, row * 66 + 66), slice(column * 73, column * 73 + 73)
            dx, dy = draws.choice([-1.5, 1.5], 2)
            motion = np.array([[1.0, 0.0, dx], [0.0, 1.0, dy]])
            piece = pictures[1][part]
            pictures[1][part] = cv2.warpAffine(piece, motion, piece.shape[::-1], borderMode=cv2.BORDER_REFLECT)
    found = register(pictures)
    assert np.max(found.std_error_pixels[1]) > 0.2
