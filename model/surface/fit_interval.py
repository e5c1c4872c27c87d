"""Confidence intervals of a surface's parameters: to first order, and from the profile of chi-square."""

import numpy as np
from numpy.typing import NDArray

from model.special_functions import ndtri
from model.surface.fit import SurfaceFit, solved
from model.surface.fit_problem import difference_jacobian, physical_values, residuals

FloatArray = NDArray[np.float64]

# The parameter is held by a spring this many times stiffer than the data.
_STIFFNESS = 1e4


def gauss_interval(fit: SurfaceFit, name: str, *, level: float = 0.95) -> tuple[float, float]:
    """Return the first-order confidence interval of a parameter.

    Parameters
    ----------
    name
        A fitted parameter.
    level
        Probability with which such intervals hold the truth, between 0 and 1.

    Returns
    -------
    tuple of float
        Value plus and minus the normal quantile times the standard uncertainty; infinite where not determined.
        May reach beyond the bounds.

    Raises
    ------
    ValueError
        If the name was not fitted or the level is not between 0 and 1.
    """
    index, quantile = _parameter_index(fit, name), _normal_quantile(level)
    reach = quantile * float(fit.information.standard_uncertainty[index])
    return float(fit.values[index]) - reach, float(fit.values[index]) + reach


def profile_interval(fit: SurfaceFit, name: str, *, level: float = 0.95) -> tuple[float, float]:
    """Return the profile-likelihood confidence interval of a parameter.

    Parameters
    ----------
    name
        A fitted parameter.
    level
        Probability with which such intervals hold the truth, between 0 and 1.

    Returns
    -------
    tuple of float
        Where chi-square, minimised over the other parameters, rises by the squared normal quantile. An end that
        lies beyond the bounds is the bound.

    Raises
    ------
    ValueError
        If the name was not fitted, the level is not between 0 and 1, or a search does not end.

    Notes
    -----
    Asymmetric where the model bends, and good near a bound, where the first-order interval is not; it takes some
    ten fits.

    References
    ----------
    Venzon and Moolgavkar (1988), doi:10.2307/2347496.
    """
    index, quantile = _parameter_index(fit, name), _normal_quantile(level)
    return (
        _profile_end(fit, index, quantile, direction=-1.0),
        _profile_end(fit, index, quantile, direction=1.0),
    )


def _parameter_index(fit: SurfaceFit, name: str) -> int:
    if name not in fit.names:
        raise ValueError(f"{name!r} was not fitted; allowed are {', '.join(fit.names)}")
    return fit.names.index(name)


def _normal_quantile(level: float) -> float:
    """Return the quantile of the standard normal distribution to which a two-sided interval reaches: 1.96 for 0.95."""
    if not 0.0 < level < 1.0:
        raise ValueError(f"level = {level}; allowed is between 0 and 1")
    return float(ndtri(0.5 + 0.5 * level))


def _profile_end(fit: SurfaceFit, index: int, quantile: float, *, direction: float) -> float:
    """Walk outwards until the profile has risen enough, then close in on the place."""
    best = float(fit.values[index])
    limit = float((fit.problem.lower if direction < 0.0 else fit.problem.upper)[index])
    spread = float(fit.information.standard_uncertainty[index])
    room = abs(limit - best)
    step = min(quantile * spread, room)
    if step == 0.0:
        return limit

    def shortfall(distance: float) -> float:
        # The root of the rise is nearly linear in the distance, so few steps find where it is met.
        risen = max(_profile_rise(fit, index, best + direction * distance, spread), 0.0)
        return float(np.sqrt(risen)) - quantile

    outer = step
    while shortfall(outer) < 0.0:
        if outer >= room:
            return limit
        outer = min(2.0 * outer, room)
    from scipy.optimize import brentq  # a quarter of a second, wanted for an interval only

    return best + direction * float(brentq(shortfall, 0.0, outer, xtol=2e-3 * outer, rtol=1e-6))


def _profile_rise(fit: SurfaceFit, index: int, target: float, spread: float) -> float:
    """Return how much chi-square rises when one physical parameter is held at a value and the others adapt."""
    problem = fit.problem
    scale = min(spread, float(problem.upper[index] - problem.lower[index]))
    stiffness = _STIFFNESS / scale

    def held(values: FloatArray) -> FloatArray:
        pull = stiffness * (physical_values(problem, values)[index] - target)
        return np.append(residuals(problem, values), pull)

    def slope(values: FloatArray) -> FloatArray:
        row = difference_jacobian(problem, values, physical_values)[index]
        return np.vstack([difference_jacobian(problem, values, residuals), stiffness * row])

    adapted = solved(problem, fit.internal, function=held, jacobian=slope)
    left = residuals(problem, adapted)
    return float(left @ left) - fit.chi_square
