"""Studies of DoLP: statistics at low light, estimators of the true DoLP, laws of S1/S0 and S2/S0, and drawn ROCs.

- `dolp_against_snr`: mean and deviation of DoLP against the SNR of S0 ([MK14] Fig. 5), to first order, exactly, and
  by Poisson draws. Few photo-electrons follow the sum over all Poisson counts, many follow Gaussian counts.
- `bias_and_rms`: errors of estimators of the true DoLP. Each estimator inverts a curve between the true length v and
  the measured length r, both over the standard deviation of a component. In u = 1/r^2 the ratio (v/r)^2 falls smoothly
  from 1 at u = 0 to 0 at the shortest r that gives more than 0. A cubic spline over 512 intervals of u keeps the error
  of v below 1e-9 at any length.
- `normalized_density`: S1/S0 and S2/S0 are ratios of correlated normal variables.
- `rx_draws`: probability of detection by random vectors, as in [MK14] section IV-B.
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
from model.processing.detection import background_condition
from model.processing.dolp_law import NormalRatio, dolp_frame, ratio_density, ratio_positive
from model.processing.quadratic_forms import tail_probabilities
from model.processing.reconstruction import MODIFIED_PICKERING_RAD, Design, design
from model.stokes import dolp as degree_of_polarization

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

FloatArray = NDArray[np.float64]

# The difference between Gaussian and Poisson counts falls with these powers of the electrons.
_MEAN_POWER, _STD_POWER = 2.0, 1.5
_SUM_ERROR = 1e-9


@dataclass(frozen=True, kw_only=True)
class DolpAgainstSnr:
    """DoLP statistics over a row of signal-to-noise ratios, each field of shape (K,)."""

    snr: FloatArray  #: mean of S0 over its standard deviation
    first_mean: FloatArray  #: to first order, as [MK14] has it
    first_std: FloatArray
    drawn_mean: FloatArray  #: of drawn Poisson counts; draws with S0 <= 0 are left out
    drawn_std: FloatArray
    true_mean: FloatArray  #: by the law of Poisson counts, given S0 > 0
    true_std: FloatArray
    true_mean_error: FloatArray  #: numerical error; not a number where it is unknown
    true_std_error: FloatArray


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
        Poisson draws for each ratio; 1e4 in [MK14].
    generator
        Source of the random numbers.
    angles_rad
        Polarizer angles, shape (N,) [rad].
    tolerance
        Relative, of the moments of Gaussian counts.

    Notes
    -----
    Shot noise only. The law of Poisson counts is summed up to an SNR of 10. Above it, the law of Gaussian counts is
    used, corrected by the difference at the last sum, which falls with more light. The error is what the sum before the
    last would have missed at the last. With fewer than two sums there is no correction, and the error is not known.

    References
    ----------
    [MK14] eq. (24)-(28), Fig. 5.
    """
    ratios, shape = np.asarray(snr, dtype=np.float64), np.asarray(stokes, dtype=np.float64)
    plan = design(angles_rad)
    # Under shot noise var S0 = (W diag(M S) W')_00 grows as S0 does: the variance at one electron gives the factor.
    unit_cov = plan.inverse @ np.diag(plan.system @ shape) @ plan.inverse.T
    s0_e = ratios**2 * unit_cov[0, 0] / shape[0] ** 2
    mean, cov = s0_e[:, None] * shape, s0_e[:, None, None] * unit_cov
    first, gaussian = dolp.first_order(mean, cov), dolp.moments(mean, cov, tolerance=tolerance)
    nothing = (np.nan, np.nan)
    poisson_mean, poisson_std = np.transpose(
        [
            poisson_dolp(plan, light) or nothing if ratio <= _POISSON_BELOW else nothing
            for light, ratio in zip(mean, ratios, strict=True)
        ]
    )
    drawn_mean, drawn_std = np.transpose([_drawn(plan, light, draws, generator) for light in mean])
    true_mean, true_mean_error = _carried_on(s0_e, poisson_mean, gaussian.mean, _MEAN_POWER)
    true_std, true_std_error = _carried_on(s0_e, poisson_std, gaussian.std, _STD_POWER)
    return DolpAgainstSnr(
        snr=ratios,
        first_mean=np.asarray(first.mean),
        first_std=np.sqrt(first.variance),
        drawn_mean=drawn_mean,
        drawn_std=drawn_std,
        true_mean=true_mean,
        true_std=true_std,
        true_mean_error=true_mean_error,
        true_std_error=true_std_error,
    )


Estimator = Literal["naive", "asymptotic", "wardle_kronberg", "maximum_likelihood", "mean", "median", "mas"]
ESTIMATORS: tuple[Estimator, ...] = get_args(Estimator)


@dataclass(frozen=True, kw_only=True)
class EstimatorError:
    """Errors of an estimator, in units of the noise."""

    bias: FloatArray  #: mean estimate less the truth
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

    Notes
    -----
    Gauss-Legendre quadrature over the Rice distribution of the measured value, r = r_0 + x^2 above the value r_0 where
    the estimate leaves 0: most estimators rise there as the root of r - r_0.

    References
    ----------
    Rice, Bell Syst. Tech. J. 24, 46 (1945), doi:10.1002/j.1538-7305.1945.tb00453.x; definition.
    """
    truth = np.asarray(true_snr_values, dtype=np.float64)
    flat = truth.reshape(-1, 1)
    kink = _THRESHOLDS[estimator]
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


def normalized_density(x: ArrayLike, stokes_mean: ArrayLike, stokes_cov: ArrayLike, *, component: int) -> FloatArray:
    """Return the density of S1/S0 or S2/S0 given S0 > 0, to rounding at any signal-to-noise ratio.

    Parameters
    ----------
    x
        Value, finite; broadcast against the leading axes of the other arguments.
    stokes_mean
        Mean of (S0, S1, S2), shape (..., 3), any unit.
    stokes_cov
        Covariance, shape (..., 3, 3).
    component
        1 or 2.

    Raises
    ------
    ValueError
        If the arguments are no mean and covariance, the component does not fluctuate apart from S0, or S0 > 0 has no
        probability.

    Notes
    -----
    No mean exists: the density falls as 1 / x^2.

    References
    ----------
    G. Marsaglia, J. Stat. Softw. 16 (2006) 4, doi:10.18637/jss.v016.i04, for the unconditional ratio.
    """
    frame, lead_shape = dolp_frame(stokes_mean, stokes_cov)
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
    # The part that is independent of S0, over S0; the other part shifts it.
    means_y = np.where(known, mean, excess / sigma)
    shift = np.where(known, 0.0, slope / sigma)
    values = np.asarray(x, dtype=np.float64)
    shape = np.broadcast_shapes(values.shape, lead_shape)
    index = np.broadcast_to(np.arange(shift.size).reshape(lead_shape), shape).ravel()
    ratio = NormalRatio(
        mean_y=means_y[index], sigma_y=own[index], mean_x=frame.mean_0[index], sigma_x=frame.sigma_0[index]
    )
    density = ratio_density(ratio, np.broadcast_to(values, shape).ravel() - shift[index]) / ratio_positive(ratio)
    return np.asarray(density.reshape(shape)[()])


# Share of a deviation that is rounding of a singular covariance.
_NO_FLUCTUATION = 3e-8


def rx_draws(
    p_false_alarm: ArrayLike,
    target_mean: ArrayLike,
    target_cov: ArrayLike,
    background_mean: ArrayLike,
    background_cov: ArrayLike,
    *,
    draws: int,
    generator: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """Return detection probabilities counted among random vectors, and their standard errors.

    Parameters
    ----------
    p_false_alarm
        Any shape, from 1/draws to 1; [MK14] draws the threshold too.
    target_mean, background_mean
        Shape (n,), one unit.
    target_cov, background_cov
        Shape (n, n), that unit squared.
    draws
        Number of target vectors and of background vectors.
    generator
        Source of the random numbers.

    Raises
    ------
    ValueError
        If the background's covariance is singular, or the draws hold less than one false alarm.

    Notes
    -----
    The exact curve (`detection.rx_roc`) is both faster and more accurate. Errors include that of the threshold, and
    stay above 1/(2 draws) where nothing or everything was detected.

    References
    ----------
    [MK14] eq. (30), section IV-B.
    """
    p = np.asarray(p_false_alarm, dtype=np.float64)
    if np.min(p, initial=1.0) * draws < 1.0:
        raise ValueError(
            f"{draws} draws hold less than one false alarm at p_false_alarm {np.min(p):g}; allowed is 1/draws or more"
        )
    mean_b, cov_b = np.asarray(background_mean, dtype=np.float64), np.asarray(background_cov, dtype=np.float64)
    background_condition(cov_b)
    to_white = np.linalg.inv(np.linalg.cholesky(cov_b))
    shift = to_white @ (np.asarray(target_mean, dtype=np.float64) - mean_b)
    found = _statistics(shift, to_white @ covariance_factor(target_cov), draws, generator)
    alarms = _statistics(np.zeros_like(shift), np.eye(mean_b.size), draws, generator)
    # The threshold, and thresholds at one standard deviation of the false alarms below and above.
    spread = np.sqrt(p * (1.0 - p) / draws)
    detected, low, high = (_share_above(found, alarms, p + side * spread) for side in (0.0, -1.0, 1.0))
    # Half a count is added to a share of none, so that its error is never zero.
    safe = (detected * draws + 0.5) / (draws + 1.0)
    return detected, np.hypot(np.sqrt(safe * (1.0 - safe) / draws), 0.5 * (high - low))


# SNR of S0, 20 dB, up to which the law of Poisson counts is summed, half a second a ratio. There the deviation of
# Gaussian counts is 1.1 % too large, their mean 4e-4 too high.
_POISSON_BELOW = 10.0 * (1.0 + 1e-9)


# Combinations of counts that are summed at most: four channels of some 60 electrons each, half a second.
_MOST_COMBINATIONS = 30_000_000
_CHUNK = 2_000_000


def poisson_dolp(plan: Design, stokes_e: ArrayLike) -> tuple[float, float] | None:
    """Return mean and deviation of DoLP under shot noise alone, given S0 > 0; None if the sum would be too long.

    [MK14] section II-C, Fig. 5; definition of the mean of a function of independent Poisson counts.
    """
    means_e = np.maximum(plan.system @ np.asarray(stokes_e, dtype=np.float64), 0.0)
    counts = [_likely_counts(mean) for mean in means_e]
    if np.prod([found.size for found, _ in counts], dtype=np.float64) > _MOST_COMBINATIONS:
        return None
    half = len(counts) // 2
    stokes_1, probability_1 = _partial_sums(plan.inverse[:, :half], counts[:half])
    stokes_2, probability_2 = _partial_sums(plan.inverse[:, half:], counts[half:])
    sums = np.zeros(3)
    rows = max(1, _CHUNK // probability_2.size)
    for start in range(0, probability_1.size, rows):
        part = slice(start, start + rows)
        s0, s1, s2 = (stokes_1[part, None, k] + stokes_2[:, k] for k in range(3))
        # Rounding of the inverse may leave something where counts cancel.
        lit = s0 > 1e-9
        degree = np.hypot(s1, s2) / np.where(lit, s0, 1.0)
        seen = np.where(lit, probability_1[part, None] * probability_2, 0.0)
        sums += [seen.sum(), (seen * degree).sum(), (seen * degree**2).sum()]
    mean, square = sums[1:] / sums[0]
    return float(mean), float(np.sqrt(max(square - mean**2, 0.0)))


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


def _partial_sums(inverse: FloatArray, counts: list[tuple[FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    """Return contributions of some channels to the Stokes parameters, shape (P, 3), and their probabilities."""
    stokes, probability = np.zeros((1, 3)), np.ones(1)
    for column, (found, likely) in zip(inverse.T, counts, strict=True):
        stokes = (stokes[:, None, :] + found[:, None] * column).reshape(-1, 3)
        probability = np.outer(probability, likely).ravel()
    return stokes, probability


def _drawn(plan: Design, light_e: FloatArray, draws: int, generator: np.random.Generator) -> tuple[float, float]:
    """Return mean and deviation of DoLP of drawn Poisson counts."""
    counts = generator.poisson(np.maximum(plan.system @ light_e, 0.0)[:, None], (plan.system.shape[0], draws))
    stokes = (plan.inverse @ counts).T
    values = np.asarray(degree_of_polarization(stokes[stokes[:, 0] > 0.0]))
    return float(values.mean()), float(values.std(ddof=1))


def _carried_on(
    s0_e: FloatArray, poisson: FloatArray, gaussian: FloatArray, power: float
) -> tuple[FloatArray, FloatArray]:
    """Return a moment by the law of Poisson counts at any light, and its error."""
    apart, summed = poisson - gaussian, np.isfinite(poisson)
    both = np.flatnonzero(np.isfinite(apart))
    if both.size < 2:
        return np.where(summed, poisson, gaussian), np.where(summed, _SUM_ERROR, np.nan)
    before, last = both[np.argsort(s0_e[both])[-2:]]
    fall = (s0_e[last] / s0_e) ** power
    missed = apart[last] - apart[before] / fall[before]
    value = np.where(summed, poisson, gaussian + apart[last] * fall)
    return value, np.where(summed, _SUM_ERROR, np.abs(missed) * fall)


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


_SQUARES: dict[Estimator, Callable[[FloatArray], FloatArray]] = {
    "wardle_kronberg": _square_of_mode,
    "maximum_likelihood": _square_of_likelihood,
    "mean": _square_of_mean,
    "median": _square_of_median,
}
# Measured length at and below which the estimate is 0.
_THRESHOLDS: dict[Estimator, float] = {
    "naive": 0.0,
    "asymptotic": 1.0,
    "wardle_kronberg": 1.0,
    "maximum_likelihood": float(np.sqrt(2.0)),
    "mean": float(np.sqrt(0.5 * np.pi)),
    "median": float(np.sqrt(2.0 * np.log(2.0))),
    "mas": 0.0,
}


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

    At low signal every estimator is biased (`bias_and_rms`); from 5 on, only the naive estimator is.

    Serkowski, Acta Astron. 8, 135 (1958); Wardle & Kronberg, ApJ 194, 249 (1974), doi:10.1086/153240;
    Simmons & Stewart, A&A 142, 100 (1985); Plaszczynski et al., MNRAS 439, 4048 (2014),
    doi:10.1093/mnras/stu270.
    """
    measured = np.asarray(measured_snr, dtype=np.float64)
    if estimator == "naive":
        return measured.copy()
    if estimator == "mas":
        return _mas(measured)
    if estimator == "asymptotic":
        return np.sqrt(np.maximum(measured**2 - 1.0, 0.0))
    above = measured > _THRESHOLDS[estimator]
    inverse = 1.0 / np.where(above, measured, np.inf) ** 2
    share = np.asarray(_share_curve(estimator)(inverse), dtype=np.float64)
    return np.where(above, measured * np.sqrt(np.maximum(share, 0.0)), 0.0)


def _mas(measured: FloatArray) -> FloatArray:
    safe = np.where(measured > 0.0, measured, 1.0)
    return np.where(measured > 0.0, measured + np.expm1(-(safe**2)) / (2.0 * safe), 0.0)


@cache
def _share_curve(estimator: Estimator) -> "CubicSpline":
    """Return (v/r)^2 as a spline in 1/r^2, from 0 to 1/r^2 of the shortest length that gives more than 0."""
    from scipy.interpolate import CubicSpline

    square = _SQUARES[estimator]
    inverse = np.linspace(0.0, 1.0 / _THRESHOLDS[estimator] ** 2, _INTERVALS + 1)
    share = np.ones_like(inverse)
    share[1:-1] = square(1.0 / inverse[1:-1]) * inverse[1:-1]
    share[-1] = 0.0
    return CubicSpline(inverse, share)


def _mass(low: FloatArray, high: FloatArray, truth: FloatArray) -> FloatArray:
    node, weight = _composite()
    inside = low + (high - low) * node
    mass: FloatArray = np.sum((high - low) * weight * _rice_density(inside, truth), axis=1)
    return mass


def _statistics(shift: FloatArray, factor: FloatArray, draws: int, generator: np.random.Generator) -> FloatArray:
    """Return sorted values of |shift + factor z|^2."""
    vectors = factor @ generator.standard_normal((factor.shape[-1], draws))
    vectors += shift[:, None]
    return np.sort(np.einsum("ij,ij->j", vectors, vectors))


def _share_above(ordered: FloatArray, alarms: FloatArray, p: FloatArray) -> FloatArray:
    """Return the share of values above the threshold that a share p of the false alarms exceeds."""
    rank = np.clip(np.ceil((1.0 - p) * alarms.size).astype(np.intp) - 1, 0, alarms.size - 1)
    return np.asarray(1.0 - np.searchsorted(ordered, alarms[rank], side="right") / ordered.size)
