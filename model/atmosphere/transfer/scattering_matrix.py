"""Scattering matrix of an aerosol at one wavelength, as the solver takes it."""

from dataclasses import dataclass, field
from math import pi

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.transfer.spherical_functions import matrix_functions

_SAMPLES_PER_DEGREE = 4
_STENCIL = np.arange(-2, 4)  # sixth-order interpolation between samples
_FEWEST_DEGREES = 24


@dataclass(frozen=True, kw_only=True, eq=False)
class ScatteringMatrix:
    """Scattering matrix of spheres by its expansion; two are the same only if they are one object.

    Attributes
    ----------
    coefficients
        a1, a2, a3, b1 of degree 0, 1, ... as in `phase.expansion_coefficients`, shape (L, 4); the first is 1.
    error_estimate
        Estimated error of F11, both in the mean over the sphere. Within a degree or two of forward it is larger: there
        lies the diffraction of the few largest spheres.
    """

    coefficients: NDArray[np.float64]
    error_estimate: float
    _samples: NDArray[np.float64] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        shape = self.coefficients.shape
        if len(shape) != 2 or shape[1] != 4 or shape[0] < 1 or abs(self.coefficients[0, 0] - 1.0) > 1e-9:
            raise ValueError("ScatteringMatrix: coefficients must be of shape (L, 4) and begin with 1")
        object.__setattr__(self, "_samples", _sampled_column(self.coefficients))

    @property
    def g(self) -> float:
        """Asymmetry, the mean cosine of the scattering angle."""
        return float(self.coefficients[1, 0]) / 3.0 if self.coefficients.shape[0] > 1 else 0.0

    def first_column(self, angle_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """F11 and F12 at scattering angles, shape (2, ...), F11 of mean 1 over the sphere.

        Parameters
        ----------
        angle_rad
            0 to pi [rad].

        Notes
        -----
        Interpolated between samples four times as dense as the expansion asks for: error below 1e-6 of the largest
        value beside.
        """
        last = self._samples.shape[1] - 1 - 2 * _STENCIL[-1]
        place = angle_rad / pi * last
        lower = np.clip(np.floor(place).astype(int), 0, last - 1)
        total = np.zeros((2, *angle_rad.shape))
        for offset in _STENCIL:
            others = _STENCIL[offset != _STENCIL]
            shares = [(place - lower - other) / (offset - other) for other in others]
            total += np.prod(shares, axis=0) * self._samples[:, lower + offset + _STENCIL[-1]]
        return total

    def matrix(self, angle_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """F11, F22, F33 and F12 at scattering angles by the sum of the expansion, shape (4, N)."""
        a1, a2, a3, b1 = self.coefficients.T
        weights = np.stack([a1, a2 + a3, a2 - a3, b1], axis=-1)
        total = np.zeros((4, angle_rad.size))
        functions = matrix_functions(degree_max=a1.size - 1, mu=np.cos(angle_rad))
        for weight, row in zip(weights, functions, strict=True):
            total += weight[:, np.newaxis] * row
        plain, plus, minus, mixed = total
        return np.stack([plain, (plus + minus) / 2.0, (plus - minus) / 2.0, mixed])


def _sampled_column(coefficients: NDArray[np.float64]) -> NDArray[np.float64]:
    """F11 and F12 at equally spaced angles from 0 to pi and, mirrored (both are even), some beyond each end."""
    degrees = max(coefficients.shape[0], _FEWEST_DEGREES)
    mu = np.cos(pi * np.arange(degrees + 1) / degrees)
    total = np.zeros((2, mu.size))
    for weight, row in zip(coefficients, matrix_functions(degree_max=len(coefficients) - 1, mu=mu), strict=True):
        total[0] += weight[0] * row[0]
        total[1] += weight[3] * row[3]
    # As sums of cosines of multiples of the angle they are read between these angles exactly.
    around = np.concatenate([total, total[:, -2:0:-1]], axis=1)
    count = _SAMPLES_PER_DEGREE * degrees
    dense = _SAMPLES_PER_DEGREE * np.fft.irfft(np.fft.rfft(around, axis=1), 2 * count, axis=1)[:, : count + 1]
    return np.pad(dense, ((0, 0), (_STENCIL[-1], _STENCIL[-1])), mode="reflect")
