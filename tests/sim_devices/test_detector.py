from dataclasses import replace

import numpy as np
import pytest

from sim_devices.exposure import Detector, Lens, draw_fixed_pattern, electrons_per_radiance_s
from tests.sim_devices.camera_builders import LENS, SILENT


def drawn(detector, seed=1):
    return draw_fixed_pattern(detector, generator=np.random.default_rng(seed))


def test_electrons_of_a_wide_lens_by_hand():
    # See camera_builders for the arithmetic; 12 digits were kept.
    assert electrons_per_radiance_s(LENS, SILENT) == pytest.approx(98844647.6619, rel=1e-12)


def test_electrons_of_the_default_camera_by_hand():
    # f/2: tan = 1/4, sin^2 = 1/17, pi/17 = 0.184799568 sr; 8.3 um squared = 6.889e-11 m^2; 0.9 and 0.45;
    # 550 nm = 3.6117197e-19 J. Light of 15 W m^-2 sr^-1 for 30 us: 6424.08 electrons.
    electrons = electrons_per_radiance_s(Lens(), Detector()) * 15.0 * 30e-6
    assert electrons == pytest.approx(6424.08, abs=0.005)


def test_default_geometry():
    detector = Detector()
    assert (detector.width, detector.height, detector.bit_depth) == (782, 582, 12)
    assert detector.pixel_pitch_m == 8.3e-6


def test_fixed_pattern_has_the_spread_and_expectation_that_were_asked_for():
    pattern = drawn(replace(SILENT, prnu=0.02, dsnu_e=3.0))
    count = 160_000
    assert abs(pattern.response.mean() - 1.0) < 5 * 0.02 / np.sqrt(count)
    assert abs(pattern.response.std() - 0.02) < 5 * 0.02 / np.sqrt(2 * count)
    assert abs(pattern.offset_e.mean()) < 5 * 3.0 / np.sqrt(count)
    assert abs(pattern.offset_e.std() - 3.0) < 5 * 3.0 / np.sqrt(2 * count)


def test_response_and_offset_are_independent():
    pattern = drawn(replace(SILENT, prnu=0.02, dsnu_e=3.0))
    correlation = np.corrcoef(pattern.response.ravel(), pattern.offset_e.ravel())[0, 1]
    assert abs(correlation) < 5 / np.sqrt(160_000)


def test_no_pattern_is_drawn_where_there_is_none():
    pattern = drawn(SILENT)
    assert pattern.response is None
    assert pattern.offset_e is None


def test_offset_does_not_depend_on_whether_there_is_prnu():
    with_prnu = drawn(replace(SILENT, prnu=0.02, dsnu_e=3.0))
    without = drawn(replace(SILENT, dsnu_e=3.0))
    np.testing.assert_array_equal(with_prnu.offset_e, without.offset_e)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("width", 0),
        ("height", 0),
        ("pixel_pitch_m", 0.0),
        ("effective_wavelength_m", -5e-7),
        ("quantum_efficiency", 0.0),
        ("quantum_efficiency", 1.01),
        ("gain_dn_per_e", 0.0),
        ("gain_dn_per_e", float("inf")),
        ("read_noise_e", -1.0),
        ("read_noise_e", float("nan")),
        ("dark_current_e_per_s", -1.0),
        ("black_level_dn", -1.0),
        ("prnu", -0.01),
        ("prnu", 0.11),
        ("dsnu_e", -1.0),
        ("full_well_e", 0.0),
        ("bit_depth", 0),
        ("bit_depth", 17),
    ],
)
def test_detector_that_cannot_be_is_refused(name, value):
    with pytest.raises(ValueError, match=f"{name} is {value}; it has to be"):
        Detector(**{name: value})


@pytest.mark.parametrize(
    ("name", "value"),
    [("focal_length_m", 0.0), ("aperture_diameter_m", -0.01), ("transmittance", 0.0), ("transmittance", 1.1)],
)
def test_lens_that_cannot_be_is_refused(name, value):
    with pytest.raises(ValueError, match=f"{name} is {value}; it has to be"):
        Lens(**{name: value})
