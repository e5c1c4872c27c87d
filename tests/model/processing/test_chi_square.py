"""The chi-square law against mpmath in both tails."""

import mpmath as mp
import numpy as np
import pytest
from scipy.special import gammaincc

from model.processing import quadratic_forms as chi_square


@pytest.mark.parametrize("degrees", [1, 2, 3, 4, 13, 40])
@pytest.mark.parametrize("p", [1e-300, 1e-12, 0.4, 0.6, 1.0 - 1e-12])
def test_quantile(degrees: int, p: float) -> None:
    found = float(chi_square.upper_quantile(p, degrees))
    half, order = mp.mpf(found) / 2, mp.mpf(degrees) / 2
    if p < 0.5:
        residual = mp.gammainc(order, half, regularized=True) / mp.mpf(p) - 1
        scale = mp.gammainc(order, half)
    else:
        residual = 1 - mp.gammainc(order, 0, half, regularized=True) / (1 - mp.mpf(p))
        scale = mp.gammainc(order, 0, half)
    # one Newton step from the quantile found to the true one, relative to it
    step = residual * scale / (half**order * mp.exp(-half))
    assert abs(float(step)) < 1e-15


def test_ends() -> None:
    assert chi_square.upper_quantile(0.0, 3) == np.inf
    assert chi_square.upper_quantile(1.0, 3) == 0.0


@pytest.mark.parametrize("p", [-0.1, 1.1, np.nan])
def test_probabilities_outside_of_0_to_1_are_refused(p: float) -> None:
    with pytest.raises(ValueError, match="probability"):
        chi_square.upper_quantile(p, 3)


def test_degrees_below_1_are_refused() -> None:
    with pytest.raises(ValueError, match="degrees"):
        chi_square.upper_quantile(0.5, 0)


@pytest.mark.parametrize("degrees", [200, 201, 500, 2000])
@pytest.mark.parametrize("p", [1e-12, 1e-3, 0.5, 0.999])
def test_many_degrees_of_freedom_have_quantiles(p, degrees):
    found = chi_square.upper_quantile(p, degrees)
    assert gammaincc(0.5 * degrees, 0.5 * found) == pytest.approx(p, rel=1e-9)
