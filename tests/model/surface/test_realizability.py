"""Mueller matrices that light can have: Cloude's coherency matrix has no negative eigenvalue."""

import numpy as np
import pytest

from model.surface import pbrdf as fresnel
from model.surface.pbrdf import Surface, half_vector_geometry, mueller

PAULI = np.array([[[1, 0], [0, 1]], [[1, 0], [0, -1]], [[0, 1], [1, 0]], [[0, -1j], [1j, 0]]])
BASIS = np.einsum("iab,jcd->ijacbd", PAULI, PAULI.conj()).reshape(4, 4, 4, 4) / 4.0


def lowest_eigenvalue(block: np.ndarray, m33: np.ndarray) -> np.ndarray:
    """Of the coherency matrix of blockdiag(block, m33): averaging with the S3-conjugate removes the couplings."""
    full = np.zeros((len(block), 4, 4))
    full[:, :3, :3], full[:, 3, 3] = block, m33
    return np.linalg.eigvalsh(np.einsum("nij,ijab->nab", full, BASIS))[:, 0]


def sample(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.uniform(0, 1.5, 400), rng.uniform(0, 1.5, 400), rng.uniform(-np.pi, np.pi, 400)


@pytest.mark.parametrize("diffuse", [None, "lambert", "balance", "coupled", "polarised"])
@pytest.mark.parametrize(("n", "k"), [(1.5, 0.0), (1.4, 0.4), (0.97, 6.0)])
def test_cloude(n: float, k: float, diffuse: str | None) -> None:
    angles = sample(6)
    lobe = Surface(n=n, k=k, slope_rms=0.3)
    specular = mueller(*angles, surface=lobe)
    geometry = half_vector_geometry(*angles)
    m00, _, m22 = fresnel.mueller_elements(cos2_psi=geometry.cos2_psi, n=n, k=k)
    # In the facet's axes M33 = M22, and turning the axes leaves M33 alone; depolarised light adds nothing to it.
    m33 = m22 / m00 * specular[:, 0, 0]
    whole = specular
    if diffuse is not None:
        whole = mueller(*angles, surface=Surface(n=n, k=k, slope_rms=0.3, dhr=0.95, diffuse=diffuse))
    scale = whole[:, 0, 0]
    lowest = lowest_eigenvalue(whole / scale[:, None, None], m33 / scale)
    assert np.min(lowest) > -1e-12


def test_the_test_sees_a_wrong_matrix() -> None:
    angles = sample(7)
    matrix = mueller(*angles, surface=Surface(n=1.5, slope_rms=0.3))
    geometry = half_vector_geometry(*angles)
    m00, _, m22 = fresnel.mueller_elements(cos2_psi=geometry.cos2_psi, n=1.5, k=0.0)
    matrix = matrix / matrix[:, :1, :1]
    matrix[:, 1, 0] *= 1.2
    assert np.min(lowest_eigenvalue(matrix, m22 / m00)) < -1e-3
