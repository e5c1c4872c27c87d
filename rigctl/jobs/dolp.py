"""Noise in the degree of polarization: [MK14] Fig. 5 exactly, and estimators of the true DoLP."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from model.processing.dolp_studies import ESTIMATORS, DolpAgainstSnr, EstimatorError, bias_and_rms, dolp_against_snr
from rigctl.base.durable import write_durably
from rigctl.paper import estimator_plot, fig5_plot

_FIG5_STOKES = (1.0, 0.5, 0.5)
_FIG5_SNR_DB = (0.0, 40.0, 21)
_TRUE_SNR = (0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 8.0)
_PLOTTED_SNR = (0.0, 6.0, 121)


@dataclass(frozen=True, kw_only=True, eq=False)
class ComparedEstimators:
    """Estimators of the true DoLP.

    Attributes
    ----------
    true_snr : (k,) array
        True DoLP over the deviation of S1/S0 and of S2/S0.
    errors : mapping
        Estimator to bias and rms error at each, in units of that deviation.
    """

    true_snr: NDArray[np.float64]
    errors: dict[str, EstimatorError]


def dolp_by_snr(*, draws: int, seed: int, out: Path | None = None) -> DolpAgainstSnr:
    """Return DoLP against the SNR of S0 as [MK14] Fig. 5 has it: first order, exact, and drawn.

    Parameters
    ----------
    draws : int
        Poisson draws for each ratio, 10 or more.
    seed : int
        Of the draws.
    out : Path or None
        Folder for fig5.png.
    """
    ratios = 10.0 ** (np.linspace(*_FIG5_SNR_DB) / 20.0)
    found = dolp_against_snr(_FIG5_STOKES, ratios, draws=draws, generator=np.random.default_rng(seed))
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        write_durably(out / "fig5.png", fig5_plot(found))
    return found


def compare_estimators(*, out: Path | None = None) -> ComparedEstimators:
    """Return bias and rms error of every estimator of the true DoLP.

    Parameters
    ----------
    out : Path or None
        Folder for estimators.png.
    """
    if out is not None:
        plotted = _errors(np.linspace(*_PLOTTED_SNR))
        out.mkdir(parents=True, exist_ok=True)
        write_durably(out / "estimators.png", estimator_plot(plotted.true_snr, plotted.errors))
    return _errors(np.array(_TRUE_SNR))


def _errors(true_snr: NDArray[np.float64]) -> ComparedEstimators:
    return ComparedEstimators(true_snr=true_snr, errors={name: bias_and_rms(name, true_snr) for name in ESTIMATORS})
