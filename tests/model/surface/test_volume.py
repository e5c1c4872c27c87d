"""Volume scattering under a rough interface: reciprocity, energy, and the white panel it was made for."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from model.surface.materials import MATERIALS, surface_of
from model.surface.pbrdf import Surface, _scattered_once, findings, hemispherical_reflectance, mueller

REAL_DATA = os.environ.get("RIGCTL_REAL_DATA")
WHITE = surface_of(MATERIALS["sintered-ptfe"], wavelength_m=633e-9)
# A clear coat over particles that scatter backwards and polarize fully; a dark, absorbing body; no facets at all.
BODIES = (
    WHITE,
    Surface(
        n=1.5,
        slope_rms=0.05,
        dhr=0.9,
        diffuse="volume",
        single_scattering=0.8,
        asymmetry=-0.4,
        single_dolp=0.2,
        depolarization=0.0,
    ),
    Surface(n=1.6, k=0.3, slope_rms=0.4, dhr=0.2, diffuse="volume", single_scattering=0.3, asymmetry=0.7),
    Surface(
        n=1.3, slope_rms=0.3, dhr=1.0, specular_weight=0.0, diffuse="volume", single_scattering=0.9, single_dolp=0.5
    ),
)


def angles(seed: int, count: int = 300) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    return rng.uniform(0, 1.56, count), rng.uniform(0, 1.56, count), rng.uniform(-np.pi, np.pi, count)


@pytest.mark.parametrize("surface", BODIES)
def test_the_way_back_is_the_transposed_matrix(surface: Surface) -> None:
    theta_i, theta_r, phi = angles(1)
    there = mueller(theta_i, theta_r, phi, surface=surface)
    back = mueller(theta_r, theta_i, phi, surface=surface)
    np.testing.assert_allclose(np.swapaxes(back, -1, -2), there, atol=1e-11 * np.max(there))


@pytest.mark.parametrize("surface", BODIES)
def test_no_polarization_is_reflected_by_more_than_what_arrives(surface: Surface) -> None:
    total = hemispherical_reflectance(np.radians([0.0, 8.0, 30.0, 60.0, 80.0, 89.0, 89.9]), surface=surface)
    assert np.all(total.s0 + np.abs(total.s1) <= 1.0 + total.error)
    assert total.s0[1] == pytest.approx(surface.dhr, abs=1e-9)
    assert not findings(surface)


@pytest.mark.parametrize("surface", [BODIES[0], BODIES[2]])
def test_the_total_is_the_integral_of_the_pbrdf(surface: Surface) -> None:
    node, weight = np.polynomial.legendre.leggauss(64)
    theta_r, phi = 0.25 * np.pi * (node + 1.0), np.pi * (np.arange(128) + 0.5) / 64
    solid = 0.25 * np.pi * weight * np.pi * np.sin(2.0 * theta_r)
    for theta_i in (0.2, 1.0):
        rows = mueller(theta_i, theta_r[:, np.newaxis], phi, surface=surface)[..., 0, :2].mean(axis=1)
        total = hemispherical_reflectance(theta_i, surface=surface)
        np.testing.assert_allclose(solid @ rows, [total.s0, total.s1], atol=2e-5)


def test_light_that_dipoles_scatter_by_a_right_angle_has_the_stated_dolp() -> None:
    at = (np.array([np.pi / 4]), np.array([np.pi / 4]), np.array([np.pi]))
    once, mu = _scattered_once(*at, BODIES[3])[0], np.cos(np.pi / 4)  # without facets, and isotropic
    h = (1.0 + 2.0 * mu) / (1.0 + 2.0 * mu * np.sqrt(1.0 - 0.9))
    assert once[0, 0] == pytest.approx(0.9 * h * h / (4.0 * np.pi * 2.0 * mu), rel=1e-12)
    assert once[1, 0] == pytest.approx(0.5 * once[0, 0], rel=1e-12)


def test_particles_give_no_light_a_dolp_above_1() -> None:
    # The largest allowed single_dolp, without facets, and without the unpolarized remainder, which would hide a fault.
    for asymmetry, depolarization, most in ((0.0, 0.0, 0.5), (0.5, 0.3, 0.58), (-0.4, 0.0, 0.228)):
        surface = Surface(
            n=1.3,
            slope_rms=0.3,
            specular_weight=0.0,
            diffuse="volume",
            dhr=0.5,
            single_scattering=0.5,
            asymmetry=asymmetry,
            single_dolp=most,
            depolarization=depolarization,
        )
        f = _scattered_once(*angles(2), surface)
        turn = np.linspace(0.0, np.pi, 60)
        out = f @ np.stack([np.ones(60), np.cos(2 * turn), np.sin(2 * turn)])
        assert np.all(np.hypot(out[:, 1], out[:, 2]) <= out[:, 0] * (1.0 + 1e-9))
        with pytest.raises(ValueError, match="single_dolp"):
            replace(surface, single_dolp=most + 0.03)


def test_a_body_that_scatters_more_once_than_its_dhr_is_refused() -> None:
    with pytest.raises(ValueError, match="single_scattering"):
        Surface(n=1.3, slope_rms=0.3, dhr=0.1, specular_weight=0.0, diffuse="volume", single_scattering=1.0)


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"single_scattering": 1.1}, "single_scattering"),
        ({"asymmetry": 0.9}, "asymmetry"),
        ({"asymmetry": 0.5, "single_dolp": 0.6}, "single_dolp"),
        ({"depolarization": -0.1}, "depolarization"),
    ],
)
def test_values_have_ranges(changes: dict, word: str) -> None:
    with pytest.raises(ValueError, match=word):
        Surface(n=1.35, slope_rms=0.3, dhr=0.9, diffuse="volume", **changes)


@pytest.mark.skipif(REAL_DATA is None, reason="set RIGCTL_REAL_DATA to the folder of measured data (ptfe_mueller)")
def test_the_library_describes_measured_sintered_ptfe() -> None:
    from benchmarks.trials.white_panel import angles_of, element_noise, judged
    from rigctl.files.materials import read_brdf_table

    data = read_brdf_table(Path(REAL_DATA or "") / "ptfe_mueller" / "PTFE.data.csv")
    rows = np.flatnonzero((np.abs(data.wavelength_m - 633e-9) < 1e-9) & (data.theta_i_rad > 0.1))
    f = mueller(*angles_of(data, rows), surface=WHITE)
    f00, dolp, by_noise, ratio = judged(data, rows, f, element_noise(data, rows))
    assert f00 < 0.04
    assert dolp < 0.007
    assert dolp**2 - by_noise**2 < 0.005**2
    # The axes of the file are the project's: S1 and S2 agree, not DoLP alone.
    assert ratio < 0.007
