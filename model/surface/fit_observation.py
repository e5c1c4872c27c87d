"""Observations for a fit of a surface's parameters: regions, their light and their measured Stokes radiance."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.surface.angle_checks import checked_azimuth, checked_zenith

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Observation:
    """Stokes radiance of one region in one geometry, and the light that fell on it.

    Parameters
    ----------
    theta_i_rad, phi_rad
        Zenith angles and relative azimuths of the sources (the sun, and points of the sky), shape (J,) [rad].
    theta_r_rad
        Zenith angle of the camera [rad].
    irradiance
        Stokes irradiance that each source gives on the surface, cosine included, in the source's own axes,
        shape (J, 3) [W m-2, or a unit of its own].
    stokes
        Measured Stokes radiance at the surface, shape (3,) [the same unit per sr]: path radiance taken off,
        transmittance divided out.
    covariance
        Of `stokes`, shape (3, 3), positive definite.
    scale
        Name of an unknown factor on `stokes`, such as that of counts; observations of one name share it and the fit
        finds it. None: `stokes` and `irradiance` have the same unit.

    Raises
    ------
    ValueError
        If shapes do not fit, a value is not finite or an angle outside its range, or the covariance is not
        positive definite.
    """

    theta_i_rad: ArrayLike
    phi_rad: ArrayLike
    theta_r_rad: float
    irradiance: ArrayLike
    stokes: ArrayLike
    covariance: ArrayLike
    scale: str | None = None

    def __post_init__(self) -> None:
        checked_zenith("theta_r_rad", self.theta_r_rad)
        theta, phi = checked_zenith("theta_i_rad", self.theta_i_rad), checked_azimuth("phi_rad", self.phi_rad)
        if theta.ndim != 1 or theta.size == 0 or phi.shape != theta.shape:
            raise ValueError(
                f"theta_i_rad has shape {theta.shape}, phi_rad {phi.shape}; allowed is (J,) for both, J > 0"
            )
        _require_finite("irradiance", self.irradiance, (theta.size, 3))
        _require_finite("stokes", self.stokes, (3,))
        _require_finite("covariance", self.covariance, (3, 3))
        whitening_matrix(self.covariance)


def sunlit(
    *,
    theta_i_rad: float,
    theta_r_rad: float,
    phi_rad: float,
    irradiance: float,
    stokes: ArrayLike,
    covariance: ArrayLike,
    scale: str | None = None,
) -> Observation:
    """Return the observation of a region in unpolarised sunlight alone.

    Parameters
    ----------
    theta_i_rad, theta_r_rad, phi_rad
        As in `model.surface.pbrdf.mueller` [rad].
    irradiance
        Of the sun on the surface, cosine included.
    stokes, covariance, scale
        As in `Observation`.

    Returns
    -------
    Observation
        With one source.

    Raises
    ------
    ValueError
        As `Observation`.
    """
    return Observation(
        theta_i_rad=[theta_i_rad],
        phi_rad=[phi_rad],
        theta_r_rad=theta_r_rad,
        irradiance=[[irradiance, 0.0, 0.0]],
        stokes=stokes,
        covariance=covariance,
        scale=scale,
    )


def whitening_matrix(covariance: ArrayLike) -> FloatArray:
    """Return W with W C W' = 1.

    Parameters
    ----------
    covariance
        C, shape (3, 3), symmetric and positive definite.

    Returns
    -------
    ndarray
        Shape (3, 3), inverse of the Cholesky factor.

    Raises
    ------
    ValueError
        If C is not symmetric or not positive definite.
    """
    matrix = np.asarray(covariance, dtype=np.float64)
    if np.max(np.abs(matrix - matrix.T)) > 1e-12 * np.max(np.abs(matrix)):
        raise ValueError("covariance is not symmetric")
    try:
        return np.asarray(np.linalg.inv(np.linalg.cholesky(matrix)))
    except np.linalg.LinAlgError as error:
        raise ValueError(
            f"covariance is not positive definite (eigenvalues {np.linalg.eigvalsh(matrix)}); each of S0, S1, S2 "
            "needs an uncertainty of its own"
        ) from error


def _require_finite(name: str, value: ArrayLike, shape: tuple[int, ...]) -> None:
    array = np.asarray(value, dtype=np.float64)
    if array.shape != shape:
        raise ValueError(f"{name} has shape {array.shape}; allowed is {shape}")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{name} has {np.sum(~np.isfinite(array))} values that are not finite")
