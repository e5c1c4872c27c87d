"""Mean and deviation of DoLP against the signal-to-noise ratio of S0 under shot noise: the study of [MK14] Fig. 5."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.processing import dolp
from model.processing.poisson_dolp import poisson_dolp
from model.processing.reconstruction import MODIFIED_PICKERING_RAD, Design, design
from model.stokes import dolp as degree_of_polarization

FloatArray = NDArray[np.float64]

# SNR of S0, 16 dB, below which the law of Poisson counts is summed; above it Gaussian counts are exact to 1e-4.
POISSON_BELOW = 10.0 ** (16.0 / 20.0) * (1.0 + 1e-9)


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
        Exact for Poisson counts, given S0 > 0; not a number above `POISSON_BELOW`, where Gaussian counts are exact
        enough.
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
        """Mean by the law of Poisson counts where it is summed, of Gaussian ones elsewhere."""
        return np.where(np.isnan(self.poisson_mean), self.mean, self.poisson_mean)

    @property
    def true_std(self) -> FloatArray:
        """Deviation by the law of Poisson counts where it is summed, of Gaussian ones elsewhere."""
        return np.where(np.isnan(self.poisson_std), self.std, self.poisson_std)


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
    Shot noise only. The draws are Poisson counts; where a channel holds few electrons their law is summed, elsewhere it
    is Gaussian.

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
    if ratio > POISSON_BELOW:
        return float("nan"), float("nan")
    found = poisson_dolp(plan, light_e)
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
