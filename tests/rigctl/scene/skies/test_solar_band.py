import numpy as np
import pytest
from pvlib import spectrum

from rigctl.scene.sun import response_band
from tests.rigctl.scene.skies.flat_bands import flat_band


# ASTM G173 outside the atmosphere, integrated between limits [W m-2], four digits.
@pytest.mark.parametrize(("limits", "irradiance"), [((400, 700), 530.0), ((380, 780), 655.9), ((350, 1000), 895.5)])
def test_irradiance_of_flat_bands(limits, irradiance):
    band = flat_band(shortest_nm=limits[0], longest_nm=limits[1], distance_factor=1.0)
    assert float(band.integral(np.ones(band.response.size))) == pytest.approx(irradiance, abs=0.06)


def test_distance_scales_the_spectrum():
    near, far = (flat_band(shortest_nm=400, longest_nm=700, distance_factor=factor) for factor in (1.0, 0.9748))
    np.testing.assert_allclose(far.irradiance_w_per_m3, 0.9748 * near.irradiance_w_per_m3)


def test_a_triangle_weighs_half_of_what_it_spans():
    flat = flat_band(shortest_nm=500, longest_nm=600, distance_factor=1.0)
    triangle = response_band(
        wavelength_nm=np.array([500.0, 550.0, 600.0]), response=np.array([0.0, 1.0, 0.0]), distance_factor=1.0
    )
    ratio = float(triangle.integral(np.ones(triangle.response.size)) / flat.integral(np.ones(flat.response.size)))
    assert ratio == pytest.approx(0.5, abs=0.01)  # the spectrum varies by some per cent within


def test_limits_between_samples_of_the_spectrum_count_exactly():
    band = flat_band(shortest_nm=500.25, longest_nm=600.75, distance_factor=1.0)
    assert band.wavelength_m[[0, -1]] * 1e9 == pytest.approx([500.25, 600.75])


@pytest.mark.parametrize(
    ("wavelengths", "word"),
    [([290.0, 500.0], "300 to 1060"), ([400.0, 1100.0], "300 to 1060"), ([500.0, 400.0], "rising")],
)
def test_bands_beyond_the_atmospheres_tables_are_refused(wavelengths, word):
    with pytest.raises(ValueError, match=word):
        response_band(wavelength_nm=np.array(wavelengths), response=np.ones(2), distance_factor=1.0)


def test_the_table_is_that_of_the_standard():
    theirs = spectrum.get_reference_spectra(standard="ASTM G173-03")["extraterrestrial"].loc[300.0:1060.0]
    ends = np.array([300.0, 1060.0])
    ours = response_band(wavelength_nm=ends, response=np.ones(2), distance_factor=1.0)
    np.testing.assert_allclose(ours.wavelength_m * 1e9, theirs.index, rtol=1e-12)
    np.testing.assert_allclose(ours.irradiance_w_per_m3 / 1e9, theirs, rtol=1e-12)
