import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.atmosphere.layers import (
    AerosolKind,
    Layer,
    expansion_coefficients,
    henyey_greenstein,
    rayleigh_column,
    stokes_basis,
)
from tests.model.atmosphere.oracles import azimuth_modes, rayleigh_matrix

MOLECULES = Layer(0.3, 0.0, 0.0, 0.0, 0.958)


@settings(deadline=None, max_examples=50)
@given(u=st.floats(-1.0, 1.0), u_in=st.floats(-1.0, 1.0), phi_rad=st.floats(-7.0, 7.0, allow_subnormal=False))
def test_rayleigh_column_is_that_of_the_dipole(u, u_in, phi_rad):
    column = rayleigh_column(mu=np.array(u), beam_mu=u_in, phi_rad=np.array(phi_rad))
    np.testing.assert_allclose(column, rayleigh_matrix(u, u_in, phi_rad, 1.0)[:, 0], atol=1e-14)


def test_rayleigh_expansion_gives_the_modes_of_the_dipole_matrix():
    u, u_in, samples = 0.35, -0.8, 8  # 8 azimuths resolve the modes 0..2 exactly
    full = np.array(
        [rayleigh_matrix(u, u_in, phi, MOLECULES.delta) for phi in 2 * np.pi * np.arange(samples) / samples]
    )
    a1, a2, a3, b1 = expansion_coefficients([MOLECULES], degree_max=2, aerosol=AerosolKind.DEPOLARIZING)[0].T
    basis = stokes_basis(degree_max=2, order_max=2, mu=np.array([u, u_in]))
    middle = np.zeros((3, 3, 3))
    middle[:, 0, 0], middle[:, 1, 1], middle[:, 2, 2] = a1, a2, a3
    middle[:, 0, 1] = middle[:, 1, 0] = b1
    modes = np.einsum("mlis,lij,mljt->mst", basis[:, :, :, 0], middle, basis[:, :, :, 1])
    np.testing.assert_allclose(modes, azimuth_modes(full, 3), atol=1e-14)


def test_henyey_greenstein_has_mean_1_and_mean_cosine_g():
    nodes, weights = np.polynomial.legendre.leggauss(200)  # its series in g = 0.7 is below 1e-60 at degree 400
    values = henyey_greenstein(g=np.array(0.7), mu=nodes, beam_mu=1.0, phi_rad=np.zeros(200))
    assert weights @ values / 2.0 == pytest.approx(1.0, abs=1e-12)
    assert weights @ (values * nodes) / 2.0 == pytest.approx(0.7, abs=1e-12)


def test_aerosol_expansion_sums_to_henyey_greenstein():
    layer = Layer(0.0, 0.2, 0.9, 0.6, 1.0)
    a1 = expansion_coefficients([layer], degree_max=60, aerosol=AerosolKind.DEPOLARIZING)[0, :, 0]
    cosine = np.linspace(-1.0, 1.0, 9)
    series = np.polynomial.legendre.legval(cosine, a1)
    exact = 0.9 * henyey_greenstein(g=np.array(0.6), mu=cosine, beam_mu=1.0, phi_rad=np.zeros(9))
    # First term left out: 123 * 0.6^61 = 4e-12, the rest 2.5 times that.
    np.testing.assert_allclose(series, exact, atol=2e-11)


def test_coefficients_are_weighted_by_the_share_of_scattering():
    layer = Layer(0.1, 0.3, 0.5, 0.6, 1.0)
    a1 = expansion_coefficients([layer], degree_max=4, aerosol=AerosolKind.DEPOLARIZING)[0, :, 0]
    assert a1[0] == pytest.approx((0.1 + 0.3 * 0.5) / 0.4)
    assert a1[1] == pytest.approx(3 * 0.6 * 0.15 / 0.4)


def test_only_a_polarizing_aerosol_passes_polarization_on():
    layer = Layer(0.0, 0.3, 1.0, 0.6, 1.0)
    depolarizing = expansion_coefficients([layer], degree_max=4, aerosol=AerosolKind.DEPOLARIZING)[0]
    polarizing = expansion_coefficients([layer], degree_max=4, aerosol=AerosolKind.POLARIZING)[0]
    assert not np.any(depolarizing[:, 1:])
    np.testing.assert_allclose(polarizing[2:, 1], polarizing[2:, 0])
    np.testing.assert_allclose(polarizing[2:, 2], polarizing[2:, 0])
