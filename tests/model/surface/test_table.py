"""Measured surfaces: what is read from noisy geometries of a known surface, and how far that is off."""

import numpy as np
import pytest

from model.surface.materials import MATERIALS, surface_of, tabulated
from model.surface.pbrdf import Surface, hemispherical_reflectance, mueller
from model.surface.table import MeasuredTable, TabulatedBrdf

WAVELENGTH_M = 633e-9
WHITE = surface_of(MATERIALS["sintered-ptfe"], wavelength_m=WAVELENGTH_M)
F_NOISE, RATIO_NOISE = 0.01, 0.006


def measured(seed: int = 1, *, count: int = 500, largest_deg: float = 75.0, noise: float = 1.0) -> MeasuredTable:
    """Return noisy measurements of the library's white panel in random geometries, at two wavelengths."""
    rng = np.random.default_rng(seed)
    theta_i, theta_r = np.deg2rad(largest_deg) * np.sqrt(rng.uniform(0, 1, (2, 2 * count)))
    phi = rng.uniform(-np.pi, np.pi, 2 * count)
    matrix = mueller(theta_i, theta_r, phi, surface=WHITE)
    brightness = np.repeat([0.9, 1.0], count)
    return MeasuredTable(
        source="panel.csv",
        wavelength_m=np.repeat([500e-9, WAVELENGTH_M], count),
        theta_i_rad=theta_i,
        theta_r_rad=theta_r,
        phi_rad=phi,
        f00_per_sr=matrix[:, 0, 0] * brightness * (1.0 + noise * F_NOISE * rng.standard_normal(2 * count)),
        ratios=matrix / matrix[:, :1, :1] + noise * RATIO_NOISE * rng.standard_normal(matrix.shape),
    )


@pytest.fixture(scope="module")
def table() -> TabulatedBrdf:
    return measured().at(WAVELENGTH_M)


def geometries(seed: int, largest_deg: float = 72.0) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    return *np.deg2rad(rng.uniform(0, largest_deg, (2, 400))), rng.uniform(-np.pi, np.pi, 400)


def test_the_stated_error_is_the_error(table: TabulatedBrdf) -> None:
    angles = geometries(2)
    found, true = table.matrix(*angles), mueller(*angles, surface=WHITE)
    error = table.standard_error(*angles)
    off = np.log(found[:, 0, 0] / true[:, 0, 0]) / error[:, 0]
    assert 0.4 < np.sqrt(np.mean(off**2)) < 1.5
    # S1 and S2 turn with the plane of scattering; their errors' norm does not.
    ratios = (found[:, 1:, 0] / found[:, :1, 0] - true[:, 1:, 0] / true[:, :1, 0]) ** 2
    assert 0.4 < np.sqrt(np.mean(np.sum(ratios, axis=1)) / np.mean(np.sum(error[:, 1:] ** 2, axis=1))) < 1.5
    # 500 noisy rows give the smooth function better than one row does.
    assert np.median(error[:, 1]) < 0.5 * RATIO_NOISE


def test_more_noise_is_more_error() -> None:
    angles = geometries(3)
    quiet, loud = (measured(noise=noise).at(WAVELENGTH_M).standard_error(*angles) for noise in (0.3, 3.0))
    # Less than ten times: what noise hides is smoothed more.
    assert np.all(np.median(loud, axis=0) > 2.0 * np.median(quiet, axis=0))


def test_the_matrix_is_reciprocal_and_mirror_symmetric(table: TabulatedBrdf) -> None:
    theta_i, theta_r, phi = geometries(4)
    there, back = table.matrix(theta_i, theta_r, phi), table.matrix(theta_r, theta_i, phi)
    np.testing.assert_allclose(np.swapaxes(back, -1, -2), there, atol=1e-12)
    mirror = np.diag([1.0, 1.0, -1.0])
    np.testing.assert_allclose(table.matrix(theta_i, theta_r, -phi), mirror @ there @ mirror, atol=1e-12)


def test_polarized_light_is_reflected_as_measured(table: TabulatedBrdf) -> None:
    angles = geometries(5)
    true = mueller(*angles, surface=WHITE)
    off = (table.matrix(*angles) - true) / true[:, :1, :1]
    assert np.sqrt(np.mean(off[:, 1:, 1:] ** 2)) < RATIO_NOISE


def test_the_total_is_that_of_the_surface() -> None:
    surface = surface_of(tabulated("white", measured()), wavelength_m=WAVELENGTH_M)
    angles = np.radians([8.0, 40.0, 60.0])
    found, true = (hemispherical_reflectance(angles, surface=one) for one in (surface, WHITE))
    np.testing.assert_allclose(found.s0, true.s0, rtol=0.01)


def test_errors_of_the_table_are_inputs_of_the_surface() -> None:
    material = tabulated("white", measured()).at(WAVELENGTH_M)
    angles = (np.array([0.8]), np.array([0.5]), np.array([2.0]))
    assert isinstance(material.table, TabulatedBrdf)
    plain = {"n": 1.0, "slope_rms": 0.3, "specular_weight": 0.0, "table": material.table}
    brighter = mueller(*angles, surface=Surface(**plain, table_f00=1.0))
    expected = 1.0 + material.table.standard_error(*angles)[0, 0]
    ratio = brighter[0, 0, 0] / mueller(*angles, surface=Surface(**plain))[0, 0, 0]
    assert ratio == pytest.approx(expected, rel=1e-3)


def test_between_two_wavelengths_the_change_is_an_error() -> None:
    between = measured().at(565e-9)
    at = tuple(np.array([value]) for value in (0.5, 0.5, 1.0))
    true = mueller(*at, surface=WHITE)[0, 0, 0] * 0.949
    found, error = between.matrix(*at)[0, 0, 0], between.standard_error(*at)[0, 0]
    assert abs(found / true - 1.0) < 3.0 * error
    assert error > 0.02


def test_nothing_is_extrapolated_in_silence(table: TabulatedBrdf) -> None:
    with pytest.raises(ValueError, match="outside of the measured range"):
        table.require_covered(np.array([1.45]), np.array([0.2]))
    with pytest.raises(ValueError, match="500 to 633 nm"):
        measured().at(700e-9)
    with pytest.raises(ValueError, match="30 or more"):
        measured(count=20).at(WAVELENGTH_M)


@pytest.mark.parametrize("is_degree", [True, False])
def test_unpolarized_light_alone_is_enough(is_degree: bool) -> None:
    whole = measured()
    ratios = np.full_like(whole.ratios, np.nan)
    ratios[:, 0, 0] = 1.0
    ratios[:, 1:, 0] = whole.ratios[:, 1:, 0]
    if is_degree:
        ratios[:, 1, 0], ratios[:, 2, 0] = np.hypot(*ratios[:, 1:, 0].T), np.nan
    part = MeasuredTable(
        source="panel.csv",
        wavelength_m=whole.wavelength_m,
        theta_i_rad=whole.theta_i_rad,
        theta_r_rad=whole.theta_r_rad,
        phi_rad=whole.phi_rad,
        f00_per_sr=whole.f00_per_sr,
        ratios=ratios,
        is_degree=is_degree,
    ).at(WAVELENGTH_M)
    # In front of a white panel the light stands across the plane of scattering.
    at = (np.radians(60.0) * np.ones(3), np.radians(50.0) * np.ones(3), np.radians([180.0, 150.0, 120.0]))
    found, true = part.matrix(*at), mueller(*at, surface=WHITE)
    np.testing.assert_allclose(found[:, 1:, 0] / found[:, :1, 0], true[:, 1:, 0] / true[:, :1, 0], atol=0.005)
    assert not np.any(found[:, 1:, 1:])
