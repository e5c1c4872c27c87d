"""Protocol of a sky, computed, sampled or made up."""

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


class Sky(Protocol):
    """Stokes radiance of the sky by direction; `model.atmosphere.lighting.lighting.Lighting.sky` is one."""

    def __call__(self, *, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> FloatArray:
        """Return S0, S1, S2 in the frame of each direction's own azimuth, shape (..., 3) [W m-2 sr-1]."""
        ...
