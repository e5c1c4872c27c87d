"""Tables of what noise does to the degree of polarization."""

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from model.processing.dolp_against_snr import DolpAgainstSnr
from model.processing.estimators import EstimatorError
from rigctl.reports.table import Column, Table

# Heading, and what stands under it.
_FIG5 = (
    ("mean: first", "first_mean"),
    ("Gaussian", "mean"),
    ("Poisson", "poisson_mean"),
    ("drawn", "drawn_mean"),
    ("std: first", "first_std"),
    ("Gaussian", "std"),
    ("Poisson", "poisson_std"),
    ("drawn", "drawn_std"),
)


def fig5_table(found: DolpAgainstSnr) -> Table[int]:
    """Return mean and deviation of DoLP against the SNR of S0: first order, exact, drawn."""
    columns: tuple[Column[int], ...] = (
        Column(title="SNR [dB]", text=lambda k: f"{20 * np.log10(found.snr[k]):.0f}"),
        Column(title="S0 [e-]", text=lambda k: f"{found.s0_e[k]:.4g}"),
        *(Column(title=title, text=partial(_five_digits, values=getattr(found, name))) for title, name in _FIG5),
    )
    return Table(columns=columns, rows=tuple(range(len(found.snr))))


def estimator_table(found: Mapping[str, EstimatorError], true_snr: Sequence[float]) -> Table[int]:
    """Return bias and rms error of estimators of the true DoLP, a row a true signal-to-noise ratio."""
    columns: tuple[Column[int], ...] = (
        Column(title="true SNR", text=lambda k: f"{true_snr[k]:g}"),
        *(Column(title=name, text=partial(_errors, found=error), unbroken=True) for name, error in found.items()),
    )
    return Table(title="bias/rms error", columns=columns, rows=tuple(range(len(true_snr))))


def _five_digits(k: int, values: Sequence[float]) -> str:
    return "-" if np.isnan(values[k]) else f"{values[k]:.5f}"


def _errors(k: int, found: EstimatorError) -> str:
    return f"{found.bias[k]:+.3f}/{found.rms[k]:.3f}"
