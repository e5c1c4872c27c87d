"""How long the expansion of the scattering matrices is, in which blocks of azimuth modes, and what its end costs."""

from collections.abc import Sequence

from model.atmosphere.layers import Layer
from model.atmosphere.phase import AerosolKind

_RAYLEIGH_DEGREE = 2
_NEGLIGIBLE = 1e-7  # share of light scattered twice in a degree that is left out, if the directions carry as many


def degree_max(layers: Sequence[Layer], *, nodes: int) -> int:
    """Largest degree of the expansion: 2 for molecules; for aerosol until it is negligible, or 2 * nodes - 1.

    Notes
    -----
    Light scattered once needs no expansion, so what counts is the square of a coefficient.

    References
    ----------
    definition
    """
    degree = _RAYLEIGH_DEGREE
    while degree < 2 * nodes - 1 and truncation_error(layers, degree=degree) > _NEGLIGIBLE:
        degree += 1
    return degree


def truncation_error(layers: Sequence[Layer], *, degree: int) -> float:
    """Largest share of twice scattered light in the degrees above the given one.

    Notes
    -----
    The first term left out, (2l + 1) g^(2l) times the albedo of the aerosol, over 1 - g^2 for those that follow.

    References
    ----------
    definition
    """
    following = degree + 1
    return max(
        (
            layer.tau_aerosol
            * layer.ssa_aerosol
            / layer.depth
            * (2 * following + 1)
            * abs(layer.g_aerosol) ** (2 * following)
            / (1.0 - layer.g_aerosol**2)
            for layer in layers
        ),
        default=0.0,
    )


def mode_blocks(degree: int, aerosol: AerosolKind) -> list[tuple[range, bool]]:
    """Azimuth modes that are solved together, and whether they carry polarization.

    Notes
    -----
    Molecules scatter in modes 0 to 2 alone: the higher ones of a depolarizing aerosol are those of the intensity. For
    either kind they stand apart because their orders die out sooner.

    References
    ----------
    definition
    """
    blocks = [(range(_RAYLEIGH_DEGREE + 1), True)]
    if degree > _RAYLEIGH_DEGREE:
        blocks.append((range(_RAYLEIGH_DEGREE + 1, degree + 1), aerosol is AerosolKind.POLARIZING))
    return blocks
