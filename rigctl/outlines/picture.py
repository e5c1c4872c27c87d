"""A run as one picture for the eye and for the search of markers: the mean over its angles, in 256 greys."""

import numpy as np
from numpy.typing import NDArray

from rigctl.measurement.measurement import measure
from rigctl.runs.run_folder import Run

# Shares of the pixels that may be darker than black and lighter than white.
_DARKEST, _LIGHTEST = 0.1, 99.9


def grey_picture(run: Run) -> NDArray[np.uint8]:
    """Return the mean of a run over all angles, shape (H, W), stretched to 0..255.

    Raises
    ------
    DataError
        The frames cannot give Stokes parameters.
    """
    mean = measure(run, regions=[]).channels.mean(axis=0)
    low, high = np.percentile(mean, (_DARKEST, _LIGHTEST))
    if not high > low:
        return np.zeros(mean.shape, dtype=np.uint8)
    return np.asarray(255.0 * np.clip((mean - low) / (high - low), 0.0, 1.0)).astype(np.uint8)
