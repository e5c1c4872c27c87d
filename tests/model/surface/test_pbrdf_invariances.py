"""What every pBRDF must obey, whatever its numbers."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.surface import pbrdf as fresnel
from model.surface.pbrdf import Surface, half_vector_geometry, mueller

SHADOWS = ("none", "v-cavity", "smith", "smith-correlated")
MIRROR = np.diag([1.0, 1.0, -1.0])
# Not so near the horizon that rounding of the angles shows: 1 / cos(1.5) = 14.
zeniths = st.floats(0.0, 1.5)
azimuths = st.floats(-np.pi, np.pi)
indices = st.tuples(st.floats(1.01, 2.5), st.sampled_from([0.0, 0.3, 4.0]))


def random_angles(count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.uniform(0, 1.5, count), rng.uniform(0, 1.5, count), rng.uniform(-np.pi, np.pi, count)


def close(actual: np.ndarray, expected: np.ndarray, relative: float) -> None:
    scale = np.maximum(np.abs(expected[..., 0, 0]), np.finfo(float).tiny)
    assert np.max(np.abs(actual - expected) / scale[..., None, None]) < relative


@pytest.mark.parametrize("shadow", SHADOWS)
@pytest.mark.parametrize("diffuse", ["lambert", "coupled", "polarised"])
@given(theta_i=zeniths, theta_r=zeniths, phi=azimuths, index=indices)
@settings(deadline=None, max_examples=25)
def test_reciprocity(shadow: str, diffuse: str, theta_i: float, theta_r: float, phi: float, index: tuple) -> None:
    # Lobes repeat among few indices only by chance; E's table is made for the fixed one below.
    lobe = Surface(n=index[0], k=index[1], slope_rms=0.25, shadowing=shadow)
    whole = Surface(n=1.5, slope_rms=0.25, shadowing=shadow, dhr=0.4, diffuse=diffuse)
    for surface in (lobe, whole):
        there = mueller(theta_i, theta_r, phi, surface=surface)
        back = mueller(theta_r, theta_i, phi, surface=surface)
        close(back, there.T, 1e-11)


@given(theta_i=zeniths, theta_r=zeniths, phi=azimuths, index=indices)
@settings(deadline=None, max_examples=50)
def test_mirror_symmetry(theta_i: float, theta_r: float, phi: float, index: tuple) -> None:
    surface = Surface(n=index[0], k=index[1], slope_rms=0.2)
    there = mueller(theta_i, theta_r, phi, surface=surface)
    close(mueller(theta_i, theta_r, -phi, surface=surface), MIRROR @ there @ MIRROR, 1e-15)


@pytest.mark.parametrize("phi", [0.0, np.pi, -np.pi, 2 * np.pi])
def test_plane_of_incidence_mixes_no_s2(phi: float) -> None:
    # sin(pi) of the double pi is 1.2e-16, which is all that these elements may hold.
    theta_i, theta_r, _ = random_angles(200, 1)
    matrix = mueller(theta_i, theta_r, phi, surface=Surface(n=1.4, k=0.4, slope_rms=0.3))
    mixed = np.abs(matrix[:, [0, 1, 2, 2], [2, 2, 0, 1]]) / matrix[:, :1, 0]
    assert np.max(mixed) < 1e-14


def test_azimuth_is_periodic() -> None:
    theta_i, theta_r, phi = random_angles(500, 2)
    surface = Surface(n=1.5, slope_rms=0.3)
    # phi + 2 pi rounds by 4e-16, which the exponent magnifies by tan^2 / slope^2, here below 1e5.
    close(
        mueller(theta_i, theta_r, phi + 2 * np.pi, surface=surface),
        mueller(theta_i, theta_r, phi, surface=surface),
        1e-10,
    )


def test_scalars_and_arrays_agree() -> None:
    theta_i, theta_r, phi = random_angles(50, 3)
    surface = Surface(n=1.6, k=0.1, slope_rms=0.2, dhr=0.3)
    together = mueller(theta_i.reshape(5, 10), theta_r.reshape(5, 10), phi.reshape(5, 10), surface=surface)
    assert together.shape == (5, 10, 3, 3)
    alone = [mueller(*angles, surface=surface) for angles in zip(theta_i, theta_r, phi, strict=True)]
    # Vector and scalar library loops may differ in the last digit, and Gaussians magnify it.
    close(together.reshape(50, 3, 3), np.array(alone), 1e-12)


def test_angles_broadcast_across_blocks() -> None:
    theta_i = np.linspace(0.0, 1.4, 150)
    theta_r = np.linspace(0.0, 1.4, 140)[:, None]
    surface = Surface(n=1.5, slope_rms=0.3)
    matrix = mueller(theta_i, theta_r, 3.0, surface=surface)
    assert matrix.shape == (140, 150, 3, 3)
    close(matrix[77, 101], mueller(theta_i[101], theta_r[77, 0], 3.0, surface=surface), 1e-12)


@pytest.mark.parametrize("shadow", SHADOWS)
@pytest.mark.parametrize("diffuse", [None, "lambert", "balance", "coupled", "polarised"])
@pytest.mark.parametrize(("n", "k"), [(1.0, 0.0), (1.5, 0.0), (0.97, 6.0), (1e-9, 1.0)])
@pytest.mark.parametrize("slope", [1e-3, 0.3])
def test_finite_everywhere(shadow: str, diffuse: str | None, n: float, k: float, slope: float) -> None:
    exact = np.deg2rad([0.0, 1e-12, 30.0, 45.0, 89.9999, 90.0, 91.0, 180.0])
    zenith = np.append(exact, [np.nextafter(np.pi / 2, 0.0), np.pi / 2 - 1e-12])
    azimuth = np.deg2rad([0.0, 1e-13, 37.0, 90.0, 180.0, 180.0 - 1e-9, 270.0, 360.0, -180.0])
    kind = {} if diffuse is None else {"diffuse": diffuse, "dhr": 1.0}
    surface = Surface(n=n, k=k, slope_rms=slope, shadowing=shadow, **kind)
    matrix = mueller(zenith[:, None, None], zenith[:, None], azimuth, surface=surface)
    assert np.all(np.isfinite(matrix))
    assert np.all(matrix[..., 0, 0] >= 0.0)


def test_nothing_at_and_beyond_the_horizon() -> None:
    hidden = np.deg2rad([90.0, 100.0, 180.0])
    surface = Surface(n=1.5, slope_rms=0.3, dhr=0.5)
    assert not np.any(mueller(hidden, 0.3, 1.0, surface=surface))
    assert not np.any(mueller(0.3, hidden, 1.0, surface=surface))


def test_index_one_reflects_nothing() -> None:
    theta_i, theta_r, phi = random_angles(100, 4)
    assert not np.any(mueller(theta_i, theta_r, phi, surface=Surface(n=1.0, slope_rms=0.2)))


def test_brewster_reflection_is_fully_horizontal() -> None:
    angle = np.arctan(1.5)
    matrix = mueller(angle, angle, np.pi, surface=Surface(n=1.5, slope_rms=0.1))
    assert matrix[1, 0] / matrix[0, 0] == pytest.approx(1.0, abs=1e-15)


def test_normal_incidence_is_a_mirror() -> None:
    n, k = 1.4, 0.4
    matrix = mueller(0.0, 0.0, np.pi, surface=Surface(n=n, k=k, slope_rms=0.1))
    power = ((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2)
    # D = 1 / (2 pi slope^2) and 1 / (4 cos cos) = 1/4 there.
    expected = np.diag([1.0, 1.0, -1.0]) * power / (8 * np.pi * 0.1**2)
    np.testing.assert_allclose(matrix, expected, atol=1e-14 * expected[0, 0])


@pytest.mark.parametrize("theta_deg", [0.0, 20.0, 60.0, 80.0])
def test_retro_reflection_keeps_the_frame(theta_deg: float) -> None:
    theta = np.deg2rad(theta_deg)
    matrix = mueller(theta, theta, 0.0, surface=Surface(n=1.5, slope_rms=0.5))
    normalised = matrix / matrix[0, 0]
    np.testing.assert_allclose(normalised, np.diag([1.0, 1.0, -1.0]), atol=1e-14)


def test_nadir_view_turns_with_azimuth_and_with_nothing_else() -> None:
    phi = np.linspace(-np.pi, np.pi, 25)
    matrix = mueller(0.5, 0.0, phi, surface=Surface(n=1.5, slope_rms=0.3))
    outgoing = matrix[:, :, 0]
    np.testing.assert_allclose(outgoing[:, 0], outgoing[0, 0], rtol=1e-13)
    np.testing.assert_allclose(np.hypot(outgoing[:, 1], outgoing[:, 2]), abs(outgoing[0, 1]), rtol=1e-13)
    beside = mueller(0.5, 1e-7, phi, surface=Surface(n=1.5, slope_rms=0.3))
    # F changes by the slope of its logarithm, about tan / slope^2 = 3 per rad, times 1e-7.
    close(beside, matrix, 1e-6)


def test_dolp_is_fresnels_and_stands_across_the_scattering_plane() -> None:
    theta_i, theta_r, phi = random_angles(500, 5)
    geometry = half_vector_geometry(theta_i, theta_r, phi)
    m00, m01, _ = fresnel.mueller_elements(cos2_psi=geometry.cos2_psi, n=1.5, k=0.0)
    for shadow, slope in (("none", 0.5), ("smith", 0.8)):
        light = mueller(theta_i, theta_r, phi, surface=Surface(n=1.5, slope_rms=slope, shadowing=shadow))[..., 0]
        np.testing.assert_allclose(np.hypot(light[:, 1], light[:, 2]) / light[:, 0], m01 / m00, atol=1e-12)
        # The electric field stands along s = k_i x k_r. Literal vectors: x to the sun, y counter-clockwise.
        sun = np.stack([np.sin(theta_i), 0 * phi, np.cos(theta_i)], axis=-1)
        camera = np.stack([np.sin(theta_r) * np.cos(phi), np.sin(theta_r) * np.sin(phi), np.cos(theta_r)], axis=-1)
        h = np.stack([-np.sin(phi), np.cos(phi), 0 * phi], axis=-1)
        s = np.cross(-sun, camera)
        expected = np.arctan2(np.sum(s * np.cross(camera, h), axis=-1), np.sum(s * h, axis=-1))
        aolp = 0.5 * np.arctan2(light[:, 2], light[:, 1])
        np.testing.assert_allclose(np.sin(aolp - expected), 0.0, atol=1e-10)


@pytest.mark.parametrize("argument", ["theta_i_rad", "theta_r_rad", "phi_rad"])
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_angles_must_be_finite(argument: str, bad: float) -> None:
    angles = {"theta_i_rad": 0.1, "theta_r_rad": 0.2, "phi_rad": 0.3} | {argument: [0.1, bad]}
    with pytest.raises(ValueError, match=argument):
        mueller(**angles, surface=Surface(n=1.5, slope_rms=0.2))


@pytest.mark.parametrize("bad", [-0.01, 3.2])
def test_zenith_angles_have_a_range(bad: float) -> None:
    with pytest.raises(ValueError, match="theta_r_rad"):
        mueller(0.1, bad, 0.0, surface=Surface(n=1.5, slope_rms=0.2))
