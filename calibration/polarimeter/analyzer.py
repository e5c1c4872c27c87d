"""Action of an analyzer on polarized light, from a generator that turns in front of it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.polarimeter.fourier_fit import FourierFit, fit_fourier

FloatArray = NDArray[np.float64]

_TWO_SIDED_95 = 1.959964


@dataclass(frozen=True, kw_only=True, eq=False)
class AnalyzerChannels:
    """Each analyzer angle by itself, for one region or for many pixels (the trailing axes).

    Attributes
    ----------
    throughput, throughput_error : (N, ...) arrays
        Response to unpolarized light relative to the mean over the angles.
    diattenuation, diattenuation_error : (N, ...) arrays
        (max - min) / (max + min) of its transmission; above 1 by its error only.
    axis_rad, axis_error_rad : (N, ...) arrays
        Transmission axis, -pi/2 to pi/2, in the generator's frame [rad].
    scan : FourierFit
        The fits themselves.
    """

    throughput: FloatArray
    throughput_error: FloatArray
    diattenuation: FloatArray
    diattenuation_error: FloatArray
    axis_rad: FloatArray
    axis_error_rad: FloatArray
    scan: FourierFit


@dataclass(frozen=True, kw_only=True)
class Extinction:
    """An extinction ratio, largest over smallest transmission.

    Attributes
    ----------
    ratio : float or None
        None where the minimum is not above 0.
    lower, upper : float or None
        Interval of 95 %; `upper` is None where there is no upper limit.
    """

    ratio: float | None
    lower: float
    upper: float | None


def analyzer_channels(generator_rad: FloatArray, intensities: FloatArray, *, generator_dolp: float) -> AnalyzerChannels:
    """Return throughput, diattenuation and axis of each analyzer angle.

    Parameters
    ----------
    generator_rad : (K,) array
        Transmission axis of the generator, counter-clockwise as the camera sees the scene [rad].
    intensities : (K, N, ...) array
        Mean counts less dark, of each generator angle and each analyzer angle.
    generator_dolp : float
        Degree of linear polarization that the generator makes, 0 to 1.

    Raises
    ------
    CalibrationError
        Angles do not determine the fit, there is no light, or `generator_dolp` is not in (0, 1].

    References
    ----------
    Boulbry, Ramella-Roman and Germer, Appl. Opt. 46, 8533 (2007), doi:10.1364/AO.46.008533; each analyzer by
    itself, in closed form.
    """
    if not 0.0 < generator_dolp <= 1.0:
        raise CalibrationError(f"the generator's DoLP is {generator_dolp}; allowed is above 0, up to 1")
    scan = fit_fourier(generator_rad, intensities)
    mean = scan.terms[0].mean(axis=0)
    return AnalyzerChannels(
        throughput=scan.terms[0] / mean,
        throughput_error=scan.mean_error() / mean,
        diattenuation=scan.modulation / generator_dolp,
        diattenuation_error=scan.modulation_error() / generator_dolp,
        axis_rad=scan.phase_rad,
        axis_error_rad=scan.phase_error_rad(),
        scan=scan,
    )


def pooled_diattenuation(channels: AnalyzerChannels) -> tuple[FloatArray, FloatArray]:
    """Return the diattenuation that all analyzer angles share, and its standard error, scatter included.

    One polarizer that turns has one diattenuation; scatter beyond the errors is the light's and enlarges them.

    Parameters
    ----------
    channels
        Diattenuation and its error at each analyzer angle, shape (N, ...).

    References
    ----------
    Definition; the mean weighted by inverse variances.
    """
    weights = channels.diattenuation_error**-2.0
    mean = (weights * channels.diattenuation).sum(axis=0) / weights.sum(axis=0)
    n = len(channels.diattenuation)
    chi2 = (weights * np.square(channels.diattenuation - mean)).sum(axis=0)
    scale = np.maximum(1.0, chi2 / max(1, n - 1))
    return mean, np.sqrt(scale / weights.sum(axis=0))


def extinction(diattenuation: float, std_error: float) -> Extinction:
    """Return the extinction ratio of a diattenuation.

    Parameters
    ----------
    diattenuation, std_error : float
        With everything in the error that it has: noise, the generator's DoLP, the dark level.

    Raises
    ------
    CalibrationError
        The diattenuation is below 0, or above 1, by more than its error.

    Notes
    -----
    Near 1 the ratio is a steep function, so the interval is that of the diattenuation, carried over: it is not
    symmetric, and open above where a perfect polarizer is within it.
    """
    low, high = diattenuation - _TWO_SIDED_95 * std_error, diattenuation + _TWO_SIDED_95 * std_error
    if high <= 0.0:
        raise CalibrationError(f"the diattenuation is {diattenuation:.4g} +- {std_error:.2g}; that is no polarizer")
    lower = _ratio(max(low, 0.0))
    if lower is None:
        raise CalibrationError(
            f"the diattenuation is {diattenuation:.6g} +- {std_error:.2g}, above 1: the light is better polarized than "
            f"stated, or more is taken off as dark level than there is: check --dolp and dark frames"
        )
    return Extinction(ratio=_ratio(diattenuation), lower=lower, upper=_ratio(high))


def _ratio(diattenuation: float) -> float | None:
    return (1.0 + diattenuation) / (1.0 - diattenuation) if diattenuation < 1.0 else None
