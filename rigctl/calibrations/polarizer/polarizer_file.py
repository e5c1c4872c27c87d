"""The file that a polarizer calibration is kept in: ``polarizer.json``."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from calibration.polarimeter.axis import AxisCandidate
from calibration.polarimeter.fourier_fit import harmonics_are_told_apart
from rigctl.calibrations.content_file import read_content
from rigctl.calibrations.fitness import require_fit
from rigctl.calibrations.made_for import MadeFor, made_for, read_made_for
from rigctl.calibrations.polarizer.polarizer_calibration import PolarizerCalibration
from rigctl.config import sha256_of
from rigctl.errors import DataError
from rigctl.files.rig_file import PolarizerSection
from rigctl.runs.run_folder import MANIFEST_FILE, Run
from rigctl.utc_time import utc_text
from rigctl.version import VERSION

# What a harmonic of the residual is a sign of.
HARMONIC_MEANING = {1: "a wedge or a tilted element", 3: "a wedge or a tilted element", 4: "a detector not linear"}

SCHEMA_VERSION = 2
# Version 1 has "devices" in place of "made_for".
_OLDEST_VERSION = 1
# For how long it is trusted where it does not say so itself: until the polarizer is taken out of its mount. A choice.
VALID_DAYS = 180.0
# Rounding of the lines that are copied into a rig file.
_COPIED_DEG = 1e-4
_SIGMAS = 3.0


def polarizer_json(
    found: PolarizerCalibration,
    runs: Sequence[Run],
    *,
    valid_days: float | None = None,
    utc_ns: Callable[[], int] = time.time_ns,
) -> dict[str, Any]:
    """Return the content of the file; angles in degrees."""
    best = found.axis.best
    frames = [record for record in runs[-1].frames if record.kind == "scene"]
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": "polarizer",
        "created_by": f"rigctl {VERSION}",
        "created_utc": utc_text(utc_ns()),
        "source": [{"path": str(run.path), "sha256": sha256_of(run.path / MANIFEST_FILE)} for run in runs],
        "made_for": made_for(runs[-1], frames).as_json() | {"valid_days": valid_days},
        "frames": found.frames,
        "axis": "polarizer angle = sense * stage angle + offset, counter-clockwise as the camera sees the scene",
        "sense": best.sense if found.axis.is_decided else None,
        "offset_deg": _offset(best) if found.axis.is_decided else None,
        "scatter_deg": float(np.degrees(found.axis.scatter_rad)),
        "candidates": [{"sense": one.sense, **_offset(one), "chi2": one.chi2} for one in (best, found.axis.other)],
        "diattenuation": _value(found.diattenuation, found.diattenuation_error),
        "extinction_ratio": None if found.extinction is None else asdict(found.extinction),
        "channels": _channels(found),
        "data_reduction": _reduction(found),
        "harmonics": [asdict(one) | {"is_seen": one.is_seen} for one in found.harmonics],
        "harmonics_told_apart": all(harmonics_are_told_apart(curve.angle_rad) for curve in found.curves),
    }


def region_json(name: str, found: PolarizerCalibration) -> dict[str, Any]:
    """Return the numbers of one region, as they stand beside those of the result."""
    return {
        "name": name,
        "sense": found.axis.best.sense if found.axis.is_decided else None,
        "offset_deg": _offset(found.axis.best),
        "diattenuation": _value(found.diattenuation, found.diattenuation_error),
        "harmonics": [asdict(one) | {"is_seen": one.is_seen} for one in found.harmonics],
    }


def rig_lines(content: dict[str, Any]) -> str:
    """Return the table for the rig file."""
    lines = ["[polarizer]", f"sense = {content['sense']}", f"offset_deg = {content['offset_deg']['value']:.4f}"]
    extinction = content["extinction_ratio"]
    if extinction is not None and extinction["ratio"] is not None:
        lines.append(f"extinction_ratio = {extinction['ratio']:.4g}")
    return "\n".join(lines)


def read_polarizer_file(path: Path) -> dict[str, Any]:
    """Return the content of a polarizer calibration, once all that the program uses has been found right.

    Raises
    ------
    DataError
        The file cannot be read, is no polarizer calibration, or is of another version: every problem at once.
    """
    return read_content(path, _Content, made_by="a polarizer calibration is made by `rigctl calibrate axis`")


def read_fitting_polarizer(path: Path, run: Run) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return a polarizer calibration for the scene frames of a run, and what is doubtful about it, in words.

    Raises
    ------
    DataError
        As `read_polarizer_file` and `require_polarizer_fits`.
    """
    content = read_polarizer_file(path)
    used = made_for(run, [record for record in run.frames if record.kind == "scene"])
    stated = run.session.get("rig", {}).get("polarizer", {})
    known = "sense" in stated and "offset_deg" in stated
    doubts = require_polarizer_fits(content, used, polarizer=PolarizerSection.model_validate(stated) if known else None)
    if content.get("channels") is None:
        doubts += (
            "polarizer calibration: made with fixed references, it holds no throughput: nothing is divided by it",
        )
    return content, doubts


def require_polarizer_fits(
    content: Mapping[str, Any], used: MadeFor, *, polarizer: PolarizerSection | None
) -> tuple[str, ...]:
    """Return what is doubtful about frames of a rig by its polarizer calibration, in words.

    Parameters
    ----------
    content : mapping
        Of the calibration's file.
    used : MadeFor
        What the frames were, or will be, taken with.
    polarizer : PolarizerSection or None
        Sense and offset that the rig file states.

    Raises
    ------
    DataError
        It is of another camera or stage, or the rig file states another sense or offset.
    """
    doubts = require_fit(
        "polarizer calibration", read_made_for(content, valid_days=VALID_DAYS), used, stage=True, gain=False
    )
    if polarizer is not None:
        _require_same_axis(content, polarizer)
    return doubts


def _require_same_axis(content: Mapping[str, Any], polarizer: PolarizerSection) -> None:
    offset = content["offset_deg"]
    apart = (polarizer.offset_deg - offset["value"] + 90.0) % 180.0 - 90.0
    if polarizer.sense != content["sense"] or abs(apart) > _SIGMAS * offset["std_error"] + _COPIED_DEG:
        raise DataError(
            f"the rig file says sense = {polarizer.sense}, offset_deg = {polarizer.offset_deg:g}; calibrated are "
            f"{content['sense']} and {offset['value']:.4f} +- {offset['std_error']:.4f}: put the calibrated ones there"
        )


class _Part(BaseModel):
    # Keys that are not known are for those who put them there.
    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)


class _Offset(_Part):
    value: float
    std_error: Annotated[float, Field(ge=0)]


class _Content(_Part):
    schema_version: Annotated[int, Field(ge=_OLDEST_VERSION, le=SCHEMA_VERSION)]
    sense: Literal[1, -1]
    offset_deg: _Offset
    made_for: MadeFor | None = None


def _offset(candidate: AxisCandidate) -> dict[str, float]:
    value, error = np.degrees([candidate.offset_rad, candidate.std_error_rad]).tolist()
    return {"value": value, "std_error": error}


def _value(value: float | None, error: float | None) -> dict[str, float] | None:
    return None if value is None or error is None else {"value": value, "std_error": error}


def _channels(found: PolarizerCalibration) -> list[dict[str, Any]] | None:
    channels, stage_rad = found.channels, found.stage_rad
    if channels is None or stage_rad is None:
        return None
    return [
        {
            "stage_angle_deg": float(np.degrees(stage_rad[index])),
            "axis_deg": _pair(np.degrees(channels.axis_rad) % 180.0, np.degrees(channels.axis_error_rad), index),
            "throughput": _pair(channels.throughput, channels.throughput_error, index),
            "diattenuation": _pair(channels.diattenuation, channels.diattenuation_error, index),
        }
        for index in range(len(stage_rad))
    ]


def _pair(values: NDArray[np.float64], errors: NDArray[np.float64], index: int) -> dict[str, float]:
    return {"value": float(values[index]), "std_error": float(errors[index])}


def _reduction(found: PolarizerCalibration) -> dict[str, Any] | None:
    if found.reduction is None:
        return None
    return {
        "matrix": found.reduction.matrix.tolist(),
        "std_error": found.reduction.std_error.tolist(),
        "singular_values": found.reduction.singular_values.tolist(),
        "condition": found.reduction.condition,
    }
