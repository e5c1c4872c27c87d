"""The bright ring around the sun, as a function of the angle from it."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from model.scene.sky import Sky

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

FloatArray = NDArray[np.float64]

# Asymmetries of the functions of the angle from the sun of which an aureole is put together.
_ASYMMETRIES = np.array([0.0, 0.3, 0.5, 0.6, 0.7, 0.8, 0.87, 0.92, 0.95, 0.97, 0.98, 0.99, 0.995, 0.998])
_AUREOLE_SAMPLES = 60
_AUREOLE_EDGE_RAD = float(np.radians(60.0))
# Nearer to the zenith the ring of the sun's own zenith angle is too small to show the aureole.
_HIGH_SUN_RAD = float(np.radians(15.0))
_FIT_STEPS = 2000


@dataclass(frozen=True, kw_only=True, eq=False)
class Aureole:
    """Radiance as a function of the angle from the sun alone: a sum of Henyey-Greenstein functions, and a correction.

    Attributes
    ----------
    sun_zenith_rad
        Where the sun is [rad].
    asymmetries, weights
        Of the functions, shape (K,), weights above 0.
    correction
        Logarithm of what the sum is to be multiplied by, over the square root of the angle from the sun in radians;
        None for none. The aureole of large particles has rings that the sum does not follow.
    """

    sun_zenith_rad: float
    asymmetries: FloatArray
    weights: FloatArray
    correction: "CubicSpline | None" = None

    def __call__(self, *, zenith_rad: FloatArray, phi_rad: FloatArray) -> FloatArray:
        """Return the radiance of the sum in directions [W m-2 sr-1]."""
        across = np.sin(zenith_rad) * np.sin(self.sun_zenith_rad) * (1.0 - np.cos(phi_rad))
        cosine = np.cos(zenith_rad - self.sun_zenith_rad) - across
        smooth = np.asarray(_henyey_greenstein(self.asymmetries, cosine) @ self.weights)
        if self.correction is None:
            return smooth
        root = np.sqrt(np.arccos(np.clip(cosine, -1.0, 1.0)))
        return np.asarray(smooth * np.exp(self.correction(np.minimum(root, self.correction.x[-1]))))


# Even in all directions.
NO_AUREOLE = Aureole(sun_zenith_rad=0.0, asymmetries=np.zeros(1), weights=np.ones(1))


def aureole_of(sky: Sky, sun_zenith_rad: float) -> Aureole:
    """Return the sum of functions that is closest to a sky around the sun, in relative terms; even where it is black.

    Parameters
    ----------
    sun_zenith_rad
        Where the sun is [rad].

    References
    ----------
    Definition: least squares with weights of 0 or more.
    """
    share = (np.arange(_AUREOLE_SAMPLES) / (_AUREOLE_SAMPLES - 1)) ** 2
    if sun_zenith_rad > _HIGH_SUN_RAD:
        from_sun = min(2.0 * sun_zenith_rad, _AUREOLE_EDGE_RAD) * share
        # Two directions of one zenith angle: sin(from_sun / 2) = sin(zenith) sin(phi / 2).
        phi = 2.0 * np.arcsin(np.minimum(np.sin(0.5 * from_sun) / np.sin(sun_zenith_rad), 1.0))
        radiance = sky(zenith_rad=sun_zenith_rad, phi_rad=phi)[:, 0]
    else:
        from_sun = 0.5 * _AUREOLE_EDGE_RAD * share
        zenith = sun_zenith_rad - from_sun
        radiance = sky(zenith_rad=np.abs(zenith), phi_rad=np.where(zenith < 0.0, np.pi, 0.0))[:, 0]
    if not np.all(radiance > 0.0):
        return NO_AUREOLE
    from scipy.interpolate import CubicSpline  # a quarter of a second, wanted for a sky only
    from scipy.optimize import nnls

    columns = _henyey_greenstein(_ASYMMETRIES, np.cos(from_sun)) / radiance[:, np.newaxis]
    scale = np.max(columns, axis=0)
    weights = nnls(columns / scale, np.ones(_AUREOLE_SAMPLES), maxiter=_FIT_STEPS)[0] / scale
    used = weights > 0.0
    left = np.log(radiance / (_henyey_greenstein(_ASYMMETRIES[used], np.cos(from_sun)) @ weights[used]))
    return Aureole(
        sun_zenith_rad=sun_zenith_rad,
        asymmetries=_ASYMMETRIES[used],
        weights=weights[used],
        correction=CubicSpline(np.sqrt(from_sun), left * _faded(from_sun / from_sun[-1]), bc_type="clamped"),
    )


def _faded(share: FloatArray) -> FloatArray:
    """Weight that falls smoothly from 1 at the middle of the aureole to 0 at its edge."""
    step = np.clip(2.0 * share - 1.0, 0.0, 1.0)
    return np.asarray(1.0 - step**2 * (3.0 - 2.0 * step))


def _henyey_greenstein(asymmetries: FloatArray, cosine: FloatArray) -> FloatArray:
    """Henyey-Greenstein functions of mean 1, shape (..., K)."""
    squares = asymmetries**2
    return np.asarray((1.0 - squares) / (1.0 + squares - 2.0 * asymmetries * cosine[..., np.newaxis]) ** 1.5)
