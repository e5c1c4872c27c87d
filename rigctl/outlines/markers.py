"""Finds ArUco markers in a picture."""

import cv2
import numpy as np
from numpy.typing import NDArray

from rigctl.choices import Dictionary
from rigctl.files.regions import Marker


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
