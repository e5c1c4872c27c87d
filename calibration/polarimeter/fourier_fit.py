"""Malus' law in closed form: intensity against the angle of a polarizer, by linear least squares."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError

FloatArray = NDArray[np.float64]

_TERMS = 3
# Beyond this the angles hardly tell the terms apart: equal modulo 180 deg, or all close together.
_WORST_CONDITION = 1e3
# Whole turns in equal steps have sqrt 2; half a turn has hundreds.
_APART_CONDITION = 3.0
# What the residual of Malus' law shows, by cycles a turn.
HARMONIC_ORDERS = (1, 3, 4)
# An amplitude of noise alone is larger than this many standard errors of its parts in 1 of 1000 cases.
SEEN_SIGMAS = 3.717


@dataclass(frozen=True, kw_only=True, eq=False)
class FourierFit:
    """Intensity = mean + cosine cos 2 angle + sine sin 2 angle, for one or many pixels.

    Attributes
    ----------
    terms : (3, ...) array
        Mean, cosine, sine; the other axes are those of the values.
    unit_covariance : (3, 3) array
        Covariance of the errors of the terms for values of variance 1.
    variance : (...) array
        Variance of a value, from the residuals.
    dof : int
        Values less terms, at least 1.
    """

    terms: FloatArray
    unit_covariance: FloatArray
    variance: FloatArray
    dof: int

    @property
    def phase_rad(self) -> FloatArray:
        """Angle of largest intensity, -pi/2 to pi/2 [rad]."""
        phase: FloatArray = 0.5 * np.arctan2(self.terms[2], self.terms[1])
        return phase

    def at(self, angles_rad: FloatArray) -> FloatArray:
        """Return what the law says of one pixel at other angles."""
        law: FloatArray = _design(angles_rad, (2,)) @ self.terms
        return law

    @property
    def modulation(self) -> FloatArray:
        """Amplitude over mean."""
        ratio: FloatArray = np.hypot(self.terms[1], self.terms[2]) / self.terms[0]
        return ratio

    def phase_error_rad(self) -> FloatArray:
        """Return the standard error of `phase_rad` [rad]."""
        _, cosine, sine = self.terms
        square = cosine**2 + sine**2
        return self._error(np.array([np.zeros_like(cosine), -0.5 * sine / square, 0.5 * cosine / square]))

    def modulation_error(self) -> FloatArray:
        """Return the standard error of `modulation`."""
        mean, cosine, sine = self.terms
        amplitude = np.hypot(cosine, sine)
        return self._error(np.array([-amplitude / mean**2, cosine / amplitude / mean, sine / amplitude / mean]))

    def mean_error(self) -> FloatArray:
        """Return the standard error of the mean term."""
        error: FloatArray = np.sqrt(self.unit_covariance[0, 0] * self.variance)
        return error

    def _error(self, gradient: FloatArray) -> FloatArray:
        square = np.einsum("i...,ij,j...->...", gradient, self.unit_covariance, gradient)
        error: FloatArray = np.sqrt(square * self.variance)
        return error


@dataclass(frozen=True, kw_only=True)
class Harmonic:
    """Residual of a scan at one frequency.

    Attributes
    ----------
    order : int
        Cycles a turn: 1 and 3 are a wedge or a tilted element, 4 a detector that is not linear.
    amplitude, std_error : float
        Relative to the mean; the error is that of cosine and sine part each.
    """

    order: int
    amplitude: float
    std_error: float

    @property
    def is_seen(self) -> bool:
        """True where noise alone would hardly make it (1 of 1000)."""
        return self.amplitude > SEEN_SIGMAS * self.std_error


def fit_fourier(angles_rad: FloatArray, values: FloatArray) -> FourierFit:
    """Return the fit of Malus' law.

    Parameters
    ----------
    angles_rad : (K,) array
        Angles of the element that turns [rad]; four or more, three of them different modulo pi.
    values : (K, ...) array
        Intensities, dark taken off.

    Raises
    ------
    CalibrationError
        Angles do not determine the law, or there is no light.

    Notes
    -----
    Unweighted; all values of a pixel are taken to have one variance, which the residuals give.
    """
    if len(angles_rad) <= _TERMS:
        raise CalibrationError(f"a scan needs 4 angles or more, to see its own errors; there are {len(angles_rad)}")
    design = _design(angles_rad, (2,))
    condition = float(np.linalg.cond(design))
    if condition > _WORST_CONDITION:
        raise CalibrationError(
            f"the angles of the scan do not tell mean, cosine and sine apart (condition {condition:.3g}, allowed "
            f"{_WORST_CONDITION:.0g}): angles that differ by 180 deg are repeats; spread them over half a turn"
        )
    inverse = np.linalg.pinv(design)
    terms = np.tensordot(inverse, values, axes=1)
    if np.min(terms[0]) <= 0.0:
        raise CalibrationError("a scan has no light above its dark level: check dark frames and region")
    dof = len(angles_rad) - _TERMS
    residual = values - np.tensordot(design, terms, axes=1)
    return FourierFit(
        terms=terms,
        unit_covariance=inverse @ inverse.T,
        variance=np.sum(np.square(residual), axis=0) / dof,
        dof=dof,
    )


def residual_harmonics(angles_rad: FloatArray, values: FloatArray) -> tuple[Harmonic, ...]:
    """Return the harmonics beside Malus' law that a scan can tell, each fitted alone beside the law.

    Parameters
    ----------
    angles_rad : (K,) array
        Angles of the element that turns [rad].
    values : (K,) array
        Intensities of one region, dark taken off.
    """
    found = []
    for order in HARMONIC_ORDERS:
        design = _design(angles_rad, (2, order))
        if len(angles_rad) <= design.shape[1] or np.linalg.cond(design) > _WORST_CONDITION:
            continue
        terms = np.linalg.pinv(design) @ values
        residual = values - design @ terms
        variance = float(residual @ residual) / (len(angles_rad) - design.shape[1])
        covariance = np.linalg.inv(design.T @ design)[-2:, -2:] * variance
        found.append(
            Harmonic(
                order=order,
                amplitude=float(np.hypot(terms[-2], terms[-1]) / terms[0]),
                std_error=float(np.sqrt(0.5 * np.trace(covariance)) / terms[0]),
            )
        )
    return tuple(found)


def harmonics_are_told_apart(angles_rad: FloatArray) -> bool:
    """Return whether a scan's angles tell the harmonics from one another: over a whole turn, not over half of one."""
    design = _design(angles_rad, (2, *HARMONIC_ORDERS))
    return len(angles_rad) > design.shape[1] and bool(np.linalg.cond(design) < _APART_CONDITION)


def _design(angles_rad: FloatArray, orders: tuple[int, ...]) -> FloatArray:
    columns = [np.ones_like(angles_rad)]
    for order in orders:
        columns += [np.cos(order * angles_rad), np.sin(order * angles_rad)]
    return np.column_stack(columns)
