"""[MK14] Fig. 5: DoLP at few electrons, first order against the exact law of Poisson counts."""

from typing import Literal

import numpy as np

from model.processing.dolp_studies import DolpAgainstSnr, dolp_against_snr
from rigctl.paper.numbers import Number

STOKES = (1.0, 0.5, 0.5)
DECIBEL = np.linspace(0.0, 40.0, 21)
_DRAWS, _SEED = 10_000, 1


class LowLight:
    """Mean and deviation of DoLP against the SNR of S0."""

    def __init__(self) -> None:
        self.found: DolpAgainstSnr = dolp_against_snr(
            STOKES, 10.0 ** (DECIBEL / 20.0), draws=_DRAWS, generator=np.random.default_rng(_SEED)
        )

    def relative_error(self, decibel: float, moment: Literal["mean", "std"]) -> Number:
        """Return what the first-order mean or deviation is off, as a share of the exact one."""
        place = int(np.argmin(np.abs(DECIBEL - decibel)))
        first = float(getattr(self.found, f"first_{moment}")[place])
        exact, error = (float(values[place]) for values in self.found.truth(moment))
        return Number(
            label=f"first-order {moment} at {decibel:g} dB off by",
            value=abs(first / exact - 1.0),
            error=error * first / exact**2,
        )
