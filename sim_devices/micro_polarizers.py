"""True polarizers on the pixels of a simulated sensor, in cells of 2 x 2."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_devices.exposure import RenderingEffect, Shot, refuse_outside

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class MicroPolarizers:
    """True axes of a cell, with errors.

    Parameters
    ----------
    cell_deg
        Axes row by row, counter-clockwise from horizontal as the camera sees the scene.
    place_error_deg
        Standard deviation of the error at each place of the cell, equal in all cells, >= 0.
    pixel_error_deg
        Standard deviation of the error of each pixel, >= 0.
    crosstalk
        Share of a pixel's light that each of its four neighbours gets, 0 to 0.2.

    Raises
    ------
    ValueError
        If a value is outside of its range.
    """

    cell_deg: tuple[float, ...] = (90.0, 45.0, 135.0, 0.0)
    place_error_deg: float = 0.0
    pixel_error_deg: float = 0.0
    crosstalk: float = 0.0

    def __post_init__(self) -> None:
        if len(self.cell_deg) != 4 or not np.all(np.isfinite(self.cell_deg)):
            raise ValueError(f"cell is {self.cell_deg}; four angles are needed")
        refuse_outside("angle_error_deg", self.place_error_deg, least=0.0, most=45.0)
        refuse_outside("pixel_error_deg", self.pixel_error_deg, least=0.0, most=45.0)
        refuse_outside("crosstalk", self.crosstalk, least=0.0, most=0.2)

    def axes_deg(self, shape: tuple[int, int], *, generator: np.random.Generator) -> FloatArray:
        """Return the axis on each pixel of a picture of (height, width) [deg]."""
        of_places, of_pixels = generator.spawn(2)
        cell = np.array(self.cell_deg) + self.place_error_deg * of_places.standard_normal(4)
        axes = np.tile(cell.reshape(2, 2), (shape[0] // 2 + 1, shape[1] // 2 + 1))[: shape[0], : shape[1]]
        return np.asarray(axes + self.pixel_error_deg * of_pixels.standard_normal(shape))


def crosstalk(share: float) -> RenderingEffect:
    """Return light with leakage to the four neighbours, mirrored at the rim."""

    def act(picture: FloatArray, _: Shot) -> FloatArray:
        padded = np.pad(picture, 1, mode="edge")
        around = padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:]
        return np.asarray((1.0 - 4.0 * share) * picture + share * around)

    return RenderingEffect(name="crosstalk", place="light", act=act)
