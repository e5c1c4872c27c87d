"""Imperfections of a session: angles that miss, pictures that shift, light that drifts, and what lies around."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Imperfections:
    """Imperfections that a session adds to a scene; by default there are none.

    Parameters
    ----------
    polarizer_angle_std_rad
        Standard deviation of the polarizer's true angle about the recorded one, normal and independent from frame to
        frame [rad], 0 to 0.5.
    misregistration_pixels
        Standard deviation of the shift of the picture from frame to frame along each axis, normal and independent
        [pixels], >= 0.
    texture_correlation_pixels
        Distance at which the correlation of the texture has fallen to exp(-1/2) [pixels], > 0.
    drift
        Change of the light from the first frame of a cycle to the last, linear in time, over its mean; -1 to 1.
    drift_order
        Place in time of each angle's frame in the cycle, from 0; empty: in the order of the angles.
    surround_albedo
        Of the ground around, as far as the air mixes it in, where it is not the mean ground's, 0 to 1; or None.
    off_axis_falloff
        Whether light falls as the fourth power of the cosine over a region's part of the field, as without flat field.

    Raises
    ------
    ValueError
        If a value is outside its range.
    """

    polarizer_angle_std_rad: float = 0.0
    misregistration_pixels: float = 0.0
    texture_correlation_pixels: float = 1.0
    drift: float = 0.0
    drift_order: tuple[int, ...] = ()
    surround_albedo: float | None = None
    off_axis_falloff: bool = False

    def __post_init__(self) -> None:
        _require("polarizer_angle_std_rad", self.polarizer_angle_std_rad, 0.0, 0.5, "rad")
        _require("misregistration_pixels", self.misregistration_pixels, 0.0, 1e6, "pixels")
        _require("texture_correlation_pixels", self.texture_correlation_pixels, 1e-6, 1e6, "pixels")
        _require("drift", self.drift, -1.0, 1.0, "")
        if self.surround_albedo is not None:
            _require("surround_albedo", self.surround_albedo, 0.0, 1.0, "")

    @property
    def kept_polarization(self) -> float:
        """Factor exp(-2 s^2) by which angles that scatter by s weaken the mean of cos 2 psi."""
        return float(np.exp(-2.0 * self.polarizer_angle_std_rad**2))

    @property
    def kept_correlation(self) -> float:
        """Correlation of texture between two frames of which each is shifted on its own.

        Notes
        -----
        The texture's autocorrelation is exp(-r^2 / 2 l^2); the difference of two shifts of deviation d has 2 d^2 along
        each axis, and the mean of the autocorrelation over it is 1 / (1 + 2 d^2 / l^2).
        """
        ratio = self.misregistration_pixels / self.texture_correlation_pixels
        return 1.0 / (1.0 + 2.0 * ratio**2)

    def analyzed(self, rows: FloatArray) -> FloatArray:
        """Return the rows by which an analyzer takes Stokes vectors, as the frames of this session have them.

        What weakens or adds to the mean light of a frame acts here.

        Parameters
        ----------
        rows
            Of the analyzer at each angle's frame, shape (N, 3).
        """
        factors = self.light_factors(len(rows))[:, None] if self.drift else 1.0
        kept = np.array([1.0, self.kept_polarization, self.kept_polarization])
        return np.asarray(rows * kept * factors)

    def light_factors(self, frames: int) -> FloatArray:
        """Return the light of each angle's frame over the mean of the cycle, shape (N,).

        Raises
        ------
        ValueError
            The order does not fit the number of frames.
        """
        order = self.drift_order or tuple(range(frames))
        if sorted(order) != list(range(frames)):
            raise ValueError(f"drift_order = {order}; allowed is each of 0 to {frames - 1} once")
        return drifting_light(self.drift, order)


def drifting_light(drift: float, order: ArrayLike) -> FloatArray:
    """Return the light of each frame over its mean, where it drifts evenly through a cycle.

    Parameters
    ----------
    drift
        Relative change from the first frame of a cycle to the last, above -2 and below 2.
    order
        Place of each angle's frame in the cycle, from 0, shape (N,), N >= 2.
    """
    places = np.asarray(order, dtype=np.float64)
    return np.asarray(1.0 + drift * (places / (places.size - 1) - 0.5))


def angle_variance(second_moment: FloatArray, *, angles_rad: FloatArray, std_rad: float) -> FloatArray:
    """Return the variance of S1 cos 2 psi + S2 sin 2 psi where psi is normal about each angle.

    Parameters
    ----------
    second_moment
        Second moments of the Stokes vector, mean mean' + covariance, shape (..., 3, 3).
    angles_rad
        Mean angles, shape (N,) [rad].
    std_rad
        Standard deviation of each [rad], >= 0.

    Returns
    -------
    ndarray
        Shape (..., N), within-vector variance averaged over the vectors.

    Notes
    -----
    With u the value at the mean angle, w that 45 deg on, and q = exp(-8 s^2):
    u^2 (1 - sqrt q)^2 / 2 + w^2 (1 - q) / 2. For small s it is (2 s w)^2.

    References
    ----------
    Definition: moments of cos and sin of a normal angle.
    """
    # expm1 keeps the digits of a small scatter.
    lost, crossed = -np.expm1(-4.0 * std_rad**2), -np.expm1(-8.0 * std_rad**2)
    cosine, sine = np.cos(2.0 * angles_rad), np.sin(2.0 * angles_rad)
    at, across = np.stack([cosine, sine], axis=-1), np.stack([-sine, cosine], axis=-1)
    polarised = second_moment[..., 1:, 1:]
    u2, w2 = (np.einsum("ni,...ij,nj->...n", rows, polarised, rows) for rows in (at, across))
    return np.asarray(0.5 * u2 * lost**2 + 0.5 * w2 * crossed)


def _require(name: str, value: float, least: float, most: float, unit: str) -> None:
    if not (least <= value <= most and np.isfinite(value)):
        raise ValueError(
            f"{name} = {value} {unit}; allowed is {least:g} to {most:g} {unit}".replace(" ;", ";").rstrip()
        )


PERFECT = Imperfections()
