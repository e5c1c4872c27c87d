"""Fresnel's equations against the textbook quotients in 40 digits."""

import mpmath as mp
import numpy as np
import pytest

from model.surface import pbrdf as fresnel


def textbook(angle_rad: float, n: float, k: float) -> tuple[complex, complex]:
    with mp.workdps(40):
        c = mp.cos(mp.mpf(angle_rad))
        m2 = mp.mpc(n, k) ** 2
        w = mp.sqrt(m2 - 1 + c * c)
        return complex((c - w) / (c + w)), complex((m2 * c - w) / (m2 * c + w))


@pytest.mark.parametrize("angle_deg", [0.0, 10.0, 56.3, 75.0, 89.0, 89.999])
@pytest.mark.parametrize(("n", "k"), [(1.5, 0.0), (1.4, 0.4), (0.2, 3.4), (0.8, 0.0), (1.0 + 1e-9, 0.0), (1.0, 1e-6)])
def test_amplitudes(angle_deg: float, n: float, k: float) -> None:
    angle = np.deg2rad(angle_deg)
    cosine = np.cos([angle])
    r_s, r_p = fresnel.amplitudes(cos2_psi=cosine**2, n=n, k=k)
    expected_s, expected_p = textbook(angle, n, k)
    # Conditioning: the cosine of 89.999 deg carries 1e-11 of its rounding; near Brewster r_p is small against 1.
    assert abs(r_s[0] - expected_s) <= 1e-10 * abs(expected_s)
    assert abs(r_p[0] - expected_p) <= 1e-10 * abs(expected_p) + 1e-15 * abs(expected_s)


def test_no_reflection_without_an_interface() -> None:
    cosine = np.array([1.0, 0.5, 1e-8])
    elements = fresnel.mueller_elements(cos2_psi=cosine**2, n=1.0, k=0.0)
    assert not np.any(elements)


def test_total_reflection_beyond_the_critical_angle() -> None:
    sine = np.array([0.81, 0.9, 0.999])
    m00, m01, _ = fresnel.mueller_elements(cos2_psi=1.0 - sine**2, n=0.8, k=0.0)
    np.testing.assert_allclose(m00, 1.0, atol=1e-14)
    np.testing.assert_allclose(m01, 0.0, atol=1e-14)


def test_a_mirror_flips_s2() -> None:
    _, _, m22 = fresnel.mueller_elements(cos2_psi=np.array([1.0]), n=1.5, k=0.0)
    assert m22[0] == pytest.approx(-0.04, abs=1e-17)
