"""The standard atmosphere: published depths, profiles, neutral points."""

import numpy as np
import pytest

from model.atmosphere.aerosols import AerosolType, aerosol_column, aerosol_optics
from model.atmosphere.air import (
    AtmosphereState,
    aerosol_spectra,
    column,
    optical_depth,
    ozone_optical_depth,
    pressure_ratio,
    rayleigh_anisotropy,
    rayleigh_optical_depth,
)
from model.atmosphere.solver import solve

CLEAR = AtmosphereState(visibility_m=23e3)


@pytest.mark.parametrize(
    ("height_m", "pressure_pa"),
    # Tables of the US standard atmosphere 1976, five digits.
    [
        (0, 101325),
        (1e3, 89876),
        (5e3, 54048),
        (11e3, 22700),
        (20e3, 5529.3),
        (32e3, 889.06),
        (50e3, 79.779),
        (80e3, 1.0524),
    ],
)
def test_pressure_is_that_of_the_standard_atmosphere(height_m, pressure_pa):
    assert float(pressure_ratio(height_m)) * 101325 == pytest.approx(pressure_pa, rel=1e-4)


# From another reading of the same sources, three digits; the aerosol's digits depend on how tables are interpolated.
@pytest.mark.parametrize(
    ("wavelength_m", "rayleigh", "aerosol", "ssa", "g", "delta"),
    [
        (450e-9, 0.221, 0.407, (0.947, 0.964), (0.668, 0.664), 0.957),
        (550e-9, 0.097, 0.324, (0.944, 0.964), (0.657, 0.651), 0.958),
        (650e-9, 0.049, 0.264, (0.938, 0.960), (0.647, 0.637), 0.959),
    ],
)
def test_rural_column_of_23_km(wavelength_m, rayleigh, aerosol, ssa, g, delta):
    one = column(CLEAR, wavelength_m=wavelength_m)
    assert one.tau_rayleigh == pytest.approx(rayleigh, abs=6e-4)
    assert one.tau_aerosol == pytest.approx(aerosol, rel=4e-3)
    assert (one.lower.ssa, one.upper.ssa) == pytest.approx(ssa, abs=6e-4)
    assert (one.lower.g, one.upper.g) == pytest.approx(g, abs=6e-4)
    assert one.delta == pytest.approx(delta, abs=6e-4)


def test_published_rayleigh_depth():
    # Bodhaine et al. (1999), table 3: 0.09721 at 550 nm for 45 degrees; their formula, 4 digits, gives 0.0971.
    assert float(rayleigh_optical_depth(wavelength_m=550e-9)) == pytest.approx(0.0971, rel=2e-3)


def test_depolarization_of_air():
    # Delta = (1 - rho)/(1 + rho/2) with the usual rho of 0.028 to 0.029 in the visible.
    assert 0.9570 < rayleigh_anisotropy(wavelength_m=550e-9) < 0.9588


@pytest.mark.parametrize("fine", [True, False])
def test_layers_hold_the_whole_depth(fine):
    one = column(CLEAR, wavelength_m=550e-9)
    layers = one.layers(fine=fine)
    assert sum(layer.depth for layer in layers) == pytest.approx(one.depth, rel=1e-12)
    assert sum(layer.tau_rayleigh for layer in layers) == pytest.approx(one.tau_rayleigh, rel=1e-12)
    assert layers[0].tau_aerosol < layers[-1].tau_aerosol  # the aerosol lies low: the last is the lowest


def test_depth_above_a_height_falls_to_nothing():
    one = column(CLEAR, wavelength_m=550e-9)
    above = one.tau_above([0.0, 20.0, 2e3, 9e3, 50e3, 2e5])
    assert np.all(np.diff(above) < 0.0)
    assert above[-1] == 0.0
    # Extinction at the ground: aerosol 0.158 km-1, molecules 0.0116 km-1.
    assert (above[0] - above[1]) / 20.0 == pytest.approx(1.70e-4, rel=0.01)


def test_spectrum_of_the_depth_is_that_of_the_columns():
    wavelengths = np.array([4.1e-7, 5.5e-7, 7e-7])
    each = [column(CLEAR, wavelength_m=w).depth for w in wavelengths]
    np.testing.assert_allclose(optical_depth(CLEAR, wavelength_m=wavelengths), each, rtol=1e-12)


def test_aerosol_of_a_given_depth_has_it():
    state = AtmosphereState(aerosol_optical_depth=0.12)
    assert column(state, wavelength_m=550e-9).tau_aerosol == pytest.approx(0.12, rel=1e-10)
    assert column(AtmosphereState(aerosol_optical_depth=0.0), wavelength_m=550e-9).tau_aerosol == 0.0


def test_visibility_is_linear_in_its_inverse_between_columns():
    inverse = (1 / 23 + 1 / 10) / 2
    low, middle, high = (aerosol_column(visibility_m=v).extinction_per_m for v in (23e3, 1e3 / inverse, 10e3))
    np.testing.assert_allclose(middle, (low + high) / 2, rtol=1e-12)


def test_a_column_is_integrated_as_an_exponential():
    aerosol = aerosol_column(visibility_m=23e3)
    # 0.158 km-1 falling to 0.0991 km-1 in 1 km: difference over logarithm of the ratio.
    assert float(aerosol.optical_depth_between(0.0, 1e3)) == pytest.approx((0.158 - 0.0991) / np.log(0.158 / 0.0991))
    level = aerosol_column(visibility_m=10e3)
    assert float(level.optical_depth_between(200.0, 700.0)) == pytest.approx(0.5 * 0.379)


def test_humidity_moves_between_the_tables():
    def ssa(relative_humidity):
        return aerosol_optics(kind=AerosolType.RURAL, wavelength_m=550e-9, relative_humidity=relative_humidity).ssa

    assert ssa(0.0) == pytest.approx(1 - 0.0593)
    assert ssa(0.7) == pytest.approx(1 - 0.0538)
    assert ssa(0.8) == pytest.approx(1 - 0.04082)
    assert ssa(0.0) < ssa(0.5) < ssa(0.75) < ssa(0.8)


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (lambda: column(AtmosphereState(), wavelength_m=5e-7), "either"),
        (lambda: column(AtmosphereState(visibility_m=2e4, aerosol_optical_depth=0.1), wavelength_m=5e-7), "either"),
        (lambda: column(AtmosphereState(visibility_m=1e3), wavelength_m=5e-7), "visibility_m"),
        (lambda: column(AtmosphereState(aerosol_optical_depth=-1.0), wavelength_m=5e-7), "optical_depth"),
        (lambda: column(AtmosphereState(visibility_m=2e4, relative_humidity=0.9), wavelength_m=5e-7), "humidity"),
        (lambda: column(AtmosphereState(visibility_m=2e4, surface_pressure_pa=0.0), wavelength_m=5e-7), "pressure"),
        (lambda: column(CLEAR, wavelength_m=2e-6), "wavelength_m"),
        (lambda: column(CLEAR, wavelength_m=5e-7).tau_above(-1.0), "height_m"),
        (lambda: ozone_optical_depth(wavelength_m=2e-7, ozone_m=0.003), "wavelength_m"),
        (lambda: ozone_optical_depth(wavelength_m=5e-7, ozone_m=-1.0), "ozone_m"),
    ],
)
def test_what_is_outside_its_range_is_refused(call, named):
    with pytest.raises(ValueError, match=named):
        call()


def principal_plane_zeros(solution):
    """Zenith angles [deg] on the side of the sun, down to 88, where S1 changes sign, interpolated."""
    zenith_deg = np.arange(5.0, 88.1, 0.5)
    s1 = solution.stokes(solution.depth, np.cos(np.radians(zenith_deg)), 0.0, looking="up")[:, 1]
    change = np.flatnonzero(s1[:-1] * s1[1:] < 0)
    return zenith_deg[change] + 0.5 * s1[change] / (s1[change] - s1[change + 1])


# Babinet's and Brewster's points of the rural atmosphere of 23 km over black ground, of an independent solver.
@pytest.mark.parametrize(
    ("wavelength_m", "sza_deg", "zeros"),
    [
        (450e-9, 22, [16.8, 30.9]),
        (450e-9, 43, [32.6, 60.3]),
        (450e-9, 50, [37.8, 69.7]),
        (450e-9, 70, [52.5]),
        (550e-9, 22, [18.0, 28.6]),
        (550e-9, 43, [34.9, 56.4]),
        (550e-9, 50, [40.4, 65.6]),
        (550e-9, 70, [56.0]),
        (650e-9, 22, [18.9, 27.2]),
        (650e-9, 43, [36.5, 53.9]),
        (650e-9, 50, [42.2, 62.8]),
        (650e-9, 70, [58.2, 87.5]),
    ],
)
def test_neutral_points(wavelength_m, sza_deg, zeros):
    one = column(CLEAR, wavelength_m=wavelength_m)
    solution = solve(one.layers(fine=True), mu0=np.cos(np.radians(sza_deg)), albedo=0.0, nodes=8, element_depth=0.05)
    assert principal_plane_zeros(solution) == pytest.approx(zeros, abs=0.3)


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
