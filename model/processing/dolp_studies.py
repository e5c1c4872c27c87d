"""Studies of DoLP: its statistics against SNR, estimators, normalized Stokes parameters, and ROC by Monte Carlo.

DoLP of few photo-electrons is the plain sum over all Poisson counts; of many, that of Gaussian counts
(`dolp_against_snr`, [MK14] Fig. 5). S1/S0 and S2/S0 are ratios of correlated normal variables (`distribution`).

Each estimator of the true DoLP (`bias_and_rms`) inverts one curve between the true length v and the measured one r,
both over the standard deviation of a component. In u = 1/r^2 the ratio (v/r)^2 falls smoothly from 1 at u = 0 to 0 at
the largest u that the curve knows (below that r the estimate is 0); it is tabulated there and interpolated by a cubic
spline, so that one table serves up to any length. With 512 intervals the error of v is below 1e-9.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.moments import covariance_factor
from model.numerics import gammaln, gauss_legendre, i0e, i1e
from model.processing import dolp
from model.processing import dolp_law as normal_ratio
from model.processing.detection import background_condition, rx_threshold
from model.processing.dolp_law import NormalRatio, dolp_frame, find_quantiles
from model.processing.quadratic_forms import tail_probabilities
from model.processing.reconstruction import MODIFIED_PICKERING_RAD, Design, design
from model.stokes import dolp as degree_of_polarization

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

FloatArray = NDArray[np.float64]

# What Gaussian counts are off falls with these powers of the electrons, in the mean by the third moments of the counts.
_POWERS = {"mean": 2.0, "std": 1.5}
_SUM_ERROR = 1e-9


@dataclass(frozen=True, kw_only=True)
class DolpAgainstSnr:
    """DoLP statistics over a row of signal-to-noise ratios, each field of shape (K,).

    Parameters
    ----------
    snr
        Mean of S0 over its standard deviation.
    s0_e
        Mean of S0 that gives it [e-].
    first_mean, first_std
        As [MK14] has them, to first order.
    mean, std
        Exact for Gaussian Stokes parameters; not a number where moments do not exist.
    drawn_mean, drawn_std, drawn_mean_error, drawn_std_error
        From drawn Poisson counts, with their standard errors; draws with S0 <= 0 are left out.
    drawn_without_light
        How many draws that were.
    poisson_mean, poisson_std
        Exact for Poisson counts, given S0 > 0; not a number at an SNR above 10, and where the sum would be too long.
    """

    snr: FloatArray
    s0_e: FloatArray
    first_mean: FloatArray
    first_std: FloatArray
    mean: FloatArray
    std: FloatArray
    drawn_mean: FloatArray
    drawn_std: FloatArray
    drawn_mean_error: FloatArray
    drawn_std_error: FloatArray
    drawn_without_light: NDArray[np.int64]
    poisson_mean: FloatArray
    poisson_std: FloatArray

    @property
    def true_mean(self) -> FloatArray:
        """Mean of DoLP by `truth`."""
        return self.truth("mean")[0]

    @property
    def true_std(self) -> FloatArray:
        """Deviation of DoLP by `truth`."""
        return self.truth("std")[0]

    def truth(self, moment: Literal["mean", "std"]) -> tuple[FloatArray, FloatArray]:
        """Return a moment by the law of Poisson counts, and its error.

        Notes
        -----
        Above the ratios at which that law is summed: that of Gaussian counts, with the difference at the last sum
        carried on as it falls with more light. Its error is what the sum before the last would have missed so at the
        last. With fewer than two sums it is the Gaussian one, and its error is not known.
        """
        poisson, gaussian = getattr(self, f"poisson_{moment}"), getattr(self, moment)
        apart = poisson - gaussian
        both = np.flatnonzero(np.isfinite(apart))
        if both.size < 2:
            summed = np.isfinite(poisson)
            return np.where(summed, poisson, gaussian), np.where(summed, _SUM_ERROR, np.nan)
        before, last = both[np.argsort(self.snr[both])[-2:]]
        fall = (self.s0_e[last] / self.s0_e) ** _POWERS[moment]
        missed = apart[last] - apart[before] / fall[before]
        value = np.where(np.isfinite(poisson), poisson, gaussian + apart[last] * fall)
        return value, np.where(np.isfinite(poisson), _SUM_ERROR, np.abs(missed) * fall)


def dolp_against_snr(
    stokes: ArrayLike,
    snr: ArrayLike,
    *,
    draws: int,
    generator: np.random.Generator,
    angles_rad: ArrayLike = MODIFIED_PICKERING_RAD,
    tolerance: float = 1e-6,
) -> DolpAgainstSnr:
    """Return analytic and drawn DoLP statistics for light of one polarization and growing intensity.

    Parameters
    ----------
    stokes
        Normalised Stokes vector, shape (3,), S0 = 1; [MK14] has (1, 0.5, 0.5).
    snr
        Signal-to-noise ratios of S0, shape (K,), > 0 (20 dB, as amplitude, is 10).
    draws
        Poisson draws for each, >= 10; 1e4 in [MK14].
    generator
        Where they come from.
    angles_rad
        Polarizer angles, shape (N,) [rad].
    tolerance
        Relative, of the exact moments.

    Notes
    -----
    Shot noise only. The draws are Poisson counts, whose law is summed where few electrons arrive.

    Raises
    ------
    ValueError
        A ratio is not above 0, or an argument is out of its range.

    References
    ----------
    [MK14] eq. (24)-(28), Fig. 5.
    """
    ratios, shape = np.asarray(snr, dtype=np.float64), np.asarray(stokes, dtype=np.float64)
    if ratios.ndim != 1 or not np.all(ratios > 0.0) or draws < 10:
        raise ValueError(f"snr = {ratios}, draws = {draws}; allowed are ratios above 0 and at least 10 draws")
    plan = design(angles_rad)
    # Under shot noise var S0 = (W diag(M S) W')_00 grows as S0 does: one electron tells the factor.
    unit_cov = plan.inverse @ np.diag(plan.system @ shape) @ plan.inverse.T
    s0_e = ratios**2 * unit_cov[0, 0] / shape[0] ** 2
    mean, cov = s0_e[:, None] * shape, s0_e[:, None, None] * unit_cov
    first, exact = dolp.first_order(mean, cov), dolp.moments(mean, cov, tolerance=tolerance)
    poisson = np.array([_poisson(plan, light, ratio) for light, ratio in zip(mean, ratios, strict=True)])
    drawn = np.array([_drawn(plan, light, draws, generator) for light in mean])
    return DolpAgainstSnr(
        snr=ratios,
        s0_e=s0_e,
        first_mean=np.asarray(first.mean),
        first_std=np.sqrt(first.variance),
        mean=np.asarray(exact.mean),
        std=np.asarray(exact.std),
        drawn_mean=drawn[:, 0],
        drawn_std=drawn[:, 1],
        drawn_mean_error=drawn[:, 2],
        drawn_std_error=drawn[:, 3],
        drawn_without_light=drawn[:, 4].astype(np.int64),
        poisson_mean=poisson[:, 0],
        poisson_std=poisson[:, 1],
    )


Estimator = Literal["naive", "asymptotic", "wardle_kronberg", "maximum_likelihood", "mean", "median", "mas"]
ESTIMATORS: tuple[Estimator, ...] = get_args(Estimator)


@dataclass(frozen=True, kw_only=True)
class EstimatorError:
    """Bias (mean estimate less truth) and rms error of an estimator, in units of the noise."""

    bias: FloatArray
    rms: FloatArray


_REACH = 13.0  # standard deviations; the Rice distribution beyond holds less than 1e-36
_PANELS = 16
_NODES = 20


def bias_and_rms(estimator: Estimator, true_snr_values: ArrayLike) -> EstimatorError:
    """Return bias and rms error of an estimator against the true DoLP over its noise.

    Parameters
    ----------
    estimator
        See `true_snr`.
    true_snr_values
        Any shape, 0 or more: true DoLP over the standard deviation of S1/S0 and of S2/S0, equal and uncorrelated.

    Returns
    -------
    EstimatorError
        In units of that standard deviation; absolute error below 1e-9 (plus rounding of the true value).

    Raises
    ------
    ValueError
        If a value is negative or not finite, or the estimator is unknown.

    Notes
    -----
    Gauss-Legendre quadrature over the Rice distribution of the measured value, r = r_0 + x^2 above the value r_0 where
    the estimate leaves 0: most estimators rise there as the root of r - r_0.

    References
    ----------
    Rice, Bell Syst. Tech. J. 24, 46 (1945), doi:10.1002/j.1538-7305.1945.tb00453.x; definition.
    """
    truth = np.asarray(true_snr_values, dtype=np.float64)
    if not np.all((truth >= 0.0) & np.isfinite(truth)):
        raise ValueError(f"true_snr_values has values down to {np.min(truth)}; allowed is 0 or more, finite")
    flat = truth.reshape(-1, 1)
    kink = _zero_threshold(estimator) if estimator in ESTIMATORS else 0.0
    low = np.maximum(flat - _REACH, 0.0)
    high = np.maximum(flat + _REACH, kink)
    start = np.maximum(low, kink)
    node, weight = _composite()
    root = np.sqrt(high - start) * node
    measured = start + root**2
    mass = 2.0 * root * np.sqrt(high - start) * weight * _rice_density(measured, flat)
    error = true_snr(measured, estimator) - flat
    unseen = _mass(low, np.minimum(np.maximum(kink, low), high), flat)
    bias = np.sum(mass * error, axis=1) - unseen * flat[:, 0]
    square = np.sum(mass * error**2, axis=1) + unseen * flat[:, 0] ** 2
    return EstimatorError(bias=bias.reshape(truth.shape), rms=np.sqrt(square).reshape(truth.shape))


@dataclass(frozen=True, kw_only=True)
class RatioDistribution:
    """Distribution of a normalised Stokes parameter given S0 > 0, each of the broadcast shape."""

    lower: FloatArray
    upper: FloatArray
    density: FloatArray


def distribution(x: ArrayLike, stokes_mean: ArrayLike, stokes_cov: ArrayLike, *, component: int) -> RatioDistribution:
    """Return both tails and the density of S1 / S0 or S2 / S0 given S0 > 0.

    Parameters
    ----------
    x
        Value, finite; broadcast against the leading axes of the other arguments.
    stokes_mean
        Mean of (S0, S1, S2), shape (..., 3), any unit.
    stokes_cov
        Covariance, shape (..., 3, 3); the component must fluctuate apart from S0.
    component
        1 or 2.

    Returns
    -------
    RatioDistribution
        To rounding, at any signal-to-noise ratio.

    Raises
    ------
    ValueError
        If the arguments are no mean and covariance, x is not finite, the component is not 1 or 2 or has no
        fluctuation of its own, or S0 > 0 has no probability.

    Notes
    -----
    No mean exists: the density falls as 1 / x^2.

    References
    ----------
    G. Marsaglia, J. Stat. Softw. 16 (2006) 4, doi:10.18637/jss.v016.i04, for the unconditional ratio.
    """
    ratio, shift, lead_shape = _ratio(stokes_mean, stokes_cov, component)
    values = np.asarray(x, dtype=np.float64)
    if not np.all(np.isfinite(values)):
        raise ValueError("x has values that are not finite")
    shape = np.broadcast_shapes(values.shape, lead_shape)
    index = np.broadcast_to(np.arange(shift.size).reshape(lead_shape), shape).ravel()
    found = _distribution(_rows(ratio, index), np.broadcast_to(values, shape).ravel() - shift[index])
    return RatioDistribution(
        lower=found.lower.reshape(shape)[()],
        upper=found.upper.reshape(shape)[()],
        density=found.density.reshape(shape)[()],
    )


@dataclass(frozen=True, kw_only=True)
class DrawnRoc:
    """Detection probabilities counted among random vectors, shape of the false alarm probabilities.

    `standard_error` is that of `p_detection`, that of a drawn threshold included.
    """

    p_false_alarm: FloatArray
    threshold: FloatArray
    p_detection: FloatArray
    standard_error: FloatArray


def rx_draws(
    p_false_alarm: ArrayLike,
    target_mean: ArrayLike,
    target_cov: ArrayLike,
    background_mean: ArrayLike,
    background_cov: ArrayLike,
    *,
    draws: int,
    generator: np.random.Generator,
    draw_threshold: bool = False,
) -> DrawnRoc:
    """Return detection probabilities counted among random vectors, each with its standard error.

    Parameters
    ----------
    p_false_alarm
        Any shape, in (0, 1).
    target_mean, background_mean
        Shape (n,), one unit.
    target_cov, background_cov
        Shape (n, n), that unit squared.
    draws
        Number of target vectors, 2 or more; as many background vectors where the threshold is drawn.
    generator
        Source of the random numbers.
    draw_threshold
        False takes the threshold from its closed form, True from background vectors, as the paper does.

    Returns
    -------
    DrawnRoc
        Counted probabilities. A standard error stays above 1/(2 draws) where nothing or everything was detected.

    Raises
    ------
    ValueError
        If an argument is out of its range, or a drawn threshold would rest on less than one false alarm.

    Notes
    -----
    The exact curve (`detection.rx_roc`) is both faster and more accurate.

    References
    ----------
    [MK14] eq. (30), section IV-B.
    """
    p = np.asarray(p_false_alarm, dtype=np.float64)
    _require_draws(p, draws, draw_threshold)
    mean_b, cov_b = np.asarray(background_mean, dtype=np.float64), np.asarray(background_cov, dtype=np.float64)
    background_condition(cov_b)
    to_white = np.linalg.inv(np.linalg.cholesky(cov_b))
    shift = to_white @ (np.asarray(target_mean, dtype=np.float64) - mean_b)
    found = _statistics(shift, to_white @ covariance_factor(target_cov), draws, generator)
    if not draw_threshold:
        threshold = rx_threshold(p, mean_b.size)
        detected = _share_above(found, threshold)
        return _roc(p, threshold, detected, _binomial_error(detected, draws))
    alarms = _statistics(np.zeros_like(shift), np.eye(mean_b.size), draws, generator)
    threshold = _drawn_threshold(alarms, p)
    detected = _share_above(found, threshold)
    # one standard deviation of the false alarms up and down, carried over to the detections
    spread = np.sqrt(p * (1.0 - p) / draws)
    low, high = (_share_above(found, _drawn_threshold(alarms, p + side * spread)) for side in (-1.0, 1.0))
    return _roc(p, threshold, detected, np.hypot(_binomial_error(detected, draws), 0.5 * (high - low)))


# SNR of S0, 20 dB, up to which the law of Poisson counts is summed, half a second a ratio. There the deviation of
# Gaussian counts is 1.1 % too large, their mean 4e-4 too high.
_POISSON_BELOW = 10.0 * (1.0 + 1e-9)


def _poisson(plan: Design, light_e: FloatArray, ratio: float) -> tuple[float, float]:
    """Return exact mean and deviation at few electrons."""
    nothing = float("nan"), float("nan")
    if ratio > _POISSON_BELOW:
        return nothing
    try:
        found = poisson_dolp(plan, light_e)
    except _TooManyCountsError:
        return nothing
    return found.mean, found.std


@dataclass(frozen=True, kw_only=True)
class PoissonDolp:
    """DoLP of Poisson counts, given that S0 > 0."""

    mean: float
    std: float
    without_light: float
    error: float


# Combinations of counts that are summed at most: four channels of some 60 electrons each, half a second.
_MOST_COMBINATIONS = 30_000_000
_CHUNK = 2_000_000


def poisson_dolp(plan: Design, stokes_e: ArrayLike) -> PoissonDolp:
    """Return the exact moments of DoLP under shot noise alone.

    [MK14] section II-C, Fig. 5; definition of the mean of a function of independent Poisson counts.
    """
    light_e = np.asarray(stokes_e, dtype=np.float64)
    means_e = plan.system @ light_e
    if np.any(means_e < -1e-12 * np.abs(means_e).max()) or not np.all(np.isfinite(means_e)):
        raise ValueError(f"stokes_e = {light_e} puts {means_e.min():g} e- behind an angle; allowed is 0 and above")
    counts = [_likely_counts(mean) for mean in np.maximum(means_e, 0.0)]
    combinations = float(np.prod([found.size for found, _ in counts], dtype=np.float64))
    if combinations > _MOST_COMBINATIONS:
        raise _TooManyCountsError(
            f"stokes_e = {light_e} allows {combinations:.1e} combinations of counts; summed are {_MOST_COMBINATIONS:g} "
            "at most"
        )
    half = len(counts) // 2
    return _summed(_halves(plan.inverse[:, :half], counts[:half]), _halves(plan.inverse[:, half:], counts[half:]))


# Counts less likely than this are left out, channel by channel.
_LEAST_PROBABILITY = 1e-15


def _likely_counts(mean_e: float) -> tuple[FloatArray, FloatArray]:
    """Return counts and their probabilities."""
    if mean_e == 0.0:
        return np.zeros(1), np.ones(1)
    counts = np.arange(np.ceil(mean_e + 40.0 + 12.0 * np.sqrt(mean_e)))
    probability = np.exp(counts * np.log(mean_e) - mean_e - gammaln(counts + 1.0))
    likely = probability > _LEAST_PROBABILITY
    return counts[likely], probability[likely]


class _TooManyCountsError(ValueError):
    """A sum over counts would be too long."""


def _summed(first: tuple[FloatArray, FloatArray], second: tuple[FloatArray, FloatArray]) -> PoissonDolp:
    sums = np.zeros(4)
    stokes, probability = second
    rows = max(1, _CHUNK // probability.size)
    for start in range(0, first[1].size, rows):
        part = slice(start, start + rows)
        s0, s1, s2 = (first[0][part, None, k] + stokes[:, k] for k in range(3))
        weight = first[1][part, None] * probability
        # Rounding of the inverse may leave something where counts cancel.
        lit = s0 > 1e-9
        degree = np.hypot(s1, s2) / np.where(lit, s0, 1.0)
        seen = np.where(lit, weight, 0.0)
        sums += [seen.sum(), (seen * degree).sum(), (seen * degree**2).sum(), weight.sum()]
    seen_all, first_moment, second_moment, all_of_it = sums
    mean = first_moment / seen_all
    return PoissonDolp(
        mean=float(mean),
        std=float(np.sqrt(max(second_moment / seen_all - mean**2, 0.0))),
        without_light=float(max(all_of_it - seen_all, 0.0)),
        error=float(abs(1.0 - all_of_it)),
    )


def _halves(inverse: FloatArray, counts: list[tuple[FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    """Return what some channels add to the Stokes parameters, shape (P, 3), and how likely, shape (P,)."""
    stokes, probability = np.zeros((1, 3)), np.ones(1)
    for column, (found, likely) in zip(inverse.T, counts, strict=True):
        stokes = (stokes[:, None, :] + found[:, None] * column).reshape(-1, 3)
        probability = np.outer(probability, likely).ravel()
    return stokes, probability


def _drawn(plan: Design, light_e: FloatArray, draws: int, generator: np.random.Generator) -> FloatArray:
    """Return mean, deviation, their standard errors, and how many draws had no light."""
    counts = generator.poisson(np.maximum(plan.system @ light_e, 0.0)[:, None], (plan.system.shape[0], draws))
    stokes = (plan.inverse @ counts).T
    lit = stokes[:, 0] > 0.0
    values = np.asarray(degree_of_polarization(stokes[lit]))
    mean, std = float(values.mean()), float(values.std(ddof=1))
    fourth = float(np.mean((values - mean) ** 4))
    std_error = np.sqrt(max(fourth - std**4, 0.0) / values.size) / (2.0 * std)
    return np.array([mean, std, std / np.sqrt(values.size), std_error, draws - int(lit.sum())])


def _square_of_mode(measured: FloatArray) -> FloatArray:
    """Return v^2 for which r is the most frequent length: r^2 = 1 + r v I1(r v)/I0(r v)."""
    y = _bisect(lambda y: 1.0 + y * _bessel_ratio(y), measured)
    return y**2 / measured


def _square_of_likelihood(measured: FloatArray) -> FloatArray:
    """Return v^2 that makes r most likely: v = r I1(r v)/I0(r v)."""
    y = _bisect(lambda y: y / _bessel_ratio(y), measured)
    return y * _bessel_ratio(y)


def _square_of_mean(measured: FloatArray) -> FloatArray:
    """Return v^2 for which r is the mean length."""
    return _bisect(lambda square: _mean_length(square) ** 2, measured)


_INTERVALS = 512
_BISECTIONS = 60
_NEWTON_STEPS = 8


def _square_of_median(measured: FloatArray) -> FloatArray:
    """Return v^2 for which r is the median length: Newton in v^2 on P(length <= r) = 1/2."""
    length = np.sqrt(measured)
    square = measured - 2.0 * np.log(2.0)
    for _ in range(_NEWTON_STEPS):
        true = np.sqrt(square)
        below = tail_probabilities(measured, np.ones((measured.size, 1)), true[:, None], degrees=[2.0]).lower
        # dP/dv = -r exp(-(r^2 + v^2)/2) I1(r v)
        slope = -length * np.exp(-0.5 * (length - true) ** 2) * i1e(length * true) / (2.0 * true)
        square = np.maximum(square - (below - 0.5) / slope, 0.5 * square)
    return np.asarray(square, dtype=np.float64)


_SQUARES: dict[str, Callable[[FloatArray], FloatArray]] = {
    "wardle_kronberg": _square_of_mode,
    "maximum_likelihood": _square_of_likelihood,
    "mean": _square_of_mean,
    "median": _square_of_median,
}
_THRESHOLDS = {
    "naive": 0.0,
    "asymptotic": 1.0,
    "wardle_kronberg": 1.0,
    "maximum_likelihood": float(np.sqrt(2.0)),
    "mean": float(np.sqrt(0.5 * np.pi)),
    "median": float(np.sqrt(2.0 * np.log(2.0))),
    "mas": 0.0,
}


def _zero_threshold(estimator: str) -> float:
    """Return the measured length at and below which the estimate is 0 (0 where there is none)."""
    return _THRESHOLDS[estimator]


def _bisect(curve: Callable[[FloatArray], FloatArray], value: FloatArray) -> FloatArray:
    """Return the argument in (0, 2 value + 2) at which the rising curve takes the value."""
    low, high = np.zeros_like(value), 2.0 * value + 2.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        below = curve(middle) < value
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return 0.5 * (low + high)


def _bessel_ratio(y: FloatArray) -> FloatArray:
    return np.asarray(i1e(y) / i0e(y), dtype=np.float64)


def _mean_length(square: FloatArray) -> FloatArray:
    """Return the mean of the Rice distribution whose true length has this square.

    Rice, Bell Syst. Tech. J. 24, 46 (1945), doi:10.1002/j.1538-7305.1945.tb00453.x.
    """
    x = 0.25 * square
    mean = np.sqrt(0.5 * np.pi) * ((1.0 + 2.0 * x) * i0e(x) + 2.0 * x * i1e(x))
    return np.asarray(mean, dtype=np.float64)


def _composite() -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights of equal Gauss-Legendre panels on (0, 1)."""
    node, weight = gauss_legendre(_NODES)
    panels = np.arange(_PANELS)[:, None]
    return ((panels + node) / _PANELS).ravel(), np.tile(weight / _PANELS, _PANELS)


def _rice_density(measured: FloatArray, truth: FloatArray) -> FloatArray:
    density = measured * np.exp(-0.5 * (measured - truth) ** 2) * i0e(measured * truth)
    return np.asarray(density, dtype=np.float64)


def true_snr(measured_snr: ArrayLike, estimator: Estimator) -> FloatArray:
    """Return the estimate of the true DoLP over its noise from the measured DoLP over its noise.

    None is unbiased at low signal: `bias_and_rms` says by how much. From 5 on all but the naive one are.

    Serkowski, Acta Astron. 8, 135 (1958); Wardle & Kronberg, ApJ 194, 249 (1974), doi:10.1086/153240;
    Simmons & Stewart, A&A 142, 100 (1985); Plaszczynski et al., MNRAS 439, 4048 (2014),
    doi:10.1093/mnras/stu270.
    """
    measured = np.asarray(measured_snr, dtype=np.float64)
    if not np.all(measured >= 0.0):
        raise ValueError(f"measured_snr has values down to {np.min(measured)}; allowed is 0 or more")
    if estimator not in ESTIMATORS:
        raise ValueError(f"estimator is {estimator!r}; allowed is one of {', '.join(ESTIMATORS)}")
    if estimator == "naive":
        return measured.copy()
    if estimator == "mas":
        return _mas(measured)
    if estimator == "asymptotic":
        return np.sqrt(np.maximum(measured**2 - 1.0, 0.0))
    above = measured > _zero_threshold(estimator)
    inverse = 1.0 / np.where(above, measured, np.inf) ** 2
    share = np.asarray(_share_curve(estimator)(inverse), dtype=np.float64)
    return np.where(above, measured * np.sqrt(np.maximum(share, 0.0)), 0.0)


def _mas(measured: FloatArray) -> FloatArray:
    safe = np.where(measured > 0.0, measured, 1.0)
    return np.where(measured > 0.0, measured + np.expm1(-(safe**2)) / (2.0 * safe), 0.0)


@cache
def _share_curve(estimator: str) -> "CubicSpline":
    """Return (v/r)^2 as a spline in 1/r^2, from 0 to 1/r^2 of the shortest length that gives more than 0."""
    from scipy.interpolate import CubicSpline

    square = _SQUARES[estimator]
    inverse = np.linspace(0.0, 1.0 / _zero_threshold(estimator) ** 2, _INTERVALS + 1)
    share = np.ones_like(inverse)
    share[1:-1] = square(1.0 / inverse[1:-1]) * inverse[1:-1]
    share[-1] = 0.0
    return CubicSpline(inverse, share)


def _mass(low: FloatArray, high: FloatArray, truth: FloatArray) -> FloatArray:
    node, weight = _composite()
    inside = low + (high - low) * node
    mass: FloatArray = np.sum((high - low) * weight * _rice_density(inside, truth), axis=1)
    return mass


# Share of a deviation that is rounding of a singular covariance.
_NO_FLUCTUATION = 3e-8


def _ratio(
    stokes_mean: ArrayLike, stokes_cov: ArrayLike, component: int
) -> tuple[NormalRatio, FloatArray, tuple[int, ...]]:
    """Return the ratio of the part of a component that is independent of S0, and what the other part adds to it."""
    if component not in (1, 2):
        raise ValueError(f"component = {component}; allowed is 1 or 2")
    frame, shape = dolp_frame(stokes_mean, stokes_cov)
    axis = frame.axis_rad
    along, across = (np.cos(axis), -np.sin(axis)) if component == 1 else (np.sin(axis), np.cos(axis))
    known = frame.sigma_0 == 0.0
    sigma = np.where(known, 1.0, frame.sigma_0)
    own = np.hypot(along * frame.radius_1, across * frame.radius_2)
    slope = along * frame.slope_1 + across * frame.slope_2
    if np.any(own <= _NO_FLUCTUATION * np.hypot(own, slope)):
        raise ValueError(f"S{component} has no fluctuation apart from that of S0; its ratio to S0 has no density")
    excess = along * frame.excess_1 + across * frame.excess_2
    mean = along * frame.mean_1 + across * frame.mean_2
    ratio = NormalRatio(
        mean_y=np.where(known, mean, excess / sigma), sigma_y=own, mean_x=frame.mean_0, sigma_x=frame.sigma_0
    )
    return ratio, np.where(known, 0.0, slope / sigma), shape


def _distribution(ratio: NormalRatio, value: FloatArray) -> RatioDistribution:
    infinite = np.full_like(value, np.inf)
    lit = normal_ratio.ratio_positive(ratio)
    return RatioDistribution(
        lower=normal_ratio.ratio_between(ratio, -infinite, value) / lit,
        upper=normal_ratio.ratio_between(ratio, value, infinite) / lit,
        density=normal_ratio.ratio_density(ratio, value) / lit,
    )


def _rows(ratio: NormalRatio, index: NDArray[np.int64]) -> NormalRatio:
    return NormalRatio(**{name: getattr(ratio, name)[index] for name in ratio.__dataclass_fields__})


def _require_draws(p: FloatArray, draws: int, draw_threshold: bool) -> None:
    if not np.all((p > 0.0) & (p < 1.0)):
        raise ValueError(f"p_false_alarm has values from {np.min(p)} to {np.max(p)}; allowed is above 0, below 1")
    if draws < 2:
        raise ValueError(f"draws is {draws}; allowed is 2 or more")
    if draw_threshold and np.min(p, initial=1.0) * draws < 1.0:
        raise ValueError(
            f"{draws} draws hold less than one false alarm at p_false_alarm {np.min(p):g}; allowed is 1/draws or more, "
            "or a threshold in closed form (draw_threshold=False)"
        )


def _statistics(shift: FloatArray, factor: FloatArray, draws: int, generator: np.random.Generator) -> FloatArray:
    """Return sorted values of |shift + factor z|^2."""
    vectors = factor @ generator.standard_normal((factor.shape[-1], draws))
    vectors += shift[:, None]
    return np.sort(np.einsum("ij,ij->j", vectors, vectors))


def _share_above(ordered: FloatArray, threshold: FloatArray) -> FloatArray:
    below = np.searchsorted(ordered, threshold, side="right")
    return np.asarray(1.0 - below / ordered.size, dtype=np.float64)


def _roc(p: FloatArray, threshold: FloatArray, detected: FloatArray, error: FloatArray) -> DrawnRoc:
    return DrawnRoc(p_false_alarm=p, threshold=threshold, p_detection=detected, standard_error=error)


def _binomial_error(share: FloatArray, draws: int) -> FloatArray:
    """Return the standard error of a counted share; half a count stands for none, so that it is never zero."""
    safe = (share * draws + 0.5) / (draws + 1.0)
    return np.asarray(np.sqrt(safe * (1.0 - safe) / draws), dtype=np.float64)


def _drawn_threshold(ordered: FloatArray, p: FloatArray) -> FloatArray:
    rank = np.clip(np.ceil((1.0 - p) * ordered.size).astype(np.intp) - 1, 0, ordered.size - 1)
    return np.asarray(ordered[rank], dtype=np.float64)


def quantile(p: ArrayLike, stokes_mean: ArrayLike, stokes_cov: ArrayLike, *, component: int) -> FloatArray:
    """Return the value that S1 / S0 or S2 / S0, given S0 > 0, does not exceed with probability p."""
    ratio, shift, lead_shape = _ratio(stokes_mean, stokes_cov, component)
    wanted = np.asarray(p, dtype=np.float64)
    if np.any(~((wanted > 0.0) & (wanted < 1.0))):
        raise ValueError(f"p runs from {np.min(wanted)} to {np.max(wanted)}; allowed is above 0 and below 1")
    shape = np.broadcast_shapes(wanted.shape, lead_shape)
    index = np.broadcast_to(np.arange(shift.size).reshape(lead_shape), shape).ravel()
    found = _solve(_rows(ratio, index), np.broadcast_to(wanted, shape).ravel())
    return np.asarray((found + shift[index]).reshape(shape)[()])


# Of the arsinh of the value over its scale: 1e130 scales.
_REACH_NORMALIZED_STOKES = 300.0


def _solve(ratio: NormalRatio, p: FloatArray) -> FloatArray:
    """Return quantiles by a search over the arsinh of the value."""
    scale = ratio.sigma_y / np.maximum(np.abs(ratio.mean_x), ratio.sigma_x)
    centre = ratio.mean_y / np.where(ratio.mean_x == 0.0, 1.0, ratio.mean_x)

    def distribution_at(index: NDArray[np.int64], place: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        found = _distribution(_rows(ratio, index), centre[index] + scale[index] * np.sinh(place))
        return found.lower, found.upper, found.density * scale[index] * np.cosh(place)

    return np.asarray(
        centre
        + scale * np.sinh(find_quantiles(distribution_at, p=p, start=np.zeros_like(p), reach=_REACH_NORMALIZED_STOKES))
    )
