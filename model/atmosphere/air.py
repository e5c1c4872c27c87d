"""The air: molecules, ozone and aerosol, as layers at one wavelength.

Heights follow the US standard atmosphere 1976. Ozone lies above nearly all scattering and acts on the beam alone.
Over a band, logarithms of the aerosol's properties are straight lines between the kinks of its tables.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.atmosphere.aerosols import (
    BOUNDARY_LAYER_TOP_M,
    TABULATED,
    AerosolChoice,
    AerosolColumn,
    AerosolOptics,
    AerosolType,
    aerosol_column,
    angstrom_ratio,
    extinction_of,
    kinks_of,
    optics_of,
    spheres_of,
)
from model.atmosphere.layers import AerosolKind, Layer
from model.atmosphere.mie import MieAerosol, aerosol_scattering

FloatArray = NDArray[np.float64]

# fmt: off
_WAVELENGTH_NM = np.array([
    300, 305, 310, 315, 320, 325, 330, 335, 340, 345, 350, 360, 440, 450, 460, 470, 480, 490, 500, 510, 520, 530,
    540, 550, 570, 593, 610, 630, 656, 667.6, 690, 710, 718, 724.4, 740, 752.5, 757.5, 762.5, 767.5, 780,
])
_ABSORPTION_PER_ATM_CM = np.array([
    10.0, 4.8, 2.7, 1.35, 0.8, 0.38, 0.16, 0.075, 0.04, 0.019, 0.007, 0.0, 0.0, 0.003, 0.006, 0.009, 0.014, 0.021,
    0.03, 0.04, 0.048, 0.063, 0.075, 0.085, 0.12, 0.119, 0.12, 0.09, 0.065, 0.051, 0.028, 0.018, 0.015, 0.012, 0.01,
    0.008, 0.007, 0.006, 0.005, 0.0,
])
# fmt: on


def ozone_optical_depth(*, wavelength_m: ArrayLike, ozone_m: float) -> NDArray[np.float64]:
    """Vertical optical depth of ozone.

    Bird & Riordan, J. Clim. Appl. Meteorol. 25 (1986) 87, table 1 (linear between its wavelengths).
    """
    wavelength_nm = np.asarray(wavelength_m, dtype=float) * 1e9
    if not np.all(wavelength_nm >= _WAVELENGTH_NM[0] * (1.0 - 1e-12)):
        raise ValueError(f"wavelength_m = {np.min(wavelength_nm):.6g}e-9 m, allowed is 300e-9 m or more")
    if not 0.0 <= ozone_m < np.inf:
        raise ValueError(f"ozone_m = {ozone_m!r} m, but it must be finite and 0 or more")
    return np.asarray(np.interp(wavelength_nm, _WAVELENGTH_NM, _ABSORPTION_PER_ATM_CM) * ozone_m * 100.0)


SEA_LEVEL_PRESSURE_PA = 101325.0
_EARTH_RADIUS_M = 6356766.0
_HYDROSTATIC_K_PER_M = 0.0341631947  # g0 M / R
_BASE_HEIGHT_M = np.array([0.0, 11e3, 20e3, 32e3, 47e3, 51e3, 71e3])  # geopotential
_LAPSE_K_PER_M = np.array([-6.5e-3, 0.0, 1e-3, 2.8e-3, 0.0, -2.8e-3, -2e-3])
_SEA_LEVEL_TEMPERATURE_K = 288.15
_TOP_M = 84852.0  # geopotential
_SHORTEST_M, _LONGEST_M = 0.25e-6, 1.1e-6


@dataclass(frozen=True, kw_only=True)
class AtmosphereState:
    """Known properties of an atmosphere; all others are those of the US standard of 1976.

    Attributes
    ----------
    visibility_m, aerosol_optical_depth
        Exactly one of them: meteorological range [m], or vertical optical depth of the aerosol at 550 nm.
    boundary_aerosol, upper_aerosol
        Aerosol of the lowest 2 km and of the air above: a documented kind, or spheres with stated sizes and indices.
    angstrom_exponent
        Of the aerosol's extinction over wavelength, in place of the spectrum of its kind; or None.
    relative_humidity
        At the ground, 0 to 0.8; the standard atmosphere has about 0.5.
    ozone_m
        Ozone at standard temperature and pressure [m].
    surface_pressure_pa
        Pressure at the ground [Pa]. Heights count from the ground.
    """

    visibility_m: float | None = None
    aerosol_optical_depth: float | None = None
    boundary_aerosol: AerosolChoice = AerosolType.RURAL
    upper_aerosol: AerosolChoice = AerosolType.TROPOSPHERIC
    angstrom_exponent: float | None = None
    relative_humidity: float = 0.5
    ozone_m: float = 3.44e-3
    surface_pressure_pa: float = SEA_LEVEL_PRESSURE_PA


@dataclass(frozen=True, kw_only=True)
class Column:
    """An atmosphere at one wavelength, without ozone (which acts on the beam above all scattering)."""

    wavelength_m: float
    tau_rayleigh: float
    delta: float
    aerosol: AerosolColumn
    lower: AerosolOptics
    upper: AerosolOptics
    lower_spheres: MieAerosol
    upper_spheres: MieAerosol

    @property
    def tau_aerosol(self) -> float:
        """Optical depth of the aerosol."""
        return self.depth - self.tau_rayleigh

    @cached_property
    def depth(self) -> float:
        """Optical depth of all."""
        return float(self.tau_above(0.0))

    def tau_above(self, height_m: ArrayLike) -> NDArray[np.float64]:
        """Optical depth above a height over the ground [m], 0 or more."""
        height = np.asarray(height_m, dtype=float)
        if not np.all(height >= 0.0):
            raise ValueError(f"height_m = {np.min(height)!r} m, allowed is 0 (the ground) or more")
        return np.asarray(self._rayleigh_above(height) + self._aerosol_between(height, np.asarray(np.inf)))

    def layers(
        self,
        *,
        fine: bool,
        aerosol: AerosolKind = AerosolKind.DEPOLARIZING,
        matrix_tolerance: float = 1e-3,
        cuts: int = 1,
        face_m: float = 0.0,
    ) -> tuple[Layer, ...]:
        """Homogeneous layers, top to bottom.

        Optical depth and single-scattering albedo are those of the column for every kind of aerosol.
        """
        heights = face_heights_m(fine=fine, cuts=cuts, face_m=face_m)
        lower, upper = (
            aerosol_scattering(spheres, wavelength_m=self.wavelength_m, tolerance=matrix_tolerance).matrix
            if aerosol is AerosolKind.SPHERES
            else None
            for spheres in (self.lower_spheres, self.upper_spheres)
        )
        low, high = heights[-2::-1], heights[:0:-1]
        molecules = self._rayleigh_above(low) - self._rayleigh_above(high)
        particles = self._aerosol_between(low, high)
        return tuple(
            Layer(
                tau_rayleigh=tau_rayleigh,
                tau_aerosol=tau_aerosol,
                ssa_aerosol=self.lower.ssa if is_low else self.upper.ssa,
                g_aerosol=self.lower.g if is_low else self.upper.g,
                delta=self.delta,
                matrix=lower if is_low else upper,
            )
            for tau_rayleigh, tau_aerosol, is_low in zip(
                molecules.tolist(), particles.tolist(), (high <= BOUNDARY_LAYER_TOP_M).tolist(), strict=True
            )
        )

    def _rayleigh_above(self, height_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Optical depth of the molecules above a height."""
        return np.asarray(self.tau_rayleigh * pressure_ratio(height_m))

    def _aerosol_between(self, lower_m: NDArray[np.float64], upper_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Optical depth of the aerosol between heights."""
        edge = BOUNDARY_LAYER_TOP_M
        below = self.aerosol.optical_depth_between(np.minimum(lower_m, edge), np.minimum(upper_m, edge))
        above = self.aerosol.optical_depth_between(np.maximum(lower_m, edge), np.maximum(upper_m, edge))
        return below * self.lower.extinction + above * self.upper.extinction


def column(state: AtmosphereState, *, wavelength_m: float) -> Column:
    """Atmosphere at one wavelength.

    Parameters
    ----------
    state
        Its known properties.
    wavelength_m
        [m], 0.3e-6 to 1.06e-6.

    Raises
    ------
    ValueError
        A part of the state, or the wavelength, is outside its range.

    References
    ----------
    U.S. Standard Atmosphere 1976; Shettle & Fenn, AFGL-TR-79-0214 (1979)
    """
    choices = (state.boundary_aerosol, state.upper_aerosol)
    lower, upper = (
        optics_of(
            choice,
            wavelength_m=wavelength_m,
            relative_humidity=state.relative_humidity,
            angstrom_exponent=state.angstrom_exponent,
        )
        for choice in choices
    )
    lower_spheres, upper_spheres = (spheres_of(choice, relative_humidity=state.relative_humidity) for choice in choices)
    return Column(
        wavelength_m=wavelength_m,
        tau_rayleigh=float(
            rayleigh_optical_depth(wavelength_m=wavelength_m, surface_pressure_pa=state.surface_pressure_pa)
        ),
        delta=rayleigh_anisotropy(wavelength_m=wavelength_m),
        aerosol=aerosol_column(visibility_m=state.visibility_m, optical_depth=state.aerosol_optical_depth),
        lower=lower,
        upper=upper,
        lower_spheres=lower_spheres,
        upper_spheres=upper_spheres,
    )


def kinks_m(state: AtmosphereState, *, aerosol: AerosolKind) -> tuple[float, ...]:
    """Wavelengths of kinks in the tables of the aerosol [m], increasing."""
    choices = {state.boundary_aerosol, state.upper_aerosol}
    if aerosol is AerosolKind.SPHERES:
        choices |= {spheres_of(choice, relative_humidity=state.relative_humidity) for choice in choices}
    return tuple(sorted(set().union(*(kinks_of(one, relative_humidity=state.relative_humidity) for one in choices))))


def optical_depth(state: AtmosphereState, *, wavelength_m: ArrayLike) -> NDArray[np.float64]:
    """Vertical optical depth of molecules and aerosol at many wavelengths, without ozone.

    definition: the depth of `column`
    """
    aerosol = aerosol_column(visibility_m=state.visibility_m, optical_depth=state.aerosol_optical_depth)
    lower, upper = (
        extinction_of(
            choice,
            wavelength_m=wavelength_m,
            relative_humidity=state.relative_humidity,
            angstrom_exponent=state.angstrom_exponent,
        )
        for choice in (state.boundary_aerosol, state.upper_aerosol)
    )
    molecules = rayleigh_optical_depth(wavelength_m=wavelength_m, surface_pressure_pa=state.surface_pressure_pa)
    depths = aerosol.optical_depth_between([0.0, BOUNDARY_LAYER_TOP_M], [BOUNDARY_LAYER_TOP_M, np.inf])
    return np.asarray(molecules + depths[0] * lower + depths[1] * upper)


def rayleigh_optical_depth(
    *, wavelength_m: ArrayLike, surface_pressure_pa: float = SEA_LEVEL_PRESSURE_PA
) -> NDArray[np.float64]:
    """Vertical optical depth of molecular scattering.

    Bodhaine et al., J. Atmos. Oceanic Technol. 16 (1999) 1854, eq. (30),
    doi:10.1175/1520-0426(1999)016<1854:ORODC>2.0.CO;2 (sea level, 45 degrees, 360 ppm CO2).
    """
    inverse_square = _inverse_square_um(wavelength_m)
    if not 0.0 < surface_pressure_pa < np.inf:
        raise ValueError(f"surface_pressure_pa = {surface_pressure_pa!r} Pa, but it must be finite and above 0")
    above = 1.0455996 - 341.29061 * inverse_square - 0.90230850 / inverse_square
    below = 1.0 + 0.0027059889 * inverse_square - 85.968563 / inverse_square
    return np.asarray(0.0021520 * above / below * surface_pressure_pa / SEA_LEVEL_PRESSURE_PA)


@dataclass(frozen=True, kw_only=True, eq=False)
class AerosolSpectrum:
    """One aerosol over a band."""

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

    Computed at the nodes; between them logarithms are linear, exactly for tables and approximately for spheres.
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


_FINE_M = 1e3 * np.concatenate(
    [
        np.arange(0, 2, 0.2),
        np.arange(2, 10, 0.25),
        np.arange(10, 20, 0.5),
        np.arange(20, 30, 1),
        [30, 32.5, 35, 40, 50, 70, 100],
    ]
)
_COARSE_M = 1e3 * np.array([0, 0.5, 1, 1.5, 2, 3, 4, 5, 7, 9, 12, 16, 20, 25, 35, 100])


# Largest ratio of the thicknesses of adjacent layers above a face near the ground.
_GROWTH = 4.0


def face_heights_m(*, fine: bool, cuts: int, face_m: float) -> NDArray[np.float64]:
    """Return the heights of the layers' faces, increasing from the ground, shape (K + 1,) [m]."""
    heights_m = _FINE_M if fine else _COARSE_M
    near = [face_m] if 0.0 < face_m < heights_m[-1] else []
    while near and near[-1] * _GROWTH < heights_m[1]:
        near.append(near[-1] * _GROWTH)
    faces: NDArray[np.float64] = np.array(sorted({*heights_m.tolist(), *near}))
    return np.interp(np.arange((faces.size - 1) * cuts + 1) / cuts, np.arange(faces.size), faces)


def pressure_ratio(height_m: ArrayLike) -> NDArray[np.float64]:
    """Pressure over that at sea level in the US standard atmosphere 1976.

    U.S. Standard Atmosphere 1976, NOAA-S/T 76-1562, eqs. (18), (33a), (33b), table 4.
    """
    height = np.asarray(height_m, dtype=float)
    # Limited to the top, above which nothing is left, so that the formula stays finite.
    held = np.minimum(height, 2.0 * _TOP_M)
    geopotential = _EARTH_RADIUS_M * held / (_EARTH_RADIUS_M + held)
    ratio = np.ones_like(geopotential)
    temperature = _SEA_LEVEL_TEMPERATURE_K
    for base, top, lapse in zip(_BASE_HEIGHT_M, [*_BASE_HEIGHT_M[1:], _TOP_M], _LAPSE_K_PER_M, strict=True):
        thickness = np.clip(geopotential - base, 0.0, top - base)
        if lapse == 0.0:
            ratio *= np.exp(-_HYDROSTATIC_K_PER_M * thickness / temperature)
        else:
            ratio *= (1.0 + lapse * thickness / temperature) ** (-_HYDROSTATIC_K_PER_M / lapse)
        temperature += lapse * (top - base)
    return np.where(geopotential < _TOP_M, ratio, 0.0)


def _inverse_square_um(wavelength_m: ArrayLike) -> NDArray[np.float64]:
    """Wavelength to the power -2 [um-2], after a check."""
    wavelength = np.asarray(wavelength_m, dtype=float)
    if not np.all((wavelength >= _SHORTEST_M) & (wavelength <= _LONGEST_M)):
        raise ValueError(
            f"wavelength_m = {np.min(wavelength):.6g} to {np.max(wavelength):.6g} m, "
            f"allowed is {_SHORTEST_M} to {_LONGEST_M} m"
        )
    return (wavelength * 1e6) ** -2.0


def rayleigh_anisotropy(*, wavelength_m: float) -> float:
    """Anisotropy delta = (1 - rho)/(1 + rho/2) of the scattering by air, rho its depolarization factor.

    Bates, Planet. Space Sci. 32 (1984) 785; mixed as in Bodhaine et al. (1999), eqs. (5), (6), (23).
    """
    inverse_square = float(_inverse_square_um(wavelength_m))
    nitrogen = 1.034 + 3.17e-4 * inverse_square
    oxygen = 1.096 + 1.385e-3 * inverse_square + 1.448e-4 * inverse_square**2
    king = (78.084 * nitrogen + 20.946 * oxygen + 0.934 + 0.036 * 1.15) / (78.084 + 20.946 + 0.934 + 0.036)
    depolarization = 6.0 * (king - 1.0) / (3.0 + 7.0 * king)
    return (1.0 - depolarization) / (1.0 + depolarization / 2.0)
