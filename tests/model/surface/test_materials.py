"""Materials as records: tables, what is assumed, and that the library can be used."""

import numpy as np
import pytest

from model.surface.materials import (
    MATERIALS,
    Material,
    Property,
    assumed_properties,
    constant,
    material,
    surface_of,
)
from model.surface.pbrdf import findings

PLAIN = {"standard_uncertainty": 0.1, "source": "a table", "confidence": "high", "assumed": False}


def test_a_table_is_interpolated() -> None:
    table = Property(values=(1.0, 2.0), wavelengths_m=(400e-9, 600e-9), **PLAIN)
    assert table.at(450e-9) == pytest.approx(1.25, rel=1e-12)
    assert table.at(600e-9) == 2.0


@pytest.mark.parametrize(("ulps", "value"), [(-4, 1.0), (4, 2.0)])
def test_rounding_does_not_leave_the_table(ulps: int, value: float) -> None:
    table = Property(values=(1.0, 2.0), wavelengths_m=(400e-9, 600e-9), **PLAIN)
    end = table.wavelengths_m[0] if ulps < 0 else table.wavelengths_m[1]
    assert table.at(end + ulps * np.spacing(end)) == value


@pytest.mark.parametrize("wavelength_m", [399e-9, 601e-9])
def test_nothing_is_extrapolated(wavelength_m: float) -> None:
    table = Property(values=(1.0, 2.0), wavelengths_m=(400e-9, 600e-9), **PLAIN)
    with pytest.raises(ValueError, match="400 to 600 nm"):
        table.at(wavelength_m)


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"values": (1.0, 2.0)}, "wavelengths"),
        ({"values": (1.0,), "wavelengths_m": (1e-6, 2e-6)}, "wavelengths"),
        ({"values": (1.0, 2.0), "wavelengths_m": (2e-6, 1e-6)}, "ascending"),
        ({"values": (np.nan,)}, "finite"),
        ({"standard_uncertainty": -0.1}, "standard_uncertainty"),
        ({"confidence": "sure"}, "confidence"),
        ({"source": " "}, "source"),
    ],
)
def test_properties_are_checked(changes: dict, word: str) -> None:
    with pytest.raises(ValueError, match=word):
        Property(**{"values": (1.0,), **PLAIN, **changes})


@pytest.mark.parametrize("name", MATERIALS)
@pytest.mark.parametrize("wavelength_m", [450e-9, 550e-9, 850e-9])
def test_library_materials_are_possible_surfaces(name: str, wavelength_m: float) -> None:
    surface = surface_of(material(name), wavelength_m=wavelength_m, diffuse="polarised")
    assert findings(surface) == ()


def test_aluminium_at_a_tabulated_wavelength() -> None:
    surface = surface_of(material("aluminium"), wavelength_m=619.93e-9)
    assert (surface.n, surface.k) == pytest.approx((1.3660, 7.4052))


def test_glass_follows_its_dispersion_formula() -> None:
    # n_F - n_C of N-BK7 is (1.5168 - 1) / 64.17 = 0.00805; linear interpolation between 50 nm adds below 5e-4.
    glass = material("glass").n
    assert glass.at(486.1e-9) - glass.at(656.3e-9) == pytest.approx(0.00805, abs=5e-4)
    assert glass.at(587.6e-9) == pytest.approx(1.5168, abs=5e-4)


def test_what_is_assumed_is_said() -> None:
    assert assumed_properties(material("black-paint")) == ("n", "k", "slope_rms", "dhr", "specular_weight")
    assert assumed_properties(material("glass")) == ("slope_rms", "specular_weight")


def test_an_unknown_material_names_the_known() -> None:
    with pytest.raises(ValueError, match="black-paint, white-paint, asphalt, glass, aluminium"):
        material("gold")


def test_an_impossible_material_is_named() -> None:
    wrong = Material(
        name="soot",
        n=constant(1.5, **PLAIN),
        k=constant(0.0, **PLAIN),
        slope_rms=constant(0.2, **PLAIN),
        dhr=constant(0.02, **PLAIN),
        specular_weight=constant(1.0, **PLAIN),
    )
    with pytest.raises(ValueError, match=r"'soot' at 550 nm.*specular_weight"):
        surface_of(wrong, wavelength_m=550e-9)


@pytest.mark.parametrize("wavelength_m", [0.0, np.nan])
def test_wavelengths_are_positive(wavelength_m: float) -> None:
    with pytest.raises(ValueError, match="wavelength_m"):
        surface_of(material("asphalt"), wavelength_m=wavelength_m)
