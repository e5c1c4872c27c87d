import numpy as np
import pytest

from model.processing.agreement import propagate


def _propagate(function, values, cov, **limits):
    size = len(values)
    free = {"least": np.full(size, -np.inf), "most": np.full(size, np.inf)}
    return propagate(function, values, cov, **(free | limits))


def test_a_linear_response_gives_j_cov_j():
    matrix = np.array([[1.0, 2.0], [0.5, -3.0], [0.0, 1.0]])
    cov = np.array([[0.04, 0.01], [0.01, 0.09]])
    found = _propagate(lambda x: matrix @ x, [1.0, 2.0], cov)
    # Differences over 0.2 and 0.3 of numbers of size 10: rounding of 1e-14.
    np.testing.assert_allclose(found.cov, matrix @ cov @ matrix.T, atol=1e-13)
    np.testing.assert_allclose(found.effects, matrix * [0.2, 0.3], atol=1e-13)
    assert found.curved == ()


def test_a_square_about_its_vertex_is_taken_by_quadrature():
    # x^2 with x ~ N(0, s): second moment about the value at 0 is 3 s^4; the slope alone says 0. Exact for 3 nodes on.
    found = _propagate(lambda x: x**2, [0.0], np.array([[0.25]]))
    assert found.curved == (0,)
    np.testing.assert_allclose(found.cov, [[3 * 0.25**2]], rtol=1e-12)


def test_correlated_inputs_bend_together_along_the_axes_of_their_covariance():
    # x0 + x1 ~ N(0, t) with t = 2 s^2 (1 + rho): of its square the second moment is 3 t^2. Each alone makes 3 s^4.
    cov = 0.25 * np.array([[1.0, 0.9], [0.9, 1.0]])
    found = _propagate(lambda x: np.array([(x[0] + x[1]) ** 2]), [0.0, 0.0], cov)
    assert found.curved == (0, 1)
    np.testing.assert_allclose(found.cov, [[3.0 * cov.sum() ** 2]], rtol=1e-12)


def test_correlated_inputs_without_room_together_are_moved_alone():
    cov = np.array([[0.25, 0.2], [0.2, 0.25]])
    room = {"least": np.array([-9.0, 0.0]), "curvature_tolerance": 0.01}
    found = _propagate(lambda x: np.array([x[0] ** 2 + 9.0 * x[1]]), [0.0, 0.6], cov, **room)
    assert (found.curved, found.limited) == ((0,), ())
    np.testing.assert_allclose(found.cov, [[81.0 * 0.25 + 3.0 * 0.25**2]], rtol=1e-12)


def test_a_curved_response_beside_a_steep_one_is_left_to_slopes():
    def function(x):
        return np.array([100.0 * x[0] + x[1] ** 2])

    found = _propagate(function, [0.0, 0.0], np.eye(2))
    # The bend is 1 against 100: it changes the deviation by 3 / 2e4.
    assert found.curved == ()


def test_an_input_near_its_limit_has_a_slope_over_the_room_that_there_is_and_is_named():
    found = _propagate(lambda x: 2.0 * x, [0.5], np.array([[1.0]]), least=np.array([0.4]))
    np.testing.assert_allclose(found.effects, [[2.0]], rtol=1e-12)
    assert found.limited == (0,)


def test_a_curved_input_without_room_for_quadrature_is_named():
    # One standard uncertainty fits above 0; the outer node of three, at 1.73 of them, does not.
    found = _propagate(lambda x: x**3, [1.2], np.array([[1.0]]), least=np.array([0.0]))
    assert found.limited == (0,)
    assert found.curved == ()


def test_limits_are_never_crossed():
    seen = []

    def function(x):
        seen.append(float(x[0]))
        return x**3

    _propagate(function, [0.9], np.array([[0.04]]), least=np.array([0.0]), most=np.array([1.0]))
    assert min(seen) >= 0.0
    assert max(seen) <= 1.0


def test_an_input_without_any_room_is_refused():
    with pytest.raises(ValueError, match="neither rise nor fall"):
        _propagate(lambda x: x, [1.0], np.array([[0.04]]), least=np.array([1.0]), most=np.array([1.0]))


def test_where_results_do_not_exist_on_one_side_the_other_has_to_do():
    def function(x):
        if x[0] > 1.1:
            raise ValueError("too large")
        return 2.0 * x

    found = _propagate(function, [1.0], np.array([[0.25]]))
    np.testing.assert_allclose(found.effects, [[1.0]], rtol=1e-12)
    assert found.limited == (0,)


def test_a_curved_response_that_ends_before_the_outer_node_takes_the_narrower_rule():
    def function(x):
        if abs(x[0]) > 2.0:
            raise ValueError("too far")
        return x**2

    # Nodes of three lie at 1.73 standard uncertainties, of five at 2.86.
    found = _propagate(function, [0.0], np.array([[1.0]]))
    assert found.curved == (0,)
    np.testing.assert_allclose(found.cov, [[3.0]], rtol=1e-12)
