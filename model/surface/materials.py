"""Materials of surfaces: each property with its uncertainty, its source and how far it can be trusted."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Literal, get_args

import numpy as np

from model.surface.diffuse import DiffuseKind
from model.surface.pbrdf import Surface
from model.surface.shadowing import Shadowing

Confidence = Literal["high", "medium", "low"]
# 700 nm and 700e-9 m may differ by the rounding of a factor, which must not put an end of a table outside of it.
_ROUNDING = 1e-12
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
        _require_table(self.values, self.wavelengths_m)
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
    """A material; see `Surface` for what its properties mean.

    Parameters
    ----------
    name
        What people call it.
    n, k, slope_rms, specular_weight
        Properties.
    dhr
        Property, or None: no diffuse term.
    dhr_angle_rad
        Zenith angle at which the DHR was measured [rad].
    """

    name: str
    n: Property
    k: Property
    slope_rms: Property
    dhr: Property | None
    specular_weight: Property
    dhr_angle_rad: float = math.radians(8.0)


def constant(
    value: float, *, standard_uncertainty: float, source: str, confidence: Confidence, assumed: bool
) -> Property:
    """Return a property that is the same at all wavelengths.

    Parameters
    ----------
    standard_uncertainty, source, confidence, assumed
        As in `Property`.

    Returns
    -------
    Property
        The property.

    Raises
    ------
    ValueError
        If a number is not finite or a word not allowed.
    """
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
    diffuse: DiffuseKind = "coupled",
) -> Surface:
    """Return the surface that a material makes at one wavelength.

    Parameters
    ----------
    wavelength_m
        Wavelength in air [m].
    shadowing, diffuse
        As in `Surface`.

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
        return Surface(
            n=material.n.at(wavelength_m),
            k=material.k.at(wavelength_m),
            slope_rms=material.slope_rms.at(wavelength_m),
            dhr=None if material.dhr is None else material.dhr.at(wavelength_m),
            dhr_angle_rad=material.dhr_angle_rad,
            shadowing=shadowing,
            diffuse=diffuse,
            specular_weight=material.specular_weight.at(wavelength_m),
        )
    except ValueError as error:
        raise ValueError(f"material {material.name!r} at {wavelength_m * 1e9:.4g} nm: {error}") from error


def properties(material: Material) -> dict[str, Property]:
    """Return the properties that a material has, by name, in the order of its fields.

    Returns
    -------
    dict
        Name to property; "dhr" only where there is one.
    """
    named = {field.name: getattr(material, field.name) for field in fields(material)}
    return {name: value for name, value in named.items() if isinstance(value, Property)}


def assumed_properties(material: Material) -> tuple[str, ...]:
    """Return the names of the properties that are assumed, to be shown wherever the material is.

    Returns
    -------
    tuple of str
        Field names.
    """
    return tuple(name for name, value in properties(material).items() if value.assumed)


def _require_table(values: Sequence[float], wavelengths_m: Sequence[float]) -> None:
    expected = len(wavelengths_m) if wavelengths_m else 1
    if len(values) != expected:
        raise ValueError(
            f"{len(values)} values and {len(wavelengths_m)} wavelengths; allowed is one value alone, or as many of each"
        )
    if not np.all(np.isfinite(values)) or not np.all(np.isfinite(wavelengths_m)):
        raise ValueError(f"values = {tuple(values)} at {tuple(wavelengths_m)} m; allowed are finite numbers")
    if wavelengths_m and (wavelengths_m[0] <= 0.0 or np.any(np.diff(wavelengths_m) <= 0.0)):
        raise ValueError(f"wavelengths_m = {tuple(wavelengths_m)} m; allowed is ascending from above 0")
