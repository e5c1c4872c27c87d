"""The standard atmosphere as the solver takes it: molecules and aerosol over height, at one wavelength."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.atmosphere.aerosol.choice import AerosolChoice, extinction_of, kinks_of, optics_of, spheres_of
from model.atmosphere.aerosol.mie_aerosol import aerosol_scattering
from model.atmosphere.aerosol.models import AerosolOptics, AerosolType
from model.atmosphere.aerosol.particle_modes import MieAerosol
from model.atmosphere.aerosol_profile import BOUNDARY_LAYER_TOP_M, AerosolColumn, aerosol_column
from model.atmosphere.molecules import (
    SEA_LEVEL_PRESSURE_PA,
    pressure_ratio,
    rayleigh_anisotropy,
    rayleigh_optical_depth,
)
from model.atmosphere.transfer.layers import Layer
from model.atmosphere.transfer.phase import AerosolKind
from model.atmosphere.transfer.scattering_matrix import ScatteringMatrix


@dataclass(frozen=True, kw_only=True)
class AtmosphereState:
    """State of an atmosphere as far as it is known; all else is the US standard of 1976.

    Attributes
    ----------
    visibility_m, aerosol_optical_depth
        Exactly one of them: meteorological range [m], or vertical optical depth of the aerosol at 550 nm.
    boundary_aerosol, upper_aerosol
        Aerosol of the lowest 2 km and of the air above: a documented kind, or spheres of one's own.
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
    """An atmosphere at one wavelength, without ozone (which acts on the beam above all scattering).

    Attributes
    ----------
    wavelength_m
        [m].
    tau_rayleigh
        Optical depth of the molecules.
    delta
        Anisotropy of their scattering.
    aerosol
        Aerosol over height at 550 nm.
    lower, upper
        Optical properties of the aerosol below and above 2 km.
    lower_spheres, upper_spheres
        The same aerosols as spheres.
    """

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
        """Optical depth above a height over the ground [m], 0 or more.

        Raises
        ------
        ValueError
            A height below the ground.
        """
        height = np.asarray(height_m, dtype=float)
        if not np.all(height >= 0.0):
            raise ValueError(f"height_m = {np.min(height)!r} m, allowed is 0 (the ground) or more")
        return np.asarray(self._rayleigh_above(height) + self._aerosol_between(height, np.asarray(np.inf)))

    def depth_above(self, height_m: float) -> float:
        """Return what `tau_above` does of one height, computed once: bounds ask for the camera's for every region."""
        if height_m not in self._depths_above:
            self._depths_above[height_m] = float(self.tau_above(height_m))
        return self._depths_above[height_m]

    @cached_property
    def _depths_above(self) -> dict[float, float]:
        return {}

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

        Parameters
        ----------
        fine
            78 layers, within 1e-4 of the radiance of many more; or 15, within 3e-3.
        aerosol
            SPHERES gives each layer the scattering matrix of its spheres.
        matrix_tolerance
            As in `model.atmosphere.aerosol.mie_aerosol.aerosol_scattering`.
        cuts
            Into how many parts of equal height each of these layers is cut, 1 or more.
        face_m
            Height at which a layer is to end, 0 or more [m]; 0 for none.

        Notes
        -----
        Optical depth and single-scattering albedo are those of the column for every kind of aerosol.
        """
        heights = face_heights_m(fine=fine, cuts=cuts, face_m=face_m)
        lower, upper = self._matrices(matrix_tolerance) if aerosol is AerosolKind.SPHERES else (None, None)
        low, high = heights[-2::-1], heights[:0:-1]
        molecules = self._rayleigh_above(low) - self._rayleigh_above(high)
        particles = self._aerosol_between(low, high)
        return tuple(
            self._layer(*depths, matrix=lower if is_low else upper, optics=self.lower if is_low else self.upper)
            for *depths, is_low in zip(
                molecules.tolist(), particles.tolist(), (high <= BOUNDARY_LAYER_TOP_M).tolist(), strict=True
            )
        )

    def _matrices(self, tolerance: float) -> list[ScatteringMatrix]:
        """Scattering matrices of the spheres below and above 2 km."""
        return [
            aerosol_scattering(spheres, wavelength_m=self.wavelength_m, tolerance=tolerance).matrix
            for spheres in (self.lower_spheres, self.upper_spheres)
        ]

    def _layer(
        self, tau_rayleigh: float, tau_aerosol: float, *, matrix: ScatteringMatrix | None, optics: AerosolOptics
    ) -> Layer:
        """Homogeneous mean of the air between two heights on one side of 2 km."""
        return Layer(
            tau_rayleigh=tau_rayleigh,
            tau_aerosol=tau_aerosol,
            ssa_aerosol=optics.ssa,
            g_aerosol=optics.g,
            delta=self.delta,
            matrix=matrix,
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
        What is known of it.
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
    """Wavelengths at which the light has a kink, for the tables of the aerosol have one [m], increasing.

    Parameters
    ----------
    state
        The atmosphere.
    aerosol
        SPHERES have the tables of their indices; every kind has the optical depth and albedo of its choice.
    """
    choices = {state.boundary_aerosol, state.upper_aerosol}
    if aerosol is AerosolKind.SPHERES:
        choices |= {spheres_of(choice, relative_humidity=state.relative_humidity) for choice in choices}
    return tuple(sorted(set().union(*(kinks_of(one, relative_humidity=state.relative_humidity) for one in choices))))


def optical_depth(state: AtmosphereState, *, wavelength_m: ArrayLike) -> NDArray[np.float64]:
    """Vertical optical depth of molecules and aerosol at many wavelengths, without ozone.

    Parameters
    ----------
    state
        What is known of the atmosphere.
    wavelength_m
        [m], 0.25e-6 to 1.06e-6.

    Raises
    ------
    ValueError
        A part of the state, or a wavelength, is outside its range.

    References
    ----------
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
# From a face near the ground each layer is at most so many times as high as the one below.
_GROWTH = 4.0


def face_heights_m(*, fine: bool, cuts: int, face_m: float) -> NDArray[np.float64]:
    """Return the heights of the layers' faces, increasing from the ground, shape (K + 1,) [m].

    Parameters
    ----------
    fine
        78 layers, or 15; 2 km is a face of both.
    cuts
        Into how many parts of equal height each of them is cut, 1 or more.
    face_m
        Height of one more face before they are cut, and if that is near the ground of some between it and the next
        [m]; on the ground or above the air for none.
    """
    faces = _with_face(_FINE_M if fine else _COARSE_M, face_m)
    return np.interp(np.arange((faces.size - 1) * cuts + 1) / cuts, np.arange(faces.size), faces)


def _with_face(heights_m: NDArray[np.float64], face_m: float) -> NDArray[np.float64]:
    if not 0.0 < face_m < heights_m[-1]:
        return heights_m
    faces = [face_m]
    while faces[-1] * _GROWTH < heights_m[1]:
        faces.append(faces[-1] * _GROWTH)
    return np.union1d(heights_m, faces)
