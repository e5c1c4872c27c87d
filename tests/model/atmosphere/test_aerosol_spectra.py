import numpy as np
import pytest

from model.atmosphere.aerosols import AerosolType
from model.atmosphere.air import AtmosphereState, aerosol_spectra, column, optical_depth

ENDS = {"shortest_m": 400e-9, "longest_m": 900e-9}
WAVELENGTHS_M = np.array([400e-9, 437e-9, 550e-9, 601e-9, 694.3e-9, 771e-9, 900e-9])


@pytest.mark.parametrize("angstrom_exponent", [None, 1.3])
@pytest.mark.parametrize("boundary", [AerosolType.RURAL, AerosolType.SOOT])
def test_depth_albedo_and_asymmetry_are_those_of_the_column(angstrom_exponent, boundary):
    state = AtmosphereState(aerosol_optical_depth=0.4, angstrom_exponent=angstrom_exponent, boundary_aerosol=boundary)
    spectra = aerosol_spectra(state, **ENDS)
    for k, wavelength_m in enumerate(WAVELENGTHS_M):
        air = column(state, wavelength_m=wavelength_m)
        total = sum(one.depth(WAVELENGTHS_M)[k] for one in spectra)
        # Between the nodes spheres, and the albedo of a table, are not quite the straight lines they are taken for.
        assert total == pytest.approx(air.tau_aerosol, rel=3e-3)
        for one, own in zip(spectra, (air.lower, air.upper), strict=True):
            assert one.ssa(WAVELENGTHS_M)[k] == pytest.approx(own.ssa, rel=3e-3)
            assert one.asymmetry(WAVELENGTHS_M)[k] == pytest.approx(own.g, rel=3e-3)


def test_the_depth_of_a_table_is_exact():
    state = AtmosphereState(aerosol_optical_depth=0.4)
    clear = AtmosphereState(aerosol_optical_depth=0.0)
    found = sum(one.depth(WAVELENGTHS_M) for one in aerosol_spectra(state, **ENDS))
    expected = optical_depth(state, wavelength_m=WAVELENGTHS_M) - optical_depth(clear, wavelength_m=WAVELENGTHS_M)
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_one_wavelength_is_a_band_too():
    state = AtmosphereState(aerosol_optical_depth=0.4)
    lower, _ = aerosol_spectra(state, shortest_m=600e-9, longest_m=600e-9)
    assert lower.ssa(np.array([600e-9]))[0] == pytest.approx(column(state, wavelength_m=600e-9).lower.ssa, rel=1e-12)
