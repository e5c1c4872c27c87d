"""Linearity: departure of the mean from proportional to the light, and its effect on the photon-transfer curve."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calibration.sensor.frame_statistics import LevelStatistics
from calibration.sensor.scatter_fit import fit_with_scatter

FloatArray = NDArray[np.float64]
LightKind = Literal["exposure", "photons"]

# A cubic with an offset has four parameters; three more levels show the scatter about it.
LINEARITY_LEVELS = 7
_TERMS = 4
# Photons per exposure that are the same to this much are of one lamp setting; exposures are then the better known.
_ONE_LAMP = 0.02
_ROOT_STEPS = 5
_STEP_OF_ERROR = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearityCurve:
    """The response `signal = x (1 + quadratic x + cubic x^2)`, x [DN] proportional to the light.

    Attributes
    ----------
    light : {"exposure", "photons"}
        What the light was taken to be proportional to.
    quadratic_per_dn, cubic_per_dn2 : float
        The two terms.
    covariance : (2, 2) array
        Of their errors.
    relative_scatter : float
        Scatter of the levels about the curve beyond their noise: flicker and drift of the lamp.
    dn_per_photon : float or None
        Slope of the curve at no signal, where photons are stated [DN].
    dn_per_photon_std_error : float
        Its standard error, without that of the photons; 0 where there is none [DN].
    """

    light: LightKind
    quadratic_per_dn: float
    cubic_per_dn2: float
    covariance: FloatArray
    relative_scatter: float
    dn_per_photon: float | None
    dn_per_photon_std_error: float

    @property
    def variance_cubic_per_dn2(self) -> float:
        """The relative term in signal^2 that the response gives a photon-transfer curve [DN^-2].

        Noise of photons passes the response with its slope: variance = gain x (d signal / d x)^2; x expressed by
        the signal, this is gain signal (1 + 3 quadratic signal + (5 cubic - 2 quadratic^2) signal^2 + ...).
        """
        return 5.0 * self.cubic_per_dn2 - 2.0 * self.quadratic_per_dn**2

    @property
    def variance_cubic_error_per_dn2(self) -> float:
        """Standard error of `variance_cubic_per_dn2` [DN^-2].

        A lamp that fades or brightens evenly makes a quadratic term b with a cubic one of 2 b^2, and no term of the
        photon-transfer curve: 8 b^2 less than it seems. Whether b is the sensor's or the lamp's is not known.
        """
        gradient = np.array([-4.0 * self.quadratic_per_dn, 5.0])
        of_the_lamp = 8.0 * self.quadratic_per_dn**2 / np.sqrt(3.0)
        return float(np.hypot(np.sqrt(gradient @ self.covariance @ gradient), of_the_lamp))


def fit_linearity(
    flats: Sequence[LevelStatistics], signal_dn: FloatArray, *, noise_dn2: FloatArray
) -> LinearityCurve | None:
    """Return the response of a sensor, None where the light of the levels is not known or takes too few values.

    Parameters
    ----------
    flats : sequence of LevelStatistics
        Levels below saturation.
    signal_dn : (n,) array
        Their means, dark taken off, > 0 [DN].
    noise_dn2 : (n,) array
        Variance of these by the noise of pixels [DN^2].

    Notes
    -----
    Fitted is a cubic in the light with an offset: an exposure is often longer or shorter than stated by a fixed
    time. Offset and slope then say where the light is 0, and the cubic is written about that point. Scatter
    of the lamp is estimated from the levels, in proportion to the signal; a lamp that is unsteady makes the
    errors of the curve large, and no more.
    """
    light, kind = _light(flats)
    if light is None:
        return None
    unit = light.max()
    design = (light / unit)[:, None] ** np.arange(_TERMS)
    fit = fit_with_scatter(design, signal_dn, sampling_covariance=np.diag(noise_dn2), scatter_shape=signal_dn)
    terms = _terms(fit.parameters)
    if terms is None:
        return None
    steps = _STEP_OF_ERROR * np.diag(np.sqrt(np.diag(fit.covariance)))
    shifted = [(_terms(fit.parameters + step), _terms(fit.parameters - step)) for step in steps]
    gradient = np.array(
        [
            (up - down) / (2.0 * step.max())
            for (up, down), step in zip(shifted, steps, strict=True)
            if up is not None and down is not None
        ]
    ).T
    if gradient.shape != (len(terms), _TERMS):
        return None
    errors = gradient @ fit.covariance @ gradient.T
    light_per_photon = _light_per_photon(flats, light)
    return LinearityCurve(
        light=kind,
        quadratic_per_dn=float(terms[0]),
        cubic_per_dn2=float(terms[1]),
        covariance=errors[:2, :2],
        relative_scatter=fit.scatter,
        dn_per_photon=float(terms[2]) / unit * light_per_photon if light_per_photon else None,
        dn_per_photon_std_error=float(np.sqrt(errors[2, 2])) / unit * (light_per_photon or 0.0),
    )


def _light_per_photon(flats: Sequence[LevelStatistics], light: FloatArray) -> float | None:
    """Return how much of the light's own unit a photon is, None where photons are not stated."""
    photons = [flat.photons for flat in flats if flat.photons is not None]
    if len(photons) < len(flats) or sum(photons) <= 0.0:
        return None
    return float(light.sum() / sum(photons))


def _light(flats: Sequence[LevelStatistics]) -> tuple[FloatArray | None, LightKind]:
    exposures = np.array([np.nan if flat.exposure_s is None else flat.exposure_s for flat in flats])
    photons = np.array([np.nan if flat.photons is None else flat.photons for flat in flats])
    if not np.isnan(photons).any() and not _proportional(exposures, photons):
        return (photons if _enough(photons) else None), "photons"
    return (exposures if _enough(exposures) else None), "exposure"


def _proportional(exposures: FloatArray, photons: FloatArray) -> bool:
    if np.isnan(exposures).any() or exposures.min() <= 0.0:
        return False
    ratio = photons / exposures
    return bool(np.ptp(ratio) <= _ONE_LAMP * ratio.max())


def _enough(light: FloatArray) -> bool:
    return not np.isnan(light).any() and light.min() >= 0.0 and len(np.unique(light)) >= LINEARITY_LEVELS


def _terms(polynomial: FloatArray) -> FloatArray | None:
    """Return quadratic and cubic term of a polynomial about its root near 0, its slope there scaled to 1; and it."""
    powers = np.polynomial.Polynomial(polynomial)
    slope = powers.deriv()
    root = 0.0
    for _ in range(_ROOT_STEPS):
        if slope(root) <= 0.0:
            return None
        root -= powers(root) / slope(root)
    first = slope(root)
    if first <= 0.0:
        return None
    return np.array([0.5 * powers.deriv(2)(root) / first**2, powers.deriv(3)(root) / 6.0 / first**3, first])
