"""Directional-hemispherical reflectance of the lobe: oracles, furnaces, and the errors it states."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.special import erfc

from model.surface.pbrdf import Lobe, Surface, facet_nodes, lobe_reflectance, mueller, reflectance_table

REFERENCE = json.loads(Path(__file__).with_name("reference_pbrdf.json").read_text())["dhr"]
NAMES = {"none": "none", "vcavity": "v-cavity", "smith_sep": "smith", "smith_hc": "smith-correlated"}
# A lossless plasma reflects everything at every angle: the white furnace.
INDICES = {"perfect_R1": (1e-12, 1.0), "dielectric_1p5": (1.5, 0.0), "aluminium_0p97_6p0": (0.97, 6.0)}
SHADOWS = tuple(NAMES.values())


def lobe(shadow: str = "v-cavity", *, n: float = 1.5, k: float = 0.0, slope: float = 0.2) -> Lobe:
    return Lobe(n=n, k=k, slope_rms=slope, shadowing=shadow)


@pytest.mark.parametrize("material", INDICES)
@pytest.mark.parametrize("slope", ["0.1", "0.35"])
@pytest.mark.parametrize("key", NAMES)
def test_table_of_another_quadrature(material: str, slope: str, key: str) -> None:
    n, k = INDICES[material]
    theta = np.deg2rad(REFERENCE["theta_deg"])
    actual = lobe_reflectance(theta, lobe=lobe(NAMES[key], n=n, k=k, slope=float(slope)))
    # The table's own error is up to 7e-4 (its source says so).
    np.testing.assert_allclose(actual.s0, REFERENCE["values"][material][slope][key], atol=1e-3)


@pytest.mark.parametrize("shadow", SHADOWS)
def test_integral_over_outgoing_directions(shadow: str) -> None:
    theta_i, slope = np.deg2rad(50.0), 0.3
    cosine, step = np.polynomial.legendre.leggauss(200)
    theta_r = np.arccos(0.5 * (cosine + 1.0))[:, None]
    # Midpoints on the half circle: the integrand is even in phi for S0 and S1.
    phi = (np.arange(200) + 0.5) * np.pi / 200
    surface = Surface(n=1.5, slope_rms=slope, shadowing=shadow)
    row = mueller(theta_i, theta_r, phi, surface=surface)[..., 0, :2]
    weight = (0.5 * step)[:, None] * np.cos(theta_r) * 2.0 * np.pi / 200
    total = np.sum(row * weight[..., None], axis=(0, 1))
    actual = lobe_reflectance(theta_i, lobe=lobe(shadow, slope=slope))
    # 600 nodes instead of 200 change the sum by 1e-14, with the V-cavity's kinks by 1e-6. The other side: 1e-8.
    relative = 1e-5 if shadow == "v-cavity" else 1e-6
    assert float(actual.s0) == pytest.approx(total[0], rel=relative)
    assert float(actual.s1) == pytest.approx(total[1], rel=relative)


@pytest.mark.parametrize("shadow", SHADOWS)
@pytest.mark.parametrize(("n", "k", "slope"), [(1.5, 0.0, 0.05), (1.5, 0.0, 0.35), (0.97, 6.0, 0.2), (1.5, 0.0, 1e-3)])
def test_stated_error_holds(shadow: str, n: float, k: float, slope: float) -> None:
    theta = np.deg2rad([0.0, 20.0, 45.0, 60.0, 80.0, 88.0, 89.9])
    rough = lobe_reflectance(theta, lobe=lobe(shadow, n=n, k=k, slope=slope), tolerance=1e-5)
    fine = lobe_reflectance(theta, lobe=lobe(shadow, n=n, k=k, slope=slope), tolerance=1e-13)
    # 5e-11: facets beyond seven standard deviations, which both rules leave out, do not enter the difference;
    # the finest rule's own rounding and error do.
    assert np.all(np.abs(rough.s0 - fine.s0) <= rough.error + fine.error + 5e-11)
    assert np.all(np.abs(rough.s1 - fine.s1) <= rough.error + fine.error + 5e-11)


@pytest.mark.parametrize("shadow", ["v-cavity", "smith", "smith-correlated"])
@pytest.mark.parametrize("slope", [0.02, 0.2, 0.6])
def test_white_furnace(shadow: str, slope: float) -> None:
    theta = np.linspace(0.0, np.pi / 2, 31)
    reflectance = lobe_reflectance(theta, lobe=lobe(shadow, n=1e-12, k=1.0, slope=slope))
    assert np.all(reflectance.s0 <= 1.0 + reflectance.error)


@pytest.mark.parametrize("shadow", SHADOWS)
def test_smooth_furnace_loses_nothing(shadow: str) -> None:
    reflectance = lobe_reflectance(np.deg2rad([0.0, 40.0]), lobe=lobe(shadow, n=1e-12, k=1.0, slope=0.02))
    # Facets that send light below the horizon at 40 deg lean by 25 deg: 23 standard deviations.
    np.testing.assert_allclose(reflectance.s0, 1.0, atol=1e-8)


def test_index_one_reflects_nothing() -> None:
    assert float(lobe_reflectance(0.5, lobe=lobe(n=1.0)).s0) == 0.0


def test_facets_are_normalised() -> None:
    # At normal incidence a facet mirrors above the horizon if its slope is below 1: share 1 - exp(-1 / (2 slope^2)).
    nodes = facet_nodes(np.zeros(1), slope_rms=0.5, shadowing="none", order=60)
    assert float(np.sum(nodes.weight)) == pytest.approx(1.0 - np.exp(-2.0), abs=1e-9)


def test_smith_facets_show_the_projected_area() -> None:
    # Weak furnace: the visible projection of all facets, integral of G1 D (l . h)+, is the cosine of the sun.
    theta, slope = 1.3, 0.4
    a = 1.0 / (np.sqrt(2.0) * slope * np.tan(theta))
    shadow = 0.5 * (np.exp(-a * a) / (a * np.sqrt(np.pi)) - erfc(a))
    # In-plane slopes alone matter: mean of (cos + x sin)+ over a Gaussian x, by its closed form.
    mean, spread = np.cos(theta), slope * np.sin(theta)
    projected = mean * (1 - 0.5 * erfc(mean / spread / np.sqrt(2))) + spread * np.exp(
        -0.5 * (mean / spread) ** 2
    ) / np.sqrt(2 * np.pi)
    assert projected / (1.0 + shadow) == pytest.approx(np.cos(theta), rel=1e-14)


def test_angles_keep_their_shape() -> None:
    reflectance = lobe_reflectance(np.full((2, 3), 0.4), lobe=lobe())
    assert reflectance.s0.shape == reflectance.s1.shape == reflectance.error.shape == (2, 3)


def test_more_angles_than_one_batch() -> None:
    theta = np.linspace(0.0, 1.5, 150)
    together = lobe_reflectance(theta, lobe=lobe())
    alone = lobe_reflectance(theta[140], lobe=lobe())
    assert float(alone.s0) == pytest.approx(together.s0[140], abs=1e-15)


def test_below_the_horizon_is_refused() -> None:
    with pytest.raises(ValueError, match="theta_i_rad"):
        lobe_reflectance(1.6, lobe=lobe())


@pytest.mark.parametrize("shadow", SHADOWS)
@pytest.mark.parametrize(
    ("n", "k", "slope"), [(1.5, 0.0, 1e-3), (1.5, 0.0, 0.15), (1.6, 0.0, 0.35), (0.97, 6.0, 0.2), (1.5, 0.0, 1.0)]
)
def test_table_holds_its_stated_error(shadow: str, n: float, k: float, slope: float) -> None:
    one = lobe(shadow, n=n, k=k, slope=slope)
    table = reflectance_table(one)
    theta = np.append(np.linspace(0.0, 1.57, 97), np.pi / 2 - slope * np.linspace(0.05, 1.0, 20))
    exact = lobe_reflectance(theta, lobe=one)
    bounded = exact.s0 <= 1.0
    miss = np.abs(table.at(theta) - exact.s0)[bounded]
    assert table.error < 1e-6
    assert np.all(miss <= table.error + exact.error[bounded])


def test_mean_over_the_hemisphere() -> None:
    theta, weight = reflectance_table(lobe(slope=0.01)).mean_nodes()
    # 2 integral cos^2 sin = 2/3; Gauss rules are exact here but for rounding.
    assert weight @ np.ones_like(theta) == pytest.approx(1.0, abs=1e-13)
    assert weight @ np.cos(theta) == pytest.approx(2.0 / 3.0, abs=1e-13)


def test_table_says_when_it_cannot_be_made() -> None:
    with pytest.raises(ValueError, match="critical angle"):
        reflectance_table(lobe("smith", n=0.8, slope=0.05))
