"""The file that a polarizer calibration is kept in: ``polarizer.json``."""

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.axis import AxisCandidate
from rigctl.config import sha256_of
from rigctl.durable_file import write_durably
from rigctl.errors import ConfigError
from rigctl.polarimeter.polarizer_calibration import PolarizerCalibration
from rigctl.runs.run_folder import MANIFEST_FILE, Run
from rigctl.utc_time import utc_text
from rigctl.version import VERSION

SCHEMA_VERSION = 1
_DEVICES = ("camera_model", "camera_serial", "stage_model", "stage_serial")


def polarizer_json(
    found: PolarizerCalibration, runs: Sequence[Run], *, utc_ns: Callable[[], int] = time.time_ns
) -> dict[str, Any]:
    """Return the content of the file; angles in degrees."""
    best = found.axis.best
    return {
        "schema_version": SCHEMA_VERSION,
        "created_by": f"rigctl {VERSION}",
        "created_utc": utc_text(utc_ns()),
        "source": [{"path": str(run.path), "sha256": sha256_of(run.path / MANIFEST_FILE)} for run in runs],
        "devices": {name: getattr(runs[0].frames[0], name) for name in _DEVICES},
        "frames": found.frames,
        "axis": "polarizer angle = sense * stage angle + offset, counter-clockwise as the camera sees the scene",
        "sense": best.sense if found.axis.is_decided else None,
        "offset_deg": _offset(best) if found.axis.is_decided else None,
        "candidates": [{"sense": one.sense, **_offset(one), "chi2": one.chi2} for one in (best, found.axis.other)],
        "diattenuation": _value(found.diattenuation, found.diattenuation_error),
        "extinction_ratio": None if found.extinction is None else asdict(found.extinction),
        "channels": _channels(found),
        "data_reduction": _reduction(found),
        "harmonics": [asdict(one) | {"is_seen": one.is_seen} for one in found.harmonics],
    }


def rig_lines(content: dict[str, Any]) -> str:
    """Return the table for the rig file."""
    lines = ["[polarizer]", f"sense = {content['sense']}", f"offset_deg = {content['offset_deg']['value']:.4f}"]
    extinction = content["extinction_ratio"]
    if extinction is not None and extinction["ratio"] is not None:
        lines.append(f"extinction_ratio = {extinction['ratio']:.4g}")
    return "\n".join(lines)


def write_polarizer_file(path: Path, content: dict[str, Any]) -> None:
    """Write a calibration: whole under its name, or not at all.

    Raises
    ------
    ConfigError
        The file cannot be written there.
    """
    try:
        write_durably(path, (json.dumps(content, indent=2, allow_nan=False) + "\n").encode("ascii"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}; its folder has to exist") from error


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
