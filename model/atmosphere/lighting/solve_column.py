"""One wavelength of an atmosphere, solved with the settings of a fidelity level."""

from dataclasses import dataclass, replace
from typing import Literal, Protocol, TypedDict, TypeVar, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.atmosphere.lighting.diffuse_light import DiffuseLight
from model.atmosphere.lighting.fidelity import SolverSettings
from model.atmosphere.profile import Column
from model.atmosphere.transfer.layers import Layer
from model.atmosphere.transfer.phase import AerosolKind
from model.atmosphere.transfer.solution import Solution

Number = TypeVar("Number", float, NDArray[np.float64])


@dataclass(frozen=True, kw_only=True)
class ExtrapolatedLight:
    """A `model.atmosphere.lighting.diffuse_light.DiffuseLight` from two others: Richardson's extrapolation.

    Attributes
    ----------
    coarse
        Light of some layers.
    fine
        Of the same layers, each cut in two; so are the solver's elements in each.

    Notes
    -----
    What is left of the layers' error falls as the fourth power of their thickness, at their faces. Within a layer
    it falls as the square: of where in it one reads the light the error is no smooth function.

    References
    ----------
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
        """True if both have what was asked for."""
        return self.coarse.converged and self.fine.converged

    @property
    def error_estimate(self) -> float:
        """Estimated error of the radiance as a share of its mean, but for layers: that of the finer one."""
        return self.fine.error_estimate

    def stokes(
        self, tau_above: ArrayLike, mu: ArrayLike, phi_rad: ArrayLike, *, looking: Literal["up", "down"]
    ) -> NDArray[np.float64]:
        """Stokes radiance as `model.atmosphere.transfer.solution.Solution.stokes` has it, shape (..., 3) [sr-1]."""
        coarse, fine = (one.stokes(tau_above, mu, phi_rad, looking=looking) for one in (self.coarse, self.fine))
        return _extrapolated(coarse, fine)


def _extrapolated(coarse: Number, fine: Number) -> Number:
    return fine + (fine - coarse) / 3.0


Light = TypeVar("Light", bound=DiffuseLight, covariant=True)


class HowToSolve(TypedDict):
    """Scene and numerical settings of `model.atmosphere.solver.solve`, which says what they are."""

    mu0: float
    albedo: float
    aerosol: AerosolKind
    nodes: int
    element_depth: float
    tolerance: float


class _SolverFor(Protocol[Light]):
    """A call like that of `model.atmosphere.solver.solve`."""

    def __call__(self, layers: tuple[Layer, ...], **how: Unpack[HowToSolve]) -> Light:
        """Solve one wavelength."""
        ...


# The solver itself, or a store of its solutions that an application puts in its place; and, where only the light
# counts, also another engine.
Solver = _SolverFor[Solution]
LightSolver = _SolverFor[DiffuseLight]


def solve_column(
    solver: LightSolver, column: Column, settings: SolverSettings, *, mu0: float, albedo: float, aerosol: AerosolKind
) -> DiffuseLight:
    """Return the diffuse light of one wavelength.

    Parameters
    ----------
    solver
        What solves layers.
    column
        The atmosphere at this wavelength.
    settings
        What the solver is told, and into which layers the atmosphere is cut.
    mu0
        Cosine of the solar zenith angle.
    albedo
        Of the ground, 0 to 1.
    aerosol
        What it does to polarization.

    Raises
    ------
    ValueError
        A number is outside the solver's range.
    """
    if settings.extrapolated:
        plain = replace(settings, extrapolated=False)
        halved = replace(plain, layer_cuts=2 * plain.layer_cuts, element_depth=0.5 * plain.element_depth)
        coarse, fine = (
            solve_column(solver, column, one, mu0=mu0, albedo=albedo, aerosol=aerosol) for one in (plain, halved)
        )
        return ExtrapolatedLight(coarse=coarse, fine=fine)
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
