"""Points that stand off a smooth curve which all others follow: influence of each in closed form."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Optional

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

from calibration.sensor.curve_model import CurveFit, CurveModel, Mask, cost_of_terms, fit_curve

FloatArray = NDArray[np.float64]

# A point more that is taken to be wrong has to explain as much as odds of 1 to 100 against it.
_ODDS_COST = 2.0 * np.log(100.0)
# Odds of less than 1 to 10 between two curves do not tell which it is.
_AS_WELL = 2.0 * np.log(10.0)
# A point that is off by ten of its own errors is seen to be off by more than this.
_FAR_SIGMA = 6.0
# A wrong point may be anywhere within its own size.
_LARGEST_SHARE = 0.25
_LEAST_FREEDOM = 3
# A point that decides the curve more than this has hardly another beside it.
_LARGEST_LEVERAGE = 1.0 - 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class PointInfluence:
    """Each point beside the curve through the others that are not outlying.

    Attributes
    ----------
    abscissa, values, variance : (n,) arrays
        The points, and the variance of each by its own sampling.
    outlying : (n,) array of bool
        The point stands off by more than chance allows in the stated share of sets.
    deviation, std_error : (n,) arrays
        The point less what the curve through the others has there, and the standard error of this difference.
    scatter : float
        Standard deviation of the scatter beyond sampling, in units of the model's shape.
    model : CurveModel
        The curve that explains the points at the least cost of terms and of wrong points.
    cost : float
        That cost: twice the negative logarithm of the likelihood, with Occam's factors.
    cost_of_each : (n,) array
        What each point adds to the cost.
    rival : PointInfluence or None
        Another curve with outlying points that explains all as well, where this one has none, or that explains all but
        a single far one as well: which of the two it is cannot be told.
    """

    abscissa: FloatArray
    values: FloatArray
    variance: FloatArray
    outlying: Mask
    deviation: FloatArray
    std_error: FloatArray
    scatter: float
    model: CurveModel
    cost: float
    cost_of_each: FloatArray
    rival: Optional["PointInfluence"] = None


def point_influence(
    models: Sequence[CurveModel],
    values: FloatArray,
    sampling_variance: FloatArray,
    *,
    abscissa: FloatArray,
    p_false: float,
) -> PointInfluence | None:
    """Return which points stand off the simplest curve that explains the others; None with too few points.

    Parameters
    ----------
    models : sequence of CurveModel
        Curves that are possible; those with so many terms that fewer than three points are left over are passed by.
    values : (n,) array
        The points.
    sampling_variance : (n,) array
        Variance of each by its own sampling, > 0.
    abscissa : (n,) array
        What the models are functions of; kept with the result.
    p_false : float
        Chance that any point of a sound set is called outlying, within (0, 1).

    Notes
    -----
    Points are taken out one by one, each time the one that is furthest off the others in units of its own error, up
    to a quarter of them; outlying are all up to the last that is off by more than its limit, so that two wrong points
    do not hide one another. Residuals of the others come from the diagonal of the hat matrix, no fit is repeated.
    Limits are quantiles of the normal law for the part of an error that is sampling and of Student's for the part that
    is estimated from the scatter of the other points, each for one of n points.

    References
    ----------
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
    """Return the best curve with another that has outlying points, where that explains all, or all others, as well."""
    if best.outlying.any():
        return best
    rivals = [
        one
        for one in found
        if one.outlying.any() and (one.cost < best.cost + _AS_WELL or (one.model.is_usual and _speaks_alone(one, best)))
    ]
    return replace(best, rival=_cheapest(rivals)) if rivals else best


def _speaks_alone(points: PointInfluence, best: PointInfluence) -> bool:
    """Return whether a single point, far off the curve of the others, is all that speaks for the best curve."""
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
    chosen, fit = active, fit_curve(model, values, sampling, used=active)
    for _ in range(max(1, int(_LARGEST_SHARE * n))):
        freedom = int(active.sum()) - model.n_free - 1
        if freedom < _LEAST_FREEDOM - 1:
            break
        worst = _furthest(fit, values, sampling, active, freedom)
        if fit.leverage[worst] >= _LARGEST_LEVERAGE:
            # No other point says anything of any of these.
            break
        active = active.copy()
        active[worst] = False
        others = fit_curve(model, values, sampling, used=active, start=fit.scatter_variance)
        off, limit = _distance(others, values, sampling, worst, freedom=freedom, p_one=p_false / n)
        if off > limit:
            chosen = active
        elif fit.scatter_variance == 0.0:
            # Sampling alone explains all: nothing is hidden behind a scatter.
            break
        fit = others
    return _beside_the_others(model, values, sampling, abscissa, chosen)


def _furthest(fit: CurveFit, values: FloatArray, sampling: FloatArray, active: Mask, freedom: int) -> int:
    """Return which of the fitted points is furthest off the others in its own standard errors, by the hat matrix."""
    square, decides = np.square(values - fit.curve), fit.leverage >= _LARGEST_LEVERAGE
    spread = square / fit.variance
    open_ = np.maximum(1.0 - fit.leverage, 1.0 - _LARGEST_LEVERAGE)
    others = np.maximum((spread[active].sum() - spread / open_) / freedom, 0.0) * fit.variance
    distance = np.where(decides, -1.0, square / (np.maximum(others, sampling) * open_))
    return int(np.argmax(np.where(active, distance, -2.0)))


def _distance(
    others: CurveFit, values: FloatArray, sampling: FloatArray, point: int, *, freedom: int, p_one: float
) -> tuple[float, float]:
    """Return how far a point is off the fit through others in its own standard errors, and how far it may be.

    The scatter is that of the others alone: where points have unlike errors, that of a wrong one hides it.
    """
    error = float(np.sqrt(others.variance[point] + others.curve_variance[point]))
    by_normal, by_student = -float(ndtri(0.5 * p_one)), -float(stdtrit(freedom, 0.5 * p_one))
    of_sampling = float(sampling[point] / others.variance[point])
    limit = float(np.sqrt(by_normal**2 * of_sampling + by_student**2 * (1.0 - of_sampling)))
    return abs(float(values[point] - others.curve[point])) / error, limit


def _beside_the_others(
    model: CurveModel, values: FloatArray, sampling: FloatArray, abscissa: FloatArray, sound: Mask
) -> PointInfluence:
    fit = fit_curve(model, values, sampling, used=sound)
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
        cost=float(cost.sum()) + unusual + cost_of_terms(model, fit),
        cost_of_each=cost,
    )
