"""Light of the sun and the sky in a band: from solved atmospheres, a formula or a table.

A scene needs a `Lighting`: the beam, the sky, and the effect of the air on the way to the camera. `compute_lighting`
makes it, with the effort of a level of fidelity. `TableLighting` reads it from a user's table.

The radiance per solar irradiance is smooth in the wavelength, the solar spectrum is not. The band is therefore
integrated by a Gauss rule with the spectrum as its weight, for which few wavelengths suffice (`spectral_rule`).
"""

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from math import ceil, exp, pi
from types import MappingProxyType
from typing import Any, Literal, Protocol, TypedDict, TypeVar, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.atmosphere.air import AtmosphereState, Column, column, kinks_m, optical_depth, ozone_optical_depth
from model.atmosphere.layers import (
    AerosolKind,
    Layer,
    merge_alike,
    rayleigh_column,
    single_peak_irradiance,
    slant,
    truncated_by_absorption,
)
from model.atmosphere.solver import Solution, gauss_nodes, solve
from model.stokes import rotate_frame

FloatArray = NDArray[np.float64]
Number = TypeVar("Number", float, NDArray[np.float64])


class Lighting(Protocol):
    """Light of one sun position in one band: on a target at the ground, and on the way to a sensor.

    Azimuths are phi = azimuth(sun) - azimuth(point of the sky, or sensor as seen from the target), Stokes parameters
    in the frame of the conventions (S1 > 0 horizontal, S2 > 0 at +45 degrees).
    """

    @property
    def direct_irradiance(self) -> float:
        """Irradiance of the beam at the ground on a plane normal to it [W m-2]."""
        ...

    def sky(self, *, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> NDArray[np.float64]:
        """Stokes radiance of the sky at the ground without the beam, shape (..., 3) [W m-2 sr-1]."""
        ...

    def transmittance(self, *, height_m: float, zenith_rad: ArrayLike) -> NDArray[np.float64]:
        """Transmittance from the ground to a sensor at a height over it, seen at a zenith angle."""
        ...

    def path(self, *, height_m: float, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> NDArray[np.float64]:
        """Stokes radiance added below the sensor over a black target, shape (..., 3) [W m-2 sr-1]."""
        ...


class Fidelity(StrEnum):
    """Tiers of the computation, from a formula to the full solution."""

    ANALYTIC = "analytic"
    SINGLE = "single"
    FAST = "fast"
    STANDARD = "standard"
    TABLE = "table"


@dataclass(frozen=True, kw_only=True)
class SolarBand:
    """Spectrum of the Sun outside the atmosphere in the band of a sensor.

    Attributes
    ----------
    wavelength_m
        Samples [m], shape (N,), increasing, two or more.
    irradiance_w_per_m3
        Spectral irradiance at the actual distance of the Sun [W m-2 per m of wavelength], 0 or more.
    response
        Relative response of the sensor, 0 to 1; 1 throughout gives the radiation in the band itself.
    """

    wavelength_m: NDArray[np.float64]
    irradiance_w_per_m3: NDArray[np.float64]
    response: NDArray[np.float64]

    def __post_init__(self) -> None:
        count = np.size(self.wavelength_m)
        shapes = {np.shape(self.wavelength_m), np.shape(self.irradiance_w_per_m3), np.shape(self.response)}
        if count < 2 or shapes != {(count,)} or not np.all(np.diff(self.wavelength_m) > 0.0):
            raise ValueError("SolarBand: wants three arrays of one length, 2 or more, over increasing wavelength_m")
        if not np.all((self.irradiance_w_per_m3 >= 0.0) & np.isfinite(self.irradiance_w_per_m3)):
            raise ValueError("SolarBand: irradiance_w_per_m3 must be finite and 0 or more")
        if not np.all((self.response >= 0.0) & (self.response <= 1.0)) or not np.any(self.weighted > 0.0):
            raise ValueError("SolarBand: response must be 0 to 1, and somewhere above 0 where the Sun shines")

    @property
    def weighted(self) -> NDArray[np.float64]:
        """Spectral irradiance times response [W m-3]."""
        return self.irradiance_w_per_m3 * self.response

    @property
    def limits_m(self) -> tuple[float, float]:
        """Shortest and longest wavelength with a response, with the sample beyond on either side [m]."""
        used = np.flatnonzero(self.response > 0.0)
        first, last = max(used[0] - 1, 0), min(used[-1] + 1, self.response.size - 1)
        return float(self.wavelength_m[first]), float(self.wavelength_m[last])

    @property
    def shares(self) -> NDArray[np.float64]:
        """Irradiance of each sample by the trapezoidal rule, shape (N,) [W m-2]."""
        reach = np.diff(self.wavelength_m)
        return np.asarray(self.weighted * 0.5 * (np.append(reach, 0.0) + np.append(0.0, reach)))

    def integral(self, factor: NDArray[np.float64]) -> NDArray[np.float64]:
        """Irradiance in the band after a spectral factor (..., N) [W m-2], by the trapezoidal rule."""
        return np.asarray(np.sum(self.shares * factor, axis=-1))


class DiffuseLight(Protocol):
    """Diffuse light of one sun position, one ground and one wavelength, per unit irradiance of the beam."""

    @property
    def mu0(self) -> float:
        """Cosine of the solar zenith angle."""
        ...

    @property
    def depth(self) -> float:
        """Extinction optical depth."""
        ...

    @property
    def ground_radiance(self) -> float:
        """Radiance that leaves the Lambertian ground [sr-1]."""
        ...

    @property
    def diffuse_irradiance(self) -> float:
        """Downward diffuse irradiance at the ground."""
        ...

    @property
    def converged(self) -> bool:
        """True if the requested tolerance was reached."""
        ...

    def stokes(
        self, tau_above: ArrayLike, mu: ArrayLike, phi_rad: ArrayLike, *, looking: Literal["up", "down"]
    ) -> NDArray[np.float64]:
        """Stokes radiance as in `model.atmosphere.solver.Solution.stokes`, shape (..., 3) [sr-1]."""
        ...


Light = TypeVar("Light", bound=DiffuseLight, covariant=True)


class HowToSolve(TypedDict):
    """Scene and numerical settings, as in `model.atmosphere.solver.solve`."""

    mu0: float
    albedo: float
    aerosol: AerosolKind
    nodes: int
    element_depth: float
    tolerance: float


class _SolverFor(Protocol[Light]):
    """Function with the arguments of `model.atmosphere.solver.solve`."""

    def __call__(self, layers: tuple[Layer, ...], **how: Unpack[HowToSolve]) -> Light:
        """Solve one wavelength."""
        ...


# The solver, a store of its solutions, or another engine.
Solver = _SolverFor[Solution]
LightSolver = _SolverFor[DiffuseLight]


@dataclass(frozen=True, kw_only=True)
class SolverSettings:
    """Numerical settings of a computed fidelity level.

    Attributes
    ----------
    fine_layers
        Whether the profile is cut in many layers.
    nodes, element_depth, tolerance
        As in `model.atmosphere.solver.solve`.
    matrix_tolerance
        Of the scattering matrix of spheres, as in `model.atmosphere.mie.aerosol_scattering`.
    layer_cuts
        Into how many parts each layer of the profile is cut.
    extrapolated
        Whether a second solution has each layer and element cut in two, and both are extrapolated to layers of no
        thickness.
    face_m
        Height of a face between layers at which light is read [m]; 0 for none.
    """

    fine_layers: bool
    nodes: int
    element_depth: float
    tolerance: float
    matrix_tolerance: float = 1e-3
    layer_cuts: int = 1
    extrapolated: bool = False
    face_m: float = 0.0


# Lines of sight with cached light, shared by the regions of a scene.
_KEPT = 64


@dataclass(frozen=True, kw_only=True)
class BandLighting:
    """Light in a band from solved atmospheres; a `model.atmosphere.sky.Lighting`."""

    columns: tuple[Column, ...]
    solutions: tuple[DiffuseLight, ...]
    irradiance: NDArray[np.float64]
    direct_irradiance: float
    wavelength_error: float
    _kept: dict[Hashable, NDArray[np.float64]] = field(default_factory=dict, init=False, repr=False, compare=False)

    @property
    def diffuse_irradiance(self) -> float:
        """Downward diffuse irradiance at the ground [W m-2]."""
        return float(self.irradiance @ [solution.diffuse_irradiance for solution in self.solutions])

    def sky(self, *, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> NDArray[np.float64]:
        """Stokes radiance of the sky at the ground without the beam, shape (..., 3) [W m-2 sr-1].

        [MK14] eq. (3): the downwelled sky radiance.
        """
        mu = _cosine(zenith_rad)
        return self._band([solution.stokes(solution.depth, mu, phi_rad, looking="up") for solution in self.solutions])

    def path(self, *, height_m: float, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> NDArray[np.float64]:
        """Stokes radiance added below a sensor over a black target, shape (..., 3) [W m-2 sr-1].

        [MK14] eq. (4).
        """
        mu, phi = _cosine(zenith_rad), np.asarray(phi_rad, dtype=float)

        def computed() -> NDArray[np.float64]:
            return self._band(
                [
                    path_radiance(solution, tau_above=above, mu=mu, phi_rad=phi)
                    for above, solution in zip(self._above(height_m), self.solutions, strict=True)
                ]
            )

        return self._once(("path", height_m, mu.shape, mu.tobytes(), phi.shape, phi.tobytes()), computed)

    def transmittance(self, *, height_m: float, zenith_rad: ArrayLike) -> NDArray[np.float64]:
        """Transmittance from the ground to a sensor, in the mean over the spectrum of the beam at the ground.

        Valid for a surface without colour; for others use the solutions at each wavelength.

        [MK14] eq. (4).
        """
        mu = _cosine(zenith_rad)

        def computed() -> NDArray[np.float64]:
            beam = self.irradiance * [np.exp(-one.depth / one.mu0) for one in self.solutions]
            each = [
                path_transmittance(tau_below=column.depth - above, mu=mu)
                for above, column in zip(self._above(height_m), self.columns, strict=True)
            ]
            return np.asarray(np.tensordot(beam / np.sum(beam), np.array(each), 1))

        return self._once(("transmittance", height_m, mu.shape, mu.tobytes()), computed)

    def _above(self, height_m: float) -> NDArray[np.float64]:
        """Optical depth above a height at each wavelength."""
        return self._once(("above", height_m), lambda: np.array([one.tau_above(height_m) for one in self.columns]))

    def _once(self, key: Hashable, compute: Callable[[], NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return a copy of the array kept under a key, computed at the first call."""
        found = self._kept.get(key)
        if found is None:
            found = compute()
            if len(self._kept) >= _KEPT:
                self._kept.clear()
            self._kept[key] = found
        return found.copy()

    def _band(self, each: list[NDArray[np.float64]]) -> NDArray[np.float64]:
        """Sum over the wavelengths."""
        return np.asarray(np.tensordot(self.irradiance, np.array(each), 1))


@dataclass(frozen=True, kw_only=True)
class AnalyticLighting:
    """A sky by formula with the beam and the path of another lighting; a `model.atmosphere.sky.Lighting`."""

    path_and_beam: Lighting
    mu0: float
    zenith_radiance: float
    dolp_max: float

    @property
    def direct_irradiance(self) -> float:
        """Irradiance of the beam at the ground on a plane normal to it [W m-2]."""
        return self.path_and_beam.direct_irradiance

    def sky(self, *, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> NDArray[np.float64]:
        """Stokes radiance of the sky by `analytic_sky`, shape (..., 3) [W m-2 sr-1]."""
        return analytic_sky(
            mu0=self.mu0,
            zenith_radiance=self.zenith_radiance,
            dolp_max=self.dolp_max,
            zenith_rad=zenith_rad,
            phi_rad=phi_rad,
        )

    def transmittance(self, *, height_m: float, zenith_rad: ArrayLike) -> NDArray[np.float64]:
        """Transmittance from the ground to a sensor."""
        return self.path_and_beam.transmittance(height_m=height_m, zenith_rad=zenith_rad)

    def path(self, *, height_m: float, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> NDArray[np.float64]:
        """Stokes radiance added below a sensor, shape (..., 3) [W m-2 sr-1]."""
        return self.path_and_beam.path(height_m=height_m, zenith_rad=zenith_rad, phi_rad=phi_rad)


@dataclass(frozen=True, kw_only=True)
class FidelityFacts:
    """Accuracy of a fidelity level, for views up to 80 degrees and a sun up to 75 degrees from the zenith.

    For spheres it holds at least ten degrees from the sun (three, except for dust). For dust the error of the radiance
    is 5 times as large in FAST and 40 times in STANDARD, that of the degree of polarization 2 and 3 times.
    """

    accuracy: str
    settings: SolverSettings | None  #: None for levels that call no solver


STANDARD_SETTINGS = SolverSettings(fine_layers=True, nodes=12, element_depth=0.05, tolerance=1e-5)

FIDELITY_LEVELS: Mapping[Fidelity, FidelityFacts] = MappingProxyType(
    {
        Fidelity.ANALYTIC: FidelityFacts(
            accuracy="geometry of the polarization only: no neutral points, angle of polarization off by up to "
            "8 deg, degree as given, radiance low by up to a factor 4",
            settings=None,
        ),
        Fidelity.SINGLE: FidelityFacts(
            accuracy="light scattered once is exact; the rest is missing: radiance low by a factor 0.25 to 0.94, "
            "degree of polarization too high by up to 0.33",
            settings=None,
        ),
        Fidelity.FAST: FidelityFacts(
            accuracy="radiance 0.3 % rms, 0.7 % at most; degree of polarization 1e-3",
            settings=SolverSettings(
                fine_layers=False, nodes=6, element_depth=0.1, tolerance=1e-3, matrix_tolerance=3e-3
            ),
        ),
        Fidelity.STANDARD: FidelityFacts(
            accuracy="radiance 2e-4, degree of polarization 1e-4",
            settings=STANDARD_SETTINGS,
        ),
        Fidelity.TABLE: FidelityFacts(
            accuracy="that of the table; between its nodes Stokes parameters are linear",
            settings=None,
        ),
    }
)


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
    """Return the light of one sun position in a band.

    `wavelengths` is their number; `split_at_kinks` divides the band at kinks of the aerosol's tables. `dolp_max` is the
    largest degree of polarization of the sky by formula. `settings` replace those of the level.
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


@dataclass(frozen=True, kw_only=True)
class UnlitSolution:
    """A `model.atmosphere.sky.DiffuseLight` without light."""

    mu0: float
    depth: float
    ground_radiance: float = 0.0
    diffuse_irradiance: float = 0.0
    converged: bool = True

    def stokes(
        self, tau_above: ArrayLike, mu: ArrayLike, phi_rad: ArrayLike, *, looking: Literal["up", "down"]
    ) -> NDArray[np.float64]:
        """Return zeros, shape (..., 3) [sr-1]."""
        shape = np.broadcast_shapes(np.shape(tau_above), np.shape(mu), np.shape(phi_rad))
        return np.zeros((*shape, 3))


def unlit_solution(layers: Sequence[Layer], *, mu0: float, **_: Any) -> UnlitSolution:
    """Return an atmosphere with the depth of these layers but without scattering; called like the solver."""
    return UnlitSolution(mu0=mu0, depth=float(sum(layer.full_depth for layer in layers)))


_NODES, _AZIMUTHS = 12, 36  # within 1e-3 for a forward peak of the aerosol that an expansion to MATRIX_DEGREE holds
MATRIX_DEGREE = 17


def single_solution(layers: Sequence[Layer], *, mu0: float, albedo: float, **_: object) -> Solution:
    """Diffuse light scattered once, and the beam's light from the ground; called like the solver.

    Exact for light scattered once. The rest, a quarter to three quarters of the radiance, is missing; the error is
    stated as 1.

    Chandrasekhar, Radiative Transfer (1950), section 7.
    """
    merged = merge_alike(layers)
    # The sky's irradiance is that of a matrix without its peak, and the peak's.
    smooth = truncated_by_absorption(merged, degree=MATRIX_DEGREE)
    sky = sky_irradiance(_beam_only(smooth, mu0=mu0, albedo=0.0))
    peak = single_peak_irradiance(merged, degree=MATRIX_DEGREE, mu0=mu0)
    return replace(_beam_only(merged, mu0=mu0, albedo=albedo), diffuse_irradiance=sky + peak)


def sky_irradiance(light: DiffuseLight) -> float:
    """Downward diffuse irradiance at the ground, per unit beam irradiance."""
    mu, weights = gauss_nodes(_NODES)
    phi_rad = 2.0 * pi * np.arange(_AZIMUTHS) / _AZIMUTHS
    sky = light.stokes(light.depth, mu, phi_rad[:, np.newaxis], looking="up")
    return 2.0 * pi * float(np.mean(sky[..., 0], axis=0) @ (weights * mu))


@dataclass(frozen=True, kw_only=True)
class TableLighting:
    """Light of one sun position in a band, from a table; a `model.atmosphere.sky.Lighting`.

    Attributes
    ----------
    direct_irradiance
        Irradiance of the beam at the ground on a plane normal to it [W m-2].
    zenith_rad
        Zenith angles of the sky and of the views, shape (Z,), increasing, two or more [rad].
    phi_rad
        Azimuth of the sun minus that of the point or sensor, shape (P,), increasing from 0 to 2 pi, or from 0 to pi
        for a table of one side of the principal plane, which the other side then mirrors [rad].
    sky_stokes
        Radiance of the sky, shape (Z, P, 3) [W m-2 sr-1].
    height_m
        Heights of sensors over the ground, shape (H,), increasing from 0, where nothing is added [m].
    path_transmittance
        Shape (H, Z), 0 to 1.
    path_stokes
        Radiance added below the sensor over a black target, shape (H, Z, P, 3) [W m-2 sr-1].

    Notes
    -----
    Stokes parameters are interpolated linearly in a frame that does not depend on azimuth, so that the zenith, where
    the frame of the conventions turns, needs no special treatment.
    """

    direct_irradiance: float
    zenith_rad: NDArray[np.float64]
    phi_rad: NDArray[np.float64]
    sky_stokes: NDArray[np.float64]
    height_m: NDArray[np.float64]
    path_transmittance: NDArray[np.float64]
    path_stokes: NDArray[np.float64]

    def __post_init__(self) -> None:
        if not 0.0 <= self.direct_irradiance < np.inf:
            raise ValueError(
                f"TableLighting: direct_irradiance = {self.direct_irradiance!r} W m-2, but it must be 0 or more"
            )
        for name, least in (("zenith_rad", 2), ("phi_rad", 2), ("height_m", 1)):
            axis = getattr(self, name)
            if axis.ndim != 1 or axis.size < least or not np.all(np.diff(axis) > 0.0):
                raise ValueError(f"TableLighting: {name} must hold {least} or more increasing numbers")
        first, last = self.phi_rad[[0, -1]]
        if abs(first) > _ROUNDING_RAD or min(abs(last - _TURN), abs(last - np.pi)) > _ROUNDING_RAD:
            raise ValueError(
                f"TableLighting: phi_rad runs from {first:.6g} to {last:.6g} rad, but it must run from 0 to pi or 2 pi"
            )
        heights, zeniths, azimuths = self.height_m.size, self.zenith_rad.size, self.phi_rad.size
        wanted = {
            "sky_stokes": (zeniths, azimuths, 3),
            "path_transmittance": (heights, zeniths),
            "path_stokes": (heights, zeniths, azimuths, 3),
        }
        for name, shape in wanted.items():
            table = getattr(self, name)
            if table.shape != shape or not np.all(np.isfinite(table)):
                raise ValueError(f"TableLighting: {name} must be finite and of shape {shape}, not {table.shape}")

    def sky(self, *, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> NDArray[np.float64]:
        """Stokes radiance of the sky, shape (..., 3) [W m-2 sr-1]; ValueError outside of the table."""
        return _read_directions(
            self.zenith_rad, *_whole_turn(self.phi_rad, self.sky_stokes), zenith_rad, phi_rad, looking="up"
        )

    def transmittance(self, *, height_m: float, zenith_rad: ArrayLike) -> NDArray[np.float64]:
        """Transmittance from the ground to a sensor; ValueError outside of the table."""
        table = self._at_height(self.path_transmittance, height_m)
        return _interpolate((self.zenith_rad,), table, np.asarray(zenith_rad, dtype=float)[..., np.newaxis])

    def path(self, *, height_m: float, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> NDArray[np.float64]:
        """Stokes radiance added below a sensor, shape (..., 3) [W m-2 sr-1]; ValueError outside of the table."""
        table = self._at_height(self.path_stokes, height_m)
        return _read_directions(self.zenith_rad, *_whole_turn(self.phi_rad, table), zenith_rad, phi_rad, looking="down")

    def _at_height(self, table: NDArray[np.float64], height_m: float) -> NDArray[np.float64]:
        """Table at one height, linear between the heights of the axis."""
        if not self.height_m[0] <= height_m <= self.height_m[-1]:
            raise ValueError(
                f"height_m = {height_m!r} m, the table holds {self.height_m[0]:.6g} to {self.height_m[-1]:.6g} m"
            )
        if self.height_m.size == 1:
            return np.asarray(table[0])
        return np.asarray(_between((self.height_m,), table, np.array([[height_m]]))[0])


@dataclass(frozen=True, kw_only=True, eq=False)
class MixedLighting:
    """Two lights mixed linearly; a `model.atmosphere.sky.Lighting`.

    Only light scattered once mixes linearly in a real atmosphere. The share makes the choice between two atmospheres a
    number with a derivative and a standard uncertainty.
    """

    first: Lighting
    second: Lighting
    share: float

    @property
    def direct_irradiance(self) -> float:
        """Irradiance of the beam at the ground on a plane normal to it [W m-2]."""
        return float(self._mixed(lambda light: np.array(light.direct_irradiance)))

    def sky(self, *, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> NDArray[np.float64]:
        """Stokes radiance of the sky; arguments as in `Lighting.sky`."""
        return self._mixed(lambda light: light.sky(zenith_rad=zenith_rad, phi_rad=phi_rad))

    def transmittance(self, *, height_m: float, zenith_rad: ArrayLike) -> NDArray[np.float64]:
        """Transmittance to a sensor; arguments as in `Lighting.transmittance`."""
        return self._mixed(lambda light: light.transmittance(height_m=height_m, zenith_rad=zenith_rad))

    def path(self, *, height_m: float, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> NDArray[np.float64]:
        """Stokes radiance added below a sensor; arguments as in `Lighting.path`."""
        return self._mixed(lambda light: light.path(height_m=height_m, zenith_rad=zenith_rad, phi_rad=phi_rad))

    def _mixed(self, part: Callable[[Lighting], NDArray[np.float64]]) -> NDArray[np.float64]:
        return np.asarray((1.0 - self.share) * part(self.first) + self.share * part(self.second))


def distance_factor(*, day_of_year: float) -> float:
    """Irradiance outside the atmosphere over that at the mean distance of the Sun, (R0/R)^2.

    The day counts from 1 on the first of January. Within 1e-3 of an ephemeris: Spencer, Search 2 (1971) 172.
    """
    if not 1.0 <= day_of_year < 367.0:
        raise ValueError(f"day_of_year = {day_of_year!r}, allowed is 1 to 367")
    angle = 2.0 * np.pi * (day_of_year - 1.0) / 365.0
    first = 1.000110 + 0.034221 * np.cos(angle) + 0.001280 * np.sin(angle)
    return float(first + 0.000719 * np.cos(2.0 * angle) + 0.000077 * np.sin(2.0 * angle))


@dataclass(frozen=True, kw_only=True, eq=False)
class SpectralRule:
    """Wavelengths at which to compute the ratio of radiance to solar irradiance, and their weights."""

    wavelength_m: FloatArray
    irradiance: FloatArray


# Relative to the band, so that a whole number is not rounded up.
_ROUNDING = 1e-9


def spectral_rule(
    *, wavelength_m: FloatArray, irradiance: FloatArray, count: int, kinks_m: Iterable[float] = ()
) -> SpectralRule:
    """Return a few wavelengths that represent a spectrum.

    K wavelengths integrate polynomials in 1/wavelength up to degree 2K - 1. A part with no more samples than
    wavelengths is used unchanged.

    Golub & Welsch, Math. Comput. 23 (1969) 221, doi:10.1090/S0025-5718-69-99647-1.
    """
    if count < 1:
        raise ValueError(f"count = {count!r}, allowed is 1 or more")
    lit = irradiance > 0.0
    if not np.any(lit):
        raise ValueError("spectral_rule: a spectrum without light")
    inverse, weight = 1.0 / wavelength_m[lit], irradiance[lit]
    stretch = np.searchsorted(np.sort(-1.0 / np.array([*kinks_m], dtype=float)), -inverse)
    width = abs(float(inverse[-1] - inverse[0])) or 1.0
    parts = []
    for own in (stretch == k for k in sorted(set(stretch.tolist()))):
        share = abs(float(inverse[own][-1] - inverse[own][0])) / width
        parts.append(_gauss(inverse[own], weight[own], max(ceil(count * share - _ROUNDING), 1)))
    return SpectralRule(
        wavelength_m=np.concatenate([1.0 / nodes for nodes, _ in parts]),
        irradiance=np.concatenate([weights for _, weights in parts]),
    )


def solve_column(
    solver: LightSolver, column: Column, settings: SolverSettings, *, mu0: float, albedo: float, aerosol: AerosolKind
) -> DiffuseLight:
    """Return the diffuse light of one wavelength."""
    if settings.extrapolated:
        plain = replace(settings, extrapolated=False)
        halved = replace(plain, layer_cuts=2 * plain.layer_cuts, element_depth=0.5 * plain.element_depth)
        coarse, fine = (
            solve_column(solver, column, one, mu0=mu0, albedo=albedo, aerosol=aerosol) for one in (plain, halved)
        )
        return _ExtrapolatedLight(coarse=coarse, fine=fine)
    return solver(
        column.layers(
            fine=settings.fine_layers,
            aerosol=aerosol,
            matrix_tolerance=settings.matrix_tolerance,
            cuts=settings.layer_cuts,
            face_m=settings.face_m,
        ),
        mu0=mu0,
        albedo=albedo,
        aerosol=aerosol,
        nodes=settings.nodes,
        element_depth=settings.element_depth,
        tolerance=settings.tolerance,
    )


def analytic_lighting(path_and_beam: BandLighting, *, mu0: float, dolp_max: float) -> AnalyticLighting:
    """Return a sky by formula that has the radiance of another at the zenith.

    See `analytic_sky`.
    """
    zenith = float(path_and_beam.sky(zenith_rad=0.0, phi_rad=0.0)[0])
    return AnalyticLighting(path_and_beam=path_and_beam, mu0=mu0, zenith_radiance=zenith, dolp_max=dolp_max)


def _cosine(zenith_rad: ArrayLike) -> NDArray[np.float64]:
    """Cosine of zenith angles that were checked; exactly 0 at the horizon."""
    zenith = np.asarray(zenith_rad, dtype=float)
    if not np.all((zenith >= 0.0) & (zenith <= np.pi / 2.0)):
        raise ValueError("zenith_rad must be 0 to pi/2 rad")
    return np.asarray(np.sin(np.pi / 2.0 - zenith))


def path_radiance(
    solution: DiffuseLight, *, tau_above: ArrayLike, mu: ArrayLike, phi_rad: ArrayLike
) -> NDArray[np.float64]:
    """Stokes radiance that the air below a sensor adds over a black target, per unit beam irradiance [sr-1].

    [MK14] eq. (4): the upwelled radiance; with light from the surroundings scattered into the line of sight.
    """
    tau = np.asarray(tau_above, dtype=float)
    stokes = solution.stokes(tau, mu, phi_rad, looking="down")
    below = np.maximum(solution.depth - tau, 0.0)
    stokes[..., 0] -= solution.ground_radiance * path_transmittance(tau_below=below, mu=mu)
    return stokes


def path_transmittance(*, tau_below: ArrayLike, mu: ArrayLike) -> NDArray[np.float64]:
    """Transmittance from the ground to a sensor.

    [MK14] eq. (4): the transmittance tau of direct and of diffuse reflected light.
    """
    return np.exp(-slant(np.asarray(tau_below, dtype=float), np.asarray(mu, dtype=float)))


def analytic_sky(
    *, mu0: float, zenith_radiance: float, dolp_max: float, zenith_rad: ArrayLike, phi_rad: ArrayLike
) -> NDArray[np.float64]:
    """Stokes radiance of a clear sky by formula, shape (..., 3), in the unit of the zenith radiance.

    Vibration across the scattering plane, as for light scattered once: there are no neutral points near the sun.

    ISO 15469:2004 / CIE S 011, sky type 12 (radiance); Rayleigh's law (polarization).
    """
    zenith, phi = np.broadcast_arrays(np.asarray(zenith_rad, dtype=float), np.asarray(phi_rad, dtype=float))
    mu = np.maximum(np.cos(zenith), 0.0)
    beam = np.sqrt(1.0 - mu0**2)
    from_sun = np.arccos(np.clip(mu * mu0 + np.sin(zenith) * beam * np.cos(phi), -1.0, 1.0))
    radiance = _gradation(mu) * _indicatrix(from_sun)
    radiance *= zenith_radiance / (_gradation(np.array(1.0)) * _indicatrix(np.arccos(np.array(mu0))))
    column = rayleigh_column(mu=-mu, beam_mu=-mu0, phi_rad=phi)
    share = column / column[..., :1] * np.array([1.0, -dolp_max, -dolp_max])
    return np.asarray(radiance[..., np.newaxis] * share)


_GRADATION = (-1.0, -0.32)
_INDICATRIX = (10.0, -3.0, 0.45)


def _gradation(mu: NDArray[np.float64]) -> NDArray[np.float64]:
    """Radiance over zenith angle."""
    factor, rate = _GRADATION
    exponent = np.full(mu.shape, -np.inf)
    np.divide(rate, mu, out=exponent, where=mu > 0.0)
    return np.asarray(1.0 + factor * np.exp(exponent))


def _indicatrix(from_sun_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Radiance over the angle from the sun."""
    factor, rate, back = _INDICATRIX
    peak = np.exp(rate * from_sun_rad) - np.exp(rate * np.pi / 2.0)
    return np.asarray(1.0 + factor * peak + back * np.cos(from_sun_rad) ** 2)


def _gauss(inverse: FloatArray, weight: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Gauss's nodes for a sum over samples, falling, and their weights: eigenvalues of Lanczos's tridiagonal matrix."""
    if inverse.size <= count:
        return inverse, weight
    vectors = np.sqrt(weight / np.sum(weight))[:, np.newaxis]
    scaled = (inverse - np.mean(inverse)) / np.ptp(inverse)
    jacobi = np.zeros((count, count))
    for k in range(count):
        following = scaled * vectors[:, k]
        jacobi[k, k] = following @ vectors[:, k]
        # Twice, against rounding.
        for _ in range(2):
            following = following - vectors @ (vectors.T @ following)
        if k + 1 < count:
            jacobi[k, k + 1] = jacobi[k + 1, k] = np.linalg.norm(following)
            vectors = np.column_stack([vectors, following / jacobi[k, k + 1]])
    values, eigen = np.linalg.eigh(jacobi)
    nodes = values[::-1] * np.ptp(inverse) + np.mean(inverse)
    return nodes, np.sum(weight) * eigen[0, ::-1] ** 2


@dataclass(frozen=True, kw_only=True)
class _ExtrapolatedLight:
    """A `model.atmosphere.sky.DiffuseLight` from two others: Richardson's extrapolation.

    At faces the remaining error falls as the fourth power of the layers' thickness. Within a layer it falls as the
    square, because the error is not a smooth function of the depth.

    L. F. Richardson, Phil. Trans. R. Soc. A 210 (1911) 307, doi:10.1098/rsta.1911.0009.
    """

    coarse: DiffuseLight
    fine: DiffuseLight

    @property
    def mu0(self) -> float:
        """Cosine of the solar zenith angle."""
        return self.fine.mu0

    @property
    def depth(self) -> float:
        """Extinction optical depth, that of both."""
        return self.fine.depth

    @property
    def ground_radiance(self) -> float:
        """Radiance that leaves the Lambertian ground [sr-1]."""
        return _extrapolated(self.coarse.ground_radiance, self.fine.ground_radiance)

    @property
    def diffuse_irradiance(self) -> float:
        """Downward diffuse irradiance at the ground."""
        return _extrapolated(self.coarse.diffuse_irradiance, self.fine.diffuse_irradiance)

    @property
    def converged(self) -> bool:
        """True if both reached the requested tolerance."""
        return self.coarse.converged and self.fine.converged

    def stokes(
        self, tau_above: ArrayLike, mu: ArrayLike, phi_rad: ArrayLike, *, looking: Literal["up", "down"]
    ) -> NDArray[np.float64]:
        """Stokes radiance as in `model.atmosphere.solver.Solution.stokes`, shape (..., 3) [sr-1]."""
        coarse, fine = (one.stokes(tau_above, mu, phi_rad, looking=looking) for one in (self.coarse, self.fine))
        return _extrapolated(coarse, fine)


def _extrapolated(coarse: Number, fine: Number) -> Number:
    return fine + (fine - coarse) / 3.0


def _beam_only(layers: Sequence[Layer], *, mu0: float, albedo: float) -> Solution:
    """Light scattered once, without its irradiance."""
    edges = np.cumsum([0.0, *(layer.depth for layer in layers)])
    return Solution(
        layers=tuple(layers),
        mu0=mu0,
        edges=edges,
        blocks=(),
        ground_radiance=albedo / pi * mu0 * exp(-float(edges[-1]) / mu0),
        diffuse_irradiance=0.0,
        orders=1,
        converged=False,
    )


def _band_lighting(
    state: AtmosphereState,
    band: SolarBand,
    ozone: NDArray[np.float64],
    rule: SpectralRule,
    columns: tuple[Column, ...],
    solutions: tuple[DiffuseLight, ...],
) -> BandLighting:
    """Sum over wavelengths; the cheap beam at all samples of the spectrum."""
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


_TURN = 2.0 * np.pi
_ROUNDING_RAD = 1e-9


def _read_directions(
    zenith_axis_rad: NDArray[np.float64],
    phi_axis_rad: NDArray[np.float64],
    stokes: NDArray[np.float64],
    zenith_rad: ArrayLike,
    phi_rad: ArrayLike,
    *,
    looking: Literal["up", "down"],
) -> NDArray[np.float64]:
    """Table (Z, P, 3) at directions."""
    zenith, phi = np.broadcast_arrays(np.asarray(zenith_rad, dtype=float), np.asarray(phi_rad, dtype=float))
    sense = 1.0 if looking == "up" else -1.0
    fixed = _turned(stokes, -sense * phi_axis_rad)
    points = np.stack([zenith, np.mod(phi, _TURN)], axis=-1)
    return _turned(_interpolate((zenith_axis_rad, phi_axis_rad), fixed, points), sense * phi)


def _turned(stokes: NDArray[np.float64], angle_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Stokes parameters with their vibration turned counter-clockwise."""
    return rotate_frame(stokes, -angle_rad)


def _interpolate(
    axes: tuple[NDArray[np.float64], ...], table: NDArray[np.float64], points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Linear interpolation within the table's zenith angles."""
    zenith, axis = points[..., 0], axes[0]
    if not np.all((zenith >= axis[0]) & (zenith <= axis[-1])):
        raise ValueError(
            f"zenith_rad runs from {np.min(zenith):.6g} to {np.max(zenith):.6g} rad, "
            f"the table holds {axis[0]:.6g} to {axis[-1]:.6g} rad"
        )
    # The last azimuth may differ from a whole turn by rounding.
    return _between(axes, table, points).reshape((*zenith.shape, *table.shape[len(axes) :]))


def _between(
    axes: tuple[NDArray[np.float64], ...], table: NDArray[np.float64], points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return a table interpolated linearly, and extrapolated beyond its last nodes."""
    from scipy.interpolate import RegularGridInterpolator

    return np.asarray(RegularGridInterpolator(axes, table, bounds_error=False, fill_value=None)(points))


def _whole_turn(
    phi_rad: NDArray[np.float64], stokes: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Table (Z, P, 3) over a whole turn; the other side of the principal plane has S2 of the other sign."""
    if phi_rad[-1] > np.pi + _ROUNDING_RAD:
        return phi_rad, stokes
    mirrored = stokes[:, -2::-1] * np.array([1.0, 1.0, -1.0])
    return np.concatenate([phi_rad, _TURN - phi_rad[-2::-1]]), np.concatenate([stokes, mirrored], axis=1)
