"""Limits of the geometry: where a plane-parallel atmosphere and few tiles of a wide field are poor, and by how much."""

from collections.abc import Iterable
from math import cos, hypot, radians, sqrt

from rigctl.files.place import GeometrySection
from rigctl.files.scene_file import SceneFile
from rigctl.numbers.number_text import percent

# As far as a plane-parallel atmosphere is taken for the sun without remark.
_PLANE_TO_DEG = 85.0
_EARTH_RADIUS_M = 6.371e6
# A field so wide, corner to corner, may come near the horizon, where light is not smooth over few tiles.
_WIDE_DEG = 90.0


def geometry_remarks(scene: SceneFile) -> Iterable[str]:
    """Return where the geometry of a scene goes beyond what the model holds for, and by how much that is off.

    Parameters
    ----------
    scene : SceneFile
        Its view and its field of view count where a region is given by its material.
    """
    if not scene.has_materials:
        return
    if scene.geometry is not None and _PLANE_TO_DEG < scene.geometry.camera_zenith_deg.value < 90.0:
        yield _of_view(scene.geometry)
    field = scene.field_of_view
    if field is not None and field.width_deg is not None and field.height_deg is not None:
        width, height = field.width_deg.value, field.height_deg.value
        if hypot(width, height) > _WIDE_DEG:
            yield (
                f"field of view {width:g} x {height:g} deg: {field.tiles_per_side} x {field.tiles_per_side} tiles are "
                "few where it comes near the horizon; --tolerance chooses them, and says what cannot be promised"
            )


def slant_path_m(*, height_m: float, zenith_rad: float) -> float:
    """Return the way from the ground to a height over a round earth, without refraction [m].

    Parameters
    ----------
    height_m
        Above the ground [m], 0 or more.
    zenith_rad
        Of the direction at the ground [rad], 0 to pi/2.

    References
    ----------
    Definition: law of cosines in the triangle with the earth's centre.
    """
    along = _EARTH_RADIUS_M * cos(zenith_rad)
    beyond = height_m * (2.0 * _EARTH_RADIUS_M + height_m)
    # The difference of two long ways, without its loss of digits.
    return beyond / (sqrt(along**2 + beyond) + along) if height_m > 0.0 else 0.0


def _of_view(geometry: GeometrySection) -> str:
    zenith_deg, height_m = geometry.camera_zenith_deg.value, geometry.camera_height_m.value
    zenith_rad = radians(zenith_deg)
    if height_m == 0.0:
        return (
            f"camera zenith {zenith_deg:g} deg: above {_PLANE_TO_DEG:g} deg light of the sky that is "
            "reflected comes from near the horizon, where a plane-parallel atmosphere is wrong"
        )
    plane_m, round_m = height_m / cos(zenith_rad), slant_path_m(height_m=height_m, zenith_rad=zenith_rad)
    return (
        f"camera zenith {zenith_deg:g} deg: above {_PLANE_TO_DEG:g} deg a plane-parallel atmosphere is "
        f"wrong; it takes {plane_m / 1000.0:.3g} km of air to the camera, over a round earth they are "
        f"{round_m / 1000.0:.3g} km ({percent(plane_m / round_m - 1.0)} too long)"
    )
