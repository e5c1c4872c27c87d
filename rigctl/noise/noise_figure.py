"""The photon-transfer plot of a noise calibration."""

import io
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calibration.noise import NoiseCalibration

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FloatArray = NDArray[np.float64]

# Two colours that a colour-blind reader tells apart, and that differ in grey.
_DATA, _FIT, _LEFT_OUT = "#0b3c6f", "#d1701a", "#9a9a9a"
_DOTS_PER_INCH = 150


def photon_transfer_png(calibration: NoiseCalibration) -> bytes:
    """Return the photon-transfer plot as a PNG file: noise against signal, and residuals of the fit.

    Notes
    -----
    Above, on log axes: standard deviation in time of a pixel, dark noise, and the fit of both together; the fixed
    pattern as a line of slope 1. Below: how far the points of the variance are from the fit, with their sampling
    errors.
    """
    from matplotlib.figure import Figure  # half a second, wanted for a plot only

    figure = Figure(figsize=(7.0, 6.5), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    _draw_noise(above, calibration)
    _draw_residuals(below, calibration)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=_DOTS_PER_INCH)
    return buffer.getvalue()


def _draw_noise(axes: "Axes", calibration: NoiseCalibration) -> None:
    transfer = calibration.transfer
    points, seen = transfer.points, transfer.points.signal_dn > 0.0
    total_dn2 = points.flat_variance_dn2
    dark_dn2 = float(np.median(total_dn2 - points.variance_dn2))
    signal_dn = np.geomspace(points.signal_dn[seen].min() / 2.0, points.signal_dn.max(), 300)
    fit_dn2 = dark_dn2 + transfer.variance_at(signal_dn)
    noisy = total_dn2 > 0.0
    for chosen, colour, label in (
        (transfer.used & noisy, _DATA, "flats used"),
        (~transfer.used & seen & noisy, _LEFT_OUT, "flats left out"),
    ):
        axes.plot(points.signal_dn[chosen], np.sqrt(total_dn2[chosen]), "o", ms=4, color=colour, label=label)
    rising = fit_dn2 > 0.0
    axes.plot(signal_dn[rising], np.sqrt(fit_dn2[rising]), color=_FIT, label=_fit_label(calibration))
    axes.axhline(np.sqrt(dark_dn2), color=_DATA, ls=":", lw=1, label=f"dark noise {np.sqrt(dark_dn2):.3g} DN")
    if calibration.prnu is not None:
        pattern_dn = calibration.prnu.value * signal_dn
        axes.plot(signal_dn, pattern_dn, color=_LEFT_OUT, ls="--", lw=1, label=f"PRNU {calibration.prnu.value:.2%}")
    if transfer.saturation is not None:
        axes.axvline(transfer.saturation.signal_dn, color=_LEFT_OUT, lw=1, label="saturation")
    axes.set(xscale="log", yscale="log", ylabel="noise of a pixel [DN]", title="Photon transfer")
    axes.grid(alpha=0.3, which="both", lw=0.4)
    axes.legend(fontsize="small")


def _fit_label(calibration: NoiseCalibration) -> str:
    gain = calibration.gain_dn_per_e
    return f"fit: gain {gain.value:.4g} ± {gain.std_error:.2g} DN/e-"


def _draw_residuals(axes: "Axes", calibration: NoiseCalibration) -> None:
    transfer = calibration.transfer
    used = transfer.used
    signal_dn, variance_dn2 = transfer.points.signal_dn[used], transfer.points.variance_dn2[used]
    fit_dn2 = transfer.variance_at(signal_dn)
    axes.errorbar(
        signal_dn,
        100.0 * (variance_dn2 / fit_dn2 - 1.0),
        100.0 * transfer.points.std_error_dn2[used] / fit_dn2,
        fmt="o",
        ms=4,
        color=_DATA,
    )
    axes.axhline(0.0, color=_FIT, lw=1)
    axes.set(xlabel="signal above dark [DN]", ylabel="variance off\nthe fit [%]")
    axes.grid(alpha=0.3, which="both", lw=0.4)
