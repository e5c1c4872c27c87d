"""ArUco markers in the picture of a run."""

import cv2
import numpy as np
from numpy.typing import NDArray

from rigctl.files.choices import Dictionary
from rigctl.files.regions import Marker
from rigctl.measurement.measurement import measure
from rigctl.runs.run_folder import Run

# Shares of the pixels that may be darker than black and lighter than white.
_DARKEST, _LIGHTEST = 0.1, 99.9


def search_markers(picture: NDArray[np.uint8], dictionary: Dictionary) -> list[Marker]:
    """Return the markers of a dictionary that a picture shows, by their number.

    Parameters
    ----------
    picture : (H, W) array
        Greys.
    dictionary : Dictionary
        Which family of markers was printed.

    Returns
    -------
    list of Marker
        Corners to a fraction of a pixel, (0, 0) being the centre of the top left pixel. A marker that is seen twice
        is left out: it would be unknown which one is meant.
    """
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    family = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{dictionary.upper()}"))
    corners, ids, _ = cv2.aruco.ArucoDetector(family, parameters).detectMarkers(picture)
    numbers = [] if ids is None else [int(number) for number in np.ravel(ids)]
    return sorted(
        (
            Marker(id=number, corners=[(float(x), float(y)) for x, y in np.reshape(four, (4, 2))])
            for number, four in zip(numbers, corners, strict=True)
            if numbers.count(number) == 1
        ),
        key=lambda marker: marker.id,
    )


def grey_picture(run: Run) -> NDArray[np.uint8]:
    """Return the mean of a run over all angles, shape (H, W), stretched to 0..255.

    Raises
    ------
    DataError
        The frames cannot give Stokes parameters.
    """
    return stretched(measure(run, regions=[]).channels.mean(axis=0))


def stretched(picture: NDArray[np.float64] | NDArray[np.uint16]) -> NDArray[np.uint8]:
    """Return a picture in greys from black to white, shape (H, W)."""
    low, high = np.percentile(picture, (_DARKEST, _LIGHTEST))
    if not high > low:
        return np.zeros(picture.shape, dtype=np.uint8)
    return np.asarray(255.0 * np.clip((picture - low) / (high - low), 0.0, 1.0)).astype(np.uint8)
