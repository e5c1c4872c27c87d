"""Mean and deviation of DoLP against the signal-to-noise ratio of S0 under shot noise: the study of [MK14] Fig. 5."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.processing import dolp
from model.processing.poisson_dolp import TooManyCountsError, poisson_dolp
from model.processing.reconstruction import MODIFIED_PICKERING_RAD, Design, design
from model.stokes import dolp as degree_of_polarization

FloatArray = NDArray[np.float64]

# SNR of S0, 20 dB, up to which the law of Poisson counts is summed, half a second a ratio. There the deviation of
# Gaussian counts is 1.1 % too large, their mean 4e-4 too high.
POISSON_BELOW = 10.0 * (1.0 + 1e-9)
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
        Exact for Poisson counts, given S0 > 0; not a number above `POISSON_BELOW`, and where the sum would be too long.
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


def _poisson(plan: Design, light_e: FloatArray, ratio: float) -> tuple[float, float]:
    """Return exact mean and deviation at few electrons."""
    nothing = float("nan"), float("nan")
    if ratio > POISSON_BELOW:
        return nothing
    try:
        found = poisson_dolp(plan, light_e)
    except TooManyCountsError:
        return nothing
    return found.mean, found.std


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
