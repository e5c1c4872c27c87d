"""The matrix that makes Stokes parameters of intensities, measured with known states of polarization."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError

FloatArray = NDArray[np.float64]

_LINEAR = 3
_WORST_CONDITION = 1e6


@dataclass(frozen=True, kw_only=True, eq=False)
class DataReduction:
    """A measured data reduction matrix W: Stokes parameters = W @ intensities.

    Attributes
    ----------
    matrix, std_error : (3, N) arrays
        W, and the standard error of each of its elements; in the units of states over intensities.
    singular_values : (M,) array
        Of the intensities; those after the third are noise, or something that is not linear.
    condition : float
        First over third.
    """

    matrix: FloatArray
    std_error: FloatArray
    singular_values: FloatArray
    condition: float


def linear_states(axis_rad: FloatArray, *, dolp: float) -> FloatArray:
    """Return the Stokes parameters (3, K) of linear polarizers in unpolarized light of S0 = 1 behind them.

    Parameters
    ----------
    axis_rad
        Axes of the polarizers, shape (K,) [rad].
    dolp
        Of the light behind them, 0 to 1.
    """
    return np.array([np.ones_like(axis_rad), dolp * np.cos(2.0 * axis_rad), dolp * np.sin(2.0 * axis_rad)])


def measured_data_reduction(states: FloatArray, intensities: FloatArray) -> DataReduction:
    """Return W from the intensities of known states.

    Parameters
    ----------
    states : (3, K) array
        S0, S1, S2 of each state; four or more states.
    intensities : (N, K) array
        Intensity in each of N >= 3 analyzer channels, dark taken off.

    Raises
    ------
    CalibrationError
        Too few states or channels, or they do not span the linear Stokes parameters.

    Notes
    -----
    W = states @ pseudo-inverse of the intensities, of which the first three singular values are kept: linear light has
    three parameters, and the others would carry noise into W. Standard errors to first order from the residuals
    of each channel.

    References
    ----------
    Boulbry, Ramella-Roman and Germer, Appl. Opt. 46, 8533 (2007), doi:10.1364/AO.46.008533.
    """
    n_channels, n_states = intensities.shape
    if n_channels < _LINEAR or n_states <= _LINEAR:
        raise CalibrationError(
            f"{n_channels} analyzer angles and {n_states} states are given; W needs 3 angles and 4 states or more"
        )
    left, singular, right = np.linalg.svd(intensities, full_matrices=False)
    if singular[_LINEAR - 1] * _WORST_CONDITION <= singular[0] or np.linalg.matrix_rank(states) < _LINEAR:
        raise CalibrationError(
            f"the states or the analyzer angles do not span linear polarization (singular values "
            f"{singular[:_LINEAR]}): angles that differ by 180 deg are repeats; "
            f"take three different ones or more of each"
        )
    inverse = (right[:_LINEAR].T / singular[:_LINEAR]) @ left[:, :_LINEAR].T
    matrix = states @ inverse
    return DataReduction(
        matrix=matrix,
        std_error=_errors(matrix, states, intensities),
        singular_values=singular,
        condition=float(singular[0] / singular[_LINEAR - 1]),
    )


def _errors(matrix: FloatArray, states: FloatArray, intensities: FloatArray) -> FloatArray:
    """Return the first-order errors of a pseudo-inverse, from those of the matrix that it inverts."""
    analyzer = intensities @ np.linalg.pinv(states)
    residual = intensities - analyzer @ states
    variance = np.square(residual).sum(axis=1) / (states.shape[1] - _LINEAR)
    covariance = np.linalg.inv(states @ states.T)
    gram = np.linalg.inv(analyzer.T @ analyzer)
    beyond = np.eye(len(analyzer)) - analyzer @ matrix
    # dW / dA[j, m], as [row of W, column of W, j, m]
    slope = -np.einsum("aj,mb->abjm", matrix, matrix) + np.einsum("am,jb->abjm", gram, beyond)
    errors: FloatArray = np.sqrt(np.einsum("abjm,mn,abjn,j->ab", slope, covariance, slope, variance))
    return errors


def block_means(picture: NDArray[np.float64] | NDArray[np.uint16] | NDArray[np.bool_], side: int) -> FloatArray:
    """Return the means over square blocks of a picture.

    Parameters
    ----------
    picture : (H, W) array
        Counts, or true and false: then the share of true.
    side : int
        Pixels along a side of a block; 1 gives the picture itself. Rows and columns at the lower and right border that
        do not make a whole block are left out.

    Raises
    ------
    CalibrationError
        The picture is smaller than a block.
    """
    rows, columns = (length // side for length in picture.shape)
    if side < 1 or rows == 0 or columns == 0:
        raise CalibrationError(
            f"blocks of {side} x {side} pixels do not fit into a picture of {picture.shape[1]} x {picture.shape[0]}"
        )
    whole = picture[: rows * side, : columns * side].astype(np.float64)
    means: FloatArray = whole.reshape(rows, side, columns, side).mean(axis=(1, 3))
    return means
