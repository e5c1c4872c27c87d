import mpmath
import numpy as np
import pytest

from model.atmosphere.layers import Layer, element_edges, slant, source_weights


@pytest.mark.parametrize("part", [0.3, 0.5, 1.0])
@pytest.mark.parametrize("path", [1e-9, 1e-3, 0.4, 0.999, 1.001, 3.0, 50.0])
def test_weights_integrate_a_parabola_exactly(path, part):
    with mpmath.workdps(40):
        x, u = mpmath.mpf(path), mpmath.mpf(part)
        basis = (lambda v: 1 - 3 * v + 2 * v * v, lambda v: 4 * v - 4 * v * v, lambda v: 2 * v * v - v)
        exact = [float(mpmath.quad(lambda v, q=q: x * mpmath.exp(-x * (u - v)) * q(v), [0, u / 2, u])) for q in basis]
    weights = source_weights(path=np.array(path), part=np.array(part))
    # A few roundings of terms whose sum is at most the source times (1 - exp(-path)).
    np.testing.assert_allclose(weights, exact, rtol=2e-13, atol=2e-14 * (1 - np.exp(-path)))


def test_at_the_horizon_only_the_near_face_counts():
    np.testing.assert_allclose(source_weights(path=np.array(np.inf), part=np.array(1.0)), [0.0, 0.0, 1.0])


def test_nothing_crossed_adds_nothing():
    np.testing.assert_array_equal(source_weights(path=np.array(np.inf), part=np.array(0.0)), np.zeros(3))


def test_slant_depth_has_its_limits():
    np.testing.assert_array_equal(
        slant(np.array([0.0, 0.2, 0.2]), np.array([0.0, 0.0, 0.5])), np.array([0.0, np.inf, 0.4])
    )


def test_elements_are_as_fine_as_asked_and_keep_their_layer():
    layers = [Layer(0.1, 0.0, 0.0, 0.0, 1.0), Layer(0.25, 0.0, 0.0, 0.0, 0.5)]
    edges, owner = element_edges(layers, element_depth=0.06, halvings=2)
    assert np.all(np.diff(edges) <= 0.06)
    assert edges[[0, -1]] == pytest.approx([0.0, 0.35])
    assert np.sum(np.diff(edges)[owner == 0]) == pytest.approx(0.1)
    assert edges[1] == pytest.approx(0.05 / 4)


def test_a_single_element_is_halved_toward_both_faces():
    edges, _ = element_edges([Layer(0.01, 0.0, 0.0, 0.0, 1.0)], element_depth=0.02, halvings=2)
    steps = np.diff(edges)
    assert np.all(steps > 0.0)
    assert steps[0] == pytest.approx(0.0025)
    assert steps[-1] == pytest.approx(0.01 / 8)
