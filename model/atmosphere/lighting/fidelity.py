"""Fidelity levels of an atmosphere: the effort that goes into it, and the accuracy that it buys."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType


class Fidelity(StrEnum):
    """Levels of effort."""

    ANALYTIC = "analytic"
    SINGLE = "single"
    FAST = "fast"
    STANDARD = "standard"
    TABLE = "table"


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
        Of the scattering matrix of spheres, as in `model.atmosphere.aerosol.mie_aerosol.aerosol_scattering`.
    layer_cuts
        Into how many parts each layer of the profile is cut.
    extrapolated
        Whether each of these layers and elements is cut in two in a second solution, and both are extrapolated to
        layers of no thickness.
    face_m
        Height at which a layer ends, for light is read there [m]; 0 for none.
    """

    fine_layers: bool
    nodes: int
    element_depth: float
    tolerance: float
    matrix_tolerance: float = 1e-3
    layer_cuts: int = 1
    extrapolated: bool = False
    face_m: float = 0.0


@dataclass(frozen=True, kw_only=True)
class FidelityFacts:
    """Accuracy of a fidelity level, for views up to 80 degrees and a sun up to 75 degrees from the zenith.

    Of spheres it holds ten degrees and more from the sun (three, but for dust); of dust, the radiance is off by 5 times
    as much in FAST and 40 times in STANDARD, the degree of polarization by 2 and 3 times. Their scattering matrix costs
    up to a second more for each wavelength, once.

    Attributes
    ----------
    accuracy
        In words; against the same atmosphere solved without compromise.
    seconds
        Time of one wavelength on one core of 2020s, all levels and 171 directions; 0 where nothing is computed.
    settings
        What the solver is told; None where it is not called.
    """

    accuracy: str
    seconds: float
    settings: SolverSettings | None


STANDARD_SETTINGS = SolverSettings(fine_layers=True, nodes=12, element_depth=0.05, tolerance=1e-5)

FIDELITY_LEVELS: Mapping[Fidelity, FidelityFacts] = MappingProxyType(
    {
        Fidelity.ANALYTIC: FidelityFacts(
            accuracy="geometry of the polarization only: no neutral points, angle of polarization off by up to "
            "8 deg, degree as given, radiance low by up to a factor 4",
            seconds=0.02,
            settings=None,
        ),
        Fidelity.SINGLE: FidelityFacts(
            accuracy="light scattered once is exact; the rest is missing: radiance low by a factor 0.25 to 0.94, "
            "degree of polarization too high by up to 0.33",
            seconds=0.02,
            settings=None,
        ),
        Fidelity.FAST: FidelityFacts(
            accuracy="radiance 0.3 % rms, 0.7 % at most; degree of polarization 1e-3",
            seconds=0.02,
            settings=SolverSettings(
                fine_layers=False, nodes=6, element_depth=0.1, tolerance=1e-3, matrix_tolerance=3e-3
            ),
        ),
        Fidelity.STANDARD: FidelityFacts(
            accuracy="radiance 2e-4, degree of polarization 1e-4",
            seconds=0.08,
            settings=STANDARD_SETTINGS,
        ),
        Fidelity.TABLE: FidelityFacts(
            accuracy="that of the table; between its nodes Stokes parameters are linear",
            seconds=0.0,
            settings=None,
        ),
    }
)
