"""Frames divided by the flat field of their polarizer angle, and what that does to noise."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.calibrations.flat.flat_file import FlatFields
from rigctl.files.regions import Region, masks
from rigctl.measurement.frame_grid import FrameGrid

FloatArray = NDArray[np.float64]

# A pixel that answers with less than this share of the others says nothing of the scene.
_DEAD = 0.1
# A region this far from the mean of the flat field has another noise than is predicted.
_UNLIKE = 0.05


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


def flat_division(grid: FrameGrid, flats: FlatFields) -> FlatDivision:
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


def flat_remarks(flat: FlatDivision, regions: list[Region]) -> Iterable[str]:
    """Return what dividing by flat fields does to the prediction of each region, where it is worth a word."""
    for name, inside in masks(regions, width=flat.dead.shape[1], height=flat.dead.shape[0]).items():
        response = float(flat.response[:, inside].mean())
        if abs(response - 1.0) > _UNLIKE:
            yield (
                f"{name}: the flat field is {response:.2f} of its mean there; its noise is predicted as for 1, "
                f"{'smaller' if response < 1.0 else 'larger'} than it is by {abs(response**-0.5 - 1.0):.0%}"
            )
    worst = float(flat.error.max())
    yield f"frames were divided by flat fields, whose own error adds a pattern of up to {worst:.2%} to single pixels"
