"""The photon-transfer plot of a noise calibration: noise against signal with its regimes, and what the fit leaves."""

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from calibration.sensor.noise import NoiseCalibration
from rigctl.reports.figures.figure_style import MEASURED, PREDICTED, legend_beside, mark_beyond, png, subplots

FloatArray = NDArray[np.float64]

_GREY = "0.45"
_LIGHT_GREY = "0.62"
# Times the median error, and relative, that a point may have to count for the axes.
_KNOWN, _LEAST_KNOWN = 10.0, 0.3


def photon_transfer_png(calibration: NoiseCalibration) -> bytes:
    """Return the photon-transfer plot as a PNG file: noise against signal, and residuals of the fit.

    Notes
    -----
    Above, on log axes: standard deviation in time of a pixel, the fit, and the regimes that it is made of: dark noise
    (slope 0), noise of photons (slope 1/2), and the fixed pattern (slope 1), which is no noise in time. Below: how far
    the points of the variance are from the fit, with their sampling errors, and where the standard's line goes.
    """
    figure, _ = subplots(1, 1, size=(9.6, 7.0))
    figure.clear()
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1.25))
    _draw_noise(above, calibration)
    _draw_residuals(below, calibration)
    return png(figure)


def _draw_noise(axes: Axes, calibration: NoiseCalibration) -> None:
    transfer = calibration.transfer
    points, seen = transfer.points, transfer.points.signal_dn > 0.0
    total_dn2 = points.flat_variance_dn2
    dark_dn2 = float(np.median(total_dn2 - points.variance_dn2))
    signal_dn = np.geomspace(min(points.signal_dn[seen].min() / 2.0, 2.0), points.signal_dn.max(), 300)
    fit_dn2 = dark_dn2 + transfer.variance_at(signal_dn)
    noisy = total_dn2 > 0.0
    named = np.array([level.cause is not None for level in calibration.influence])
    for chosen, marker, colour, label in (
        (transfer.used & noisy, "o", MEASURED, "flats used"),
        (~transfer.used & seen & noisy, "x", _GREY, "flats left out"),
        (named & seen & noisy, "s", "black", "flats named as wrong"),
    ):
        axes.plot(
            points.signal_dn[chosen],
            np.sqrt(total_dn2[chosen]),
            marker,
            ms=5,
            mfc="none" if marker == "s" else None,
            color=colour,
            label=label,
        )
    rising = (fit_dn2 > 0.0) & (signal_dn <= 1.3 * transfer.top_dn)
    axes.plot(signal_dn[rising], np.sqrt(fit_dn2[rising]), color=PREDICTED, label=_fit_label(calibration))
    _draw_regimes(axes, calibration, signal_dn, dark_dn=float(np.sqrt(dark_dn2)))
    axes.set(xscale="log", yscale="log", ylabel="noise of a pixel in time [DN]", title="Photon transfer")
    axes.set_xlim(_left_dn(calibration), 1.3 * float(points.signal_dn.max()))
    axes.set_ylim(bottom=0.3 * np.sqrt(max(dark_dn2, 1.0 / 12.0)))
    axes.grid(alpha=0.3, which="both", lw=0.4)
    legend_beside(axes)


def _left_dn(calibration: NoiseCalibration) -> float:
    """Return where the axis begins: below the faintest point whose photon noise is known, not of one that is dark."""
    points, used = calibration.transfer.points, calibration.transfer.used
    relative = points.std_error_dn2[used] / calibration.transfer.variance_at(points.signal_dn[used])
    known = np.abs(relative) < max(_KNOWN * float(np.median(np.abs(relative))), _LEAST_KNOWN)
    return float(points.signal_dn[used][known].min()) / 5.0


def _draw_regimes(axes: Axes, calibration: NoiseCalibration, signal_dn: FloatArray, *, dark_dn: float) -> None:
    gain = calibration.gain_dn_per_e.value
    axes.plot(signal_dn, np.full_like(signal_dn, dark_dn), color=_GREY, ls=":", lw=1.2, label=_dark_label(dark_dn))
    axes.plot(
        signal_dn,
        np.sqrt(gain * signal_dn),
        color=_GREY,
        ls="--",
        lw=1.2,
        label="photons, slope 1/2: root(gain x signal)",
    )
    if calibration.prnu is not None:
        label = f"fixed pattern, slope 1: PRNU {calibration.prnu.value:.2%} (not in the points)"
        axes.plot(signal_dn, calibration.prnu.value * signal_dn, color=_GREY, ls="-.", lw=1.2, label=label)
    saturation = calibration.transfer.saturation
    if saturation is not None:
        low, high = (saturation.signal_dn + sign * 3.0**0.5 * saturation.std_error_dn for sign in (-1.0, 1.0))
        axes.axvspan(low, high, color=_LIGHT_GREY, alpha=0.5, lw=0, label="saturation lies here")


def _dark_label(dark_dn: float) -> str:
    return f"dark noise, slope 0: {dark_dn:.3g} DN"


def _fit_label(calibration: NoiseCalibration) -> str:
    gain = calibration.gain_dn_per_e
    return f"fit: gain {gain.value:.4g} ± {gain.std_error:.2g} DN/e- at no signal"


def _draw_residuals(axes: Axes, calibration: NoiseCalibration) -> None:
    transfer = calibration.transfer
    used = transfer.used
    signal_dn, variance_dn2 = transfer.points.signal_dn[used], transfer.points.variance_dn2[used]
    fit_dn2 = transfer.variance_at(signal_dn)
    off = 100.0 * (variance_dn2 / fit_dn2 - 1.0)
    errors = 100.0 * transfer.points.std_error_dn2[used] / fit_dn2
    axes.errorbar(signal_dn, off, errors, fmt="o", ms=4, color=MEASURED, label="flats used, with sampling errors")
    mark_beyond(axes, signal_dn, off, errors)
    axes.axhline(0.0, color=PREDICTED, lw=1)
    emva = calibration.emva1288["gain_dn_per_e"]
    if emva is not None:
        shown = np.geomspace(signal_dn.min(), signal_dn.max(), 100)
        off = 100.0 * (emva.value * shown / transfer.variance_at(shown) - 1.0)
        axes.plot(shown, off, color=_GREY, ls="--", lw=1.2, label="straight line of EMVA 1288")
    axes.set(xlabel="signal above dark [DN]", ylabel="variance off the fit [%]")
    axes.grid(alpha=0.3, which="both", lw=0.4)
    legend_beside(axes)
