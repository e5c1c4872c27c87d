"""A sampled sky against the sky itself, and the light that falls on level ground."""

import numpy as np
import pytest

from model.atmosphere.aerosols import AerosolType
from model.atmosphere.air import AtmosphereState
from model.atmosphere.layers import AerosolKind
from model.atmosphere.sky import Fidelity, SolarBand, compute_lighting
from model.scene.sky_light import sample_sky
from tests.model.made_lighting import even_sky, illumination, polarized_sky

RANDOM = np.random.default_rng(5)
ZENITH_RAD, PHI_RAD = RANDOM.uniform(0.0, np.radians(88.0), 300), RANDOM.uniform(-7.0, 7.0, 300)


def computed_sky(sun_zenith_deg, aerosol=AerosolKind.DEPOLARIZING, kind=AerosolType.RURAL, *, air=None):
    wavelength_m = np.linspace(500e-9, 600e-9, 11)
    band = SolarBand(wavelength_m=wavelength_m, irradiance_w_per_m3=np.full(11, 1.8e9), response=np.ones(11))
    return compute_lighting(
        air or AtmosphereState(visibility_m=23e3, boundary_aerosol=kind),
        fidelity=Fidelity.FAST,
        band=band,
        mu0=np.cos(np.radians(sun_zenith_deg)),
        albedo=0.1,
        aerosol=aerosol,
        wavelengths=2,
    ).sky


def largest_difference(sampled, sky, zenith_rad=ZENITH_RAD, phi_rad=PHI_RAD):
    exact = sky(zenith_rad=zenith_rad, phi_rad=phi_rad)
    return np.max(np.abs(sampled(zenith_rad=zenith_rad, phi_rad=phi_rad) - exact) / exact[:, :1])


@pytest.mark.parametrize("sun_zenith_deg", [0.0, 22.0, 50.0, 80.0])
def test_samples_stand_for_a_computed_sky_to_their_own_estimate(sun_zenith_deg):
    sky = computed_sky(sun_zenith_deg)
    sampled = sample_sky(sky, sun_zenith_rad=np.radians(sun_zenith_deg))
    # The estimate is the largest of 44 differences; 300 random directions find somewhat larger ones.
    assert largest_difference(sampled, sky) < 1.5 * sampled.relative_error
    assert sampled.relative_error < 5e-3


@pytest.mark.parametrize("pressure_pa", [1e3, 1.0, 1e-4])
def test_thin_air_that_is_bright_at_the_horizon_alone_leaves_no_ripples(pressure_pa):
    sky = computed_sky(50.0, air=AtmosphereState(surface_pressure_pa=pressure_pa, aerosol_optical_depth=0.0))
    sampled = sample_sky(sky, sun_zenith_rad=np.radians(50.0))
    # Without its own depth the ripples were from 0.7 to 1e5 of the light.
    assert largest_difference(sampled, sky) < 1e-3
    assert sampled.relative_error < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("kind", [AerosolType.RURAL, AerosolType.DUST])
@pytest.mark.parametrize("sun_zenith_deg", [5.0, 40.0])
def test_the_aureole_of_spheres_is_held(sun_zenith_deg, kind):
    sun_rad = np.radians(sun_zenith_deg)
    sky = computed_sky(sun_zenith_deg, AerosolKind.SPHERES, kind)
    sampled = sample_sky(sky, sun_zenith_rad=sun_rad)
    zenith = np.abs(sun_rad + RANDOM.normal(0.0, 0.05, 200))
    phi = RANDOM.normal(0.0, 0.05, 200)
    exact = sky(zenith_rad=zenith, phi_rad=phi)
    # At the sun it is some thirty times as bright as in the mean, and falls to half within some degrees.
    assert np.max(exact[:, 0]) > 5.0 * np.min(exact[:, 0])
    # Measured: 1e-3 for rural spheres, 2e-3 for dust; a sum of Henyey-Greenstein functions alone leaves 0.06 of dust.
    assert largest_difference(sampled, sky, zenith, phi) < min(4e-3, 2.0 * sampled.relative_error)


def test_twice_the_samples_are_better():
    sky = computed_sky(50.0)
    coarse, fine = (sample_sky(sky, sun_zenith_rad=np.radians(50.0), zeniths=12 * k, azimuths=10 * k) for k in (1, 2))
    assert fine.relative_error < 0.2 * coarse.relative_error


def test_nodes_give_the_sky_itself():
    sky = polarized_sky()
    sampled = sample_sky(sky, sun_zenith_rad=np.radians(50.0), zeniths=24, azimuths=8)
    nodes_rad = 0.25 * np.pi * (1.0 - np.cos(np.pi * np.arange(25) / 24))
    zenith, phi = np.meshgrid(nodes_rad, np.pi / 8.0 * np.arange(-3, 8))
    np.testing.assert_allclose(
        sampled(zenith_rad=zenith, phi_rad=phi), sky(zenith_rad=zenith, phi_rad=phi), rtol=0, atol=1e-11
    )


def test_the_zenith_is_no_special_point():
    sky = computed_sky(50.0)
    sampled = sample_sky(sky, sun_zenith_rad=np.radians(50.0))
    for phi_rad in (0.0, 0.7, -2.0):
        # Light from the zenith turns its frame with the azimuth that is asked for.
        np.testing.assert_allclose(
            sampled(zenith_rad=0.0, phi_rad=phi_rad), sky(zenith_rad=1e-9, phi_rad=phi_rad), rtol=1e-6
        )


def test_sky_irradiance_of_an_even_sky_is_pi():
    assert illumination(sky=even_sky).sky_irradiance == pytest.approx(np.pi, rel=1e-9)
    assert illumination(zenith_deg=85.0).direct_horizontal_irradiance > 0.0


def test_ground_radiance_is_what_a_lambertian_ground_sends_back():
    made = illumination(sky=even_sky, albedo=0.2)
    received = np.pi + 300.0 * np.cos(np.radians(50.0))
    assert made.diffuse_radiance.ground_radiance == pytest.approx(0.2 / np.pi * received, rel=1e-9)
    assert made.direct_horizontal_irradiance == pytest.approx(300.0 * np.cos(np.radians(50.0)))


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda: sample_sky(polarized_sky(), sun_zenith_rad=1.0)(zenith_rad=1.6, phi_rad=0.0), "below the horizon"),
        (lambda: sample_sky(polarized_sky(), sun_zenith_rad=1.0, azimuths=3), "azimuths = 3"),
        (lambda: illumination(zenith_deg=85.01), "solar zenith = .* allowed is 0 to 85 deg"),
        (lambda: illumination(zenith_deg=-1.0), "solar zenith"),
        (lambda: illumination(albedo=1.2), "ground_albedo"),
    ],
)
def test_impossible_skies_are_refused(call, word):
    with pytest.raises(ValueError, match=word):
        call()
