"""Agreement of prediction and measurement: standard scores, and a decision over all of them."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.special_functions import ndtr

FloatArray = NDArray[np.float64]


def two_sided_p_value(z: ArrayLike) -> FloatArray:
    """Return the chance that a standard normal number is at least as far from 0 as `z`.

    Parameters
    ----------
    z
        Standard scores, any shape.
    """
    return np.asarray(2.0 * ndtr(-np.abs(np.asarray(z, dtype=np.float64))))


def holm_rejections(p_values: ArrayLike, *, alpha: float) -> NDArray[np.bool_]:
    """Return which hypotheses are rejected so that any false rejection at all has a chance of at most `alpha`.

    Parameters
    ----------
    p_values
        Shape (n,), each in [0, 1]; they may depend on each other in any way.
    alpha
        Chance of one or more false rejections, in (0, 1).

    Returns
    -------
    array of bool, shape (n,)
        True where the hypothesis is rejected.

    Raises
    ------
    ValueError
        A p value or `alpha` lies outside of its range.

    References
    ----------
    Holm, S. (1979), "A simple sequentially rejective multiple test procedure", Scandinavian Journal of
    Statistics 6, 65-70.
    """
    p = np.asarray(p_values, dtype=np.float64)
    if not 0.0 < alpha < 1.0:
        raise ValueError(f"alpha is {alpha}; it has to lie between 0 and 1")
    if p.ndim != 1 or not np.all((p >= 0.0) & (p <= 1.0)):
        raise ValueError("p_values has to be one row of numbers from 0 to 1")
    order = np.argsort(p, kind="stable")
    passed = p[order] > alpha / np.arange(p.size, 0, -1)
    first_kept = int(np.argmax(passed)) if passed.any() else p.size
    rejected = np.zeros(p.size, dtype=np.bool_)
    rejected[order[:first_kept]] = True
    return rejected


def propagate_inputs(
    function: Callable[[FloatArray], FloatArray], values: ArrayLike, cov: ArrayLike, *, least: Sequence[float]
) -> FloatArray:
    """Return the covariance of a function's results that comes from uncertain inputs.

    Parameters
    ----------
    function
        Takes inputs, shape (k,), and returns results, shape (m,).
    values
        Where the inputs stand, shape (k,).
    cov
        Covariance of the inputs, shape (k, k).
    least
        Smallest value each input may take, for instance 0; -inf where there is none.

    Returns
    -------
    array of float64, shape (m, m)
        J cov J' with the Jacobian J of `input_jacobian`.

    Notes
    -----
    Linear in the inputs: where the response bends within one standard uncertainty the result is only its linear
    part.

    References
    ----------
    JCGM 100:2008 (GUM), section 5.
    """
    input_cov = np.asarray(cov, dtype=np.float64)
    jacobian = input_jacobian(function, values, np.sqrt(np.diag(input_cov)), least=least)
    return np.asarray(jacobian @ input_cov @ jacobian.T)


def input_jacobian(
    function: Callable[[FloatArray], FloatArray], values: ArrayLike, deviations: ArrayLike, *, least: Sequence[float]
) -> FloatArray:
    """Return the derivatives of a function's results by its inputs, each taken over one standard uncertainty.

    Parameters
    ----------
    function
        Takes inputs, shape (k,), and returns results, shape (m,).
    values
        Where the inputs stand, shape (k,).
    deviations
        Standard uncertainty of each input, shape (k,); an input with 0 has the derivative 0.
    least
        Smallest value each input may take, for instance 0; -inf where there is none.

    Returns
    -------
    array of float64, shape (m, k)
        By central differences over one standard uncertainty to either side (less where `least` is near; to one side
        where an input stands on it).

    References
    ----------
    JCGM 100:2008 (GUM), section 5.
    """
    start, steps = np.asarray(values, dtype=np.float64), np.asarray(deviations, dtype=np.float64)
    columns = [
        _slope(function, start, position=k, step=float(steps[k]), least=least[k])
        for k in range(start.size)
        if steps[k] > 0.0
    ]
    jacobian = np.zeros((function(start).size, start.size))
    if columns:
        jacobian[:, steps > 0.0] = np.stack(columns, axis=1)
    return jacobian


def _slope(
    function: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    *,
    position: int,
    step: float,
    least: float,
) -> FloatArray:
    """Return the derivative of `function` by one input."""
    below = min(step, start[position] - least)
    above = below if below > 0.0 else step
    high, low = start.copy(), start.copy()
    high[position] += above
    low[position] -= below
    return np.asarray((function(high) - function(low)) / (above + below))
