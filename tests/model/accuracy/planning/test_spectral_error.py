from dataclasses import replace

import numpy as np
import pytest

from model.accuracy.chain import LightStore
from model.accuracy.plan import NUMERICAL_SETTINGS, WAVELENGTHS, at_level, settings_at, spectral_error
from model.atmosphere.aerosols import AerosolType
from model.atmosphere.air import AtmosphereState
from rigctl.scene.sun import response_band
from tests.model.accuracy.random_scenes import random_scene

COARSE = settings_at(dict.fromkeys(NUMERICAL_SETTINGS, 0), 1e-4)
# Directions all over the sky.
ZENITH_RAD, PHI_RAD = np.meshgrid(np.radians([20.0, 50.0, 75.0]), np.radians([15.0, 90.0, 165.0]))


def band(short_nm, long_nm):
    return response_band(wavelength_nm=np.array([short_nm, long_nm]), response=np.ones(2), distance_factor=1.0)


def air(**changes):
    wide = {
        "band": band(400.0, 700.0),
        "state": AtmosphereState(aerosol_optical_depth=0.3),
        "ground_albedo": 0.2,
        "sun_zenith_rad": np.radians(50.0),
    }
    return replace(random_scene(0).air, **(wide | changes))


def sky_error(one, settings):
    """Largest relative error of S0 of the sky, against twelve wavelengths between the tables' entries."""
    finest = at_level(settings, WAVELENGTHS, len(NUMERICAL_SETTINGS[WAVELENGTHS].levels) - 1)
    own, fine = (
        LightStore()
        .illumination(one, chosen, sun_azimuth_rad=0.0)
        .lighting.sky(zenith_rad=ZENITH_RAD, phi_rad=PHI_RAD)[..., 0]
        for chosen in (settings, finest)
    )
    return float(np.max(np.abs(own / fine - 1.0)))


@pytest.mark.parametrize("level", [0, 1, 2, 4])
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"sun_zenith_rad": np.radians(75.0)},
        {"band": band(450.0, 550.0)},
        {"state": AtmosphereState(aerosol_optical_depth=0.5, angstrom_exponent=-0.2)},
        {"state": AtmosphereState(aerosol_optical_depth=0.5, boundary_aerosol=AerosolType.SOOT)},
    ],
)
def test_the_sky_is_off_by_no_more_and_not_by_far_less(level, changes):
    one, settings = air(**changes), at_level(COARSE, WAVELENGTHS, level)
    true, estimated = sky_error(one, settings), spectral_error(one, settings).scattered
    # Elements of a depth of 0.1 come and go with the wavelength: 2e-6 of noise at these coarse settings.
    assert true < estimated + 2e-6
    assert true > 0.05 * estimated - 2e-6


def test_a_narrow_band_needs_one_wavelength():
    # The beam's light falls and rises as powers up to 8 of the wavelength: curvature 72 / 2, variance of 2 nm in 520.
    expected = 36.0 * (1.0 / 520.0) ** 2 / 3.0
    assert spectral_error(air(band=band(519.0, 521.0)), at_level(COARSE, WAVELENGTHS, 0)).scattered < 2.0 * expected


def test_transmittance_is_that_of_all_wavelengths():
    one = air()
    errors = [abs(spectral_error(one, at_level(COARSE, WAVELENGTHS, k)).transmittance(slant=2.0)) for k in (0, 1, 4)]
    assert errors[0] > 1e-2 > errors[1] > 1e-4 > 1e-5 > errors[2]


def test_air_without_aerosol_has_one_part():
    clear = air(state=AtmosphereState(aerosol_optical_depth=0.0))
    settings = at_level(COARSE, WAVELENGTHS, 1)
    assert sky_error(clear, settings) < spectral_error(clear, settings).scattered < 0.01


def test_a_table_has_no_wavelengths():
    with pytest.raises(ValueError, match="no wavelengths"):
        spectral_error(air(state=None), COARSE)
