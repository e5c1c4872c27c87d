import numpy as np
import pytest

from model.atmosphere.aerosols import TABULATED, AerosolType, aerosol_optics, preset_aerosol
from model.atmosphere.mie import (
    LogNormal,
    MieAerosol,
    ParticleMode,
    RefractiveIndex,
    TabulatedSizes,
    aerosol_extinction_m2,
    aerosol_scattering,
    efficiencies,
    log_normal,
    mixed_index,
    sphere_coefficients,
)
from tests.model.atmosphere.mie_cases import NOMINAL_RURAL, REFERENCE, aerosol_of

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


def test_tighter_tolerances_are_kept():
    for tolerance in (1e-3, 1e-6):
        found = aerosol_scattering(aerosol_of(BY_NAME["fine"]), wavelength_m=0.55e-6, tolerance=tolerance)
        assert found.error_estimate < 1.5 * tolerance  # tails may add a quarter


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


@pytest.mark.parametrize("kind", AerosolType)
def test_every_preset_says_where_it_is_from(kind):
    preset = preset_aerosol(kind, relative_humidity=0.5)
    assert preset.name == kind.value
    assert preset.source
    assert preset.assumed


def test_albedos_of_the_other_presets_are_those_known():
    # Hess, Koepke & Schult (1998) at 550 nm: water-soluble (50 %) 0.97, mineral transported 0.84, soot 0.21.
    known = {AerosolType.WATER_SOLUBLE: 0.97, AerosolType.DUST: 0.84, AerosolType.SOOT: 0.21}
    for kind, ssa in known.items():
        found = aerosol_scattering(preset_aerosol(kind, relative_humidity=0.5), wavelength_m=550e-9)
        assert found.ssa == pytest.approx(ssa, abs=0.01)


def test_water_makes_particles_larger_and_scatter_more():
    dry, moist = (preset_aerosol(AerosolType.WATER_SOLUBLE, relative_humidity=value) for value in (0.0, 0.8))
    assert moist.modes[0].sizes.median_radius_m > 1.4 * dry.modes[0].sizes.median_radius_m
    assert moist.modes[0].index.at(550e-9).real < dry.modes[0].index.at(550e-9).real
    assert aerosol_extinction_m2(moist, wavelength_m=550e-9) > 2 * aerosol_extinction_m2(dry, wavelength_m=550e-9)


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
    exact = efficiencies(size_parameter=x, a=a, b=b)
    # The spread of 1e-4 enters squared, times the curvature.
    assert found.extinction_m2 == pytest.approx(exact.extinction[0] * np.pi * 0.3e-6**2, rel=2e-6)
    assert found.matrix.g == pytest.approx(exact.asymmetry[0], abs=2e-6)


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


def test_only_two_kinds_have_a_table():
    assert {AerosolType.RURAL, AerosolType.TROPOSPHERIC} == TABULATED
    with pytest.raises(ValueError, match="no table"):
        aerosol_optics(kind=AerosolType.DUST, wavelength_m=550e-9, relative_humidity=0.5)
