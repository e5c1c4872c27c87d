"""Profile of the aerosol over height: extinction at 550 nm for a visibility or an optical depth."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

BOUNDARY_LAYER_TOP_M = 2000.0
# fmt: off
_HEIGHT_M = 1e3 * np.array([
    0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23, 24, 25, 30, 35, 40,
])
# From 5 km up: spring and summer below 10 km, background stratosphere above [km-1].
_UPPER_PER_KM = np.array([
    9.31e-3, 7.71e-3, 6.23e-3, 3.37e-3, 1.82e-3, 1.14e-3, 7.99e-4, 6.41e-4, 5.17e-4, 4.42e-4, 3.95e-4, 3.82e-4,
    4.25e-4, 5.2e-4, 5.81e-4, 5.89e-4, 5.02e-4, 4.2e-4, 3e-4, 1.98e-4, 1.31e-4, 3.32e-5, 1.64e-5, 7.99e-6,
])
_VISIBILITY_KM = np.array([50.0, 23.0, 10.0, 5.0, 2.0])
# At 0, 1, 2, 3 and 4 km for each visibility [km-1].
_LOWER_PER_KM = np.array([
    [0.0662, 0.0415, 0.0260, 0.0146, 0.0102],
    [0.158, 0.0991, 0.0621, 0.0346, 0.0185],
    [0.379, 0.379, 0.0621, 0.0346, 0.0185],
    [0.770, 0.770, 0.0621, 0.0346, 0.0185],
    [1.94, 1.94, 0.0621, 0.0346, 0.0185],
])
# fmt: on
_REFERENCE_VISIBILITY_M = 23e3


@dataclass(frozen=True, kw_only=True)
class AerosolColumn:
    """Extinction of the aerosol at 550 nm, exponential between the heights of a table.

    Attributes
    ----------
    height_m
        Heights above the ground, increasing from 0 [m].
    extinction_per_m
        At these heights, before scaling [m-1], above 0; there is no aerosol above the last.
    scale
        Factor on the extinction, 0 or more.
    """

    height_m: NDArray[np.float64]
    extinction_per_m: NDArray[np.float64]
    scale: float

    def optical_depth_between(self, lower_m: ArrayLike, upper_m: ArrayLike) -> NDArray[np.float64]:
        """Optical depth at 550 nm between two heights, lower_m <= upper_m [m]."""
        return self._below(np.asarray(upper_m, dtype=float)) - self._below(np.asarray(lower_m, dtype=float))

    def _below(self, height_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Optical depth between the ground and a height."""
        part = np.clip(height_m[..., np.newaxis] - self.height_m[:-1], 0.0, np.diff(self.height_m))
        rate = np.diff(np.log(self.extinction_per_m)) / np.diff(self.height_m)
        # The mean of an exponential over the part crossed; rate may be 0 where extinction does not change.
        growth = rate * part
        safe = np.where(growth == 0.0, 1.0, growth)
        mean = np.where(growth == 0.0, 1.0, np.expm1(growth) / safe)
        return np.asarray(self.scale * np.sum(self.extinction_per_m[:-1] * part * mean, axis=-1))


def aerosol_column(*, visibility_m: float | None = None, optical_depth: float | None = None) -> AerosolColumn:
    """Aerosol over height for a visibility at the ground, or for an optical depth at 550 nm.

    Parameters
    ----------
    visibility_m
        Meteorological range [m], 2e3 to 50e3; or None.
    optical_depth
        Vertical optical depth at 550 nm, 0 or more; or None. Scales the column of 23 km at all heights.

    Raises
    ------
    ValueError
        Not exactly one is given, or it is outside its range.

    Notes
    -----
    Up to 4 km extinction is linear in 1/visibility between the tabulated 2, 5, 10, 23 and 50 km. The optical depth
    that a "visibility" stands for differs by 30 % between codes: 0.324 here for 23 km, 0.226 by the rule of 6S.

    References
    ----------
    Shettle & Fenn, AFGL-TR-79-0214 (1979), as tabulated in LOWTRAN 7 (Kneizys et al., AFGL-TR-88-0177).
    """
    if (visibility_m is None) == (optical_depth is None):
        raise ValueError("aerosol_column: give either visibility_m or optical_depth")
    if visibility_m is not None:
        return _column_of_visibility(visibility_m)
    if optical_depth is None or not 0.0 <= optical_depth < np.inf:
        raise ValueError(f"aerosol_column: optical_depth = {optical_depth!r}, but it must be finite and 0 or more")
    reference = _column_of_visibility(_REFERENCE_VISIBILITY_M)
    return replace(reference, scale=optical_depth / float(reference.optical_depth_between(0.0, _HEIGHT_M[-1])))


def _column_of_visibility(visibility_m: float) -> AerosolColumn:
    """Column of a meteorological range."""
    visibility_km = visibility_m / 1e3
    if not _VISIBILITY_KM[-1] <= visibility_km <= _VISIBILITY_KM[0]:
        raise ValueError(f"aerosol_column: visibility_m = {visibility_m!r} m, allowed is 2e3 to 50e3 m")
    lower = [np.interp(1.0 / visibility_km, 1.0 / _VISIBILITY_KM, column) for column in _LOWER_PER_KM.T]
    per_km = np.concatenate([lower, _UPPER_PER_KM])
    return AerosolColumn(height_m=_HEIGHT_M, extinction_per_m=per_km / 1e3, scale=1.0)
