"""Mie scattering against miepython, literal series and closed forms; documented aerosols."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.atmosphere.aerosols import AerosolType, aerosol_optics, preset_aerosol
from model.atmosphere.mie import (
    LogNormal,
    MieAerosol,
    ParticleMode,
    RefractiveIndex,
    TabulatedSizes,
    aerosol_extinction_m2,
    aerosol_scattering,
    amplitude_sums,
    log_normal,
    mixed_index,
    number_of_volume,
    sphere_coefficients,
)
from tests.model.atmosphere.mie_cases import NOMINAL_RURAL, REFERENCE, aerosol_of
from tests.model.atmosphere.oracles import efficiencies

MU = np.array(REFERENCE["mu"])


def one_sphere(x, n, k, mu=MU):
    """Extinction, scattering, asymmetry and both amplitudes of one sphere."""
    size = np.array([x])
    a, b = sphere_coefficients(size_parameter=size, n=n, k=k)
    plus, minus = amplitude_sums(a, b, mu)
    return efficiencies(size, a, b)[:, 0], (plus[0] + minus[0]) / 2, (plus[0] - minus[0]) / 2


@pytest.mark.parametrize("case", REFERENCE["spheres"], ids=lambda case: f"x={case['x']} m={case['n']}+{case['k']}i")
def test_efficiencies_are_those_of_the_literal_series_and_of_miepython(case):
    numbers, _, _ = one_sphere(case["x"], case["n"], case["k"])
    # Thirteen digits are stored; a thousand terms round to some 1e-13 of the largest. The asymmetry of a small sphere
    # (2e-7 for x = 1e-3) is a difference that rounds to 1e-15.
    np.testing.assert_allclose(numbers[:2], case["literal"][:2], rtol=1e-11)
    assert numbers[2] == pytest.approx(case["literal"][2], rel=1e-11, abs=2e-15)
    # miepython's extinction of absorbing spheres is itself off by up to 2e-10.
    np.testing.assert_allclose(numbers, case["miepython"], rtol=1e-8)


@pytest.mark.parametrize("case", REFERENCE["spheres"], ids=lambda case: f"x={case['x']} m={case['n']}+{case['k']}i")
def test_amplitudes_are_those_of_miepython(case):
    _, s1, s2 = one_sphere(case["x"], case["n"], case["k"])
    real1, imag1, real2, imag2 = np.array(case["amplitudes"]).T
    for found, wanted in ((s1, real1 + 1j * imag1), (s2, real2 + 1j * imag2)):
        # Its series ends some terms earlier: 2e-10 of the forward amplitude.
        np.testing.assert_allclose(found, wanted, rtol=1e-8, atol=1e-9 * abs(wanted[0]))


@pytest.mark.parametrize(("x", "n", "k"), [(1e-8, 1.5, 0.1), (0.02, 1.5, 0.0), (3.0, 1.33, 0.0), (12.0, 1.6, 0.5)])
def test_coefficients_are_quotients_of_bessel_functions(x, n, k):
    a, b = sphere_coefficients(size_parameter=np.array([x]), n=n, k=k)
    with mpmath.workdps(60):
        index, size = mpmath.mpc(n, k), mpmath.mpf(x)

        def psi(order, z):
            return mpmath.sqrt(mpmath.pi * z / 2) * mpmath.besselj(order + mpmath.mpf(1) / 2, z)

        def xi(order, z):
            return psi(order, z) + 1j * mpmath.sqrt(mpmath.pi * z / 2) * mpmath.bessely(order + mpmath.mpf(1) / 2, z)

        def slope(function, order, z):
            return function(order - 1, z) - order * function(order, z) / z

        for order in (1, 2):
            inner, inner_slope = psi(order, index * size), slope(psi, order, index * size)
            for found, factor in ((a, index), (b, 1 / index)):
                top = factor * inner * slope(psi, order, size) - psi(order, size) * inner_slope
                bottom = factor * inner * slope(xi, order, size) - xi(order, size) * inner_slope
                exact = complex(top / bottom)
                # The magnetic ones of a small sphere are a difference of equal terms, but count for nothing.
                allowed = 1e-12 * abs(exact) + 1e-15 * abs(complex(a[0, order - 1]))
                assert abs(found[0, order - 1] - exact) < allowed


@settings(deadline=None, max_examples=30)
@given(x=st.floats(1e-3, 300.0), n=st.floats(1.1, 2.5))
def test_a_sphere_that_does_not_absorb_scatters_what_it_takes_away(x, n):
    numbers, _, _ = one_sphere(x, n, 0.0)
    assert numbers[1] == pytest.approx(numbers[0], rel=1e-12)  # rounding of the sums of positive terms


def test_a_very_small_sphere_is_a_dipole():
    x, m = 1e-4, 1.5 + 0.02j
    numbers, s1, s2 = one_sphere(x, m.real, m.imag)
    strength = (m**2 - 1) / (m**2 + 2)
    # What is left out is of the order of x^2.
    assert numbers[1] == pytest.approx(8 / 3 * x**4 * abs(strength) ** 2, rel=1e-7)
    assert numbers[0] == pytest.approx(4 * x * strength.imag, rel=1e-6)
    np.testing.assert_allclose(s2, s1 * MU, rtol=1e-6, atol=1e-6 * abs(s1[0]))


def test_many_sizes_at_once_equal_one_by_one():
    sizes = np.array([1e-3, 0.5, 0.5, 7.0, 120.0])
    a, b = sphere_coefficients(size_parameter=sizes, n=1.53, k=0.01)
    alone = [one_sphere(x, 1.53, 0.01)[0] for x in sizes]
    np.testing.assert_allclose(efficiencies(sizes, a, b).T, alone, rtol=1e-12)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"size_parameter": np.array([0.0])}, "size_parameter"),
        ({"size_parameter": np.array([np.nan])}, "size_parameter"),
        ({"size_parameter": np.array([3e4])}, "size_parameter"),
        ({"size_parameter": np.zeros(0)}, "size_parameter"),
        ({"size_parameter": np.array([2.0, 1.0])}, "increase"),
        ({"n": 0.0}, "n = 0.0"),
        ({"k": -0.1}, "k = -0.1"),
        ({"k": np.inf}, "k = inf"),
    ],
)
def test_what_the_series_does_not_cover_is_refused(change, named):
    with pytest.raises(ValueError, match=named):
        sphere_coefficients(**({"size_parameter": np.array([1.0]), "n": 1.5, "k": 0.0} | change))


ANGLE_RAD = np.radians(REFERENCE["angle_deg"])
BY_NAME = {case["name"]: case for case in REFERENCE["distributions"]}


@pytest.mark.parametrize("case", REFERENCE["distributions"], ids=lambda case: case["name"])
def test_a_distribution_is_that_of_miepython(case):
    found = aerosol_scattering(aerosol_of(case), wavelength_m=case["wavelength_m"], tolerance=1e-9)
    # The reference's extinction of absorbing spheres is off by up to 2e-10; tails left out here are 3e-10.
    assert found.extinction_m2 == pytest.approx(case["extinction_m2"], rel=1e-8)
    assert found.ssa == pytest.approx(case["ssa"], abs=1e-8)
    assert found.matrix.g == pytest.approx(case["g"], abs=1e-8)
    f11, f22, f33, f12 = found.matrix.matrix(ANGLE_RAD)
    # At the exact forward direction the largest spheres, left out, weigh a hundred times their share.
    allowed = 1e-8 * np.where(ANGLE_RAD == 0.0, max(case["f11"]), 1.0)
    for element, name in ((f11, "f11"), (f22, "f11"), (f33, "f33"), (f12, "f12")):
        assert np.all(np.abs(element - case[name]) < allowed + 1e-8 * np.abs(case[name]))


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5])
@pytest.mark.parametrize("case", REFERENCE["distributions"], ids=lambda case: case["name"])
def test_errors_are_not_larger_than_estimated(case, tolerance):
    aerosol = aerosol_of(case)
    found, exact = (
        aerosol_scattering(aerosol, wavelength_m=case["wavelength_m"], tolerance=each) for each in (tolerance, 1e-9)
    )
    assert abs(found.extinction_m2 / exact.extinction_m2 - 1.0) < found.error_estimate
    assert abs(found.ssa - exact.ssa) < found.error_estimate
    root, weight = np.polynomial.legendre.leggauss(400)
    angle = np.arccos(root)
    missed = weight @ np.abs(found.matrix.matrix(angle)[0] - exact.matrix.matrix(angle)[0]) / 2.0
    assert missed < found.matrix.error_estimate


def test_dry_rural_aerosol_of_nominal_radii():
    found = aerosol_scattering(NOMINAL_RURAL, wavelength_m=550e-9)
    # Three digits of another code for the same modes.
    assert found.ssa == pytest.approx(0.940, abs=5e-4)
    assert found.matrix.g == pytest.approx(0.655, abs=5e-4)


@pytest.mark.parametrize(
    ("kind", "humidity", "wavelength_m"),
    [
        (AerosolType.RURAL, 0.0, 550e-9),
        (AerosolType.RURAL, 0.0, 1060e-9),
        (AerosolType.RURAL, 0.7, 694.3e-9),
        (AerosolType.RURAL, 0.8, 550e-9),
        (AerosolType.RURAL, 0.8, 1060e-9),
        (AerosolType.TROPOSPHERIC, 0.7, 337.1e-9),
        (AerosolType.TROPOSPHERIC, 0.7, 550e-9),
        (AerosolType.TROPOSPHERIC, 0.7, 1060e-9),
    ],
)
def test_presets_are_the_aerosols_of_the_table(kind, humidity, wavelength_m):
    # At the table's own wavelengths and humidities: the table was made by Mie's theory for the same spheres.
    preset = preset_aerosol(kind, relative_humidity=humidity)
    found = aerosol_scattering(preset, wavelength_m=wavelength_m, tolerance=3e-3)
    ratio = found.extinction_m2 / aerosol_extinction_m2(preset, wavelength_m=550e-9)
    table = aerosol_optics(kind=kind, wavelength_m=wavelength_m, relative_humidity=humidity)
    # Its index between given wavelengths, the water's and the ends of its sizes are not known to more digits.
    assert ratio == pytest.approx(table.extinction, rel=3e-3)
    assert found.ssa == pytest.approx(table.ssa, abs=1e-3)
    assert found.matrix.g == pytest.approx(table.g, abs=5e-4)


def test_albedos_of_the_other_presets_are_those_known():
    # Hess, Koepke & Schult (1998) at 550 nm: water-soluble (50 %) 0.97, mineral transported 0.84, soot 0.21.
    known = {AerosolType.WATER_SOLUBLE: 0.97, AerosolType.DUST: 0.84, AerosolType.SOOT: 0.21}
    for kind, ssa in known.items():
        found = aerosol_scattering(preset_aerosol(kind, relative_humidity=0.5), wavelength_m=550e-9)
        assert found.ssa == pytest.approx(ssa, abs=0.01)


def test_extinction_alone_is_that_of_the_whole():
    for case in REFERENCE["distributions"]:
        aerosol = aerosol_of(case)
        alone = aerosol_extinction_m2(aerosol, wavelength_m=case["wavelength_m"], tolerance=1e-6)
        assert alone == pytest.approx(case["extinction_m2"], rel=2e-6)


def test_a_narrow_law_is_a_single_sphere():
    sizes = LogNormal(median_radius_m=0.3e-6, ln_sigma=1e-4)
    mode = ParticleMode(number_share=2.0, sizes=sizes, index=RefractiveIndex(n=(1.4,), k=(0.01,)))
    found = aerosol_scattering(
        MieAerosol(name="one size", modes=(mode,), source="test"), wavelength_m=0.5e-6, tolerance=1e-6
    )
    x = np.array([2 * np.pi * 0.3 / 0.5])
    a, b = sphere_coefficients(size_parameter=x, n=1.4, k=0.01)
    extinction, _, asymmetry = efficiencies(x, a, b)[:, 0]
    # The spread of 1e-4 enters squared, times the curvature.
    assert found.extinction_m2 == pytest.approx(extinction * np.pi * 0.3e-6**2, rel=2e-6)
    assert found.matrix.g == pytest.approx(asymmetry, abs=2e-6)


def test_number_shares_count_relative_to_each_other():
    def scaled(factor):
        modes = tuple(
            ParticleMode(number_share=factor * mode.number_share, sizes=mode.sizes, index=mode.index)
            for mode in aerosol_of(BY_NAME["bimodal"]).modes
        )
        return aerosol_scattering(MieAerosol(name="scaled", modes=modes, source="test"), wavelength_m=0.44e-6)

    one, ten = scaled(1.0), scaled(10.0)
    assert ten.extinction_m2 == pytest.approx(one.extinction_m2, rel=1e-12)
    assert ten.ssa == pytest.approx(one.ssa, rel=1e-12)


def test_a_mode_that_adds_nothing_changes_nothing():
    (mode,) = aerosol_of(BY_NAME["fine"]).modes
    trace = ParticleMode(number_share=1e-12, sizes=mode.sizes, index=mode.index)
    alone, both = (
        aerosol_scattering(MieAerosol(name="trace", modes=modes, source="test"), wavelength_m=0.55e-6)
        for modes in ((mode,), (mode, trace))
    )
    assert both.extinction_m2 == pytest.approx(alone.extinction_m2, rel=1e-3)


def test_either_median_and_either_logarithm_say_the_same():
    sigma = 0.8
    one = log_normal(number_median_radius_m=0.1e-6, ln_sigma=sigma)
    other = log_normal(volume_median_radius_m=0.1e-6 * np.exp(3 * sigma**2), log10_sigma=sigma / np.log(10.0))
    assert other.median_radius_m == pytest.approx(one.median_radius_m, rel=1e-12)
    assert other.ln_sigma == pytest.approx(one.ln_sigma, rel=1e-12)


def test_the_volume_median_halves_the_volume():
    law = log_normal(volume_median_radius_m=1e-6, ln_sigma=0.7)
    log_radius = np.linspace(np.log(1e-9), np.log(1e-3), 20001)
    volume = np.exp(3 * log_radius) * law.number_per_log_radius(np.exp(log_radius))
    assert np.sum(volume[log_radius < np.log(1e-6)]) / np.sum(volume) == pytest.approx(0.5, abs=1e-3)  # one step


def test_laws_of_size_hold_one_particle():
    log_radius = np.linspace(np.log(1e-9), np.log(1e-4), 200001)
    table = TabulatedSizes(radius_m=(1e-7, 3e-7, 1e-6), number_per_log_radius_at=(1.0, 4.0, 0.0))
    for law in (LogNormal(median_radius_m=1e-7, ln_sigma=0.5), table):
        number = np.sum(law.number_per_log_radius(np.exp(log_radius))) * (log_radius[1] - log_radius[0])
        assert number == pytest.approx(1.0, abs=1e-4)  # a jump of the table at its first row costs half a step


def test_index_is_linear_between_rows():
    index = RefractiveIndex(wavelength_m=(4e-7, 6e-7), n=(1.5, 1.6), k=(0.0, 0.02))
    assert index.at(5e-7) == pytest.approx(1.55 + 0.01j)
    mixed = mixed_index(parts=(index, index), volume_shares=(0.25, 0.75))
    assert mixed.at(4.5e-7) == pytest.approx(index.at(4.5e-7))


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: log_normal(ln_sigma=0.5), "median"),
        (lambda: log_normal(number_median_radius_m=1e-7, volume_median_radius_m=1e-7, ln_sigma=0.5), "median"),
        (lambda: log_normal(number_median_radius_m=1e-7), "sigma"),
        (lambda: log_normal(number_median_radius_m=1e-7, ln_sigma=0.5, log10_sigma=0.2), "sigma"),
        (lambda: log_normal(number_median_radius_m=1e-7, ln_sigma=2.5), "ln_sigma"),
        (lambda: log_normal(number_median_radius_m=-1e-7, ln_sigma=0.5), "median_radius_m"),
        (lambda: log_normal(number_median_radius_m=1e-7, ln_sigma=0.1, largest_radius_m=1e-9), "largest_radius_m"),
        (lambda: TabulatedSizes(radius_m=(1e-7,), number_per_log_radius_at=(1.0,)), "two or more"),
        (lambda: TabulatedSizes(radius_m=(2e-7, 1e-7), number_per_log_radius_at=(1.0, 1.0)), "increase"),
        (lambda: TabulatedSizes(radius_m=(1e-7, 2e-7), number_per_log_radius_at=(0.0, 0.0)), "not all 0"),
        (lambda: RefractiveIndex(n=(1.5,), k=(-0.1,)), "k ="),
        (lambda: RefractiveIndex(n=(0.0,), k=(0.1,)), "n ="),
        (lambda: RefractiveIndex(n=(1.5, 1.5), k=(0.1,)), "rows"),
        (lambda: RefractiveIndex(wavelength_m=(6e-7, 5e-7), n=(1.5, 1.5), k=(0.1, 0.1)), "increase"),
        (lambda: RefractiveIndex(wavelength_m=(5e-7, 6e-7), n=(1.5, 1.5), k=(0.1, 0.1)).at(7e-7), "index is given"),
        (lambda: mixed_index(parts=(RefractiveIndex(n=(1.5,), k=(0.0,)),), volume_shares=(0.9,)), "sum to 1"),
        (lambda: MieAerosol(name="none", modes=(), source="test"), "one mode"),
        (lambda: aerosol_scattering(NOMINAL_RURAL, wavelength_m=0.0), "wavelength_m"),
        (lambda: aerosol_scattering(NOMINAL_RURAL, wavelength_m=5e-7, tolerance=0.0), "tolerance"),
        (lambda: aerosol_scattering(NOMINAL_RURAL, wavelength_m=5e-8), "largest_radius_m"),
        (lambda: preset_aerosol(AerosolType.RURAL, relative_humidity=0.9), "relative_humidity"),
    ],
)
def test_what_has_no_meaning_is_refused(make, named):
    with pytest.raises(ValueError, match=named):
        make()


def test_the_number_that_makes_a_volume_is_that_of_the_integral():
    sigma, median = 0.6, 0.3
    ln_radius = np.linspace(np.log(median) - 8.0, np.log(median) + 8.0, 4001)
    number_median = median * np.exp(-3.0 * sigma**2)
    density = np.exp(-0.5 * ((ln_radius - np.log(number_median)) / sigma) ** 2) / (sigma * np.sqrt(2.0 * np.pi))
    volume = np.trapezoid(density * 4.0 / 3.0 * np.pi * np.exp(3.0 * ln_radius), ln_radius)
    assert number_of_volume(volume=volume, volume_median_radius_m=median, ln_sigma=sigma) == pytest.approx(1.0)


@pytest.mark.parametrize("change", [{"volume": 0.0}, {"volume_median_radius_m": -1.0}, {"ln_sigma": 3.0}])
def test_impossible_volumes_are_refused(change):
    with pytest.raises(ValueError, match=next(iter(change))):
        number_of_volume(**({"volume": 1.0, "volume_median_radius_m": 1e-7, "ln_sigma": 0.5} | change))
