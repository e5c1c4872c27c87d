"""A picture that is there already, seen on a page as a live one is."""

import cv2
import numpy as np
from numpy.typing import NDArray

from rigctl.web.live_look import LiveLook
from rigctl.web.live_rig import VIEW
from rigctl.web.pictures import Picture

_QUALITY = 90


class StillPicture:
    """One picture, whole, as `rigctl.web.hands.View` asks for it.

    Parameters
    ----------
    grey : (H, W) array of uint8
        The picture as it is shown.
    """

    def __init__(self, grey: NDArray[np.uint8]) -> None:
        self._picture = Picture(jpeg=cv2.imencode(".jpg", grey, (cv2.IMWRITE_JPEG_QUALITY, _QUALITY))[1].tobytes())
        self._look = LiveLook(sequence=1, width=grey.shape[1], height=grey.shape[0])

    def look(self) -> LiveLook:
        """Return its size."""
        return self._look

    def newest_sequence(self, name: str) -> int | None:
        """Return 1 for the view, None for any other name."""
        return self._look.sequence if name == VIEW else None

    def picture(self, name: str, *, zebra: bool = True, dolp_top: float = 1.0) -> Picture | None:
        """Return the view, None for any other name; saturation is not known of it."""
        return self._picture if name == VIEW else None
