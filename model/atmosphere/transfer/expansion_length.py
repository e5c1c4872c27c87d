"""Length of the expansion of the scattering matrices, its blocks of azimuth modes, and the error of its end."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from model.atmosphere.transfer.delta_m_truncation import forward_share
from model.atmosphere.transfer.layers import Layer
from model.atmosphere.transfer.phase import AerosolKind
from model.atmosphere.transfer.scattering_matrix import ScatteringMatrix
from model.atmosphere.transfer.spherical_functions import matrix_functions

_RAYLEIGH_DEGREE = 2
_NEGLIGIBLE = 1e-7  # share of light scattered twice in a degree that is left out, if the directions carry as many
_BEYOND_AUREOLE_MU = np.cos(np.radians(np.linspace(10.0, 180.0, 86)))


def degree_max(layers: Sequence[Layer], *, nodes: int) -> int:
    """Largest degree of the expansion: 2 for molecules; for aerosol until it is negligible, or 2 * nodes - 1.

    Parameters
    ----------
    layers
        From top to bottom.
    nodes
        Directions of a hemisphere, 2 or more.

    Notes
    -----
    Light scattered once needs no expansion, so what counts is the square of a coefficient. A scattering matrix that
    gives up its forward peak is best cut at 3/2 of the nodes: products of higher degree are not integrated well enough
    (rural aerosol, 12 nodes, error of the sky beyond 20 degrees from the sun: 1.6e-4 there, 6e-4 at 2, 4.6e-4 at 1).
    """
    matrices = [layer.matrix for layer in layers if layer.matrix is not None]
    if matrices:
        longest = max(matrix.coefficients.shape[0] for matrix in matrices) - 1
        return int(max(min(3 * nodes // 2 - 1, longest), _RAYLEIGH_DEGREE))
    degree = _RAYLEIGH_DEGREE
    while degree < 2 * nodes - 1 and truncation_error(layers, degree=degree, mu0=1.0) > _NEGLIGIBLE:
        degree += 1
    return degree


def truncation_error(layers: Sequence[Layer], *, degree: int, mu0: float) -> float:
    """Error, as a share of the mean radiance, from the degrees above the given one in light scattered twice.

    Parameters
    ----------
    layers
        From top to bottom.
    degree
        The last that is kept, 0 or more.
    mu0
        Cosine of the solar zenith angle, above 0 to 1.

    Notes
    -----
    Henyey-Greenstein: the first term left out, (2l + 1) g^(2l) times the albedo of the aerosol, over 1 - g^2 for those
    that follow. A matrix: the largest error, beyond ten degrees from the sun, that delta-M with exact single scattering
    leaves, times half the slant depth of scattering by the aerosol, which is the share of light scattered twice.

    References
    ----------
    Nakajima & Tanaka, J. Quant. Spectrosc. Radiat. Transfer 40 (1988) 51, doi:10.1016/0022-4073(88)90031-3.
    """
    slant = sum(layer.tau_aerosol * layer.ssa_aerosol for layer in layers if layer.matrix is not None) / mu0
    return max(
        (
            layer.tau_aerosol
            * layer.ssa_aerosol
            / layer.depth
            * _neglected(layer, degree)
            * (1.0 if layer.matrix is None else min(slant / 2.0, 1.0))
            for layer in layers
        ),
        default=0.0,
    )


def _neglected(layer: Layer, degree: int) -> float:
    """Share of light that the aerosol scattered twice in the degrees above the given one."""
    following = degree + 1
    if layer.matrix is None:
        return float((2 * following + 1) * abs(layer.g_aerosol) ** (2 * following) / (1.0 - layer.g_aerosol**2))
    return _aureole_error(layer.matrix, degree, forward_share(layer, degree=degree))


@lru_cache(maxsize=256)
def _aureole_error(matrix: ScatteringMatrix, degree: int, peak: float) -> float:
    """Largest error of the phase function of light scattered twice, ten degrees and more from the sun.

    Twice scattered has the squares of the coefficients (over 2l + 1); delta-M keeps them up to the degree, and TMS
    gives twice the peak times the coefficient beyond.
    """
    degrees = np.arange(matrix.coefficients.shape[0])
    share = matrix.coefficients[:, 0] / (2 * degrees + 1)
    missing = np.where(degrees <= degree, -(peak**2), share**2 - 2.0 * peak * share)
    functions = matrix_functions(degree_max=degrees.size - 1, mu=_BEYOND_AUREOLE_MU)
    total = np.zeros_like(_BEYOND_AUREOLE_MU)
    for weight, row in zip(missing * (2 * degrees + 1), functions, strict=True):
        total += weight * row[0]
    return float(np.max(np.abs(total)))


def mode_blocks(degree: int, aerosol: AerosolKind) -> list[tuple[range, bool]]:
    """Azimuth modes that are solved together, and whether they carry polarization.

    Parameters
    ----------
    degree
        The last azimuth mode, 2 or more.
    aerosol
        How its scattering polarizes.

    Notes
    -----
    Molecules scatter in modes 0 to 2 alone: the higher ones of a depolarizing aerosol are those of the intensity. For
    either kind they stand apart because their orders die out sooner.
    """
    blocks = [(range(_RAYLEIGH_DEGREE + 1), True)]
    if degree > _RAYLEIGH_DEGREE:
        blocks.append((range(_RAYLEIGH_DEGREE + 1, degree + 1), aerosol is not AerosolKind.DEPOLARIZING))
    return blocks
