"""Linear least squares with points that may scatter more than their own errors say."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class ScatterFit:
    """A fitted linear model.

    Attributes
    ----------
    parameters : (p,) array
        Best fit.
    covariance : (p, p) array
        Covariance of their errors, scatter included.
    response : (p, n) array
        Derivative of each parameter by each fitted value: the fit is this matrix times the values.
    scatter : float
        Standard deviation of the scatter beyond the sampling errors, in units of the scatter's shape.
    chi2_per_dof : float or None
        Of the sampling errors alone; None where there are no more values than parameters.
    """

    parameters: FloatArray
    covariance: FloatArray
    response: FloatArray
    scatter: float
    chi2_per_dof: float | None


def fit_with_scatter(
    design: FloatArray, values: FloatArray, *, sampling_covariance: FloatArray, scatter_shape: FloatArray
) -> ScatterFit:
    """Return the generalised least-squares fit, with the scatter that makes chi-squared what it should be.

    Parameters
    ----------
    design : (n, p) array
        Columns of the linear model, independent; n >= p.
    values : (n,) array
        What is fitted.
    sampling_covariance : (n, n) array
        Covariance of the values by their own sampling, positive definite.
    scatter_shape : (n,) array
        Standard deviation of one unit of extra, independent scatter of each value, >= 0, not all 0.

    Notes
    -----
    The extra scatter is 0 while chi-squared is below its degrees of freedom, else what brings it there. A
    factor on all error bars would leave a point of small sampling error, such as a long stack, to decide the
    fit alone; scatter that does not come from sampling is shared by all points.

    References
    ----------
    Paule and Mandel, J. Res. NBS 87, 377 (1982), doi:10.6028/jres.087.022.
    """
    shape_variance = np.diag(np.square(scatter_shape))
    dof: int = len(values) - design.shape[1]

    def excess(scatter_variance: float) -> float:
        chi2 = _solve(design, values, sampling_covariance + scatter_variance * shape_variance)[2]
        return chi2 - dof

    scatter_variance = 0.0
    if dof > 0 and excess(0.0) > 0.0:
        from scipy.optimize import brentq  # wanted where there is scatter only

        scatter_variance = brentq(excess, 0.0, _scatter_bound(excess, sampling_covariance, scatter_shape))
    parameters, response, _ = _solve(design, values, sampling_covariance + scatter_variance * shape_variance)
    covariance = response @ (sampling_covariance + scatter_variance * shape_variance) @ response.T
    return ScatterFit(
        parameters=parameters,
        covariance=covariance,
        response=response,
        scatter=float(np.sqrt(scatter_variance)),
        chi2_per_dof=excess(0.0) / dof + 1.0 if dof > 0 else None,
    )


def _solve(design: FloatArray, values: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Return parameters, their derivatives by the values, and chi-squared."""
    factor = np.linalg.cholesky(covariance)
    white_design = np.linalg.solve(factor, design)
    response = np.linalg.pinv(white_design) @ np.linalg.inv(factor)
    parameters = response @ values
    residual = np.linalg.solve(factor, values - design @ parameters)
    return parameters, response, float(residual @ residual)


def _scatter_bound(
    excess: Callable[[float], float], sampling_covariance: FloatArray, scatter_shape: FloatArray
) -> float:
    """Return a variance of scatter at which chi-squared is too small."""
    scatters = scatter_shape > 0.0
    bound = float(np.max(np.diag(sampling_covariance)[scatters] / np.square(scatter_shape[scatters])))
    while excess(bound) > 0.0:
        bound *= 10.0
    return bound
