"""Position of a camera, as seen from its target."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class View:
    """Position of a camera as seen from its target, and how it is held.

    Attributes
    ----------
    zenith_rad
        Angle from up of the direction to the camera [rad], 0 (overhead) to below pi/2.
    azimuth_rad
        Of that direction, clockwise from north [rad]. Overhead it says how the horizontal axis lies.
    roll_rad
        Angle by which the camera's horizontal is turned counter-clockwise from the true horizontal, as the camera
        sees the scene [rad].
    height_m
        Of the camera over the ground [m], 0 or more; 0 is a camera with no air before it.

    Raises
    ------
    ValueError
        If a value is outside its range.
    """

    zenith_rad: float
    azimuth_rad: float
    roll_rad: float = 0.0
    height_m: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.zenith_rad < 0.5 * np.pi:
            raise ValueError(
                f"camera zenith = {np.degrees(self.zenith_rad):.6g} deg; allowed is 0 (overhead) to below 90 deg"
            )
        for name, angle in (("azimuth", self.azimuth_rad), ("roll", self.roll_rad)):
            if not np.isfinite(angle):
                raise ValueError(f"camera {name} = {angle} rad; allowed are finite angles")
        if not 0.0 <= self.height_m < np.inf:
            raise ValueError(f"camera height = {self.height_m} m; allowed is 0 or more")
