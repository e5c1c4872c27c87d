"""One wavelength of an atmosphere, solved with the settings of a fidelity level."""

from dataclasses import replace
from typing import Protocol, TypedDict, TypeVar, Unpack

from model.atmosphere.lighting.diffuse_light import DiffuseLight
from model.atmosphere.lighting.extrapolated_light import ExtrapolatedLight
from model.atmosphere.lighting.fidelity import SolverSettings
from model.atmosphere.profile import Column
from model.atmosphere.transfer.layers import Layer
from model.atmosphere.transfer.phase import AerosolKind
from model.atmosphere.transfer.solution import Solution

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

    References
    ----------
    definition
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
