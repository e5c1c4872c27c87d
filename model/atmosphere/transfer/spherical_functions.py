"""Wigner functions, and the basis in which the scattering matrix of randomly oriented particles separates."""

from collections.abc import Iterator
from functools import lru_cache
from math import comb, sqrt

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def wigner_d(*, degree_max: int, order_max: int, second: int, mu: FloatArray) -> FloatArray:
    """Wigner's functions d^l_mn(arccos mu) for every degree l and first order m, at one second order n.

    Parameters
    ----------
    degree_max, order_max
        Largest l and largest m; both count from 0.
    second
        The second order n, of any sign.
    mu
        Cosine of the angle, shape (N,), -1 to 1.

    Returns
    -------
    ndarray, shape (order_max + 1, degree_max + 1, N)
        Zero where l < max(m, |n|).

    Notes
    -----
    Upward recurrence in l from the closed form at l = max(m, |n|), which is stable.

    References
    ----------
    Mishchenko, Travis & Lacis, Scattering, Absorption, and Emission of Light by Small Particles (2002), appendix B.
    """
    values = np.zeros((order_max + 1, degree_max + 1, mu.size))
    for order in range(min(order_max, degree_max) + 1):
        lowest = max(order, abs(second))
        if lowest <= degree_max:
            values[order, lowest] = _lowest_degree(order, second, mu)
    for degree, rise, shift, fall in _recurrence(degree_max, order_max, second):
        # Orders above this degree start later, from their own closed form.
        known = slice(0, rise.shape[0])
        values[known, degree + 1] = (rise * mu - shift) * values[known, degree]
        values[known, degree + 1] -= fall * values[known, max(degree, 1) - 1]
    return values


def _lowest_degree(order: int, second: int, mu: FloatArray) -> FloatArray:
    """d^l_mn at l = max(m, |n|)."""
    difference, total = abs(order - second), abs(order + second)
    sign = 1.0 if second >= order else (-1.0) ** difference
    shape: FloatArray = ((1.0 - mu) / 2.0) ** (difference / 2) * ((1.0 + mu) / 2.0) ** (total / 2)
    return sign * sqrt(comb(difference + total, total)) * shape


@lru_cache(maxsize=64)
def _recurrence(
    degree_max: int, order_max: int, second: int
) -> tuple[tuple[int, FloatArray, FloatArray, FloatArray], ...]:
    """For each degree l its factors in d^(l+1) = (rise mu - shift) d^l - fall d^(l-1), by first order, shape (M, 1)."""
    return tuple((degree, *_factors(degree, order_max, second)) for degree in range(abs(second), degree_max))


def _factors(degree: int, order_max: int, second: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Factors of one degree; at l = 0 there is no degree before, and its factor is 0."""
    orders = np.arange(min(order_max, degree) + 1)[:, np.newaxis]
    upper, divisor = degree + 1, max(degree, 1)
    scale = np.sqrt((upper**2 - orders**2) * (upper**2 - second**2))
    earlier = np.sqrt((degree**2 - orders**2) * (degree**2 - second**2)) * (upper / divisor)
    twice = 2 * degree + 1
    return twice * upper / scale, twice * (orders * second / divisor) / scale, earlier / scale


def matrix_functions(*, degree_max: int, mu: FloatArray) -> Iterator[FloatArray]:
    """Functions in which a scattering matrix is expanded, degree by degree from 0.

    Parameters
    ----------
    degree_max
        Largest degree, 0 or more.
    mu
        Cosine of the scattering angle, shape (N,), -1 to 1.

    Yields
    ------
    ndarray, shape (4, N)
        d^l_00, d^l_22, d^l_2-2 and d^l_02 of one degree; those but the first are 0 below degree 2.

    References
    ----------
    de Rooij & van der Stap, Astron. Astrophys. 131 (1984) 237; recurrence as in `wigner_d`.
    """
    functions = np.zeros((3, 4, mu.size))
    functions[0, 0], functions[1, 0], functions[2, 0] = 1.0, mu, 1.5 * mu**2 - 0.5
    for row, (order, second) in enumerate(((2, 2), (2, -2), (0, 2)), start=1):
        functions[2, row] = _lowest_degree(order, second, mu)
    yield from functions[: degree_max + 1]
    before, current = functions[1], functions[2]
    first, second_order = np.array([0, 2, 2, 0])[:, np.newaxis], np.array([0, 2, -2, 2])[:, np.newaxis]
    degree = np.arange(2.0, max(degree_max, 2))[:, np.newaxis, np.newaxis]
    scale = degree * np.sqrt(((degree + 1) ** 2 - first**2) * ((degree + 1) ** 2 - second_order**2))
    rise = (2 * degree + 1) * degree * (degree + 1) / scale
    shift = (2 * degree + 1) * first * second_order / scale
    fall = (degree + 1) * np.sqrt((degree**2 - first**2) * (degree**2 - second_order**2)) / scale
    for factor, constant, back in zip(rise, shift, fall, strict=True):
        before, current = current, (factor * mu - constant) * current - back * before
        yield current


def stokes_basis(*, degree_max: int, order_max: int, mu: FloatArray) -> FloatArray:
    """Basis matrices that carry the radiance (I, Q, U) of one azimuth mode to expansion space and back.

    Parameters
    ----------
    degree_max, order_max
        Largest degree and largest azimuth mode.
    mu
        Cosine of the direction of propagation from the upward vertical, shape (N,), -1 to 1.

    Returns
    -------
    ndarray, shape (order_max + 1, degree_max + 1, 3, N, 3)
        For mode m and degree l a symmetric 3 by 3 matrix at each direction (second and last axis).

    Notes
    -----
    With I, Q as cosine and U as sine series in the azimuth of propagation, mode m of the scattering matrix between
    two directions is the sum over l of basis(mu) @ B_l @ basis(mu'), B_l = [[a1, b1, 0], [b1, a2, 0], [0, 0, a3]]
    (the coefficients of `phase`), in the meridian frame with Q > 0 for E in the vertical plane.

    References
    ----------
    Siewert, Astron. Astrophys. 109 (1982) 195; de Rooij & van der Stap, Astron. Astrophys. 131 (1984) 237.
    """
    plain, even, odd = basis_functions(degree_max=degree_max, order_max=order_max, mu=mu)
    basis = np.zeros((order_max + 1, degree_max + 1, 3, mu.size, 3))
    basis[:, :, 0, :, 0] = plain
    basis[:, :, 1, :, 1] = basis[:, :, 2, :, 2] = even
    basis[:, :, 1, :, 2] = basis[:, :, 2, :, 1] = odd
    return basis


def basis_functions(*, degree_max: int, order_max: int, mu: FloatArray) -> FloatArray:
    """Entries of the matrices of `stokes_basis` that are not zero: I to I, Q to Q as U to U, Q to U as U to Q.

    Parameters
    ----------
    degree_max, order_max, mu
        As in `stokes_basis`.

    Returns
    -------
    ndarray, shape (3, order_max + 1, degree_max + 1, N)
        Not to be written to: the last few are kept, for all wavelengths of a band ask for the same.

    References
    ----------
    Siewert, Astron. Astrophys. 109 (1982) 195.
    """
    numbers = (degree_max + 1) * (order_max + 1) * mu.size
    kept = next((kept for most, kept in _KEPT_UP_TO if numbers <= most), _kept_functions_of_many)
    return kept(degree_max, order_max, np.ascontiguousarray(mu, dtype=np.float64).tobytes())


def _functions(degree_max: int, order_max: int, mu_bytes: bytes) -> FloatArray:
    mu = np.frombuffer(mu_bytes)
    plain, plus, minus = (wigner_d(degree_max=degree_max, order_max=order_max, second=n, mu=mu) for n in (0, 2, -2))
    functions = np.stack([plain, 0.5 * (plus + minus), 0.5 * (minus - plus)])
    functions.flags.writeable = False
    return functions


# Of many directions they take tens of megabytes; of the few of a quadrature little; of some lines of sight, to which a
# sweep comes back with every sun, next to nothing.
_kept_functions_of_many, _kept_functions_of_few, _kept_functions_of_some = (
    lru_cache(maxsize=size)(_functions) for size in (6, 48, 192)
)
_KEPT_UP_TO = ((10_000, _kept_functions_of_some), (40_000, _kept_functions_of_few))
