"""Sources of a camera's direction: compass, level, positions, sun in a picture, shadow, a panel that lies level."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.pointing.camera_pose import PoseSource, camera_axes, wrapped_rad
from calibration.pointing.lens import NAMES, Lens, rays
from calibration.pointing.panel_pose import PanelStand

FloatArray = NDArray[np.float64]
_STEP = 1e-3
# Where a source says nothing its covariance has an inverse all the same.
_LEAST_RAD = 1e-6
# A ray has to fall by this share of its length to meet the ground.
_LEAST_DOWN = 1e-3
# The ellipsoid of WGS 84.
_EQUATOR_M, _ECCENTRICITY_2 = 6_378_137.0, 6.694_379_990_14e-3


@dataclass(frozen=True, kw_only=True)
class SunSeen:
    """The sun's direction as it is seen, refraction in it, and how well it is known (clock, site) [rad]."""

    azimuth_rad: float
    elevation_rad: float
    std_rad: float = 0.0

    @property
    def vector(self) -> FloatArray:
        """In east, north, up."""
        level = np.cos(self.elevation_rad)
        return np.array(
            [np.sin(self.azimuth_rad) * level, np.cos(self.azimuth_rad) * level, np.sin(self.elevation_rad)]
        )


def compass(reading_rad: float, std_rad: float, *, declination_rad: float, declination_std_rad: float) -> PoseSource:
    """Return what a compass says of the direction in which the camera looks; declination is positive to the east.

    Parameters
    ----------
    reading_rad
        Clockwise from magnetic north [rad].
    std_rad
        Its standard uncertainty, above 0 [rad].
    declination_rad, declination_std_rad
        Of the place, positive to the east, and its standard uncertainty [rad].
    """
    variance = std_rad**2 + declination_std_rad**2
    return PoseSource(
        name="compass",
        residual=lambda angles: wrapped_rad(np.array([reading_rad + declination_rad - angles[0]])),
        covariance=lambda _: np.array([[variance]]),
    )


def level(elevation_rad: float, roll_rad: float, std_rad: float) -> PoseSource:
    """Return what a level on the camera says: its elevation and roll, each to the same standard uncertainty.

    Parameters
    ----------
    elevation_rad, roll_rad
        As read [rad].
    std_rad
        Standard uncertainty of each, above 0 [rad].
    """
    return PoseSource(
        name="level",
        residual=lambda angles: wrapped_rad(np.array([elevation_rad - angles[1], roll_rad - angles[2]])),
        covariance=lambda _: std_rad**2 * np.eye(2),
    )


def way_between(camera: Sequence[float], target: Sequence[float]) -> FloatArray:
    """Return the way from one place to another nearby: east, north, up [m].

    Parameters
    ----------
    camera, target : (latitude, longitude, height)
        North and east are positive [deg, deg, m].

    References
    ----------
    Radii of curvature of the ellipsoid of WGS 84 (NIMA TR8350.2), at the middle of both; what is neglected is of the
    second order in the way over the Earth's radius.
    """
    middle = np.radians(0.5 * (camera[0] + target[0]))
    flattened = 1.0 - _ECCENTRICITY_2 * np.sin(middle) ** 2
    height = 0.5 * (camera[2] + target[2])
    by_meridian = _EQUATOR_M * (1.0 - _ECCENTRICITY_2) / flattened**1.5 + height
    by_parallel = (_EQUATOR_M / np.sqrt(flattened) + height) * np.cos(middle)
    turned = float(wrapped_rad(np.radians([target[1] - camera[1]]))[0])
    north = by_meridian * np.radians(target[0] - camera[0])
    return np.array([by_parallel * turned, north, target[2] - camera[2]])


def positions(camera_to_target_m: FloatArray, std_m: FloatArray) -> PoseSource:
    """Return what the places of camera and target say of the direction; the target is on the camera's axis.

    Parameters
    ----------
    camera_to_target_m : (3,) array
        East, north, up [m].
    std_m : (3,) array
        Its standard uncertainties [m].
    """
    east, north, up = camera_to_target_m
    flat = float(np.hypot(east, north))
    far = flat**2 + up**2
    slope = np.array(
        [
            [north / flat**2, -east / flat**2, 0.0],
            [-east * up / (flat * far), -north * up / (flat * far), flat / far],
        ]
    )
    covariance = slope @ np.diag(std_m**2) @ slope.T
    stated = np.array([np.arctan2(east, north), np.arctan2(up, flat)])
    return PoseSource(
        name="positions",
        residual=lambda angles: wrapped_rad(stated - angles[:2]),
        covariance=lambda _: covariance,
    )


def sun_in_picture(pixel: FloatArray, pixel_std: float, sun: SunSeen, lens: Lens) -> PoseSource:
    """Return what the place of the sun in a picture says: its ray beside its direction, in two angles across it.

    Parameters
    ----------
    pixel
        Place of the sun, right and down, shape (2,) [px].
    pixel_std
        Standard uncertainty of each coordinate, above 0 [px].
    sun
        Where it stood.
    lens
        Of the camera.
    """
    seen = _SeenPoints(pixel[None, :], pixel_std, lens)

    def residual(angles: FloatArray) -> FloatArray:
        return _across(seen.rays[0], camera_axes(angles) @ sun.vector)

    def covariance(angles: FloatArray) -> FloatArray:
        expected = camera_axes(angles) @ sun.vector
        return seen.covariance(lambda looks: _across(looks[0], expected)) + (sun.std_rad**2 + _LEAST_RAD**2) * np.eye(2)

    def by_lens(angles: FloatArray) -> FloatArray:
        expected = camera_axes(angles) @ sun.vector
        return seen.by_lens(lambda looks: _across(looks[0], expected))

    return PoseSource(name="sun in the picture", residual=residual, covariance=covariance, by_lens=by_lens)


def shadow(foot: FloatArray, tip: FloatArray, pixel_std: float, sun: SunSeen, lens: Lens) -> PoseSource:
    """Return what the shadow of an upright rod on level ground says: it points away from the sun.

    Parameters
    ----------
    foot, tip : (2,) arrays
        Where the shadow begins, at the rod, and where it ends [pixel].
    pixel_std : float
        Standard uncertainty of each [pixel].
    """
    seen = _SeenPoints(np.array([foot, tip]), pixel_std, lens)
    variance = (sun.std_rad / np.cos(sun.elevation_rad)) ** 2 + _LEAST_RAD**2

    def residual_of(local: FloatArray, angles: FloatArray) -> FloatArray:
        looks = local @ camera_axes(angles)
        # Below the horizon both meet the ground; above it there is none, and the residual is as large as can be.
        if looks[0, 2] > -_LEAST_DOWN or looks[1, 2] > -_LEAST_DOWN:
            return np.array([np.pi])
        ground = looks[:, :2] / -looks[:, 2:]
        east, north = ground[1] - ground[0]
        return wrapped_rad(np.array([np.arctan2(east, north) - sun.azimuth_rad - np.pi]))

    return PoseSource(
        name="shadow",
        residual=lambda angles: residual_of(seen.rays, angles),
        covariance=lambda angles: seen.covariance(lambda local: residual_of(local, angles)) + variance,
        by_lens=lambda angles: seen.by_lens(lambda local: residual_of(local, angles)),
    )


class _SeenPoints:
    """Points of a picture as rays, and those rays with each pixel and each number of the lens moved by a little."""

    def __init__(self, pixels: FloatArray, pixel_std: float, lens: Lens) -> None:
        self.rays = rays(pixels, lens)
        self._std = pixel_std
        steps = _STEP * np.eye(pixels.size).reshape(-1, *pixels.shape)
        self._by_pixel = [(rays(pixels + step, lens) - self.rays) / _STEP for step in steps]
        self._by_lens = [np.zeros_like(self.rays) for _ in NAMES]
        for place, other, step in lens.moved():
            self._by_lens[place] = (rays(pixels, other) - self.rays) / step

    def covariance(self, of: Callable[[FloatArray], FloatArray]) -> FloatArray:
        """Return the covariance of something that is computed of the rays, by the errors of the pixels."""
        slope = self._slope(of, self._by_pixel)
        return np.asarray(self._std**2 * slope @ slope.T)

    def by_lens(self, of: Callable[[FloatArray], FloatArray]) -> FloatArray:
        """Return the change of something that is computed of the rays by each number of the lens."""
        return self._slope(of, self._by_lens)

    def _slope(self, of: Callable[[FloatArray], FloatArray], moves: Sequence[FloatArray]) -> FloatArray:
        base = of(self.rays)
        return np.column_stack([wrapped_rad(of(self.rays + _STEP * move) - base) / _STEP for move in moves])


def level_panel(name: str, stand: PanelStand, tilt_std_rad: float) -> PoseSource:
    """Return what a panel says that lies level: its normal, in the camera's axes, is the vertical.

    Parameters
    ----------
    name : str
        Of the panel.
    stand : PanelStand
        How it stands before the camera.
    tilt_std_rad : float
        How level it lies, in each of two directions [rad].
    """

    def vertical(angles: FloatArray) -> FloatArray:
        return np.asarray(camera_axes(angles)[:, 2])

    def spread(angles: FloatArray) -> FloatArray:
        basis = _basis(vertical(angles))
        return basis @ stand.covariance @ basis.T + tilt_std_rad**2 * np.eye(2)

    return PoseSource(
        name=f"level panel {name}",
        residual=lambda angles: _across(stand.normal, vertical(angles)),
        covariance=spread,
        by_lens=lambda angles: np.asarray(_basis(vertical(angles)) @ stand.by_lens),
    )


def _across(seen: FloatArray, expected: FloatArray) -> FloatArray:
    """Return by how much a ray lies beside another, in two angles at right angles to it [rad]."""
    beside = _basis(expected) @ seen
    size = float(np.linalg.norm(beside))
    # The angle itself, and not its sine: beyond a right angle the sine falls again.
    angle = float(np.arctan2(size, float(expected @ seen)))
    return beside * (angle / size) if size > 0.0 else np.array([angle, 0.0])


def _basis(vector: FloatArray) -> FloatArray:
    """Return two unit vectors at right angles to one, as rows."""
    x, y, z = vector.tolist()
    # At right angles to the two largest parts, so that the length is never near 0.
    first = np.array([0.0, z, -y]) if abs(x) <= min(abs(y), abs(z)) else np.array([-z, 0.0, x])
    first = np.array([y, -x, 0.0]) if abs(z) < min(abs(x), abs(y)) else first
    first /= float(np.linalg.norm(first))
    a, b, c = first.tolist()
    return np.array([first, [y * c - z * b, z * a - x * c, x * b - y * a]])
