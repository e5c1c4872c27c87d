"""The file that a noise calibration is kept in: ``noise.json``."""

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from calibration.flags import Flag
from calibration.sensor.brighter_fatter import brighter_fatter
from calibration.sensor.emva1288 import EMVA_SYMBOLS
from calibration.sensor.noise import NoiseCalibration
from calibration.sensor.photon_transfer import PhotonTransfer
from rigctl.calibrations.content_file import read_content
from rigctl.calibrations.fitness import require_fit
from rigctl.calibrations.made_for import MadeFor, made_for, read_made_for
from rigctl.calibrations.noise.noise_frames import FrameSet
from rigctl.calibrations.noise.pattern_json import dark_json, performance_json
from rigctl.runs.run_folder import Run
from rigctl.utc_time import utc_text
from rigctl.version import VERSION

SCHEMA_VERSION = 2
# Version 1 has "camera" in place of "made_for".
_OLDEST_VERSION = 1
# For how long a noise calibration is trusted where it does not say so itself: a choice.
VALID_DAYS = 365.0
QUANTITIES = (
    "gain_dn_per_e",
    "read_noise_e",
    "dark_current_e_per_s",
    "black_level_dn",
    "saturation_e",
    "prnu",
    "dsnu_e",
)
# Asymmetry and negative eigenvalues of a covariance that rounding of its printed digits can make.
_ROUNDING = 1e-9


def noise_json(
    calibration: NoiseCalibration, frames: FrameSet, *, utc_ns: Callable[[], int] = time.time_ns
) -> dict[str, Any]:
    """Return the content of the file.

    Parameters
    ----------
    calibration : NoiseCalibration
        The calibration.
    frames : FrameSet
        What it was made from.
    utc_ns : callable
        The clock that dates it [ns].
    """
    estimates = {name: getattr(calibration, name) for name in QUANTITIES}
    return {
        "schema_version": SCHEMA_VERSION,
        "created_by": f"rigctl {VERSION}",
        "created_utc": utc_text(utc_ns()),
        "source": asdict(frames.source),
        "made_for": frames.made_for.as_json(),
        **{name: None if found is None else asdict(found) for name, found in estimates.items()},
        "covariance": {
            "names": list(calibration.covariance.names),
            "matrix": calibration.covariance.matrix.tolist(),
        },
        "flags": flags_json(calibration.flags),
        "performance": performance_json(calibration),
        "dark_levels": dark_json(calibration),
        "photon_transfer": _curve(calibration.transfer),
        "linearity": _linearity(calibration.transfer),
        "emva1288": {
            name: None if figure is None else asdict(figure) | {"symbol": EMVA_SYMBOLS[name]}
            for name, figure in calibration.emva1288.items()
        },
    }


def flags_json(flags: tuple[Flag, ...]) -> list[dict[str, Any]]:
    """Return flags as the file holds them."""
    return [asdict(flag) for flag in flags]


def _curve(transfer: PhotonTransfer) -> dict[str, Any]:
    points = transfer.points
    return {
        "signal_dn": points.signal_dn.tolist(),
        "variance_dn2": points.variance_dn2.tolist(),
        "std_error_dn2": points.std_error_dn2.tolist(),
        "used": transfer.used.tolist(),
        "fit": "variance_dn2 = gain_dn_per_e * signal_dn + bend * signal_dn**2 + cubic * signal_dn**3",
        "gain_dn_per_e": transfer.gain_dn_per_e,
        "bend": transfer.bend,
        "cubic": transfer.cubic,
        "relative_scatter": transfer.fit.scatter / transfer.gain_dn_per_e,
        "chi2_per_dof": transfer.fit.chi2_per_dof,
    }


def _linearity(transfer: PhotonTransfer) -> dict[str, Any] | None:
    curve, spreading = transfer.linearity, brighter_fatter(transfer)
    if curve is None:
        return None
    return {
        "fit": "signal_dn = x * (1 + quadratic_per_dn * x + cubic_per_dn2 * x**2), x proportional to the light",
        "light": curve.light,
        "quadratic_per_dn": curve.quadratic_per_dn,
        "cubic_per_dn2": curve.cubic_per_dn2,
        "covariance": curve.covariance.tolist(),
        "relative_scatter": curve.relative_scatter,
        "brighter_fatter": None if spreading is None else asdict(spreading),
    }


def read_noise_file(path: Path) -> dict[str, Any]:
    """Return the content of a noise calibration file, once all that the program uses has been found right.

    Raises
    ------
    DataError
        The file cannot be read, is no noise calibration, or is of another version: every problem at once.
    """
    return read_content(path, _NoiseContent, made_by="a noise calibration is made by `rigctl calibrate noise`")


def require_noise_fits(noise: Mapping[str, Any], used: MadeFor) -> tuple[str, ...]:
    """Return what is doubtful about using a noise calibration for frames, in words.

    Parameters
    ----------
    noise : mapping
        Content of its file.
    used : MadeFor
        What the frames were, or will be, taken with.

    Raises
    ------
    DataError
        It is of another camera, gain, bit depth or binning.
    """
    return require_fit("noise calibration", read_made_for(noise, valid_days=VALID_DAYS), used)


def read_fitting_noise(path: Path, run: Run) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return a noise calibration for the scene frames of a run, and what is doubtful about it, in words.

    Raises
    ------
    DataError
        As `read_noise_file` and `require_noise_fits`.
    """
    noise = read_noise_file(path)
    return noise, require_noise_fits(noise, made_for(run, [one for one in run.frames if one.kind == "scene"]))


class _Part(BaseModel):
    # Keys that are not known are for those who put them there.
    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)


class _Value(_Part):
    value: float
    std_error: Annotated[float, Field(ge=0)]
    n: Annotated[int, Field(ge=1)]


class _PositiveValue(_Value):
    value: Annotated[float, Field(gt=0)]


class _Covariance(_Part):
    names: list[str]
    matrix: list[list[float]]

    @model_validator(mode="after")
    def _is_a_covariance(self) -> Self:
        if unknown := [name for name in self.names if name not in QUANTITIES]:
            raise ValueError(f"names {unknown} are none of {', '.join(QUANTITIES)}")
        if [len(row) for row in self.matrix] != [len(self.names)] * len(self.names):
            raise ValueError(f"the matrix has to have {len(self.names)} rows and columns, one for each name")
        matrix = np.array(self.matrix)
        scale = np.sqrt(np.abs(np.diag(matrix)))
        if np.any(np.abs(matrix - matrix.T) > _ROUNDING * np.outer(scale, scale)):
            raise ValueError("the matrix is not symmetric")
        correlation = matrix / np.where(scale > 0.0, np.outer(scale, scale), 1.0)
        if len(matrix) and np.linalg.eigvalsh(correlation).min() < -_ROUNDING:
            raise ValueError("the matrix is no covariance: it has a negative eigenvalue")
        return self


class _Flag(_Part):
    name: str
    message: str
    refuses: bool


class _Camera(_Part):
    model: str | None = None
    serial: str | None = None
    gain_db: float | None = None
    bit_depth: int | None = None


class _NoiseContent(_Part):
    schema_version: Annotated[int, Field(ge=_OLDEST_VERSION, le=SCHEMA_VERSION)]
    gain_dn_per_e: _PositiveValue
    read_noise_e: _Value | None
    dark_current_e_per_s: _Value | None
    black_level_dn: _Value
    saturation_e: _Value | None
    prnu: _Value | None
    dsnu_e: _Value | None
    covariance: _Covariance | None = None
    flags: list[_Flag] = []
    camera: _Camera | None = None
    made_for: MadeFor | None = None
