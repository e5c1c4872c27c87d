"""What the means of a region do not repeat from cycle to cycle, beyond the noise of their pixels."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Repeatability:
    """Relative standard errors of the mean of all cycles.

    Attributes
    ----------
    own
        Of each angle by itself; ratios of angles have it too.
    common
        Of all angles alike, as of light that drifts; ratios have none of it.
    """

    own: float = 0.0
    common: float = 0.0

    def cov(self, mean: FloatArray) -> FloatArray:
        """Return the covariance of the means of the angles, shape (N, N)."""
        return np.diag(np.square(mean * self.own)) + np.outer(mean, mean) * self.common**2


def repeatability(pixels: FloatArray, *, noise_inflation: float = 1.0) -> Repeatability:
    """Return what differs from cycle to cycle, and is not the noise of the pixels.

    Parameters
    ----------
    pixels
        Cycles, angles, pixels, shape (C, N, P); dark level off.
    noise_inflation
        How many times the variance of a mean over the pixels is that of as many independent ones, by their noise.

    Returns
    -------
    Repeatability
        Nothing where there is one cycle, or no light.

    Notes
    -----
    The factor of each cycle that all angles share is taken out by least squares; what is left, of (C - 1) (N - 1)
    degrees of freedom, is each angle's own. A factor that drifts reaches the angles of one cycle one after the other:
    in which order is not asked, so its slope counts for each angle as if it came at a time of its own.

    What cannot be below 0 is on average 0.4 standard errors too large where there is nothing; half of one, that which
    noise alone gives, is taken off. It is missed where as little is there: errors of means are 3 % too small at most.

    References
    ----------
    Definition; analysis of variance of a two-way layout.
    """
    means = pixels.mean(axis=2)
    if len(means) < 2:
        return Repeatability()
    # The noise of the pixels makes means differ too, and is in their errors already.
    return repeatability_of(means, pixels.var(axis=0, ddof=1).mean(axis=1) / pixels.shape[2] * noise_inflation)


def repeatability_of(means: FloatArray, noise: FloatArray) -> Repeatability:
    """Return the same by the means over the pixels and what the pixels' noise makes of their variance.

    Parameters
    ----------
    means
        Cycles, angles, shape (C, N).
    noise
        Variance of such a mean by the noise of its pixels, shape (N,).
    """
    cycles, angles = means.shape
    level = means.mean(axis=0)
    light = float(level @ level)
    if cycles < 2 or not light > 0.0:
        return Repeatability()
    noise_of_factor = float(level**2 @ noise) / light**2
    share = float(np.sum(level**4)) / light**2
    factor = (means - level) @ level / light
    left = means - level * (1.0 + factor[:, np.newaxis])
    noise_left = float(noise.sum()) - noise_of_factor * light
    own = 0.0
    if angles > 1:
        by_chance = 0.5 * noise_left * np.sqrt(2.0 / ((cycles - 1) * (angles - 1)))
        excess = float(np.sum(left**2)) / (cycles - 1) - noise_left - by_chance
        own = max(excess, 0.0) / (light * (1.0 - share))
    # Of the factor's variance, what the angles' own errors and the noise leave.
    of_others = noise_of_factor + own * share
    common = max(float(np.var(factor, ddof=1)) - of_others, 0.0)
    time = np.arange(cycles) - 0.5 * (cycles - 1)
    slope2 = max((float(time @ factor) / float(time @ time)) ** 2 - of_others / float(time @ time), 0.0)
    drifted = slope2 * (angles**2 - 1) / (12.0 * angles**2)
    return Repeatability(own=float(np.sqrt(own / cycles + drifted)), common=float(np.sqrt(common / cycles)))
