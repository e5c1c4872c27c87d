"""Path between the ground and a sensor at a height: transmittance, and light scattered into the line of sight."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.atmosphere.lighting.diffuse_light import DiffuseLight
from model.atmosphere.transfer.depth import slant


def path_transmittance(*, tau_below: ArrayLike, mu: ArrayLike) -> NDArray[np.float64]:
    """Transmittance from the ground to a sensor.

    Parameters
    ----------
    tau_below
        Optical depth between the ground and the sensor, 0 or more.
    mu
        Cosine of the view zenith angle, 0 to 1.

    References
    ----------
    [MK14] eq. (4): the transmittance tau of direct and of diffuse reflected light.
    """
    return np.exp(-slant(np.asarray(tau_below, dtype=float), np.asarray(mu, dtype=float)))


def path_radiance(
    solution: DiffuseLight, *, tau_above: ArrayLike, mu: ArrayLike, phi_rad: ArrayLike
) -> NDArray[np.float64]:
    """Stokes radiance that the air below a sensor adds over a black target, per unit beam irradiance [sr-1].

    Parameters
    ----------
    solution
        The solved atmosphere; the albedo of its ground is that of the target's surroundings.
    tau_above
        Optical depth above the sensor.
    mu
        Cosine of the view zenith angle, 0 to 1.
    phi_rad
        Azimuth of the sun minus azimuth of the sensor as seen from the target [rad].

    Returns
    -------
    ndarray, shape (..., 3)
        S0, S1, S2.

    References
    ----------
    [MK14] eq. (4): the upwelled radiance; with light from the surroundings scattered into the line of sight.
    """
    tau = np.asarray(tau_above, dtype=float)
    stokes = solution.stokes(tau, mu, phi_rad, looking="down")
    below = np.maximum(solution.depth - tau, 0.0)
    stokes[..., 0] -= solution.ground_radiance * path_transmittance(tau_below=below, mu=mu)
    return stokes
