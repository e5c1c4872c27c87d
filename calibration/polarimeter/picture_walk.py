"""The walk of the picture as the polarizer turns, and pictures moved back by it: what that does to their noise."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Wander:
    """The shifts as a function of the stage angle: centre + turning vector.

    Attributes
    ----------
    centre_pixels, turning_pixels : complex
        shift = centre + turning * exp(i sense stage angle), x in the real part, y (down) in the imaginary.
    sense : {1, -1}
        Which way the picture walks on its circle.
    residual_pixels : float
        Root mean square of what is left, per axis; 0 where there is no freedom left.
    """

    centre_pixels: complex
    turning_pixels: complex
    sense: int
    residual_pixels: float

    def shift_pixels(self, stage_rad: float, *, against_rad: float) -> FloatArray:
        """Return the shift (x, y) of the picture at one stage angle against that at another."""
        ends = np.exp(1j * self.sense * np.array([stage_rad, against_rad]))
        moved = self.turning_pixels * (ends[0] - ends[1])
        return np.array([moved.real, moved.imag])


def fit_wander(stage_rad: FloatArray, shift_pixels: FloatArray, *, sense: int = 1) -> Wander:
    """Return the circle on which the picture walks while a wedge turns with the polarizer.

    Parameters
    ----------
    stage_rad : (N,) array
        Stage angles, two different ones or more [rad].
    shift_pixels : (N, 2) array
        Shifts against the first angle.
    sense : {1, -1}
        Of the walk: +1 if it turns as the stage angle does in a picture with y down.

    Raises
    ------
    CalibrationError
        The stage angles are all the same.

    Notes
    -----
    The wrong sense makes the residual large.
    """
    design = np.column_stack([np.ones(len(stage_rad)), np.exp(1j * sense * stage_rad)])
    if np.linalg.matrix_rank(design) < 2:
        raise CalibrationError("all stage angles are the same; the walk of the picture needs two or more")
    shifts = shift_pixels[:, 0] + 1j * shift_pixels[:, 1]
    terms = np.linalg.pinv(design) @ shifts
    freedom = 2 * (len(shifts) - 2)
    residual = shifts - design @ terms
    square = float(np.sum(np.abs(residual) ** 2)) / freedom if freedom else 0.0
    return Wander(
        centre_pixels=complex(terms[0]), turning_pixels=complex(terms[1]), sense=sense, residual_pixels=square**0.5
    )


def moved_back(picture: FloatArray, shift_pixels: FloatArray) -> tuple[FloatArray, float]:
    """Return a picture moved back by a shift, and the factor by which that makes its pixels' variance smaller.

    Parameters
    ----------
    picture : (H, W) array
        Counts, dark taken off.
    shift_pixels : (2,) array
        Its shift (x, y) against the picture that it is to lie on.

    Notes
    -----
    Bilinear. Each new pixel is a mean of up to four, so that white noise falls (to a quarter at half a pixel both ways)
    and neighbours share it. Next to the border the picture is mirrored; mask as many pixels as the shift has.
    """
    part_x, part_y = shift_pixels - np.floor(shift_pixels)
    factor = ((1.0 - part_x) ** 2 + part_x**2) * ((1.0 - part_y) ** 2 + part_y**2)
    height, width = picture.shape
    rows, columns = np.arange(height) + shift_pixels[1], np.arange(width) + shift_pixels[0]
    return _bilinear(picture, rows, columns), float(factor)


def _bilinear(picture: FloatArray, rows: FloatArray, columns: FloatArray) -> FloatArray:
    # OpenCV rounds a shift to 1/32 pixel when it interpolates; this does not.
    moved = picture
    for axis, places in ((0, rows), (1, columns)):
        lower = np.floor(places).astype(np.int64)
        part = (places - lower).reshape((-1, 1) if axis == 0 else (1, -1))
        size = picture.shape[axis]
        below, above = (np.take(moved, _mirrored(lower + step, size), axis=axis) for step in (0, 1))
        moved = (1.0 - part) * below + part * above
    return moved


def _mirrored(index: NDArray[np.int64], size: int) -> NDArray[np.int64]:
    folded = np.abs(index) % (2 * size - 2)
    mirrored: NDArray[np.int64] = np.minimum(folded, 2 * size - 2 - folded)
    return mirrored
