"""The sun of a scene in one line of words."""

import numpy as np

from rigctl.numbers.angles import wrapped
from rigctl.scene.model_records import camera_view, sun_azimuth_rad
from rigctl.scene.scene_record import Scene


def sun_text(scene: Scene, *, time: str | None = None) -> str:
    """Return zenith angle and azimuth of the sun, phi (the sun's azimuth minus the camera's), and when that is.

    Parameters
    ----------
    scene : Scene
        With sun and camera.
    time : str or None
        When, in words.
    """
    if scene.sun is None or scene.geometry is None:
        return "none"
    azimuth = scene.sun.azimuth_deg
    apart_deg = float(np.rad2deg(sun_azimuth_rad(scene) - camera_view(scene).azimuth_rad))
    # In (-180, 180], to the digits that are shown: 180 is where the camera looks toward the sun's side.
    phi_deg = -float(wrapped(-round(apart_deg, 2), turn=360.0))
    parts = (
        f"zenith {scene.sun.zenith_deg.value:.2f} deg",
        "azimuth not stated" if azimuth is None else f"azimuth {azimuth.value:.2f} deg",
        f"phi {phi_deg:.2f} deg",
        *(() if time is None else (time,)),
    )
    return ", ".join(parts)
