"""Between which numbers each input of a prediction has to stay."""

import numpy as np
from numpy.typing import NDArray

from rigctl.files.light_sections import FIELD_MOST_DEG, HUMIDITY_MOST
from rigctl.scene.scene_inputs import Inputs

# Of a share, whatever it is a share of, there is no more than all.
_SHARES = (
    "optics_transmittance",
    "quantum_efficiency",
    "polarizer_transmittance",
    "ground_albedo",
    "surround_albedo",
    "dolp_max",
    "share",
)
_LARGEST = {"relative_humidity": HUMIDITY_MOST, "width_deg": FIELD_MOST_DEG, "height_deg": FIELD_MOST_DEG}
# An ideal polarizer has no largest extinction ratio, and none below 1.
_RATIO = "extinction_ratio"
# Just above the horizon.
_LOWEST_DEG = 89.0


def largest(inputs: Inputs) -> NDArray[np.float64]:
    """Return the largest value that each input may take; infinity where there is none."""
    return np.array([_largest(name.rpartition(".")[2]) for name in inputs.names])


def smallest(inputs: Inputs) -> NDArray[np.float64]:
    """Return the smallest value that each input may take; minus infinity where there is none."""
    ratios = np.array([name.endswith(_RATIO) for name in inputs.names])
    return np.where(ratios, np.maximum(inputs.least, 1.0), inputs.least)


def _largest(last: str) -> float:
    if last in _SHARES:
        return 1.0
    if last in _LARGEST:
        return _LARGEST[last]
    return _LOWEST_DEG if last in ("zenith_deg", "camera_zenith_deg") else np.inf
