"""Numerical settings of the whole chain: what costs time and buys accuracy, and nothing else."""

from dataclasses import dataclass

from model.atmosphere.lighting.fidelity import FIDELITY_LEVELS, STANDARD_SETTINGS, Fidelity, SolverSettings
from model.scene.field_of_view import TileRule


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Numerical settings of the whole chain.

    Attributes
    ----------
    wavelengths, split_at_kinks
        At how many the atmosphere is solved, 1 to 20, and whether each stretch between the entries of the aerosol's
        tables has its own part of them, rounded up.
    solver
        Streams, layers, element depth and orders of scattering of a solution.
    sky_zeniths, sky_azimuths
        Steps of the grid on which the sky is kept, as in `model.scene.sampled_sky.sample_sky`; 0 zeniths for none, the
        sky itself is then asked in every direction.
    hemisphere_tolerance
        Of the integral of pBRDF times sky, share of its S0.
    tiles_per_side, tile_rule
        Nodes over the field of view along each side.
    negligible_spread
        A field over which light varies by less than this share of S0 is taken as a point; 0 to take none as one.
    dolp_tolerance
        Relative, of mean and deviation of the pixels' DoLP: decides between first order, second order and quadrature.
    roc_tolerance
        Relative, of the tail of the detector's statistic that is integrated, 1e-12 to 0.01.
    """

    wavelengths: int
    solver: SolverSettings
    split_at_kinks: bool = False
    sky_zeniths: int = 24
    sky_azimuths: int = 20
    hemisphere_tolerance: float = 1e-4
    tiles_per_side: int = 5
    tile_rule: TileRule = "gauss-legendre"
    negligible_spread: float = 1e-3
    dolp_tolerance: float = 1e-6
    roc_tolerance: float = 1e-10


def settings_of_fidelity(fidelity: Fidelity, *, wavelengths: int = 4) -> Settings:
    """Return the settings that a fidelity level stands for.

    Parameters
    ----------
    fidelity
        For a fidelity level that solves nothing the settings of STANDARD stand in; they are not used.
    wavelengths
        As in `Settings`.
    """
    return Settings(wavelengths=wavelengths, solver=FIDELITY_LEVELS[fidelity].settings or STANDARD_SETTINGS)
