"""The affine map between two pictures of the same points, with its error."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError

FloatArray = NDArray[np.float64]

_LEAST_POINTS = 4
_COEFFICIENTS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class AffineMap:
    """Where points of one picture lie in another.

    Attributes
    ----------
    matrix
        Shape (2, 3): (x', y') = matrix @ (x, y, 1) [pixel].
    residual_rms_px
        Of the points about the map, per coordinate, corrected for the fitted coefficients [pixel].
    unit_cov
        Covariance of each row of the matrix over the square of that rms, shape (3, 3).
    """

    matrix: FloatArray
    residual_rms_px: float
    unit_cov: FloatArray

    def apply(self, points: FloatArray) -> FloatArray:
        """Return where points (n, 2) [pixel] lie in the other picture."""
        return np.asarray(_with_ones(points) @ self.matrix.T)

    def std_error_px(self, points: FloatArray) -> FloatArray:
        """Return the standard error of each mapped coordinate of points (n, 2), shape (n,) [pixel].

        Far from the points of the fit it grows in proportion to the distance.
        """
        extended = _with_ones(points)
        return np.asarray(self.residual_rms_px * np.sqrt(np.einsum("ni,ij,nj->n", extended, self.unit_cov, extended)))


def fit_affine(before: FloatArray, after: FloatArray) -> AffineMap:
    """Return the least-squares affine map from points to points.

    Parameters
    ----------
    before, after
        The same points in two pictures, shape (n, 2), n >= 4, not all on a line [pixel].

    Raises
    ------
    CalibrationError
        Fewer than four points, or all on a line.

    References
    ----------
    Definition: ordinary least squares, one row of the map a coordinate.
    """
    if len(before) < _LEAST_POINTS:
        raise CalibrationError(f"an affine map needs {_LEAST_POINTS} points, {len(before)} were given")
    extended = _with_ones(before)
    if np.linalg.matrix_rank(extended - extended.mean(axis=0)) < _COEFFICIENTS - 1:
        raise CalibrationError("an affine map needs points that are not all on a line")
    solution, *_ = np.linalg.lstsq(extended, after, rcond=None)
    freedom = 2 * (len(before) - _COEFFICIENTS)
    rms = float(np.sqrt(np.sum((after - extended @ solution) ** 2) / freedom))
    return AffineMap(
        matrix=np.asarray(solution.T),
        residual_rms_px=rms,
        unit_cov=np.asarray(np.linalg.inv(extended.T @ extended), dtype=np.float64),
    )


def _with_ones(points: FloatArray) -> FloatArray:
    return np.column_stack([np.asarray(points, dtype=np.float64), np.ones(len(points))])
