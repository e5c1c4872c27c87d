import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.atmosphere.sky import spectral_rule

WAVELENGTH_M = np.linspace(400e-9, 700e-9, 301)
# A spectrum that is not smooth: lines of all depths.
JAGGED = np.random.default_rng(5).uniform(0.2, 2.0, 301)


def mean(rule, function):
    return float(rule.irradiance @ function(1e-6 / rule.wavelength_m) / np.sum(rule.irradiance))


def mean_of_all(function, irradiance=JAGGED):
    return float(irradiance @ function(1e-6 / WAVELENGTH_M) / np.sum(irradiance))


@pytest.mark.parametrize("count", [1, 2, 3, 5, 8])
def test_polynomials_of_twice_the_degree_are_exact(count):
    rule = spectral_rule(wavelength_m=WAVELENGTH_M, irradiance=JAGGED, count=count)
    for degree in range(2 * count):
        # Products of terms between 1.4 and 2.5: rounding only.
        assert mean(rule, lambda x, k=degree: (x - 2.0) ** k) == pytest.approx(
            mean_of_all(lambda x, k=degree: (x - 2.0) ** k), abs=1e-12
        )


def test_one_degree_more_is_not_exact():
    rule = spectral_rule(wavelength_m=WAVELENGTH_M, irradiance=JAGGED, count=2)
    assert abs(mean(rule, lambda x: x**4) - mean_of_all(lambda x: x**4)) > 1e-6


def test_wavelengths_rise_and_weights_are_of_the_band():
    rule = spectral_rule(wavelength_m=WAVELENGTH_M, irradiance=JAGGED, count=6)
    assert np.all(np.diff(rule.wavelength_m) > 0.0)
    assert np.all(rule.irradiance > 0.0)
    assert np.sum(rule.irradiance) == pytest.approx(np.sum(JAGGED), rel=1e-12)


def kinked(x):
    """Slope that changes where the wavelength is 550 nm."""
    return np.exp(-np.abs(x - 1.0 / 0.55))


def test_a_kink_is_met_by_rules_on_either_side():
    plain = spectral_rule(wavelength_m=WAVELENGTH_M, irradiance=JAGGED, count=8)
    split = spectral_rule(wavelength_m=WAVELENGTH_M, irradiance=JAGGED, count=8, kinks_m=(550e-9,))
    errors = [abs(mean(rule, kinked) - mean_of_all(kinked)) for rule in (plain, split)]
    assert errors[1] < 1e-8 < 1e-5 < errors[0]


def test_stretches_share_the_wavelengths_by_their_width():
    rule = spectral_rule(
        wavelength_m=WAVELENGTH_M, irradiance=JAGGED, count=8, kinks_m=(300e-9, 550e-9, 694.3e-9, 1.06e-6)
    )
    counts = np.histogram(rule.wavelength_m, bins=[400e-9, 550e-9, 694.3e-9, 700e-9])[0]
    # In inverse wavelength the stretches are 64, 35 and 1 % of the band.
    np.testing.assert_array_equal(counts, [6, 3, 1])


def test_no_more_wavelengths_than_samples():
    rule = spectral_rule(wavelength_m=WAVELENGTH_M[:3], irradiance=JAGGED[:3], count=5)
    np.testing.assert_array_equal(rule.wavelength_m, WAVELENGTH_M[:3])
    np.testing.assert_array_equal(rule.irradiance, JAGGED[:3])


def test_dark_samples_do_not_count():
    dark = np.where(WAVELENGTH_M < 500e-9, 0.0, JAGGED)
    rule = spectral_rule(wavelength_m=WAVELENGTH_M, irradiance=dark, count=4)
    assert np.all(rule.wavelength_m >= 500e-9)
    assert mean(rule, np.square) == pytest.approx(mean_of_all(np.square, dark), rel=1e-12)


@given(seed=st.integers(0, 10_000), samples=st.integers(2, 400), count=st.integers(1, 20))
@settings(deadline=None, max_examples=60)
def test_any_spectrum_has_a_rule_within_it(seed, samples, count):
    draw = np.random.default_rng(seed)
    wavelength_m = np.sort(draw.uniform(3e-7, 1e-6, samples))
    irradiance = draw.exponential(size=samples)
    rule = spectral_rule(wavelength_m=wavelength_m, irradiance=irradiance, count=count)
    assert rule.wavelength_m.size == min(count, samples)
    # Eigenvalues to some rounding errors of the width.
    assert np.all(rule.wavelength_m > wavelength_m[0] * (1.0 - 1e-12))
    assert np.all(rule.wavelength_m < wavelength_m[-1] * (1.0 + 1e-12))
    assert np.sum(rule.irradiance) == pytest.approx(np.sum(irradiance), rel=1e-10)
    x, nodes = 1e-6 / wavelength_m, 1e-6 / rule.wavelength_m
    assert rule.irradiance @ nodes == pytest.approx(irradiance @ x, rel=1e-9)


def test_a_count_below_one_is_refused():
    with pytest.raises(ValueError, match="count = 0, allowed is 1 or more"):
        spectral_rule(wavelength_m=WAVELENGTH_M, irradiance=JAGGED, count=0)


def test_a_spectrum_without_light_is_refused():
    with pytest.raises(ValueError, match="without light"):
        spectral_rule(wavelength_m=WAVELENGTH_M, irradiance=np.zeros(301), count=2)
