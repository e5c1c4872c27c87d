"""Heights at which the air is cut in layers."""

import numpy as np
from numpy.typing import NDArray

_FINE_M = 1e3 * np.concatenate(
    [
        np.arange(0, 2, 0.2),
        np.arange(2, 10, 0.25),
        np.arange(10, 20, 0.5),
        np.arange(20, 30, 1),
        [30, 32.5, 35, 40, 50, 70, 100],
    ]
)
_COARSE_M = 1e3 * np.array([0, 0.5, 1, 1.5, 2, 3, 4, 5, 7, 9, 12, 16, 20, 25, 35, 100])
# From a face near the ground each layer is at most so many times as high as the one below.
_GROWTH = 4.0


def face_heights_m(*, fine: bool, cuts: int, face_m: float) -> NDArray[np.float64]:
    """Return the heights of the layers' faces, increasing from the ground, shape (K + 1,) [m].

    Parameters
    ----------
    fine
        78 layers, or 15; 2 km is a face of both.
    cuts
        Into how many parts of equal height each of them is cut, 1 or more.
    face_m
        Height of one more face before they are cut, and if that is near the ground of some between it and the next
        [m]; on the ground or above the air for none.
    """
    faces = _with_face(_FINE_M if fine else _COARSE_M, face_m)
    return np.interp(np.arange((faces.size - 1) * cuts + 1) / cuts, np.arange(faces.size), faces)


def _with_face(heights_m: NDArray[np.float64], face_m: float) -> NDArray[np.float64]:
    if not 0.0 < face_m < heights_m[-1]:
        return heights_m
    faces = [face_m]
    while faces[-1] * _GROWTH < heights_m[1]:
        faces.append(faces[-1] * _GROWTH)
    return np.union1d(heights_m, faces)
