"""What a surface accepts, and what its diffuse term adds up to."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from model.surface.pbrdf import Surface, findings, hemispherical_reflectance, mueller, reflectance_table

KINDS = ("lambert", "balance", "coupled", "polarised")
WHITE = {"n": 1.5, "slope_rms": 0.15, "dhr": 0.8}


@pytest.mark.parametrize(
    ("argument", "value"),
    [
        ("n", 0.0),
        ("n", np.nan),
        ("k", -0.1),
        ("k", np.inf),
        ("slope_rms", 5e-4),
        ("slope_rms", np.nan),
        ("dhr", 1.2),
        ("dhr", -0.1),
        ("dhr", np.nan),
        ("dhr_angle_rad", 1.6),
        ("dhr_angle_rad", -0.1),
        ("specular_weight", 1.1),
        ("specular_weight", -0.1),
        ("shadowing", "beckmann"),
        ("diffuse", "rough"),
    ],
)
def test_values_have_ranges(argument: str, value: object) -> None:
    with pytest.raises(ValueError, match=argument):
        Surface(**{**WHITE, argument: value})


def test_smooth_surface_is_refused_with_the_reason() -> None:
    with pytest.raises(ValueError, match="narrower than the sun"):
        Surface(n=1.5, slope_rms=1e-4)


def test_dhr_below_the_lobes_own_says_what_to_change() -> None:
    # R(8 deg) of n = 1.5 is 0.0400; 0.03 / 0.0401 = 0.749.
    with pytest.raises(ValueError, match=r"specular_weight to at most 0\.74"):
        Surface(n=1.5, slope_rms=0.15, dhr=0.03)


def test_specular_weight_makes_it_consistent() -> None:
    surface = Surface(n=1.5, slope_rms=0.15, dhr=0.03, specular_weight=0.7)
    assert float(hemispherical_reflectance(surface.dhr_angle_rad, surface=surface).s0) == pytest.approx(0.03, abs=1e-7)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("weight", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("shadow", ["none", "v-cavity", "smith-correlated"])
def test_total_is_the_dhr_where_it_was_measured(kind: str, weight: float, shadow: str) -> None:
    surface = Surface(**WHITE, diffuse=kind, specular_weight=weight, shadowing=shadow, dhr_angle_rad=0.3)
    total = hemispherical_reflectance(0.3, surface=surface)
    # The series for E and the quadrature, 1e-7 each.
    assert float(total.s0) == pytest.approx(0.8, abs=2e-7)


@pytest.mark.parametrize("kind", KINDS)
def test_total_is_the_integral_of_the_pbrdf(kind: str) -> None:
    surface = Surface(n=1.5, slope_rms=0.3, dhr=0.6, diffuse=kind, specular_weight=0.8, shadowing="smith")
    cosine, step = np.polynomial.legendre.leggauss(200)
    theta_r = np.arccos(0.5 * (cosine + 1.0))[:, None]
    phi = (np.arange(200) + 0.5) * np.pi / 200
    row = mueller(1.0, theta_r, phi, surface=surface)[..., 0, :]
    weight = (0.5 * step)[:, None] * np.cos(theta_r) * 2.0 * np.pi / 200
    total = np.sum(row * weight[..., None], axis=(0, 1))
    stated = hemispherical_reflectance(1.0, surface=surface)
    # 500 nodes instead of 200 change the sum by 1e-14; the series for E and the quadrature are good to 1e-7 each.
    assert float(stated.s0) == pytest.approx(total[0], abs=3e-7)
    assert float(stated.s1) == pytest.approx(total[1], abs=3e-7)


@pytest.mark.parametrize("name", ["black", "white", "asphalt"])
@pytest.mark.parametrize("kind", ["coupled", "polarised"])
def test_energy_for_every_polarization_up_to_85_deg(name: str, kind: str) -> None:
    made_of = {
        "black": {"n": 1.5, "slope_rms": 0.15, "dhr": 0.05},
        "white": WHITE,
        "asphalt": {"n": 1.6, "slope_rms": 0.3, "dhr": 0.09},
    }
    surface = Surface(**made_of[name], diffuse=kind)
    total = hemispherical_reflectance(np.deg2rad(np.arange(0.0, 86.0)), surface=surface)
    assert np.all(total.s0 + np.abs(total.s1) <= 1.0)


def test_polarised_diffuse_conserves_energy_to_the_horizon() -> None:
    surface = Surface(**WHITE, diffuse="polarised")
    total = hemispherical_reflectance(np.deg2rad(np.arange(85.0, 89.95, 0.1)), surface=surface)
    assert np.all(total.s0 + np.abs(total.s1) <= 1.0)


def test_balance_keeps_the_total_constant() -> None:
    surface = Surface(**WHITE, diffuse="balance")
    total = hemispherical_reflectance(np.deg2rad([0.0, 30.0, 60.0, 80.0]), surface=surface)
    np.testing.assert_allclose(total.s0, 0.8, atol=3e-7)


def test_lambert_is_constant() -> None:
    with_diffuse, without = Surface(**WHITE, diffuse="lambert"), Surface(n=1.5, slope_rms=0.15)
    angles = (np.array([0.1, 0.9, 1.3]), np.array([0.2, 1.0, 0.4]), 2.0)
    difference = mueller(*angles, surface=with_diffuse) - mueller(*angles, surface=without)
    share = 0.8 - float(hemispherical_reflectance(np.deg2rad(8.0), surface=without).s0)
    np.testing.assert_allclose(difference[:, 0, 0], share / np.pi, rtol=1e-7)
    assert not np.any(difference.reshape(3, 9)[:, 1:])


def test_white_paint_by_another_quadrature() -> None:
    # Quadrature over outgoing directions, good to 7e-4, printed with three digits.
    total = hemispherical_reflectance(np.deg2rad([8.0, 80.0, 88.0]), surface=Surface(**WHITE))
    np.testing.assert_allclose(total.s0, [0.800, 0.843, 0.890], atol=1.2e-3)


@pytest.mark.parametrize(
    ("changes", "geometry", "f00", "dolp"),
    [
        ({"n": 1.49, "slope_rms": 0.10, "dhr": 0.05}, (50, 50, 180), 0.545, 0.940),
        ({"n": 1.49, "slope_rms": 0.10, "dhr": 0.05}, (22, 53, 180), 0.0112, 0.415),
        ({"n": 1.50, "slope_rms": 0.15, "dhr": 0.80}, (50, 40, 180), 0.399, 0.322),
        ({"n": 1.63, "slope_rms": 0.30, "dhr": 0.10}, (43, 53, 90), 0.0193, 0.106),
    ],
)
def test_typical_scenes(changes: dict, geometry: tuple, f00: float, dolp: float) -> None:
    light = mueller(*np.deg2rad(geometry), surface=Surface(**changes))[:, 0]
    # Printed with three digits, so half a unit of the last one, doubled.
    assert light[0] == pytest.approx(f00, rel=5e-3)
    assert np.hypot(light[1], light[2]) / light[0] == pytest.approx(dolp, abs=1e-3)


def test_polarised_diffuse_light_is_vertical() -> None:
    # No lobe to speak of beside the glint: what comes out at 60 deg has passed the surface, p better than s.
    light = mueller(0.0, 1.0, 0.0, surface=Surface(**WHITE, diffuse="polarised"))[:, 0]
    assert light[1] < 0.0


def test_polarised_diffuse_of_a_hidden_interface_is_lambertian() -> None:
    # Without a lobe there is no interface that could polarise: every direction gets dhr / pi, all of it S0.
    matrix = mueller(np.array([0.1, 1.2]), 1.0, 2.0, surface=Surface(**WHITE, diffuse="polarised", specular_weight=0.0))
    expected = np.zeros((2, 3, 3))
    expected[:, 0, 0] = 0.8 / np.pi
    np.testing.assert_allclose(matrix, expected, atol=1e-14)


def test_a_perfect_mirror_leaves_nothing_to_diffuse() -> None:
    mirror = {"n": 1e-12, "k": 1.0, "slope_rms": 0.02}
    angles = (0.3, 0.4, 3.0)
    whole = mueller(*angles, surface=Surface(**mirror, dhr=1.0))
    np.testing.assert_array_equal(whole, mueller(*angles, surface=Surface(**mirror)))


def test_a_mirror_that_no_light_enters_has_no_light_to_polarise_on_its_way_out() -> None:
    # Rough: the lobe loses light between its facets, so that a DHR of 1 leaves something, which could not have entered.
    mirror = Surface(n=1.0, k=1e9, slope_rms=0.2, dhr=1.0, shadowing="smith", diffuse="polarised")
    with pytest.raises(ValueError, match="choose 'coupled'"):
        mueller(0.3, 0.4, 3.0, surface=mirror)


def test_weight_scales_the_lobe() -> None:
    angles = (0.7, 0.6, 3.0)
    full = mueller(*angles, surface=Surface(n=1.5, slope_rms=0.2))
    part = mueller(*angles, surface=Surface(n=1.5, slope_rms=0.2, specular_weight=0.25))
    np.testing.assert_allclose(part, 0.25 * full, rtol=1e-14)


def test_a_sound_surface_has_no_findings() -> None:
    assert findings(Surface(n=1.5, slope_rms=0.15, dhr=0.05)) == ()


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({**WHITE, "diffuse": "lambert"}, "unpolarised light"),
        (WHITE, "polarised light from 86 deg"),
        ({**WHITE, "shadowing": "none"}, "neighbouring facets"),
        ({**WHITE, "shadowing": "none"}, " unpolarised light from 89 deg"),
        ({**WHITE, "shadowing": "none"}, " polarised light from 8"),
        ({"n": 1.5, "slope_rms": 0.15, "dhr": 0.05, "diffuse": "balance"}, "no diffuse term is left"),
    ],
)
def test_findings(changes: dict, word: str) -> None:
    assert any(word in sentence for sentence in findings(Surface(**changes)))


def test_hemispherical_reflectance_ends_at_the_horizon() -> None:
    with pytest.raises(ValueError, match="theta_i_rad"):
        hemispherical_reflectance(np.pi / 2, surface=Surface(**WHITE))


def test_threads_share_the_series() -> None:
    theta = np.linspace(0.0, 1.5, 200)
    surfaces = [Surface(n=1.501 + 0.001 * (i % 3), slope_rms=0.21, dhr=0.5) for i in range(12)]
    alone = [mueller(theta, 0.5, 1.0, surface=surface) for surface in surfaces]
    reflectance_table.cache_clear()
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda surface: mueller(theta, 0.5, 1.0, surface=surface), surfaces))
    np.testing.assert_array_equal(together, alone)
