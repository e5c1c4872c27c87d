"""Size distributions: number of particles of an aerosol by radius."""

from dataclasses import dataclass
from math import exp, inf, isfinite, log, pi, sqrt
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

_REACH = 8.0  # standard deviations of a log-normal distribution beyond which 1e-15 of it lies


class SizeDistribution(Protocol):
    """Number of particles over the logarithm of their radius."""

    @property
    def breaks_m(self) -> tuple[float, ...]:
        """Increasing radii [m]: the ends, and those between where the number is not smooth."""
        ...

    @property
    def ends_vanish(self) -> bool:
        """True if the number falls off smoothly to nothing at both ends, and is smooth between."""
        ...

    def number_per_log_radius(self, radius_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Particles per unit of ln(radius), for one particle in all."""
        ...


@dataclass(frozen=True, kw_only=True)
class LogNormal:
    """Log-normal number of particles over radius; `log_normal` makes one from other ways to say it.

    Attributes
    ----------
    median_radius_m
        Radius that half of the particles exceed [m], above 0.
    ln_sigma
        Standard deviation of the natural logarithm of the radius, above 0 to 2.
    largest_radius_m
        Radius [m] above which there are none.
    """

    median_radius_m: float
    ln_sigma: float
    largest_radius_m: float = inf

    def __post_init__(self) -> None:
        if not (0.0 < self.median_radius_m < inf):
            raise ValueError(f"LogNormal: median_radius_m = {self.median_radius_m!r} m must be finite and above 0")
        if not 0.0 < self.ln_sigma <= 2.0:
            raise ValueError(
                f"LogNormal: ln_sigma = {self.ln_sigma!r}, allowed is above 0 to 2; "
                "it is the natural logarithm of the geometric standard deviation"
            )
        if not self.largest_radius_m > self.breaks_m[0]:
            raise ValueError(f"LogNormal: largest_radius_m = {self.largest_radius_m!r} m leaves no particles")

    @property
    def breaks_m(self) -> tuple[float, ...]:
        """Ends [m] for number and area; the median of the area is exp(2 sigma^2) larger than that of the number."""
        lowest = self.median_radius_m * exp(-_REACH * self.ln_sigma)
        highest = self.median_radius_m * exp(2.0 * self.ln_sigma**2 + _REACH * self.ln_sigma)
        return lowest, min(highest, self.largest_radius_m)

    @property
    def ends_vanish(self) -> bool:
        """True if there is no largest radius."""
        return self.largest_radius_m == inf

    def number_per_log_radius(self, radius_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Particles per unit of ln(radius); 0 above the largest radius, otherwise not renormalized."""
        deviation = (np.log(radius_m) - log(self.median_radius_m)) / self.ln_sigma
        density = np.exp(-0.5 * deviation**2) / (sqrt(2.0 * pi) * self.ln_sigma)
        return np.where(radius_m <= self.largest_radius_m, density, 0.0)


def log_normal(
    *,
    number_median_radius_m: float | None = None,
    volume_median_radius_m: float | None = None,
    ln_sigma: float | None = None,
    log10_sigma: float | None = None,
    largest_radius_m: float = inf,
) -> LogNormal:
    """Log-normal distribution from either median and either logarithm.

    Parameters
    ----------
    number_median_radius_m, volume_median_radius_m
        Exactly one: radius [m] that half of the number, or of the volume, lies above.
    ln_sigma, log10_sigma
        Exactly one: standard deviation of the natural or of the decimal logarithm of the radius.
    largest_radius_m
        Radius [m] above which there are no particles.

    Raises
    ------
    ValueError
        Not exactly one of a pair is given, or it is outside its range.

    References
    ----------
    definition: the volume's median is exp(3 sigma^2) times that of the number.
    """
    if (number_median_radius_m is None) == (volume_median_radius_m is None):
        raise ValueError("log_normal: give either number_median_radius_m or volume_median_radius_m")
    if (ln_sigma is None) == (log10_sigma is None):
        raise ValueError("log_normal: give either ln_sigma or log10_sigma")
    sigma = ln_sigma if ln_sigma is not None else log(10.0) * (log10_sigma or 0.0)
    median = number_median_radius_m
    if median is None:
        median = (volume_median_radius_m or 0.0) * exp(-3.0 * sigma**2)
    return LogNormal(median_radius_m=median, ln_sigma=sigma, largest_radius_m=largest_radius_m)


@dataclass(frozen=True, kw_only=True)
class TabulatedSizes:
    """Number of particles over radius as a table; linear in ln(radius) between its rows, none outside.

    Attributes
    ----------
    radius_m
        Increasing radii [m], two or more, above 0.
    number_per_log_radius_at
        Particles per unit of ln(radius) at these, 0 or more, on any scale.
    """

    radius_m: tuple[float, ...]
    number_per_log_radius_at: tuple[float, ...]

    def __post_init__(self) -> None:
        radius, number = np.array(self.radius_m), np.array(self.number_per_log_radius_at)
        if radius.size < 2 or radius.shape != number.shape:
            raise ValueError(f"TabulatedSizes: {radius.size} radii and {number.size} numbers; give two or more of each")
        if not (radius[0] > 0.0 and np.all(np.diff(radius) > 0.0) and isfinite(radius[-1])):
            raise ValueError("TabulatedSizes: radius_m must be finite, above 0 and increase")
        if not (np.all(number >= 0.0) and np.all(np.isfinite(number)) and np.any(number > 0.0)):
            raise ValueError("TabulatedSizes: number_per_log_radius_at must be finite, 0 or more, and not all 0")

    @property
    def breaks_m(self) -> tuple[float, ...]:
        """Radii [m] of the rows."""
        return self.radius_m

    @property
    def ends_vanish(self) -> bool:
        """Never: a table has corners."""
        return False

    def number_per_log_radius(self, radius_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Particles per unit of ln(radius), for one particle in all."""
        log_radius, number = np.log(self.radius_m), np.array(self.number_per_log_radius_at)
        total = np.sum(np.diff(log_radius) * (number[1:] + number[:-1])) / 2.0
        return np.asarray(np.interp(np.log(radius_m), log_radius, number / total, left=0.0, right=0.0))


def number_of_volume(*, volume: float, volume_median_radius_m: float, ln_sigma: float) -> float:
    """Return how many particles of a log-normal distribution together have a volume, per unit of that volume.

    Parameters
    ----------
    volume
        Volume of all particles, above 0, in any unit.
    volume_median_radius_m
        Radius [m] that half of the volume lies above, above 0.
    ln_sigma
        Standard deviation of the natural logarithm of the radius, above 0 to 2.

    Raises
    ------
    ValueError
        An argument outside its range.

    References
    ----------
    definition: the mean cube of the radius is that of the volume's median times exp(-9 sigma^2 / 2).
    """
    if not all(isfinite(value) and value > 0.0 for value in (volume, volume_median_radius_m)):
        raise ValueError(f"volume = {volume!r} and volume_median_radius_m = {volume_median_radius_m!r} must be above 0")
    if not 0.0 < ln_sigma <= 2.0:
        raise ValueError(f"ln_sigma = {ln_sigma!r}, allowed is above 0 to 2")
    mean_cube = volume_median_radius_m**3 * exp(-4.5 * ln_sigma**2)
    return volume / (4.0 / 3.0 * pi * mean_cube)
