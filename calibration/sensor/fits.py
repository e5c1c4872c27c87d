"""Least squares for points with unknown extra scatter, and the influence of single points in closed form.

Points of a real sensor scatter by more than their sampling errors. `fit_with_scatter` estimates the extra scatter and
adds it to the error of each point. `point_influence` finds points that do not follow the smooth curve of all others: it
fits several curves, leaves out the furthest point again and again, and chooses the curve by a cost that counts the
misfit, the number of terms and the number of points left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Optional

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Most steps of the scatter, and relative change at which they end: for one fit, and for many curves.
_STEPS, _CONVERGED = 100, 1e-9
_CURVE_STEPS, _CURVE_CONVERGED = 30, 1e-3
# Prior odds against each wrong point: 1 to 100.
_ODDS_COST = 2.0 * np.log(100.0)
# Least odds that decide between two curves: 1 to 10.
_AS_WELL = 2.0 * np.log(10.0)
# Least significance of a point that is off by ten of its own errors.
_FAR_SIGMA = 6.0
# Largest share of points that are left out, and least degrees of freedom of the others.
_LARGEST_SHARE, _LEAST_FREEDOM = 0.25, 3
# Largest influence of a point on the curve for a comparison with the others.
_LARGEST_LEVERAGE = 1.0 - 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class ScatterFit:
    """A fitted linear model."""

    parameters: FloatArray
    covariance: FloatArray  #: of the parameters
    response: FloatArray  #: derivative of each parameter with respect to each value
    scatter: float  #: extra standard deviation, in units of the shape of the scatter
    chi2_per_dof: float | None  #: without the extra scatter; None without degrees of freedom


def fit_with_scatter(
    design: FloatArray, values: FloatArray, *, sampling_covariance: FloatArray, scatter_shape: FloatArray
) -> ScatterFit:
    """Return the generalised least-squares fit with extra scatter.

    The extra scatter brings chi-squared down to its degrees of freedom; 0 if it is below. All points share it. A
    factor on all error bars would let a point of small sampling error, such as a long stack, decide the fit alone.

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
        before, scatter_variance = scatter_variance, _scatter_step(scatter_variance, chi2=chi2, fall=fall, freedom=dof)
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


def _scatter_step(scatter_variance: float, *, chi2: float, fall: float, freedom: int) -> float:
    """Return the variance of scatter that brings chi-squared closer to its degrees of freedom, 0 where none is needed.

    Newton's step for the inverse of chi-squared, which is concave in the variance: steps come to the root from below.
    """
    if fall <= 0.0:
        return scatter_variance
    return max(scatter_variance + (chi2 / freedom - 1.0) * chi2 / fall, 0.0)


def _chi2(
    design: FloatArray, values: FloatArray, covariance: FloatArray, shape_variance: FloatArray
) -> tuple[float, float]:
    """Return chi-squared of the best fit, and its decrease with the variance of the scatter."""
    factor = np.linalg.cholesky(covariance)
    white = np.linalg.solve(factor, np.column_stack([design, values]))
    basis = np.linalg.qr(white[:, :-1])[0]
    residual = white[:, -1] - basis @ (basis.T @ white[:, -1])
    weighted = np.linalg.solve(factor.T, residual)
    return float(residual @ residual), float(np.square(weighted) @ shape_variance)


def _response(design: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the derivative of each parameter with respect to each value."""
    factor = np.linalg.cholesky(covariance)
    response: FloatArray = np.linalg.pinv(np.linalg.solve(factor, design)) @ np.linalg.inv(factor)
    return response


@dataclass(frozen=True, kw_only=True, eq=False)
class CurveModel:
    """One smooth curve that points may follow."""

    design: FloatArray  #: (points, terms)
    scatter_shape: FloatArray  #: (points,): scatter of each point relative to the others
    first_term_std: float | None = None  #: prior standard deviation of the first term about 0; None if it is free
    term_sizes: FloatArray | None = None  #: largest plausible size of each term
    is_usual: bool = True  #: unusual curves are tried only if all usual ones leave points out
    is_through_zero: bool = False  #: it has no offset

    @property
    def n_free(self) -> int:
        """Number of terms without prior knowledge."""
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
        """Terms of the curve by the columns of the basis."""
        return np.linalg.inv(np.linalg.qr(self.design, mode="r"))


@dataclass(frozen=True, kw_only=True, eq=False)
class CurveFit:
    """A curve through some points."""

    curve: FloatArray
    curve_variance: FloatArray
    variance: FloatArray
    scatter_variance: float
    covariance: FloatArray

    @property
    def leverage(self) -> FloatArray:
        """Influence of each point on the curve at its own place, in (0, 1) for the used points."""
        return self.curve_variance / self.variance


def _fit_curve(
    model: CurveModel, values: FloatArray, sampling_variance: FloatArray, *, used: Mask, start: float = 0.0
) -> CurveFit:
    """Return the weighted fit through the used points, with extra scatter."""
    basis, y, own = model.basis[used], values[used], sampling_variance[used]
    shape_variance = np.square(model.scatter_shape)
    shape, known, freedom = shape_variance[used], _known_of_terms(model), len(y) - model.n_free
    scatter = start
    for _ in range(_CURVE_STEPS):
        weight = 1.0 / (own + scatter * shape)
        weighted: FloatArray = basis.T * weight
        information: FloatArray = weighted @ basis + known
        covariance = np.asarray(np.linalg.inv(information), dtype=np.float64)
        parameters = covariance @ (weighted @ y)
        of_each = np.square(y - basis @ parameters) * weight
        chi2 = float(of_each.sum())
        if abs(chi2 - freedom) <= _CURVE_CONVERGED * freedom or (scatter == 0.0 and chi2 < freedom):
            break
        scatter = _scatter_step(scatter, chi2=chi2, fall=float(of_each @ (weight * shape)), freedom=freedom)
    return CurveFit(
        curve=model.basis @ parameters,
        curve_variance=np.maximum(np.sum((model.basis @ covariance) * model.basis, axis=1), 0.0),
        variance=sampling_variance + scatter * shape_variance,
        scatter_variance=scatter,
        covariance=covariance,
    )


def _known_of_terms(model: CurveModel) -> FloatArray:
    """Return the prior knowledge of the first term as information about the columns of the basis."""
    first = model.terms_of_basis[0] / (np.inf if model.first_term_std is None else model.first_term_std)
    known: FloatArray = np.outer(first, first)
    return known


def _cost_of_terms(model: CurveModel, fit: CurveFit) -> float:
    """Return Occam's factor of the terms: how far the points narrow the range of each.

    For terms of unknown size it is that of the information in n points (Schwarz). For terms expected to be small this
    is too weak: two more terms could follow one wrong level at an end.
    """
    if model.term_sizes is None:
        return model.n_free * float(np.log(len(fit.curve)))
    bounded = np.isfinite(model.term_sizes)
    to_terms = model.terms_of_basis[bounded]
    left = to_terms @ fit.covariance @ to_terms.T
    before = left + np.diag(np.square(model.term_sizes[bounded]))
    return float(np.linalg.slogdet(before)[1] - np.linalg.slogdet(left)[1])


@dataclass(frozen=True, kw_only=True, eq=False)
class PointInfluence:
    """Each point compared with the curve through all other points that are not outlying."""

    abscissa: FloatArray
    values: FloatArray
    variance: FloatArray  #: by sampling alone
    outlying: Mask
    deviation: FloatArray  #: of each point from the others, and its standard error
    std_error: FloatArray
    scatter: float  #: beyond sampling, in units of the shape of the curve's scatter
    model: CurveModel  #: the curve
    cost: float  #: minus twice the logarithm of its probability, and the part of each point
    cost_of_each: FloatArray
    rival: Optional["PointInfluence"] = None  #: an equally likely curve that leaves points out


def point_influence(
    models: Sequence[CurveModel],
    values: FloatArray,
    sampling_variance: FloatArray,
    *,
    abscissa: FloatArray,
    p_false: float,
) -> PointInfluence | None:
    """Return the points off the simplest curve that explains the others; None with too few points.

    Up to a quarter of the points are left out one after another, each time the furthest in units of its own error. All
    up to the last beyond its limit are outlying, so that two wrong points do not hide one another. Residuals come from
    the hat matrix. Limits are quantiles, for one of n points, of the normal law for the sampling part of
    an error and of Student's for the part estimated from the scatter of the other points.

    Rosner, Technometrics 25, 165 (1983), doi:10.1080/00401706.1983.10487848; Cook and Weisberg, Residuals and Influence
    in Regression (1982), chapter 2.
    """
    possible = [model for model in models if len(values) - model.n_free > _LEAST_FREEDOM]
    found: list[PointInfluence] = []
    for model in sorted(possible, key=lambda one: not one.is_usual):
        if model.is_usual or not found or _cheapest(found).outlying.any():
            found.append(_eliminate(model, values, sampling_variance, abscissa, p_false))
    return _with_rival(_cheapest(found), found) if found else None


def _cheapest(found: Sequence[PointInfluence]) -> PointInfluence:
    return min(found, key=lambda one: one.cost)


def _with_rival(best: PointInfluence, found: Sequence[PointInfluence]) -> PointInfluence:
    """Return the best curve, with an equally good rival that has outlying points."""
    if best.outlying.any():
        return best
    rivals = [
        one
        for one in found
        if one.outlying.any()
        and (one.cost < best.cost + _AS_WELL or (one.model.is_usual and _alone_decides(one, best)))
    ]
    return replace(best, rival=_cheapest(rivals)) if rivals else best


def _alone_decides(points: PointInfluence, best: PointInfluence) -> bool:
    """Return whether the best curve is better only because of one point far off the curve of the others."""
    if np.count_nonzero(points.outlying) != 1:
        return False
    own = np.sqrt(points.variance + np.square(points.scatter * points.model.scatter_shape))[points.outlying]
    of_others = (one.cost - one.cost_of_each[points.outlying][0] for one in (points, best))
    without, with_it = of_others
    return bool(abs(points.deviation[points.outlying][0]) > _FAR_SIGMA * own[0]) and without < with_it + _AS_WELL


def _eliminate(
    model: CurveModel, values: FloatArray, sampling: FloatArray, abscissa: FloatArray, p_false: float
) -> PointInfluence:
    n = len(values)
    active = np.ones(n, dtype=bool)
    chosen, fit = active, _fit_curve(model, values, sampling, used=active)
    for _ in range(max(1, int(_LARGEST_SHARE * n))):
        freedom = int(active.sum()) - model.n_free - 1
        if freedom < _LEAST_FREEDOM - 1:
            break
        worst = _furthest(fit, values, sampling, active, freedom)
        if fit.leverage[worst] >= _LARGEST_LEVERAGE:
            # These points cannot be compared.
            break
        active = active.copy()
        active[worst] = False
        others = _fit_curve(model, values, sampling, used=active, start=fit.scatter_variance)
        off, limit = _distance(others, values, sampling, worst, freedom=freedom, p_one=p_false / n)
        if off > limit:
            chosen = active
        elif fit.scatter_variance == 0.0:
            # Sampling explains all, so scatter hides no wrong point.
            break
        fit = others
    return _compared(model, values, sampling, abscissa, chosen)


def _furthest(fit: CurveFit, values: FloatArray, sampling: FloatArray, active: Mask, freedom: int) -> int:
    """Return the fitted point that is furthest off the others in its own standard errors, by the hat matrix."""
    square, decides = np.square(values - fit.curve), fit.leverage >= _LARGEST_LEVERAGE
    spread = square / fit.variance
    open_ = np.maximum(1.0 - fit.leverage, 1.0 - _LARGEST_LEVERAGE)
    others = np.maximum((spread[active].sum() - spread / open_) / freedom, 0.0) * fit.variance
    distance = np.where(decides, -1.0, square / (np.maximum(others, sampling) * open_))
    return int(np.argmax(np.where(active, distance, -2.0)))


def _distance(
    others: CurveFit, values: FloatArray, sampling: FloatArray, point: int, *, freedom: int, p_one: float
) -> tuple[float, float]:
    """Return the distance of a point from the fit through others in its own standard errors, and its limit.

    The scatter is that of the others alone, because a wrong point would otherwise hide in its own scatter.
    """
    error = float(np.sqrt(others.variance[point] + others.curve_variance[point]))
    by_normal, by_student = -float(ndtri(0.5 * p_one)), -float(stdtrit(freedom, 0.5 * p_one))
    of_sampling = float(sampling[point] / others.variance[point])
    limit = float(np.sqrt(by_normal**2 * of_sampling + by_student**2 * (1.0 - of_sampling)))
    return abs(float(values[point] - others.curve[point])) / error, limit


def _compared(
    model: CurveModel, values: FloatArray, sampling: FloatArray, abscissa: FloatArray, sound: Mask
) -> PointInfluence:
    fit = _fit_curve(model, values, sampling, used=sound)
    variance, leverage, residual = fit.variance, fit.leverage, values - fit.curve
    open_ = np.maximum(1.0 - leverage, 1.0 - _LARGEST_LEVERAGE)
    wide = np.square(model.scatter_shape * np.median(np.abs(values) / model.scatter_shape)) + sampling
    of_wrong = np.log(wide) + _ODDS_COST
    cost = np.where(sound, np.log(variance) + np.square(residual) / variance, of_wrong)
    unusual = 0.0 if model.is_usual else float(np.median(of_wrong - np.log(variance)))
    return PointInfluence(
        abscissa=abscissa,
        values=values,
        variance=sampling,
        outlying=~sound,
        deviation=np.where(sound, residual / open_, residual),
        std_error=np.sqrt(np.where(sound, variance / open_, variance * (1.0 + leverage))),
        scatter=float(np.sqrt(fit.scatter_variance)),
        model=model,
        cost=float(cost.sum()) + unusual + _cost_of_terms(model, fit),
        cost_of_each=cost,
    )
