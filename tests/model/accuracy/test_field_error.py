import numpy as np
import pytest

from model.accuracy.field_error import PLACES, decay, field_error, grown
from model.quadrature import gauss_legendre


def over_field(law, per_side):
    """Values of a law of x and y in 0 to 1 at the tiles, as one component, and their weights."""
    node, weight = gauss_legendre(per_side)
    x, y = np.meshgrid(node, node)
    values = law(x, y).ravel()[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    return values, np.outer(weight, weight).ravel()


def estimate(law, per_side):
    values, _ = over_field(law, per_side)
    between = law(PLACES[:, 0], PLACES[:, 1])[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    return field_error(values, between)


def moments(law, per_side):
    values, weights = over_field(law, per_side)
    mean = weights @ values[:, 0]
    return mean, weights @ (values[:, 0] - mean) ** 2


def test_a_plane_has_no_error_with_two_tiles():
    found = estimate(lambda x, y: 10.0 + x + 2.0 * y, 2)
    # Rounding of 10, and of it times the deviation of the plane.
    assert np.max(found.mean) < 1e-13
    assert np.max(found.cov) < 1e-13


@pytest.mark.parametrize("per_side", [3, 4, 5, 6])
@pytest.mark.parametrize("steepness", [0.3, 1.0, 2.0])
def test_the_estimate_is_above_the_error_of_a_smooth_field(per_side, steepness):
    def law(x, y):
        return np.exp(steepness * (x + 0.5 * y))

    found = estimate(law, per_side)
    for own, finest, estimated in zip(
        moments(law, per_side), moments(law, 20), (found.mean[0], found.cov[0, 0]), strict=True
    ):
        # Sums of 400 values of size 1 round by some eps.
        assert abs(own - finest) < estimated + 1e-14


@pytest.mark.parametrize("kink", [0.31, 0.4, 0.55])
def test_the_estimate_is_above_the_error_of_a_kink(kink):
    def law(x, y):
        return 1.0 + np.abs(x + 0.3 * y - kink)

    found = estimate(law, 4)
    for own, finest, estimated in zip(
        moments(law, 4), moments(law, 400), (found.mean[0], found.cov[0, 0]), strict=True
    ):
        assert abs(own - finest) < estimated


def test_a_field_that_does_not_fall_off_is_not_trusted():
    def law(x, _):
        return np.sign(x - 0.4)

    true = abs(moments(law, 5)[1] - 4.0 * 0.4 * 0.6)
    assert estimate(law, 5).cov[0, 0] > true


def test_what_one_component_lacks_is_not_laid_on_another():
    found = estimate(lambda x, y: np.exp(2.0 * x + y), 3)
    assert found.cov[0, 0] > 0.0
    assert np.count_nonzero(found.cov) == 1


@pytest.mark.parametrize("per_side", [3, 4, 6])
@pytest.mark.parametrize("ratio", [0.05, 0.3])
def test_the_decay_of_a_field_is_that_of_its_degrees(per_side, ratio):
    def law(x, y):
        degrees = np.arange(per_side)
        factors = ratio**degrees * np.sqrt(2.0 * degrees + 1.0)
        return np.polynomial.legendre.legval(2.0 * x - 1.0, factors)

    assert decay(over_field(law, per_side)[0]) == pytest.approx(ratio, rel=1e-6)


def test_two_tiles_a_side_tell_no_decay():
    assert decay(over_field(lambda x, y: 1.0 + x, 2)[0]) is None


def test_a_field_without_any_light_tells_no_decay():
    assert decay(np.zeros((16, 3))) is None


@pytest.mark.parametrize("seed", range(4))
def test_a_covariance_grows_along_its_axes_for_every_error_within_the_sizes(seed):
    rng = np.random.default_rng(seed)
    field = rng.normal(size=(400, 3)) @ rng.normal(size=(3, 3))
    sizes = np.array([1.0, 0.5, 0.7]) * 1e-2
    cov = np.cov(field.T, bias=True)
    wider = grown(cov, sizes)
    axes = np.linalg.eigh(cov / np.outer(sizes, sizes))[1].T / sizes
    assert np.all(np.linalg.eigvalsh(wider - cov) > 0.0)
    for _ in range(50):
        # An error that goes with the field, of a deviation of 1 in units of the sizes.
        error = field @ rng.normal(size=(3, 3))
        error *= sizes / np.sqrt(3.0) / np.std(error, axis=0)
        found = np.cov((field + error).T, bias=True)
        for axis in axes:
            assert axis @ found @ axis <= axis @ wider @ axis


def test_where_there_was_no_field_the_error_is_all_of_it():
    assert np.diag(grown(np.zeros((3, 3)), np.array([2.0, 1.0, 1.5]))) == pytest.approx([4.0, 1.0, 2.25])
