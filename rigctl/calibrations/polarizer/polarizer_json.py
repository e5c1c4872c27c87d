"""The content of ``polarizer.json``, of a calibration and the runs that it was made from."""

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.calibrations.made_for import made_for
from rigctl.calibrations.polarizer.polarizer_calibration import PolarizerCalibration, candidate_offset_deg
from rigctl.calibrations.polarizer.polarizer_file import SCHEMA_VERSION
from rigctl.files.config import sha256_of
from rigctl.numbers.utc_time import utc_text
from rigctl.runs.run_folder import MANIFEST_FILE, Run
from rigctl.version import VERSION

# What a harmonic of the residual is a sign of.
HARMONIC_MEANING = {1: "a wedge or a tilted element", 3: "a wedge or a tilted element", 4: "a detector not linear"}


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
        "offset_deg": asdict(found.offset_deg) if found.axis.is_decided else None,
        "scatter_deg": float(np.degrees(found.axis.scatter_rad)),
        "candidates": [
            {"sense": one.sense, **asdict(candidate_offset_deg(one)), "chi2": one.chi2}
            for one in (best, found.axis.other)
        ],
        "diattenuation": _value(found.diattenuation, found.diattenuation_error),
        "extinction_ratio": None if found.extinction is None else asdict(found.extinction),
        "channels": _channels(found),
        "data_reduction": _reduction(found),
        "harmonics": [asdict(one) | {"is_seen": one.is_seen} for one in found.harmonics],
        "harmonics_told_apart": found.harmonics_told_apart,
    }


def region_json(name: str, found: PolarizerCalibration) -> dict[str, Any]:
    """Return the numbers of one region, as they stand beside those of the result."""
    return {
        "name": name,
        "sense": found.axis.best.sense if found.axis.is_decided else None,
        "offset_deg": asdict(found.offset_deg),
        "diattenuation": _value(found.diattenuation, found.diattenuation_error),
        "harmonics": [asdict(one) | {"is_seen": one.is_seen} for one in found.harmonics],
    }


def rig_lines(found: PolarizerCalibration) -> str:
    """Return the table for the rig file, of a calibration whose sense is decided."""
    lines = ["[polarizer]", f"sense = {found.axis.best.sense}", f"offset_deg = {found.offset_deg.value:.4f}"]
    if found.extinction is not None and found.extinction.ratio is not None:
        lines.append(f"extinction_ratio = {found.extinction.ratio:.4g}")
    return "\n".join(lines)


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
