"""Shadowing and masking of facets by their neighbours."""

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from model.special_functions import erfc

FloatArray = NDArray[np.float64]
Shadowing = Literal["none", "v-cavity", "smith", "smith-correlated"]
SHADOWING: tuple[Shadowing, ...] = get_args(Shadowing)


def shadowed_prefactor(
    *,
    cos_i: FloatArray,
    sin_i: FloatArray,
    cos_r: FloatArray,
    sin_r: FloatArray,
    mean_cosine: FloatArray,
    cos2_psi: FloatArray,
    slope_rms: float,
    shadowing: Shadowing,
) -> FloatArray:
    """Return G / (4 cos theta_i cos theta_r), the visible share of facets over the projections.

    Parameters
    ----------
    cos_i, sin_i, cos_r, sin_r
        Of the zenith angles of sun and sensor; cosines above 0.
    mean_cosine
        (cos_i + cos_r) / 2 = cos beta cos psi.
    cos2_psi
        Squared cosine of the angle of incidence on the facet, above 0.
    slope_rms
        Standard deviation of the slope along one axis; used by the Smith forms.
    shadowing
        "none" (G = 1), "v-cavity", "smith" (product of the two ways) or "smith-correlated" (the heights of the
        point as seen by sun and sensor are the same height).

    Returns
    -------
    ndarray
        G and the quotient taken together, so that grazing directions do not overflow.

    Notes
    -----
    With G = 1 the surface reflects more than it receives near grazing. The other three conserve energy.

    References
    ----------
    "v-cavity": Torrance and Sparrow (1967), doi:10.1364/JOSA.57.001105. Smith: Smith (1967),
    doi:10.1109/TAP.1967.1138991, for Gaussian slopes; the correlated form: Heitz (2014), J. Computer Graphics
    Techniques 3(2).
    """
    if shadowing == "none":
        return 0.25 / (cos_i * cos_r)
    if shadowing == "v-cavity":
        cavity = 0.5 * mean_cosine / (cos2_psi * np.maximum(cos_i, cos_r))
        return np.minimum(0.25 / (cos_i * cos_r), cavity)
    masked_i = _masked_cosine(cos_i, sin_i, slope_rms)
    masked_r = _masked_cosine(cos_r, sin_r, slope_rms)
    if shadowing == "smith":
        return 0.25 / ((cos_i + masked_i) * (cos_r + masked_r))
    return 0.25 / (cos_i * cos_r + cos_r * masked_i + cos_i * masked_r)


def _masked_cosine(cos: FloatArray, sin: FloatArray, slope_rms: float) -> FloatArray:
    """Cosine times Smith's Lambda for Gaussian slopes: finite at grazing, zero at the normal."""
    spread = np.sqrt(2.0) * slope_rms * sin
    with np.errstate(over="ignore"):
        a = np.divide(cos, spread, out=np.full_like(cos, np.inf), where=spread > 0.0)
        return np.asarray(0.5 * (spread * np.exp(-a * a) / np.sqrt(np.pi) - cos * erfc(a)))
