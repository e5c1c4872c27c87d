import numpy as np
import pytest
from scipy.integrate import quad

from model.atmosphere.layers import Layer
from model.atmosphere.solver import beam_share, single_scattering, solve
from tests.model.atmosphere.oracles import rayleigh_matrix

LAYERS = [Layer(0.05, 0.02, 0.9, 0.6, 0.95), Layer(0.08, 0.3, 0.94, 0.7, 0.958)]


@pytest.mark.parametrize("mu", [1e-3, 0.2, 0.6 - 1e-7, 0.6 - 1e-12, 0.6, 0.6 + 1e-10, 0.9, 1.0])
@pytest.mark.parametrize("depth", [1e-10, 0.1, 3.0])
def test_downward_share_is_the_integral_also_at_the_sun(mu, depth):
    # The integral over a path s (depth = mu s) is done piecewise where the exponential is steep.
    points = depth - np.minimum(depth, mu * np.array([30.0, 5.0, 1.0]))
    exact, _ = quad(
        lambda t: np.exp(-t / 0.6 - (depth - t) / mu) / mu, 0.0, depth, points=points, epsabs=0, epsrel=1e-12, limit=200
    )
    share = beam_share(depth=np.array(depth), mu=np.array(mu), mu0=0.6, upward=False)
    assert share == pytest.approx(exact, rel=1e-9)


def test_upward_share_is_the_integral():
    exact, _ = quad(lambda t: np.exp(-t / 0.6 - t / 0.3) / 0.3, 0.0, 0.4, epsabs=0, epsrel=1e-12)
    share = beam_share(depth=np.array(0.4), mu=np.array(0.3), mu0=0.6, upward=True)
    assert share == pytest.approx(exact, rel=1e-12)


def test_horizon_sees_the_local_source():
    share = beam_share(depth=np.array(0.4), mu=np.array(0.0), mu0=0.6, upward=False)
    assert share == pytest.approx(np.exp(-0.4 / 0.6), rel=1e-14)


def literal_single_scattering(tau, mu, phi_rad, mu0, upward):
    """Integral over depth of both layers' scattering matrices times the beam, by quadrature."""
    total, top = np.zeros(3), 0.0
    for layer in LAYERS:
        low, high = (max(top, tau), top + layer.depth) if upward else (top, min(top + layer.depth, tau))
        top += layer.depth
        if high <= low:
            continue
        reach, _ = quad(lambda t: np.exp(-t / mu0 - abs(tau - t) / mu) / mu, low, high, epsrel=1e-12)
        u = mu if upward else -mu
        column = layer.tau_rayleigh / layer.depth * rayleigh_matrix(u, -mu0, phi_rad, layer.delta)[:, 0]
        cosine = np.sqrt((1 - mu * mu) * (1 - mu0 * mu0)) * np.cos(phi_rad) - u * mu0
        g = layer.g_aerosol
        peak = (1 - g * g) / (1 + g * g - 2 * g * cosine) ** 1.5
        column[0] += layer.tau_aerosol * layer.ssa_aerosol / layer.depth * peak
        total += reach * column / (4 * np.pi)
    return total


@pytest.mark.parametrize("upward", [True, False])
@pytest.mark.parametrize("tau", [0.0, 0.03, 0.07, 0.2, 0.45])
def test_single_scattering_is_the_literal_integral(tau, upward):
    value = single_scattering(
        LAYERS, mu0=0.6, tau_above=np.array([tau]), mu=np.array([0.35]), phi_rad=np.array([1.1]), upward=upward
    )
    np.testing.assert_allclose(value[0], literal_single_scattering(tau, 0.35, 1.1, 0.6, upward), rtol=1e-10, atol=1e-15)


@pytest.mark.parametrize("looking", ["up", "down"])
@pytest.mark.parametrize(("zenith", "azimuth"), [(0.5, 0.3), (1.2, 2.0), (0.9, 4.0), (1.4, 5.5)])
def test_light_scattered_once_vibrates_across_the_scattering_plane(looking, zenith, azimuth):
    # Free of any meridian convention: vectors east, north, up; azimuths from north over east; camera axes right and up.
    sun_zenith, sun_azimuth = 0.7, 1.0
    to_sun = compass_vector(sun_zenith, sun_azimuth)
    to_point = compass_vector(zenith, azimuth)  # to the point of the sky, or from the target to the sensor
    forward = to_point if looking == "up" else -to_point
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    vibration = np.cross(forward, to_sun)
    angle = np.arctan2(vibration @ up, vibration @ right)
    thin = solve([Layer(1e-9, 0.0, 0.0, 0.0, 1.0)], mu0=np.cos(sun_zenith), albedo=0.0)
    tau_above = 1e-9 if looking == "up" else 0.0
    s0, s1, s2 = thin.stokes(tau_above, np.cos(zenith), sun_azimuth - azimuth, looking=looking)
    degree = np.hypot(s1, s2)
    # Twice scattered light is of the order of the depth, 1e-9 times a factor of tens.
    np.testing.assert_allclose([s1, s2], degree * np.array([np.cos(2 * angle), np.sin(2 * angle)]), atol=1e-6 * s0)
    cosine = to_sun @ to_point * (1 if looking == "up" else -1)
    assert degree / s0 == pytest.approx((1 - cosine**2) / (1 + cosine**2), rel=1e-6)


def compass_vector(zenith, azimuth):
    """East, north, up."""
    return np.array([np.sin(zenith) * np.sin(azimuth), np.sin(zenith) * np.cos(azimuth), np.cos(zenith)])
