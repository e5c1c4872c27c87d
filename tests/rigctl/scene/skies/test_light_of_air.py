import numpy as np
import pytest
from pvlib import spectrum

from model.accuracy.chain import LightStore, settings_of_fidelity
from model.atmosphere.air import AtmosphereState, column
from model.atmosphere.layers import AerosolKind
from model.atmosphere.sky import Fidelity
from model.atmosphere.solver import solve
from model.scene.scene import Air
from tests.rigctl.scene.skies.flat_bands import flat_band

STATE = AtmosphereState(visibility_m=23e3)
# By the NREL algorithm on day 145.
DISTANCE_FACTOR = 0.9748


def air(sun_zenith_deg, **changes):
    known = {
        "sun_zenith_rad": np.radians(sun_zenith_deg).item(),
        "band": flat_band(shortest_nm=400.0, longest_nm=700.0, distance_factor=DISTANCE_FACTOR),
        "fidelity": Fidelity.FAST,
        "aerosol": AerosolKind.DEPOLARIZING,
        "state": STATE,
        "ground_albedo": 0.2,
    }
    return Air(**(known | changes))


def lit(wanted, *, store=None, sun_azimuth_rad=0.0):
    store = LightStore() if store is None else store
    settings = settings_of_fidelity(wanted.fidelity, wavelengths=4)
    return store.illumination(wanted, settings, sun_azimuth_rad=sun_azimuth_rad)


def spectrl2(sun_zenith_deg):
    """Direct normal and diffuse horizontal irradiance, 400 to 700 nm, with ozone and hardly any water."""
    zenith = np.array([sun_zenith_deg])
    cosine = np.cos(np.radians(zenith))
    air_mass = 1.0 / (cosine + 0.15 * (93.885 - zenith) ** -1.253)
    found = spectrum.spectrl2(
        apparent_zenith=zenith,
        aoi=zenith,
        surface_tilt=np.zeros(1),
        ground_albedo=0.2,
        surface_pressure=101325.0,
        relative_airmass=air_mass,
        precipitable_water=1.4,
        ozone=0.344,
        aerosol_turbidity_500nm=float(column(STATE, wavelength_m=500e-9).tau_aerosol),
        dayofyear=145,
    )
    nm = found["wavelength"]
    grid = np.linspace(400.0, 700.0, 601)
    return tuple(float(np.trapezoid(np.interp(grid, nm, np.ravel(found[name])), grid)) for name in ("dni", "dhi"))


@pytest.mark.parametrize("sun_zenith_deg", [25.0, 50.0])
def test_irradiance_agrees_with_spectrl2(sun_zenith_deg):
    made = lit(air(sun_zenith_deg))
    direct, diffuse = spectrl2(sun_zenith_deg)
    # A model with an older solar spectrum and its own law of turbidity: 5 % in the beam, 8 % in the sky were seen.
    assert made.lighting.direct_irradiance == pytest.approx(direct, rel=0.10)
    assert made.sky_irradiance == pytest.approx(diffuse, rel=0.10)


def test_the_beam_without_ozone_is_known():
    # 320.8 W m-2 at the mean distance, from 61 wavelengths of the same atmosphere, sun 25 deg from the zenith.
    dry = air(25.0, state=AtmosphereState(visibility_m=23e3, ozone_m=0.0))
    made = lit(dry)
    assert made.lighting.direct_irradiance == pytest.approx(320.8 * DISTANCE_FACTOR, rel=2e-3)
    assert made.sky_irradiance == pytest.approx(140.8, rel=1e-2)  # over a ground of albedo 0.2; fast tier


def test_a_sky_is_solved_once_for_all_azimuths_of_the_sun():
    calls = []

    def counted(*arguments, **settings):
        calls.append(1)
        return solve(*arguments, **settings)

    store = LightStore(solver=counted)
    lit(air(40.0), store=store)
    lit(air(40.0), store=store, sun_azimuth_rad=1.0)
    assert len(calls) == 4  # wavelengths
    lit(air(41.0), store=store)
    assert len(calls) == 8


def test_the_sampled_sky_is_that_of_the_atmosphere():
    made = lit(air(40.0))
    exact = made.lighting.sky(zenith_rad=[0.3, 1.2], phi_rad=[0.4, 2.0])
    sampled = made.diffuse_radiance.sky(zenith_rad=[0.3, 1.2], phi_rad=[0.4, 2.0])
    assert np.max(np.abs(sampled - exact)) < 3.0 * made.diffuse_radiance.relative_error * exact[0, 0]


def test_a_low_sun_is_refused_before_anything_is_computed():
    with pytest.raises(ValueError, match="allowed is 0 to 85 deg"):
        lit(air(86.0), store=LightStore(solver=None))
