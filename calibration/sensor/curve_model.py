"""A smooth curve that points may follow, fitted to some of them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibration.sensor.scatter_fit import scatter_step

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SCATTER_STEPS = 30
_CONVERGED = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class CurveModel:
    """One smooth curve that points may follow.

    Attributes
    ----------
    design : (n, p) array
        Columns of a linear model.
    scatter_shape : (n,) array
        Standard deviation of one unit of extra, independent scatter of each point, > 0.
    first_term_std : float or None
        What the first term is expected to be at most (one standard deviation about 0); None where it is free.
    term_sizes : (p,) array or None
        How large each term may be (one standard deviation about 0), infinite for those that every curve of the set has;
        None where nothing is known of any.
    is_usual : bool
        False for a curve that is believed where it explains more than one wrong point would.
    is_through_zero : bool
        True for a curve without an offset.
    """

    design: FloatArray
    scatter_shape: FloatArray
    first_term_std: float | None = None
    term_sizes: FloatArray | None = None
    is_usual: bool = True
    is_through_zero: bool = False

    @property
    def n_free(self) -> int:
        """Number of terms of which nothing is expected."""
        return int(self.design.shape[1]) - (self.first_term_std is not None)

    @property
    def n_bends(self) -> int:
        """Number of terms beyond an offset."""
        return int(self.design.shape[1]) - (not self.is_through_zero)

    @cached_property
    def basis(self) -> FloatArray:
        """Orthonormal columns of the same curves: equations in them are well conditioned."""
        return np.linalg.qr(self.design)[0]

    @cached_property
    def terms_of_basis(self) -> FloatArray:
        """What one of each column of the basis is in the terms."""
        return np.linalg.inv(np.linalg.qr(self.design, mode="r"))


@dataclass(frozen=True, kw_only=True, eq=False)
class CurveFit:
    """A curve through some points.

    Attributes
    ----------
    curve : (n,) array
        The curve at all points.
    curve_variance : (n,) array
        Variance of its error there.
    variance : (n,) array
        Variance of each point by its sampling and by the scatter.
    scatter_variance : float
        Variance of the scatter beyond sampling, in units of the model's shape squared.
    covariance : (p, p) array
        Covariance of the errors of the basis' columns.
    """

    curve: FloatArray
    curve_variance: FloatArray
    variance: FloatArray
    scatter_variance: float
    covariance: FloatArray

    @property
    def leverage(self) -> FloatArray:
        """How much each point decides the curve where it stands, in (0, 1) where it is one of the used."""
        return self.curve_variance / self.variance


def fit_curve(
    model: CurveModel, values: FloatArray, sampling_variance: FloatArray, *, used: Mask, start: float = 0.0
) -> CurveFit:
    """Return the weighted fit through the used points, with the scatter that makes chi-squared what it should be.

    Parameters
    ----------
    model : CurveModel
        The curve.
    values, sampling_variance : (n,) arrays
        The points, and the variance of each by its own sampling, > 0.
    used : (n,) array of bool
        Those that the curve is fitted to.
    start : float
        Variance of the scatter that is tried first.
    """
    basis, y, own = model.basis[used], values[used], sampling_variance[used]
    shape_variance = np.square(model.scatter_shape)
    shape, known, freedom = shape_variance[used], _known_of_terms(model), len(y) - model.n_free
    scatter = start
    for _ in range(_SCATTER_STEPS):
        weight = 1.0 / (own + scatter * shape)
        weighted: FloatArray = basis.T * weight
        information: FloatArray = weighted @ basis + known
        covariance = np.asarray(np.linalg.inv(information), dtype=np.float64)
        parameters = covariance @ (weighted @ y)
        of_each = np.square(y - basis @ parameters) * weight
        chi2 = float(of_each.sum())
        if abs(chi2 - freedom) <= _CONVERGED * freedom or (scatter == 0.0 and chi2 < freedom):
            break
        scatter = scatter_step(scatter, chi2=chi2, fall=float(of_each @ (weight * shape)), freedom=freedom)
    return CurveFit(
        curve=model.basis @ parameters,
        curve_variance=np.maximum(np.sum((model.basis @ covariance) * model.basis, axis=1), 0.0),
        variance=sampling_variance + scatter * shape_variance,
        scatter_variance=scatter,
        covariance=covariance,
    )


def _known_of_terms(model: CurveModel) -> FloatArray:
    """Return what is known of the first term beforehand, as information about the columns of the basis."""
    first = model.terms_of_basis[0] / (np.inf if model.first_term_std is None else model.first_term_std)
    known: FloatArray = np.outer(first, first)
    return known


def cost_of_terms(model: CurveModel, fit: CurveFit) -> float:
    """Return Occam's factor of the terms: by how much the points narrow what each may be.

    Where nothing is known of their sizes it is that of the information in n points (Schwarz). It is too small for terms
    that are expected to be small: one wrong level at an end, which two terms more can reach, would pass for a curve.

    Parameters
    ----------
    model
        Its terms, and what is known of their sizes.
    fit
        Of these terms.
    """
    if model.term_sizes is None:
        return model.n_free * float(np.log(len(fit.curve)))
    bounded = np.isfinite(model.term_sizes)
    to_terms = model.terms_of_basis[bounded]
    left = to_terms @ fit.covariance @ to_terms.T
    before = left + np.diag(np.square(model.term_sizes[bounded]))
    return float(np.linalg.slogdet(before)[1] - np.linalg.slogdet(left)[1])
