import numpy as np
import pytest

from model.sensor.electrons import electrons_per_radiance
from model.sensor.spectral_response import effective_wavelength_m, spectral_electrons_per_radiance
from tests.model.sensors import sensor

NODES = np.linspace(400e-9, 700e-9, 301)


def _weights(**changes):
    values = {"optics_transmittance": 0.9, "quantum_efficiency": 0.45} | changes
    return spectral_electrons_per_radiance(sensor(), wavelength_m=NODES, **values)


def test_flat_band_is_the_band_form_at_its_mean_wavelength():
    spectral = 1e8 * np.sum(_weights())
    # 1e8 W m-2 sr-1 m-1 over 300 nm is 30 W m-2 sr-1; the trapezoid is exact for a linear integrand.
    assert spectral == pytest.approx(30.0 * electrons_per_radiance(sensor()), rel=1e-13)


def test_effective_wavelength_makes_the_band_form_exact():
    radiance = 1e8 * (700e-9 / NODES) ** 4
    centre = effective_wavelength_m(NODES, radiance)
    band = np.trapezoid(radiance, NODES) * electrons_per_radiance(sensor(wavelength_m=centre))
    assert np.sum(_weights() * radiance) == pytest.approx(band, rel=1e-13)
    assert centre < 550e-9


def test_relative_response_counts_once():
    halved = _weights(relative_response=np.full(NODES.size, 0.5))
    np.testing.assert_allclose(halved, 0.5 * _weights(), rtol=1e-15)


@pytest.mark.parametrize("nodes", [[500e-9], [500e-9, 400e-9], [-1e-9, 1e-9]])
def test_samples_must_increase_above_zero(nodes):
    with pytest.raises(ValueError, match="increasing samples"):
        effective_wavelength_m(nodes, np.ones(len(nodes)))


def test_response_above_one_is_refused():
    with pytest.raises(ValueError, match="quantum_efficiency"):
        _weights(quantum_efficiency=1.5)


def test_weight_without_light_is_refused():
    with pytest.raises(ValueError, match="> 0 somewhere"):
        effective_wavelength_m(NODES, np.zeros(NODES.size))
