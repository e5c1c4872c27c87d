"""Wavelength that stands for a band in the electron equation."""

import numpy as np
import pytest

from model.sensor import effective_wavelength_m, electrons_per_radiance
from tests.model.sensors import sensor

NODES = np.linspace(400e-9, 700e-9, 301)


def test_flat_band_has_its_mean_wavelength():
    # The trapezoid is exact for a linear integrand.
    assert effective_wavelength_m(NODES, np.ones(NODES.size)) == pytest.approx(550e-9, rel=1e-13)


def test_effective_wavelength_makes_the_band_form_exact():
    radiance = 1e8 * (700e-9 / NODES) ** 4
    centre = effective_wavelength_m(NODES, radiance)
    band = np.trapezoid(radiance, NODES) * electrons_per_radiance(sensor(wavelength_m=centre))
    # Electrons of unit radiance go with the wavelength.
    each = electrons_per_radiance(sensor(wavelength_m=550e-9)) * NODES / 550e-9
    assert np.trapezoid(each * radiance, NODES) == pytest.approx(band, rel=1e-13)
    assert centre < 550e-9


@pytest.mark.parametrize("nodes", [[500e-9], [500e-9, 400e-9], [-1e-9, 1e-9]])
def test_samples_must_increase_above_zero(nodes):
    with pytest.raises(ValueError, match="increasing samples"):
        effective_wavelength_m(nodes, np.ones(len(nodes)))


def test_weight_without_light_is_refused():
    with pytest.raises(ValueError, match="> 0 somewhere"):
        effective_wavelength_m(NODES, np.zeros(NODES.size))
