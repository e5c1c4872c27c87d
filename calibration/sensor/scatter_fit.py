"""Linear least squares with points that may scatter more than their own errors say."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_STEPS = 100
_CONVERGED = 1e-9


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
    shape_variance = np.square(scatter_shape)
    dof: int = len(values) - design.shape[1]
    scatter_variance, chi2_of_sampling = 0.0, None
    for _ in range(_STEPS if dof > 0 else 0):
        chi2, fall = _chi2(
            design, values, sampling_covariance + np.diag(scatter_variance * shape_variance), shape_variance
        )
        chi2_of_sampling = chi2 if chi2_of_sampling is None else chi2_of_sampling
        before, scatter_variance = scatter_variance, scatter_step(scatter_variance, chi2=chi2, fall=fall, freedom=dof)
        if abs(scatter_variance - before) <= _CONVERGED * scatter_variance:
            break
    covariance = sampling_covariance + np.diag(scatter_variance * shape_variance)
    response = _response(design, covariance)
    return ScatterFit(
        parameters=response @ values,
        covariance=response @ covariance @ response.T,
        response=response,
        scatter=float(np.sqrt(scatter_variance)),
        chi2_per_dof=None if chi2_of_sampling is None else chi2_of_sampling / dof,
    )


def scatter_step(scatter_variance: float, *, chi2: float, fall: float, freedom: int) -> float:
    """Return the variance of scatter that brings chi-squared closer to its degrees of freedom, 0 where none is needed.

    Parameters
    ----------
    scatter_variance : float
        The variance that chi-squared is of.
    chi2, fall : float
        Chi-squared, and by how much it falls with this variance.
    freedom : int
        Its degrees of freedom, > 0.

    Notes
    -----
    Newton's step for the inverse of chi-squared, which is concave in the variance: steps come to the root from below.
    """
    if fall <= 0.0:
        return scatter_variance
    return max(scatter_variance + (chi2 / freedom - 1.0) * chi2 / fall, 0.0)


def _chi2(
    design: FloatArray, values: FloatArray, covariance: FloatArray, shape_variance: FloatArray
) -> tuple[float, float]:
    """Return chi-squared of the best fit, and by how much it falls with the variance of the scatter."""
    factor = np.linalg.cholesky(covariance)
    white = np.linalg.solve(factor, np.column_stack([design, values]))
    basis = np.linalg.qr(white[:, :-1])[0]
    residual = white[:, -1] - basis @ (basis.T @ white[:, -1])
    weighted = np.linalg.solve(factor.T, residual)
    return float(residual @ residual), float(np.square(weighted) @ shape_variance)


def _response(design: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the derivative of each parameter by each value."""
    factor = np.linalg.cholesky(covariance)
    response: FloatArray = np.linalg.pinv(np.linalg.solve(factor, design)) @ np.linalg.inv(factor)
    return response
