"""Five materials to begin with. Most of their values are assumed: replace them by what was measured."""

from collections.abc import Mapping
from types import MappingProxyType

from model.surface.materials import Material, Property, constant

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

MATERIALS: Mapping[str, Material] = MappingProxyType(
    {
        "black-paint": _BLACK_PAINT,
        "white-paint": _WHITE_PAINT,
        "asphalt": _ASPHALT,
        "glass": _GLASS,
        "aluminium": _ALUMINIUM,
    }
)


def material(name: str) -> Material:
    """Return a material of the library.

    Parameters
    ----------
    name
        One of `MATERIALS`.

    Returns
    -------
    Material
        The record.

    Raises
    ------
    ValueError
        If there is none of that name.

    References
    ----------
    Each property names its source.
    """
    if name not in MATERIALS:
        raise ValueError(f"material {name!r} is not known; allowed are {', '.join(MATERIALS)}")
    return MATERIALS[name]
