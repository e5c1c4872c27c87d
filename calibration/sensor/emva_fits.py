"""The lines of EMVA 1288, unweighted as the standard has them, and the figures that follow from them."""

import numpy as np
from numpy.typing import NDArray

from calibration.sensor.dark_signal import QUANTISATION_LIMIT_DN2, QUANTISATION_VAR_DN2
from calibration.sensor.emva_sweep import EmvaSweep

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Upper end of the fits of gain and responsivity, and range of the linearity fit, as shares of saturation.
GAIN_RANGE = 0.7
_LINEARITY_RANGE = (0.05, 0.95)


def temporal_figures(sweep: EmvaSweep, *, flats: Mask, darks: Mask) -> dict[str, float]:
    """Return the figures that come from means and temporal variances; those that do not exist are left out.

    Parameters
    ----------
    sweep : EmvaSweep
        All levels.
    flats, darks : (n,), (m,) arrays of bool
        The levels to use; the rest is left out, to see how much hangs on it. Saturation is that of all.

    References
    ----------
    EMVA Standard 1288, Release 4.0 Linear, sections 6.5 to 6.9 and 7.1.
    """
    chosen = flats & (sweep.signal_dn <= GAIN_RANGE * sweep.saturation_signal_dn)
    if not np.any(sweep.signal_dn[chosen] > 0.0):
        return {}
    gain = _slope(sweep.signal_dn[chosen], sweep.variance_dn2[chosen])
    if gain <= 0.0:
        return {}
    dark_variance, variance_slope = _dark_line(sweep, sweep.dark_variance_dn2, darks)
    dark_variance = max(dark_variance, QUANTISATION_LIMIT_DN2)
    found = {
        "gain_dn_per_e": gain,
        "temporal_dark_noise_dn": float(np.sqrt(dark_variance)),
        "temporal_dark_noise_e": float(np.sqrt(dark_variance - QUANTISATION_VAR_DN2)) / gain,
        "threshold_e": float(np.sqrt(dark_variance)) / gain + 0.5,
    }
    if sweep.has_exposures:
        found["dark_current_mean_e_per_s"] = _dark_line(sweep, sweep.dark_mean_dn, darks)[1] / gain
        found["dark_current_variance_e_per_s"] = variance_slope / gain**2
    found |= _photon_figures(sweep, chosen, found)
    return found | _saturation_figures(sweep, found)


def is_capped(sweep: EmvaSweep) -> bool:
    """Return whether the dark variance is below 0.24 DN^2, where the standard takes that in its place.

    Parameters
    ----------
    sweep : EmvaSweep
        All levels.
    """
    every = np.ones(len(sweep.exposure_s), dtype=bool)
    return _dark_line(sweep, sweep.dark_variance_dn2, every)[0] < QUANTISATION_LIMIT_DN2


def _slope(x: FloatArray, y: FloatArray) -> float:
    """Return the unweighted least-squares slope of a line through the origin."""
    return float(x @ y / (x @ x))


def _dark_line(sweep: EmvaSweep, values: FloatArray, darks: Mask) -> tuple[float, float]:
    """Return value at no exposure and slope; with two exposures or fewer the value at the shortest, and 0."""
    if not sweep.has_exposures:
        return float(values[darks][0]), 0.0
    exposures_s, chosen = sweep.exposure_s[darks], values[darks]
    from_middle = exposures_s - exposures_s.mean()
    slope = _slope(from_middle, chosen)
    return float(chosen.mean() - slope * exposures_s.mean()), slope


def _photon_figures(sweep: EmvaSweep, chosen: Mask, found: dict[str, float]) -> dict[str, float]:
    if sweep.light is None or not sweep.light_is_photons:
        return {}
    responsivity = _slope(sweep.light[chosen], sweep.signal_dn[chosen])
    efficiency = responsivity / found["gain_dn_per_e"]
    return {
        "responsivity_dn_per_photon": responsivity,
        "quantum_efficiency": efficiency,
        "threshold_photons": found["threshold_e"] / efficiency,
    }


def _saturation_figures(sweep: EmvaSweep, found: dict[str, float]) -> dict[str, float]:
    if sweep.saturation is None:
        return {}
    figures = {}
    saturation_e = sweep.saturation_signal_dn / found["gain_dn_per_e"]
    if "quantum_efficiency" in found and sweep.light is not None:
        figures["saturation_photons"] = float(sweep.light[sweep.saturation])
        saturation_e = figures["saturation_photons"] * found["quantum_efficiency"]
    return figures | {
        "saturation_e": saturation_e,
        "dynamic_range": saturation_e / found["threshold_e"],
        "snr_max": float(np.sqrt(saturation_e)),
    }


def linearity_deviation(sweep: EmvaSweep) -> FloatArray | None:
    """Return by how much the means within 5 to 95 % of saturation are off their line, relative to it.

    None where there is no saturation, no light that is known, or fewer than three levels. The line is fitted
    with weights 1 / signal^2.

    Parameters
    ----------
    sweep
        Means of the levels over the light.

    References
    ----------
    EMVA Standard 1288, Release 4.0 Linear, section 6.8.
    """
    if sweep.light is None or sweep.saturation is None:
        return None
    low, high = (share * sweep.saturation_signal_dn for share in _LINEARITY_RANGE)
    chosen = (sweep.signal_dn >= low) & (sweep.signal_dn <= high)
    if np.count_nonzero(chosen) < 3:
        return None
    light, signal = sweep.light[chosen], sweep.signal_dn[chosen]
    line = np.polyval(np.polyfit(light, signal, 1, w=1.0 / signal), light)
    deviation: FloatArray = signal / line - 1.0
    return deviation
