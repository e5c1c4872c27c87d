"""Materials: properties of surfaces, each with its uncertainty, its source and its confidence.

A `Material` has a `Property` for each number of a `Surface`, constant or as a table over wavelength; `surface_of` takes
them at one wavelength. A measured material is a table of geometries instead (`tabulated`). `MATERIALS` are those to
begin with: most of their values are assumed. Replace them by what was measured.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from types import MappingProxyType
from typing import Any, Literal, get_args

import numpy as np

from model.surface.facets import Shadowing
from model.surface.pbrdf import DiffuseKind, Surface
from model.surface.table import MeasuredTable, TabulatedBrdf

Confidence = Literal["high", "medium", "low"]
# 700 nm and 700e-9 m may differ by rounding; the ends of a table are inside it all the same.
_ROUNDING = 1e-12
# A table has no facets; this slope spreads the directions from which its light is summed.
_TABLE_SLOPE = 0.3
CONFIDENCE: tuple[Confidence, ...] = get_args(Confidence)


@dataclass(frozen=True, kw_only=True)
class Property:
    """One property of a material, a constant or a table over wavelength.

    Parameters
    ----------
    values
        One value, or one for each wavelength of the table.
    wavelengths_m
        Wavelengths in air of the table [m], ascending; empty for a constant.
    standard_uncertainty
        Of the value, in its unit; 0 for an exact number.
    source
        Where it comes from, in words.
    confidence
        "high", "medium" or "low".
    assumed
        True for a value that was not measured on this surface or one of its kind.

    Raises
    ------
    ValueError
        If the table's lengths differ, its wavelengths do not ascend, or a number is not finite.
    """

    values: tuple[float, ...]
    wavelengths_m: tuple[float, ...] = ()
    standard_uncertainty: float
    source: str
    confidence: Confidence
    assumed: bool

    def __post_init__(self) -> None:
        if len(self.values) != (len(self.wavelengths_m) or 1):
            raise ValueError(
                f"{len(self.values)} values and {len(self.wavelengths_m)} wavelengths; allowed is one value alone, or "
                "as many of each"
            )
        if not np.all(np.isfinite((*self.values, *self.wavelengths_m))):
            raise ValueError(f"values = {self.values} at {self.wavelengths_m} m; allowed are finite numbers")
        if np.any(np.diff((0.0, *self.wavelengths_m)) <= 0.0):
            raise ValueError(f"wavelengths_m = {self.wavelengths_m} m; allowed is ascending from above 0")
        if not (math.isfinite(self.standard_uncertainty) and self.standard_uncertainty >= 0.0):
            raise ValueError(f"standard_uncertainty = {self.standard_uncertainty}; allowed is 0 and above")
        if self.confidence not in CONFIDENCE:
            raise ValueError(f"confidence = {self.confidence!r}; allowed are {', '.join(map(repr, CONFIDENCE))}")
        if not self.source.strip():
            raise ValueError("source is empty; say where the value comes from")

    def at(self, wavelength_m: float) -> float:
        """Return the value at a wavelength, linearly between the table's.

        Parameters
        ----------
        wavelength_m
            Wavelength in air [m]; a constant holds at all of them.

        Returns
        -------
        float
            In the property's unit.

        Raises
        ------
        ValueError
            If the wavelength is outside the table: nothing is extrapolated.
        """
        if not self.wavelengths_m:
            return self.values[0]
        low, high = self.wavelengths_m[0], self.wavelengths_m[-1]
        if not low * (1.0 - _ROUNDING) <= wavelength_m <= high * (1.0 + _ROUNDING):
            raise ValueError(
                f"wavelength_m = {wavelength_m} m; the table ({self.source}) covers {low * 1e9:.4g} to "
                f"{high * 1e9:.4g} nm; give a value for this wavelength"
            )
        return float(np.interp(wavelength_m, self.wavelengths_m, self.values))


@dataclass(frozen=True, kw_only=True)
class Material:
    """A material, by its properties or as a table of measurements; see `Surface` for what the properties mean.

    Parameters
    ----------
    name
        What people call it.
    n, k, slope_rms, specular_weight
        Properties; None of a table.
    dhr
        Property, or None: no diffuse term.
    single_scattering, asymmetry, single_dolp, depolarization
        Properties, or None where the diffuse term does not count what one particle scatters.
    dhr_angle_rad
        Zenith angle at which the DHR was measured [rad].
    diffuse
        Form of the diffuse term that describes it.
    table
        Measured geometries, or what they make of one wavelength.
    table_f00, table_s1, table_s2
        Errors of a table in its standard errors: 0 with an uncertainty of 1.
    """

    name: str
    n: Property | None = None
    k: Property | None = None
    slope_rms: Property | None = None
    dhr: Property | None = None
    specular_weight: Property | None = None
    single_scattering: Property | None = None
    asymmetry: Property | None = None
    single_dolp: Property | None = None
    depolarization: Property | None = None
    dhr_angle_rad: float = math.radians(8.0)
    diffuse: DiffuseKind = "coupled"
    table: MeasuredTable | TabulatedBrdf | None = None
    table_f00: Property | None = None
    table_s1: Property | None = None
    table_s2: Property | None = None

    def at(self, wavelength_m: float) -> "Material":
        """Return the material with the properties that it has at one wavelength.

        Parameters
        ----------
        wavelength_m
            Wavelength in air [m].

        Returns
        -------
        Material
            All its properties are constants.

        Raises
        ------
        ValueError
            If the wavelength is outside a table.
        """
        at: dict[str, Any] = {
            name: replace(found, values=(found.at(wavelength_m),), wavelengths_m=())
            for name, found in properties(self).items()
        }
        table = self.table.at(wavelength_m) if isinstance(self.table, MeasuredTable) else self.table
        return replace(self, **at, table=table)


def tabulated(name: str, table: MeasuredTable) -> Material:
    """Return the material that a table of measured geometries describes.

    Its properties are the errors of the table, which a prediction counts like those of other materials.
    """
    error = constant(
        0.0,
        standard_uncertainty=1.0,
        source=f"interpolation and noise of {table.source}, in standard errors",
        confidence="high",
        assumed=False,
    )
    return Material(name=name, table=table, table_f00=error, table_s1=error, table_s2=error)


def constant(
    value: float, *, standard_uncertainty: float, source: str, confidence: Confidence, assumed: bool
) -> Property:
    """Return a property that is the same at all wavelengths; arguments as in `Property`."""
    return Property(
        values=(float(value),),
        standard_uncertainty=standard_uncertainty,
        source=source,
        confidence=confidence,
        assumed=assumed,
    )


def surface_of(
    material: Material,
    *,
    wavelength_m: float,
    shadowing: Shadowing = "v-cavity",
    diffuse: DiffuseKind | None = None,
) -> Surface:
    """Return the surface that a material makes at one wavelength.

    Parameters
    ----------
    wavelength_m
        Wavelength in air [m].
    shadowing
        As in `Surface`.
    diffuse
        As in `Surface`; None is the material's own.

    Returns
    -------
    Surface
        Ready for `mueller`.

    Raises
    ------
    ValueError
        If the wavelength is outside a table, or the values form no possible surface.
    """
    if not (math.isfinite(wavelength_m) and wavelength_m > 0.0):
        raise ValueError(f"wavelength_m = {wavelength_m} m; allowed is above 0")
    try:
        return surface_here(material.at(wavelength_m), shadowing=shadowing, diffuse=diffuse)
    except ValueError as error:
        raise ValueError(f"material {material.name!r} at {wavelength_m * 1e9:.4g} nm: {error}") from error


def surface_here(here: Material, *, shadowing: Shadowing = "v-cavity", diffuse: DiffuseKind | None = None) -> Surface:
    """Return the surface of a material whose properties are those of one wavelength, as `Material.at` gives them."""
    values: dict[str, Any] = {name: found.values[0] for name, found in properties(here).items()}
    if isinstance(here.table, TabulatedBrdf):
        values |= {"table": here.table, "n": 1.0, "slope_rms": _TABLE_SLOPE, "specular_weight": 0.0}
    return Surface(
        **values,
        dhr_angle_rad=here.dhr_angle_rad,
        shadowing=shadowing,
        diffuse=here.diffuse if diffuse is None else diffuse,
    )


def properties(material: Material) -> dict[str, Property]:
    """Return the properties that a material has, by name, in the order of its fields."""
    named = {field.name: getattr(material, field.name) for field in fields(material)}
    return {name: value for name, value in named.items() if isinstance(value, Property)}


def assumed_properties(material: Material) -> tuple[str, ...]:
    """Return the names of the properties that are assumed, to be shown wherever the material is."""
    return tuple(name for name, value in properties(material).items() if value.assumed)


_BINDER = (
    "acrylic binder: 1.4946 at 550 nm, Zhang et al. (2020), via refractiveindex.info; urethanes about 1.48 to 1.50"
)
_FITTED_COATS = (
    "fits of the same lobe to man-made coats, slope 0.105 to 0.163 per axis, Photonics 12(1), 17 (2025), appendix A; "
    "0.10 semi-gloss, 0.25 matte"
)
_DIELECTRIC = "dielectric: absorption at the first surface is negligible"
_ALL_SHOWN = constant(
    1.0,
    standard_uncertainty=0.0,
    source="clean surface; dust and pores lower it: fit it",
    confidence="low",
    assumed=True,
)


def _no_absorption(standard_uncertainty: float) -> Property:
    return constant(
        0.0,
        standard_uncertainty=standard_uncertainty,
        source=_DIELECTRIC,
        confidence="medium",
        assumed=True,
    )


_COAT_SLOPE = constant(0.15, standard_uncertainty=0.04, source=_FITTED_COATS, confidence="low", assumed=True)

_BLACK_PAINT = Material(
    name="black paint",
    n=constant(1.50, standard_uncertainty=0.03, source=_BINDER, confidence="medium", assumed=True),
    k=_no_absorption(0.05),
    slope_rms=_COAT_SLOPE,
    dhr=constant(
        0.05,
        standard_uncertainty=0.005,
        source="black coats reflect 0.045 to 0.06 in the visible",
        confidence="medium",
        assumed=True,
    ),
    specular_weight=_ALL_SHOWN,
)

_WHITE_PAINT = Material(
    name="white paint",
    n=constant(1.50, standard_uncertainty=0.03, source=_BINDER, confidence="medium", assumed=True),
    k=_no_absorption(0.01),
    slope_rms=_COAT_SLOPE,
    dhr=constant(
        0.80,
        standard_uncertainty=0.05,
        source="titanium dioxide coats reflect 0.70 to 0.88 in the visible",
        confidence="medium",
        assumed=True,
    ),
    specular_weight=_ALL_SHOWN,
)

_ASPHALT = Material(
    name="asphalt",
    n=constant(
        1.60,
        standard_uncertainty=0.04,
        source="bitumen 1.635 in index lists; mineral grains 1.50 to 1.64",
        confidence="low",
        assumed=True,
    ),
    k=_no_absorption(0.05),
    slope_rms=constant(
        0.30,
        standard_uncertainty=0.06,
        source="no measurement known; 0.25 to 0.45 is plausible",
        confidence="low",
        assumed=True,
    ),
    dhr=constant(
        0.09,
        standard_uncertainty=0.03,
        source="visible albedo of roads: fresh 0.04 to 0.06, aged 0.12 to 0.15",
        confidence="medium",
        assumed=True,
    ),
    specular_weight=_ALL_SHOWN,
)

_GLASS = Material(
    name="glass",
    n=Property(
        values=(1.53085, 1.52532, 1.52141, 1.51852, 1.51629, 1.51452, 1.51306, 1.51078, 1.50900, 1.50750),
        wavelengths_m=(400e-9, 450e-9, 500e-9, 550e-9, 600e-9, 650e-9, 700e-9, 800e-9, 900e-9, 1000e-9),
        standard_uncertainty=0.005,
        source="SCHOTT N-BK7 crown glass, Sellmeier formula of the 2017 catalogue; float glass is within 0.01",
        confidence="high",
        assumed=False,
    ),
    k=constant(0.0, standard_uncertainty=1e-6, source="SCHOTT catalogue 2017", confidence="high", assumed=False),
    slope_rms=constant(
        0.02,
        standard_uncertainty=0.01,
        source="polished, seen as a narrow lobe; no measurement",
        confidence="low",
        assumed=True,
    ),
    dhr=None,
    specular_weight=_ALL_SHOWN,
)

_RAKIC = "evaporated film, Rakic (1995), doi:10.1364/AO.34.004755, via refractiveindex.info; a rolled sheet differs"
_ALUMINIUM_WAVELENGTHS_M = (
    364.66e-9,
    413.28e-9, 442.80e-9, 476.87e-9, 516.60e-9, 563.57e-9, 619.93e-9, 652.25e-9, 688.81e-9, 729.32e-9,
    774.91e-9, 794.78e-9, 815.69e-9, 837.74e-9, 885.61e-9, 911.66e-9, 939.28e-9, 968.63e-9, 999.88e-9,
)  # fmt: skip

_ALUMINIUM = Material(
    name="aluminium",
    n=Property(
        values=(
            0.39877,
            0.52135, 0.60790, 0.72780, 0.87340, 1.0728, 1.3660, 1.5724, 1.8301, 2.1606,
            2.6154, 2.7675, 2.7668, 2.6945, 2.2802, 1.9739, 1.6784, 1.4867, 1.4359,
        ),
        wavelengths_m=_ALUMINIUM_WAVELENGTHS_M,
        standard_uncertainty=0.1,
        source=_RAKIC,
        confidence="high",
        assumed=False,
    ),
    k=Property(
        values=(
            4.3957,
            5.0008, 5.3676, 5.7781, 6.2418, 6.7839, 7.4052, 7.7354, 8.0601, 8.3565,
            8.4914, 8.3866, 8.2573, 8.1878, 8.1134, 8.3058, 8.5970, 9.0655, 9.4939,
        ),
        wavelengths_m=_ALUMINIUM_WAVELENGTHS_M,
        standard_uncertainty=0.2,
        source=_RAKIC,
        confidence="high",
        assumed=False,
    ),
    slope_rms=constant(
        0.15,
        standard_uncertainty=0.06,
        source="no measurement; 0.1 to 0.3 is plausible for a brushed or blasted sheet",
        confidence="low",
        assumed=True,
    ),
    dhr=None,
    specular_weight=_ALL_SHOWN,
)  # fmt: skip

_GERMER = (
    "fitted to the Mueller BRDF of Germer, Appl. Opt. 56, 9333 (2017), incidence 15 to 75 deg; "
    "uncertainty by a jackknife over the angles of incidence"
)
_GERMER_WAVELENGTHS_M = (351e-9, 532e-9, 633e-9, 1064e-9)


def _of_germer(*values: float, standard_uncertainty: float) -> Property:
    return Property(
        values=values,
        wavelengths_m=_GERMER_WAVELENGTHS_M,
        standard_uncertainty=standard_uncertainty,
        source=_GERMER,
        confidence="high",
        assumed=False,
    )


_SINTERED_PTFE = Material(
    name="sintered PTFE",
    n=constant(
        1.35,
        standard_uncertainty=0.02,
        source="PTFE, index lists: 1.35 to 1.38; of the fits no more than n with specular_weight is determined",
        confidence="medium",
        assumed=True,
    ),
    k=_no_absorption(0.001),
    slope_rms=constant(0.315, standard_uncertainty=0.03, source=_GERMER, confidence="high", assumed=False),
    dhr=_of_germer(0.984, 0.982, 0.983, 0.983, standard_uncertainty=0.003),
    specular_weight=_of_germer(0.054, 0.077, 0.086, 0.097, standard_uncertainty=0.03),
    single_scattering=_of_germer(0.760, 0.731, 0.741, 0.785, standard_uncertainty=0.12),
    asymmetry=_of_germer(0.477, 0.545, 0.548, 0.557, standard_uncertainty=0.04),
    single_dolp=_of_germer(0.181, 0.215, 0.231, 0.232, standard_uncertainty=0.01),
    depolarization=_of_germer(0.516, 0.334, 0.314, 0.311, standard_uncertainty=0.04),
    diffuse="volume",
)

MATERIALS: Mapping[str, Material] = MappingProxyType(
    {
        "black-paint": _BLACK_PAINT,
        "white-paint": _WHITE_PAINT,
        "asphalt": _ASPHALT,
        "glass": _GLASS,
        "aluminium": _ALUMINIUM,
        "sintered-ptfe": _SINTERED_PTFE,
    }
)


def material(name: str) -> Material:
    """Return a material of the library; raise ValueError if there is none of that name."""
    if name not in MATERIALS:
        raise ValueError(f"material {name!r} is not known; allowed are {', '.join(MATERIALS)}")
    return MATERIALS[name]
