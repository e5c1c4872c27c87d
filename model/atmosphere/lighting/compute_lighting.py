"""Light in a band, computed with the effort of a fidelity level."""

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.lighting.analytic_sky import AnalyticLighting
from model.atmosphere.lighting.band_lighting import BandLighting
from model.atmosphere.lighting.diffuse_light import DiffuseLight
from model.atmosphere.lighting.fidelity import FIDELITY_LEVELS, STANDARD_SETTINGS, Fidelity, SolverSettings
from model.atmosphere.lighting.single_scattering import single_solution
from model.atmosphere.lighting.solve_column import LightSolver, solve_column
from model.atmosphere.ozone import ozone_optical_depth
from model.atmosphere.profile import AtmosphereState, Column, column, kinks_m, optical_depth
from model.atmosphere.solver import solve
from model.atmosphere.spectral_rule import SpectralRule, spectral_rule
from model.atmosphere.sun import SolarBand
from model.atmosphere.transfer.phase import AerosolKind


def compute_lighting(
    state: AtmosphereState,
    *,
    fidelity: Fidelity,
    band: SolarBand,
    mu0: float,
    albedo: float,
    aerosol: AerosolKind = AerosolKind.DEPOLARIZING,
    wavelengths: int = 4,
    split_at_kinks: bool = False,
    dolp_max: float = 0.2,
    solver: LightSolver = solve,
    settings: SolverSettings | None = None,
) -> BandLighting | AnalyticLighting:
    """Light of one sun position in a band.

    Parameters
    ----------
    state
        The atmosphere.
    fidelity
        Any but TABLE, which is made from a table (`model.atmosphere.lighting.table_lighting`).
    band
        Spectrum of the sun at its actual distance, and response of the sensor.
    mu0
        Cosine of the solar zenith angle, cos(85 deg) to 1.
    albedo
        Albedo of the ground around, 0 to 1.
    aerosol
        What the aerosol does to polarization.
    wavelengths
        How many to compute.
    split_at_kinks
        Whether each stretch between the entries of the aerosol's tables has its own part of them, rounded up: pays
        below an error of 1e-4.
    dolp_max
        Largest degree of polarization of the sky; fidelity ANALYTIC alone uses it.
    solver
        What solves a wavelength.
    settings
        In place of the level's own; where light is scattered once, the layers alone count.

    Raises
    ------
    ValueError
        An argument outside its range.
    """
    if fidelity is Fidelity.TABLE:
        raise ValueError("compute_lighting: tier 'table' is not computed; build a TableLighting from the table")
    kind = AerosolKind(aerosol)
    ozone = np.exp(-ozone_optical_depth(wavelength_m=band.wavelength_m, ozone_m=state.ozone_m) / mu0)
    rule = spectral_rule(
        wavelength_m=band.wavelength_m,
        irradiance=band.shares * ozone,
        count=wavelengths,
        kinks_m=kinks_m(state, aerosol=kind) if split_at_kinks else (),
    )
    columns = tuple(column(state, wavelength_m=float(wavelength)) for wavelength in rule.wavelength_m)
    own = FIDELITY_LEVELS[fidelity].settings
    solutions = tuple(
        solve_column(
            single_solution if own is None else solver,
            one,
            settings or own or STANDARD_SETTINGS,
            mu0=mu0,
            albedo=albedo,
            aerosol=kind,
        )
        for one in columns
    )
    lighting = _band_lighting(state, band, ozone, rule, columns, solutions)
    return lighting if fidelity is not Fidelity.ANALYTIC else analytic_lighting(lighting, mu0=mu0, dolp_max=dolp_max)


def analytic_lighting(path_and_beam: BandLighting, *, mu0: float, dolp_max: float) -> AnalyticLighting:
    """Return a sky by formula that has the radiance of another at the zenith.

    Parameters
    ----------
    path_and_beam
        The other.
    mu0
        Cosine of the solar zenith angle.
    dolp_max
        Largest degree of polarization of the sky.

    References
    ----------
    definition: see `model.atmosphere.lighting.analytic_sky`
    """
    zenith = float(path_and_beam.sky(zenith_rad=0.0, phi_rad=0.0)[0])
    return AnalyticLighting(path_and_beam=path_and_beam, mu0=mu0, zenith_radiance=zenith, dolp_max=dolp_max)


def _band_lighting(
    state: AtmosphereState,
    band: SolarBand,
    ozone: NDArray[np.float64],
    rule: SpectralRule,
    columns: tuple[Column, ...],
    solutions: tuple[DiffuseLight, ...],
) -> BandLighting:
    """Wavelengths put together; the beam, which costs nothing, at all samples of the spectrum."""
    mu0 = solutions[0].mu0
    used = band.weighted > 0.0
    depth = np.zeros(used.size)
    depth[used] = optical_depth(state, wavelength_m=band.wavelength_m[used])
    direct = float(band.integral(ozone * np.exp(-depth / mu0)))
    from_nodes = float(rule.irradiance @ [np.exp(-one.depth / mu0) for one in columns])
    return BandLighting(
        columns=columns,
        solutions=solutions,
        irradiance=rule.irradiance,
        direct_irradiance=direct,
        wavelength_error=abs(from_nodes / direct - 1.0),
    )
