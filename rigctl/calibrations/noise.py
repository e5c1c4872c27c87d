"""Noise calibrations (``noise.json``): quantities with errors, their covariance, flags."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field

from calibration.results import Flag
from model.sensor import SensorNoise
from rigctl.calibrations.kinds import Bounded, MadeFor, Measured, MeasuredOverFrames
from rigctl.calibrations.record import CalibrationRecord

FloatArray = NDArray[np.float64]

SCHEMA_VERSION = 2
QUANTITIES = (
    "gain_dn_per_e",
    "read_noise_e",
    "dark_current_e_per_s",
    "black_level_dn",
    "saturation_e",
    "prnu",
    "dsnu_e",
)
# Asymmetry and negative eigenvalues of a covariance that rounding can cause.
_ROUNDING = 1e-9
# Of an estimate's square in any unit; see the largest number of a file.
_LARGEST_COVARIANCE = 1e24

StatedEstimate = MeasuredOverFrames[Bounded]
Gain = MeasuredOverFrames[Annotated[float, Field(gt=0, le=1e6)]]
# Largest non-uniformity: a pixel with ten times the response of the others is a defect.
Ratio = MeasuredOverFrames[Annotated[float, Field(ge=-10, le=10)]]


def _without_bound(found: Any) -> Any:
    """Return a number of a file, None for a bound."""
    if isinstance(found, dict) and found.get("bound") in ("<", ">"):
        value = found.get("value")
        if not isinstance(value, int | float) or not abs(value) < float("inf"):
            raise ValueError("a bound has to have a finite value")
        return None
    return found


_Quantity = TypeVar("_Quantity")
_Known = Annotated[_Quantity, BeforeValidator(_without_bound)]
_Covariance = Annotated[float, Field(ge=-_LARGEST_COVARIANCE, le=_LARGEST_COVARIANCE)]


@dataclass(frozen=True, kw_only=True)
class JointErrors:
    """Covariance of the errors of several quantities."""

    names: tuple[str, ...]
    matrix: tuple[tuple[_Covariance, ...], ...]

    def __post_init__(self) -> None:
        if unknown := [name for name in self.names if name not in QUANTITIES]:
            raise ValueError(f"names {unknown} are not known; allowed are {', '.join(QUANTITIES)}")
        if [len(row) for row in self.matrix] != [len(self.names)] * len(self.names):
            raise ValueError(f"the matrix has to have {len(self.names)} rows and columns, one for each name")
        if len(set(self.names)) < len(self.names):
            raise ValueError(f"names {list(self.names)} are not distinct")
        matrix = np.array(self.matrix)
        scale = np.sqrt(np.abs(np.diag(matrix)))
        if np.any(np.abs(matrix - matrix.T) > _ROUNDING * np.outer(scale, scale)):
            raise ValueError("the matrix is not symmetric")
        correlation = matrix / np.where(scale > 0.0, np.outer(scale, scale), 1.0)
        if len(matrix) and np.linalg.eigvalsh(correlation).min() < -_ROUNDING:
            raise ValueError("the matrix is not a covariance: it has a negative eigenvalue")


@dataclass(frozen=True, kw_only=True)
class Performance:
    """Figures of merit that the program uses."""

    dark_current_variance_e_per_s: StatedEstimate | None = None


@dataclass(frozen=True, kw_only=True)
class NoiseParameters(CalibrationRecord):
    """A noise calibration as its file holds it."""

    KIND = "noise"
    MADE_BY = "a noise calibration is made by `rigctl calibrate noise`"

    schema_version: Annotated[int, Field(ge=SCHEMA_VERSION, le=SCHEMA_VERSION)]
    #: Each in the unit that its name ends in; None is not known, or known by a bound only (``{"bound": "<", "value":
    #: 4.2}``). Measured values may be below 0 by their error.
    gain_dn_per_e: Gain
    read_noise_e: _Known[StatedEstimate | None]
    dark_current_e_per_s: _Known[StatedEstimate | None]
    black_level_dn: StatedEstimate
    saturation_e: _Known[StatedEstimate | None]
    prnu: _Known[Ratio | None]
    dsnu_e: _Known[StatedEstimate | None]
    covariance: JointErrors | None = None  #: Of their errors.
    performance: Performance | None = None  #: Figures of merit.
    flags: tuple[Flag, ...] = ()  #: findings in the frames
    made_for: MadeFor | None = None

    @property
    def known(self) -> dict[str, StatedEstimate]:
        """Its quantities by name, those that are known."""
        return {name: found for name in QUANTITIES if (found := getattr(self, name)) is not None}

    @property
    def history(self) -> dict[str, Measured[float]]:
        """Gain, read noise and dark current that are known."""
        known = self.known
        return {
            name: Measured(value=known[name].value, std_error=known[name].std_error)
            for name in ("gain_dn_per_e", "read_noise_e", "dark_current_e_per_s")
            if name in known
        }

    @property
    def below_zero(self) -> dict[str, float]:
        """Estimates below 0 of quantities that cannot be."""
        return {
            name: self.known[name].value
            for name in ("read_noise_e", "dark_current_e_per_s", "prnu", "dsnu_e")
            if name in self.known and self.known[name].value < 0.0
        }

    def sensor_noise(self) -> SensorNoise:
        """Return the noise of the sensor; 0 for quantities that are not known or estimated below 0."""
        values = {name: 0.0 if name in self.below_zero else one.value for name, one in self.known.items()}
        return SensorNoise(
            gain_dn_per_e=self.gain_dn_per_e.value,
            read_noise_e=values.get("read_noise_e", 0.0),
            dark_current_e_per_s=values.get("dark_current_e_per_s", 0.0),
            black_level_dn=self.black_level_dn.value,
            prnu=values.get("prnu", 0.0),
            dsnu_e=values.get("dsnu_e", 0.0),
        )

    def covariance_of(self, names: Sequence[str]) -> FloatArray:
        """Return the covariance of the errors of some quantities, (n, n); 0 where it is not known."""
        known, joint = self.known, self.covariance
        cov = np.diag([known[name].std_error ** 2 if name in known else 0.0 for name in names])
        if joint is not None:
            here = [k for k, name in enumerate(names) if name in joint.names]
            there = [joint.names.index(names[k]) for k in here]
            cov[np.ix_(here, here)] = np.array(joint.matrix)[np.ix_(there, there)]
        return cov


def read_noise_file(path: str | Path) -> NoiseParameters:
    """Return a noise calibration.

    Raises
    ------
    DataError
        The file cannot be read, or is not a noise calibration of this version: every problem at once.
    """
    return NoiseParameters.read(Path(path))
