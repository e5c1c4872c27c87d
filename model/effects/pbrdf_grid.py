"""Reflectance of a surface over the sky, as upper limits on a grid, and sums of light over it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.scene.view import View
from model.surface.pbrdf import Surface, mueller

FloatArray = NDArray[np.float64]
# Radiance of the sky by zenith angle and angle from the sun, both of one shape [W m-2 sr-1].
RadianceOfSky = Callable[[FloatArray, FloatArray], FloatArray]

# Steps over the hemisphere in the search of the largest pBRDF.
_ZENITHS, _AZIMUTHS = 46, 31
# Digits of an angle [rad] to which views are one.
_DIGITS = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class PbrdfGrid:
    """Reflectance times cos(theta_i) over the sky for some views [sr-1].

    Attributes
    ----------
    zenith_rad, azimuth_rad
        Angles from the normal and from the plane of the view, half of it, rising.
    values
        View's angle from the normal to the most that is reflected, and the most that is polarised of it, of light of
        any polarization, shape (2, zeniths, azimuths).
    """

    zenith_rad: FloatArray
    azimuth_rad: FloatArray
    values: Mapping[float, FloatArray]

    @classmethod
    def of(cls, surface: Surface, theta_r_rad: FloatArray) -> "PbrdfGrid":
        """Return the grid with the mirror directions of views at some angles from the normal, shape (K,) [rad]."""
        grid, near = np.linspace(0.0, 0.5 * np.pi - 1e-3, _ZENITHS), surface.slope_rms * np.linspace(-3.0, 3.0, 13)
        angles = sorted({_rounded(float(angle)) for angle in theta_r_rad})
        zenith = np.concatenate([grid, *(one + near for one in angles)])
        zenith = np.unique(np.clip(zenith, 0.0, 0.5 * np.pi - 1e-6))
        azimuth = np.concatenate([np.linspace(0.0, np.pi, _AZIMUTHS), np.pi - np.abs(near)])
        azimuth = np.unique(np.clip(azimuth, 0.0, np.pi))
        weight = np.cos(zenith)[:, np.newaxis]
        matrices = {one: mueller(zenith[:, np.newaxis], one, azimuth, surface=surface) for one in angles}
        values = {one: _most_reflected(each) * weight for one, each in matrices.items()}
        return cls(zenith_rad=zenith, azimuth_rad=azimuth, values=values)

    @property
    def largest(self) -> FloatArray:
        """The largest of all, and of all that is polarised, shape (2,)."""
        return np.asarray(np.max([np.max(values, axis=(-2, -1)) for values in self.values.values()], axis=0))

    def reflected(
        self, sky: RadianceOfSky, views: tuple[View, ...], *, sun_zenith_rad: float, sun_azimuth_rad: float
    ) -> FloatArray:
        """Return the largest over views of the sum of the reflectance times a sky, all and what is polarised, (2,).

        Parameters
        ----------
        sky
            Radiance of an unpolarised or polarised sky.
        views
            At whose angles the grid was made; of a level surface.
        sun_zenith_rad, sun_azimuth_rad
            Of the sun.
        """
        zenith, found = self.zenith_rad[:, np.newaxis], []
        for angle, off_rad in {
            (_rounded(one.zenith_rad), round(sun_azimuth_rad - one.azimuth_rad, 2)) for one in views
        }:
            both_sides = np.zeros(())
            for side in (self.azimuth_rad, -self.azimuth_rad):
                toward = np.cos(zenith) * np.cos(sun_zenith_rad)
                toward = toward + np.sin(zenith) * np.sin(sun_zenith_rad) * np.cos(side - off_rad)
                scattering = np.arccos(np.clip(toward, -1.0, 1.0))
                both_sides = both_sides + sky(np.broadcast_to(zenith, scattering.shape), scattering)
            rows = _sum(self.values[angle] * both_sides, self.azimuth_rad)
            found.append(_sum(rows * np.sin(self.zenith_rad), self.zenith_rad))
        return np.asarray(np.max(found, axis=0))


def _most_reflected(mueller: FloatArray) -> FloatArray:
    """Most of S0 and of polarised light that matrices make of light of any polarization, shape (2, ...)."""
    rest = mueller[..., 1:, 1:]
    squares = np.sum(rest**2, axis=(-2, -1))
    determinant = rest[..., 0, 0] * rest[..., 1, 1] - rest[..., 0, 1] * rest[..., 1, 0]
    norm = np.sqrt(0.5 * (squares + np.sqrt(np.maximum(squares**2 - 4.0 * determinant**2, 0.0))))
    total = mueller[..., 0, 0] + np.hypot(mueller[..., 0, 1], mueller[..., 0, 2])
    return np.stack([total, np.hypot(mueller[..., 1, 0], mueller[..., 2, 0]) + norm])


def _rounded(angle_rad: float) -> float:
    """Return an angle to digits at which lobes differ by less than what the grid is multiplied by."""
    return round(angle_rad, _DIGITS)


def _sum(values: FloatArray, at: FloatArray) -> FloatArray:
    """Integral over the last axis by the trapezoidal rule."""
    return np.asarray(0.5 * np.sum((values[..., 1:] + values[..., :-1]) * np.diff(at), axis=-1))
