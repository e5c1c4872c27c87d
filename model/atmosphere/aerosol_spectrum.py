"""Optical properties of a state's aerosols over all wavelengths of a band: lines between the kinks of their tables."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.aerosol.angstrom import angstrom_ratio
from model.atmosphere.aerosol.choice import AerosolChoice, kinks_of, optics_of
from model.atmosphere.aerosol.models import TABULATED
from model.atmosphere.aerosol_profile import BOUNDARY_LAYER_TOP_M, aerosol_column
from model.atmosphere.profile import AtmosphereState

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class AerosolSpectrum:
    """One aerosol over a band.

    Attributes
    ----------
    depth_550
        Vertical optical depth at 550 nm.
    angstrom_exponent
        Of the extinction in place of its own spectrum; or None.
    nodes_m
        Ends of the band and kinks in it, of spheres the middles between these too; shape (K,), increasing [m].
    log_extinction, log_ssa, log_g
        Logarithms, there, of the extinction over that at 550 nm, of the single-scattering albedo and of the asymmetry.
    """

    depth_550: float
    angstrom_exponent: float | None
    nodes_m: FloatArray
    log_extinction: FloatArray
    log_ssa: FloatArray
    log_g: FloatArray

    def depth(self, wavelength_m: FloatArray) -> FloatArray:
        """Return the vertical optical depth at wavelengths of the band."""
        if self.angstrom_exponent is not None:
            return self.depth_550 * angstrom_ratio(exponent=self.angstrom_exponent, wavelength_m=wavelength_m)
        return self.depth_550 * self._read(self.log_extinction, wavelength_m)

    def ssa(self, wavelength_m: FloatArray) -> FloatArray:
        """Return the single-scattering albedo at wavelengths of the band."""
        return self._read(self.log_ssa, wavelength_m)

    def asymmetry(self, wavelength_m: FloatArray) -> FloatArray:
        """Return the asymmetry at wavelengths of the band."""
        return self._read(self.log_g, wavelength_m)

    def _read(self, logarithms: FloatArray, wavelength_m: FloatArray) -> FloatArray:
        return np.exp(np.interp(wavelength_m, self.nodes_m, logarithms))


def aerosol_spectra(
    state: AtmosphereState, *, shortest_m: float, longest_m: float
) -> tuple[AerosolSpectrum, AerosolSpectrum]:
    """Return the aerosol of the lowest 2 km and that above over a band.

    Parameters
    ----------
    state
        The atmosphere.
    shortest_m, longest_m
        Ends of the band [m], 0.3e-6 to 1.06e-6.

    Raises
    ------
    ValueError
        A part of the state, or a wavelength, is outside its range.

    Notes
    -----
    Computed at the nodes alone: between them the logarithms of a table are straight lines, and those of spheres are
    taken as such.
    """
    profile = aerosol_column(visibility_m=state.visibility_m, optical_depth=state.aerosol_optical_depth)
    depths = profile.optical_depth_between([0.0, BOUNDARY_LAYER_TOP_M], [BOUNDARY_LAYER_TOP_M, np.inf])

    def spectrum(choice: AerosolChoice, depth: float) -> AerosolSpectrum:
        kinks = kinks_of(choice, relative_humidity=state.relative_humidity)
        nodes_m = sorted({shortest_m, longest_m, *(kink for kink in kinks if shortest_m < kink < longest_m)})
        if choice not in TABULATED:
            nodes_m = sorted({*nodes_m, *(0.5 * (one + other) for one, other in pairwise(nodes_m))})
        found = [
            optics_of(choice, wavelength_m=node_m, relative_humidity=state.relative_humidity, angstrom_exponent=None)
            for node_m in nodes_m
        ]
        return AerosolSpectrum(
            depth_550=depth,
            angstrom_exponent=state.angstrom_exponent,
            nodes_m=np.array(nodes_m),
            log_extinction=np.log([optics.extinction for optics in found]),
            log_ssa=np.log([optics.ssa for optics in found]),
            log_g=np.log([optics.g for optics in found]),
        )

    lower, upper = zip((state.boundary_aerosol, state.upper_aerosol), depths.tolist(), strict=True)
    return spectrum(*lower), spectrum(*upper)
