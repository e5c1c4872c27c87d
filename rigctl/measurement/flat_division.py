"""Frames divided by the flat field of their polarizer angle, and what that does to noise."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.measurement.frame_grid import FrameGrid
from rigctl.polarimeter.flat_file import Flats

FloatArray = NDArray[np.float64]

# A pixel that answers with less than this share of the others says nothing of the scene.
_DEAD = 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class FlatDivision:
    """The flat field of each channel.

    Attributes
    ----------
    response : (N, H, W) array
        What frames are divided by, mean 1; 1 where a pixel is dead.
    dead : (H, W) array of bool
        Pixels that hardly answer to light.
    variance_factor : (N,) array
        What the division makes of the variance of noise, mean over the pixels.
    error : (N,) array
        Standard deviation over the pixels of the flat field's own error, relative.
    """

    response: FloatArray
    dead: NDArray[np.bool_]
    variance_factor: FloatArray
    error: FloatArray

    def divided(self, signal: FloatArray, channel: int) -> FloatArray:
        """Return a frame of a channel, dark level off, over its flat field."""
        return np.asarray(signal / self.response[channel])


def flat_division(grid: FrameGrid, flats: Flats) -> FlatDivision:
    """Return what the frames of a run are to be divided by.

    Raises
    ------
    DataError
        An angle of the run has no flat field.
    """
    places = [flats.place(angle_deg) for angle_deg in np.degrees(grid.polarizer_angles_rad)]
    response, errors = flats.response[places], flats.std_error[places]
    dead = np.any(response < _DEAD, axis=0)
    response = np.where(dead, 1.0, response)
    alive = ~dead
    return FlatDivision(
        response=response,
        dead=dead,
        variance_factor=np.mean(response[:, alive] ** -2.0, axis=1),
        error=np.sqrt(np.mean(np.square(errors[:, alive] / response[:, alive]), axis=1)),
    )
