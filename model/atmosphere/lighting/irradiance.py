"""Irradiance of the ground by a sky, summed over directions."""

from math import pi

import numpy as np

from model.atmosphere.lighting.diffuse_light import DiffuseLight
from model.atmosphere.transfer.transport import gauss_nodes

_NODES, _AZIMUTHS = 12, 36  # within 1e-3 for a forward peak of the aerosol that an expansion to MATRIX_DEGREE holds
MATRIX_DEGREE = 17


def sky_irradiance(light: DiffuseLight) -> float:
    """Downward diffuse irradiance at the ground, per unit beam irradiance.

    Parameters
    ----------
    light
        A sky without a sharp aureole (see `model.atmosphere.transfer.delta_m_truncation.with_truncated_matrix`).

    References
    ----------
    definition
    """
    mu, weights = gauss_nodes(_NODES)
    phi_rad = 2.0 * pi * np.arange(_AZIMUTHS) / _AZIMUTHS
    sky = light.stokes(light.depth, mu, phi_rad[:, np.newaxis], looking="up")
    return 2.0 * pi * float(np.mean(sky[..., 0], axis=0) @ (weights * mu))
