"""Scattering of a plane wave by homogeneous spheres: expansion coefficients, efficiencies and amplitudes."""

from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import NDArray

_LARGEST_SIZE, _SMALLEST_SIZE = 2e4, 1e-8


@dataclass(frozen=True, kw_only=True)
class SphereEfficiencies:
    """Cross-sections of spheres over their geometrical ones, and the asymmetry; each of shape (N,).

    Attributes
    ----------
    extinction, scattering
        Efficiencies.
    asymmetry
        Mean cosine of the scattering angle.
    """

    extinction: NDArray[np.float64]
    scattering: NDArray[np.float64]
    asymmetry: NDArray[np.float64]


def sphere_terms(size_parameter: NDArray[np.float64]) -> NDArray[np.int_]:
    """Terms that the series needs, for each size parameter.

    Parameters
    ----------
    size_parameter
        Circumference over wavelength, shape (K,), above 0.

    Notes
    -----
    A term falls like exp(-(4/3) (1.26 c)^1.5) at x + c x^(1/3): for c = 6 what is left out is below 1e-11 of the sum.

    References
    ----------
    Wiscombe, Appl. Opt. 19 (1980) 1505, doi:10.1364/AO.19.001505, who takes c = 4.05 for half as many digits.
    """
    return np.asarray(np.ceil(size_parameter + 6.0 * np.cbrt(size_parameter) + 4.0), dtype=np.int_)


def sphere_coefficients(
    *, size_parameter: NDArray[np.float64], n: float, k: float
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Coefficients a_n and b_n of the scattered wave, column n - 1 for order n.

    Parameters
    ----------
    size_parameter
        Circumference over wavelength in the medium, shape (N,), increasing, 1e-8 to 2e4.
    n, k
        Real and (absorbing, 0 or more) imaginary part of the index relative to the medium, n above 0.

    Returns
    -------
    a, b : ndarray, shape (N, terms)
        Zero beyond the terms of each size.

    Raises
    ------
    ValueError
        An argument outside its range.

    Notes
    -----
    Logarithmic derivative downward from far above its turning point; Riccati-Bessel functions of the first kind upward
    to their turning point and by downward ratios beyond, of the second kind upward. Real parts are formed without
    the difference of large terms, so that a small sphere without absorption has as much extinction as scattering.

    References
    ----------
    Bohren & Huffman, Absorption and Scattering of Light by Small Particles (1983), eqs. (4.56), (4.57), (4.88);
    time factor exp(-i omega t), index n + ik.
    """
    _check(size_parameter, n, k)
    terms = sphere_terms(size_parameter)
    count = int(terms[-1])
    index = complex(n, k)
    derivative = _logarithmic_derivative(index * size_parameter, count)
    ratio = _first_kind_ratios(size_parameter, count)
    a, b = (np.zeros((size_parameter.size, count), dtype=complex) for _ in range(2))
    first, second = np.sin(size_parameter), np.cos(size_parameter)
    first_before, second_before = second, -first  # orders 0 and -1
    for order in range(1, count + 1):
        # Sizes increase, so those whose series has ended are the first ones: only the others go on.
        start = int(np.searchsorted(terms, order))
        x = size_parameter[start:]
        held = slice(start - size_parameter.size, None)
        upward = (2 * order - 1) / x * first[held] - first_before[held]
        first, first_before = np.where(order > x, first[held] * ratio[order, start:], upward), first[held]
        second, second_before = (2 * order - 1) / x * second[held] - second_before[held], second[held]
        for target, factor in ((a, 1.0 / index), (b, index)):
            slope = derivative[order, start:] * factor + order / x
            target[start:, order - 1] = _coefficient(slope * first - first_before, slope * second - second_before)
    return a, b


def efficiencies(
    *, size_parameter: NDArray[np.float64], a: NDArray[np.complex128], b: NDArray[np.complex128]
) -> SphereEfficiencies:
    """Efficiencies and asymmetry from the coefficients of `sphere_coefficients`.

    Parameters
    ----------
    size_parameter
        Circumference over wavelength, shape (K,), above 0.
    a, b
        Coefficients of each sphere, shape (K, T).

    References
    ----------
    Bohren & Huffman (1983), eqs. (4.61), (4.62) and section 4.5.
    """
    order = np.arange(1, a.shape[1] + 1)
    scale = 2.0 / size_parameter**2
    degenerate = 2 * order + 1
    power = np.abs(a) ** 2 + np.abs(b) ** 2
    scattering = scale * (power @ degenerate)
    lower, upper = slice(None, -1), slice(1, None)
    neighbours = (a[:, lower] * a[:, upper].conj() + b[:, lower] * b[:, upper].conj()).real
    crossed = (a * b.conj()).real
    cosines = neighbours @ (order * (order + 2) / (order + 1))[lower] + crossed @ (degenerate / (order * (order + 1)))
    return SphereEfficiencies(
        extinction=scale * ((a + b).real @ degenerate),
        scattering=scattering,
        asymmetry=2.0 * scale * cosines / scattering,
    )


def amplitude_sums(
    a: NDArray[np.complex128], b: NDArray[np.complex128], mu: NDArray[np.float64]
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Sum and difference of the amplitudes, S1 + S2 and S1 - S2, each of shape (N, A).

    Parameters
    ----------
    a, b
        Coefficients, shape (N, terms).
    mu
        Cosine of the scattering angle, shape (A,).

    Notes
    -----
    S1 is that of the field across the scattering plane, S2 of the field in it.

    References
    ----------
    Bohren & Huffman (1983), eqs. (4.47), (4.74).
    """
    order = np.arange(1, a.shape[1] + 1)
    weight = (2 * order + 1) / (order * (order + 1))
    pi, tau = _angular_functions(mu, a.shape[1])
    return _product((a + b) * weight, pi + tau), _product((a - b) * weight, pi - tau)


def _check(size_parameter: NDArray[np.float64], n: float, k: float) -> None:
    """Refuse what the series does not cover."""
    allowed = (size_parameter >= _SMALLEST_SIZE) & (size_parameter <= _LARGEST_SIZE)
    if size_parameter.ndim != 1 or size_parameter.size == 0 or not np.all(allowed):
        raise ValueError(
            f"size_parameter: 1 or more values of {_SMALLEST_SIZE:g} to {_LARGEST_SIZE:g} in one dimension are allowed"
        )
    if np.any(np.diff(size_parameter) < 0.0):
        raise ValueError("size_parameter must increase")
    if not (0.0 < n < np.inf and 0.0 <= k < np.inf):
        raise ValueError(f"index n = {n!r}, k = {k!r}: n must be above 0 and k 0 or more, both finite")


def _logarithmic_derivative(argument: NDArray[np.complexfloating], count: int) -> NDArray[np.complex128]:
    """D_n of the first kind at complex arguments, shape (count + 1, N)."""
    largest = float(np.max(np.abs(argument)))
    # Beyond the turning point an error of the start decays like exp(-(4/3) (1.26 * 8)^1.5), below 1e-18.
    start = max(count, ceil(largest)) + ceil(8.0 * largest ** (1.0 / 3.0)) + 16
    values = np.zeros((count + 1, argument.size), dtype=complex)
    inverse = 1.0 / argument
    current = np.zeros_like(argument)
    for order in range(start, 0, -1):
        step = order * inverse
        current = step - 1.0 / (current + step)
        if order <= count + 1:
            values[order - 1] = current
    return values


def _first_kind_ratios(size_parameter: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Riccati-Bessel psi_n over psi_(n-1), shape (count + 1, N), meant for n above the size parameter."""
    ratios = np.zeros((count + 2, size_parameter.size))
    inverse = 1.0 / size_parameter
    # At the start, n^2 / x^2 - 1 of the turning point's width lies behind for all: terms + 20 orders.
    current = np.zeros_like(size_parameter)
    for order in range(count + 20 + ceil(2.0 * float(size_parameter[-1]) ** (1.0 / 3.0)), 0, -1):
        current = 1.0 / ((2 * order + 1) * inverse - current)
        if order <= count + 1:
            ratios[order] = current
    return ratios


def _coefficient(p: NDArray[np.complex128], q: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Quotient p / (p - iq), with a real part that keeps its digits where q is far larger than p."""
    denominator = np.abs(p - 1j * q) ** 2
    mixed = p * q.conj()
    result: NDArray[np.complex128] = ((np.abs(p) ** 2 - mixed.imag) + 1j * mixed.real) / denominator
    return result


def _angular_functions(mu: NDArray[np.float64], count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Angular functions pi_n and tau_n for n = 1 to count, each of shape (count, A)."""
    pi = np.zeros((count + 1, mu.size))
    pi[1] = 1.0
    for order in range(2, count + 1):
        pi[order] = ((2 * order - 1) * mu * pi[order - 1] - order * pi[order - 2]) / (order - 1)
    orders = np.arange(1, count + 1)[:, np.newaxis]
    return pi[1:], orders * mu * pi[1:] - (orders + 1) * pi[:-1]


def _product(coefficients: NDArray[np.complex128], functions: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Complex by real matrix product, as two real ones."""
    return np.asarray(coefficients.real @ functions + 1j * (coefficients.imag @ functions))
