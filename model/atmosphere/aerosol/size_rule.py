"""Trapezoidal rule over the sizes of an aerosol, in steps that suit how spheres scatter."""

from itertools import pairwise
from math import ceil, log, pi

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.aerosol.particle_modes import MieAerosol, ParticleMode

# The variable of the integral over size is ln x + x / _BEND: steps of ln x for small spheres, of x for large ones,
# whose efficiencies ripple with a period in x.
_BEND = 10.0
_FIRST_STEP = 0.08
_LARGEST_SIZE = 2e3
_SCAN_STEP = 0.05  # of ln x, to find the sizes that matter


def size_ranges(aerosol: MieAerosol, *, wavelength_m: float, tolerance: float) -> list[NDArray[np.float64]]:
    """For each mode the size parameters between which its distribution is smooth; empty if it adds nothing.

    Parameters
    ----------
    aerosol
        Its modes.
    wavelength_m
        [m].
    tolerance
        Share of the extinction that both tails of all modes together may leave out, about four times over.

    Raises
    ------
    ValueError
        Spheres matter that are too large for the wavelength.
    """
    grids = [_weighed_sizes(mode, wavelength_m) for mode in aerosol.modes]
    least = tolerance / (8.0 * len(grids)) * sum(float(np.sum(weight)) for _, weight in grids)
    ranges = [
        _range(mode, size, weight, least, wavelength_m)
        for mode, (size, weight) in zip(aerosol.modes, grids, strict=True)
    ]
    largest = max(float(bounds[-1]) for bounds in ranges if bounds.size)
    if largest > _LARGEST_SIZE:
        raise ValueError(
            f"aerosol {aerosol.name!r}: spheres up to {largest * wavelength_m / (2.0 * pi):.3g} m matter at "
            f"{wavelength_m:.4g} m, allowed are {_LARGEST_SIZE * wavelength_m / (2.0 * pi):.3g} m; "
            "give a smaller largest_radius_m or a larger tolerance"
        )
    return ranges


def size_nodes(
    mode: ParticleMode, bounds: NDArray[np.float64], *, wavelength_m: float, halving: int, middles: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Size parameters and weights (number times geometrical cross-section [m2]) of a rule for one mode.

    Parameters
    ----------
    bounds
        One of `size_ranges`, not empty.
    wavelength_m
        [m].
    halving
        How often the first step has been halved.
    middles
        False: the trapezoidal rule. True: the rule of the middles of its steps; the mean of both is the trapezoidal
        rule of the next halving.

    References
    ----------
    Korobov's transformation of a trapezoidal rule: Sidi, Practical Extrapolation Methods (2003), appendix D.
    """
    place, step = _steps(np.log(bounds) + bounds / _BEND, halving, middles=middles, ends_vanish=mode.sizes.ends_vanish)
    size = _size_at(place)
    radius = size * wavelength_m / (2.0 * pi)
    density = mode.number_share * mode.sizes.number_per_log_radius(radius) * pi * radius**2
    weight = density * step / (1.0 + size / _BEND)
    return size[weight > 0.0], weight[weight > 0.0]


def _weighed_sizes(mode: ParticleMode, wavelength_m: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Size parameters in equal steps of their logarithm, and roughly what each adds to the extinction."""
    first, last = mode.sizes.breaks_m[0], mode.sizes.breaks_m[-1]
    radius = np.geomspace(first, last, ceil(log(last / first) / _SCAN_STEP) + 2)
    size = 2.0 * pi * radius / wavelength_m
    # Small spheres absorb like x and scatter like x^4, large ones take away twice their cross-section.
    efficiency = np.minimum(2.0, 0.25 * size**4 + 2.0 * size * mode.index.at(wavelength_m).imag)
    number = mode.number_share * mode.sizes.number_per_log_radius(radius)
    return size, number * radius**2 * efficiency * log(last / first) / radius.size


def _range(
    mode: ParticleMode, size: NDArray[np.float64], weight: NDArray[np.float64], least: float, wavelength_m: float
) -> NDArray[np.float64]:
    """Range of one mode: its breaks, cut where the tails beyond add less than the least."""
    kept = np.flatnonzero((np.cumsum(weight) > least) & (np.cumsum(weight[::-1])[::-1] > least))
    if kept.size == 0:
        return np.zeros(0)
    low, high = size[max(kept[0] - 1, 0)], size[min(kept[-1] + 1, size.size - 1)]
    breaks = 2.0 * pi * np.array(mode.sizes.breaks_m) / wavelength_m
    inner = breaks[(breaks > low * (1.0 + 1e-9)) & (breaks < high * (1.0 - 1e-9))]
    return np.concatenate([[low], inner, [high]])


def _steps(
    bounds: NDArray[np.float64], halving: int, *, middles: bool, ends_vanish: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Abscissae and weights of a rule on neighbouring intervals."""
    abscissae, weights = [], []
    for low, high in pairwise(bounds):
        count = ceil((high - low) / _FIRST_STEP) * 2**halving
        share = (np.arange(count) + 0.5) / count if middles else np.arange(count + 1.0) / count
        step = np.full(share.size, 1.0 / count)
        if not middles:
            step[[0, -1]] /= 2.0
        if not ends_vanish:
            # The rule then is of eighth order on an interval at whose ends the size distribution breaks off.
            step, share = 140.0 * (share * (1.0 - share)) ** 3 * step, share**4 * np.polyval((-20, 70, -84, 35), share)
        abscissae.append(low + (high - low) * share)
        weights.append((high - low) * step)
    return np.concatenate(abscissae), np.concatenate(weights)


def _size_at(place: NDArray[np.float64]) -> NDArray[np.float64]:
    """Size parameter x of ln x + x / _BEND, by Newton's method in ln x, which is convex."""
    logarithm = np.where(place < 1.0, place, np.log(_BEND * np.maximum(place, 1.0)))
    for _ in range(12):
        bend = np.exp(logarithm) / _BEND
        logarithm = logarithm - (logarithm + bend - place) / (1.0 + bend)
    return np.asarray(np.exp(logarithm))
