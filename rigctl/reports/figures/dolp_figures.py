"""Plots of what noise does to the degree of polarization."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from model.processing.dolp_against_snr import DolpAgainstSnr
from model.processing.estimators import EstimatorError
from rigctl.reports.figures.figure_style import MEASURED, PREDICTED, png, subplots

_DASHES = ("-", "--", "-.", ":", (0, (5, 1)), (0, (3, 1, 1, 1)), (0, (1, 1)))


def fig5_plot(found: DolpAgainstSnr) -> bytes:
    """Return mean and deviation of DoLP against the SNR of S0: draws, first order, exact, as [MK14] Fig. 5."""
    figure, axes = subplots(1, 2, size=(11.0, 4.2))
    decibel = 20 * np.log10(found.snr)
    rows = (
        (axes[0], "mean of DoLP", found.drawn_mean, found.drawn_mean_error, found.first_mean, found.true_mean),
        (axes[1], "deviation of DoLP", found.drawn_std, found.drawn_std_error, found.first_std, found.true_std),
    )
    for ax, label, drawn, error, first, exact in rows:
        ax.errorbar(decibel, drawn, yerr=error, fmt="o", markersize=4, color=MEASURED, label="Poisson draws")
        ax.plot(decibel, first, color="0.45", linestyle="--", label="first order, [MK14]")
        ax.plot(decibel, exact, color=PREDICTED, label="exact law: Poisson to 16 dB, Gaussian above")
        ax.axvline(20.0, color="0.8", linewidth=1.0)
        ax.set_xlabel("SNR of S0 [dB, amplitude]")
        ax.set_ylabel(label)
        ax.set_ylim(0.0, 1.15 * float(np.max(drawn)))
    axes[1].legend(fontsize=8)
    return png(figure)


def estimator_plot(true_snr: NDArray[np.float64], errors: Mapping[str, EstimatorError]) -> bytes:
    """Return bias and rms error of every estimator against the true signal-to-noise ratio."""
    figure, axes = subplots(1, 2, size=(11.0, 4.2))
    for (name, found), dash in zip(errors.items(), _DASHES, strict=True):
        axes[0].plot(true_snr, found.bias, linestyle=dash, label=name)
        axes[1].plot(true_snr, found.rms, linestyle=dash, label=name)
    for ax, label in zip(axes, ("bias", "rms error"), strict=True):
        ax.set_xlabel("true DoLP / deviation")
        ax.set_ylabel(f"{label} / deviation")
        ax.axhline(0.0 if label == "bias" else 1.0, color="0.8", linewidth=1.0)
    axes[1].legend(fontsize=8)
    return png(figure)
