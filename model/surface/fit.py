"""Index, roughness, DHR and specular weight of a surface from measured Stokes radiances."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from model.surface.fit_observation import Observation
from model.surface.fit_parameters import PARAMETERS
from model.surface.fit_problem import (
    FitProblem,
    difference_jacobian,
    fit_problem,
    initial_values,
    physical_values,
    residuals,
    surface_of_values,
)
from model.surface.identifiability import Information, information
from model.surface.pbrdf import Surface

FloatArray = NDArray[np.float64]

_TOLERANCE = 1e-8
_EVALUATIONS = 200
_BAD_FIT = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceFit:
    """Parameters of a surface as the observations give them.

    Parameters
    ----------
    surface
        The best surface.
    names
        Parameters that were fitted.
    values
        Shape (P,).
    information
        First-order (Gauss-Newton) uncertainties, correlations, and what cannot be told apart.
    chi_square
        Sum of squared residuals in units of their uncertainty.
    degrees_of_freedom
        Number of residuals less that of parameters and of unknown factors.
    p_value
        Probability of a chi-square at least as large, were model and covariances right; 1 without freedom.
    findings
        What to know before using the values, in words: at a bound, not determined, a bad fit.
    problem
        What was fitted, for `profile_interval`.
    internal
        The solution as `problem` counts it.
    """

    surface: Surface
    names: tuple[str, ...]
    values: FloatArray
    information: Information
    chi_square: float
    degrees_of_freedom: int
    p_value: float
    findings: tuple[str, ...]
    problem: FitProblem
    internal: FloatArray


def fit_surface(
    observations: Sequence[Observation],
    *,
    start: Surface,
    free: Sequence[str] = ("n", "slope_rms", "dhr"),
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> SurfaceFit:
    """Return the parameters of a surface that fit measured Stokes radiances best.

    Parameters
    ----------
    observations
        Regions in one or several geometries.
    start
        Where to begin; parameters that are not free keep its values, and so do shadowing and diffuse kind.
    free
        Any of "n", "k", "slope_rms", "dhr", "specular_weight".
    bounds
        Where to look, by name, instead of `PARAMETERS`' own. None for "dhr".

    Returns
    -------
    SurfaceFit
        With uncertainties and findings.

    Raises
    ------
    ValueError
        If the input is not possible, the search does not end, or the best parameters form no possible surface (a
        DHR that is held fixed, below what the fitted lobe reflects).

    Notes
    -----
    Weighted least squares, hence maximum likelihood for Gaussian noise of known covariance. The best minimum near
    the start is found; a start far off may lead to another. What the covariances leave out (illumination,
    model) the uncertainties leave out too; `p_value` tells when that matters.

    References
    ----------
    Definition; trust-region reflective least squares, Branch, Coleman and Li (1999),
    doi:10.1137/S1064827595289108.
    """
    problem = fit_problem(observations, start=start, free=free, bounds=bounds or {})
    internal = solved(
        problem,
        initial_values(problem),
        function=lambda values: residuals(problem, values),
        jacobian=lambda values: difference_jacobian(problem, values, residuals),
    )
    left = residuals(problem, internal)
    information_ = _information(problem, internal)
    chi_square, freedom = float(left @ left), left.size - len(problem.names) - len(problem.sharing)
    p_value = float(chdtrc(freedom, chi_square)) if freedom > 0 else 1.0
    return SurfaceFit(
        surface=surface_of_values(problem, internal),
        names=problem.names,
        values=physical_values(problem, internal),
        information=information_,
        chi_square=chi_square,
        degrees_of_freedom=freedom,
        p_value=p_value,
        findings=(*information_.words, *_bound_words(problem, internal), *_misfit_words(p_value, freedom)),
        problem=problem,
        internal=internal,
    )


def solved(
    problem: FitProblem,
    start: FloatArray,
    *,
    function: Callable[[FloatArray], FloatArray],
    jacobian: Callable[[FloatArray], FloatArray],
) -> FloatArray:
    """Return the values within the problem's bounds that minimise the sum of squares of a function.

    Parameters
    ----------
    problem
        Names and bounds.
    start
        Where to begin, shape (P,).
    function, jacobian
        Residuals, shape (M,), and their derivatives, shape (M, P).

    Returns
    -------
    ndarray
        Shape (P,).

    Raises
    ------
    ValueError
        If the search does not end.

    References
    ----------
    Branch, Coleman and Li (1999), doi:10.1137/S1064827595289108.
    """
    margin = 1e-9 * (problem.upper - problem.lower)
    from scipy.optimize import least_squares  # a quarter of a second, wanted for a fit only

    solution = least_squares(
        function,
        np.clip(start, problem.lower + margin, problem.upper - margin),
        jac=jacobian,
        bounds=(problem.lower, problem.upper),
        x_scale=[PARAMETERS[name].step for name in problem.names],
        ftol=_TOLERANCE,
        xtol=_TOLERANCE,
        gtol=_TOLERANCE,
        max_nfev=_EVALUATIONS,
    )
    if solution.status <= 0:
        raise ValueError(
            f"the search did not end within {_EVALUATIONS} evaluations; begin nearer, or free fewer parameters"
        )
    return np.asarray(solution.x)


def _information(problem: FitProblem, internal: FloatArray) -> Information:
    """Uncertainties of the physical parameters: chain rule through the excess that stands for the DHR."""
    inner = difference_jacobian(problem, internal, residuals)
    physical = difference_jacobian(problem, internal, physical_values)
    return information(inner @ np.linalg.inv(physical), names=problem.names, ranges=problem.upper - problem.lower)


def _bound_words(problem: FitProblem, internal: FloatArray) -> list[str]:
    words = []
    for index, name in enumerate(problem.names):
        near = 1e-6 * (problem.upper[index] - problem.lower[index])
        for side, bound in (("lower", problem.lower[index]), ("upper", problem.upper[index])):
            if abs(internal[index] - bound) > near:
                continue
            which = "the excess of dhr over the specular lobe" if name == "dhr" else name
            words.append(
                f"{which} ends at its {side} bound {bound:g}: first-order uncertainties do not hold there, use the "
                "profile interval"
            )
    return words


def _misfit_words(p_value: float, freedom: int) -> list[str]:
    if freedom <= 0:
        return ["as many parameters as measured numbers: the fit cannot be checked against the data"]
    if p_value < _BAD_FIT:
        blame = "uncertainties are too small, or something is missing (skylight, another diffuse term, shadowing)"
        return [f"the model misses the data (p = {p_value:.1g}): {blame}"]
    return []
