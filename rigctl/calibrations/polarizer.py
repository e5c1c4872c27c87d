"""Polarizer calibrations (``polarizer.json``), and their lines in a rig file."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field

from calibration.polarimeter.analyzer import false_dolp
from rigctl.base.durable import MOST_TEXT_BYTES, read_bounded, write_durably
from rigctl.base.numbers import wrapped
from rigctl.calibrations.kinds import Bounded, MadeFor, Measured, at_least
from rigctl.calibrations.polarizer_scan import PolarizerCalibration, candidate_offset_deg
from rigctl.calibrations.record import CalibrationRecord, header_of, made_for_scene, source_of_run
from rigctl.console import Json
from rigctl.errors import ConfigError, DataError
from rigctl.files.rig_file import PolarizerSection, load_rig
from rigctl.files.session_file import DEFAULT_ANGLES_DEG
from rigctl.runs.folder import Run
from rigctl.runs.records import PolarizerAsTaken

SCHEMA_VERSION = 2
# Rounding of the lines for a rig file.
_COPIED_DEG = 1e-4
_SIGMAS = 3.0
# Causes of harmonics in the residuals of Malus' law.
HARMONIC_MEANING = {
    1: "a wedge or a tilted element",
    3: "a wedge or a tilted element",
    4: "a detector not linear, or the polarizer",
    5: "a wedge or a tilted element",
    6: "a detector not linear, or the polarizer",
}
NO_HARMONICS = (
    "harmonics beyond the second are not determined: that takes 12 frames or more over a whole turn. The error of the "
    "offset allows for up to 3 % of each where the residual does not exclude it"
)


@dataclass(frozen=True, kw_only=True)
class Channel:
    """Polarizer at one stage angle: throughput is the response to unpolarized light over the mean of all angles."""

    stage_angle_deg: Bounded
    #: of a thousand angles one alone would have to pass light
    throughput: Measured[Annotated[float, Field(gt=0, le=1e3)]]


@dataclass(frozen=True, kw_only=True)
class PolarizerParameters(CalibrationRecord):
    """Content of a polarizer calibration, as far as the program uses it."""

    KIND = "polarizer"
    MADE_BY = "a polarizer calibration is made by `rigctl calibrate axis`"

    schema_version: Annotated[int, Field(ge=SCHEMA_VERSION, le=SCHEMA_VERSION)]
    sense: Literal[1, -1]  #: of the polarizer angle against the stage angle
    offset_deg: Measured[Bounded]  #: polarizer angle where the stage stands at 0 [deg]
    #: each stage angle by itself; None where fixed references were used, which do not measure throughput
    channels: Annotated[tuple[Channel, ...], at_least(1)] | None = None
    made_for: MadeFor | None = None

    @property
    def parts(self) -> tuple[str, ...]:
        """The axis, and the throughput unless fixed references were used."""
        return ("axis",) if self.channels is None else ("axis", "throughput")

    @property
    def history(self) -> dict[str, Measured[float]]:
        """Offset of the axis."""
        return {"offset_deg": self.offset_deg}

    @classmethod
    def read_fitting(cls, path: Path, run: Run) -> tuple[Self, tuple[str, ...]]:
        """Return the calibration for the scene frames of a run, and doubts about it as text."""
        found = cls.read(path)
        doubts = require_polarizer_fits(found, made_for_scene(run), polarizer=run.session.polarizer)
        if found.channels is None:
            doubts += (
                "polarizer calibration: made with fixed references, so without throughput: nothing is divided by it",
            )
        return found, doubts


def read_polarizer_file(path: str | Path) -> PolarizerParameters:
    """Return a polarizer calibration.

    Raises
    ------
    DataError
        The file cannot be read, or is not a polarizer calibration of this version: every problem at once.
    """
    return PolarizerParameters.read(Path(path))


def require_polarizer_fits(
    calibration: PolarizerParameters, used: MadeFor, *, polarizer: PolarizerSection | PolarizerAsTaken
) -> tuple[str, ...]:
    """Return doubts about frames of a rig by its polarizer calibration; DataError if they do not fit."""
    doubts = calibration.doubts(used)
    if polarizer.sense is not None and polarizer.offset_deg is not None:
        _require_same_axis(calibration, polarizer.sense, polarizer.offset_deg)
    return doubts


def _require_same_axis(calibration: PolarizerParameters, sense: int, offset_deg: float) -> None:
    offset = calibration.offset_deg
    apart = wrapped(offset_deg - offset.value, turn=180.0)
    if sense != calibration.sense or abs(apart) > _SIGMAS * offset.std_error + _COPIED_DEG:
        raise DataError(
            f"the rig file says sense = {sense}, offset_deg = {offset_deg:g}; calibrated are "
            f"{calibration.sense} and {offset.value:.4f} +- {offset.std_error:.4f}: put the calibrated ones there"
        )


def polarizer_content(
    found: PolarizerCalibration,
    runs: Sequence[Run],
    *,
    regions: Mapping[str, PolarizerCalibration],
    valid_days: float | None = None,
) -> dict[str, Json]:
    """Return the content of the file, angles in degrees; of several runs it is for the devices of the last."""
    frames = [record for record in runs[-1].frames if record.kind == "scene"]
    source = [source_of_run(run) for run in runs]
    axis, reduction = found.axis, found.reduction
    return header_of(
        "polarizer", SCHEMA_VERSION, source=source, run=runs[-1], records=frames, valid_days=valid_days
    ) | {
        "frames": found.frames,
        "axis": "polarizer angle = sense * stage angle + offset, counter-clockwise as the camera sees the scene",
        "sense": axis.best.sense if axis.is_decided else None,
        "offset_deg": asdict(found.offset_deg) if axis.is_decided else None,
        "scatter_deg": float(np.degrees(axis.scatter_rad)),
        "candidates": [
            {"sense": one.sense, **asdict(candidate_offset_deg(one)), "chi2": one.chi2}
            for one in (axis.best, axis.other)
        ],
        "diattenuation": _diattenuation(found),
        "extinction_ratio": None if found.extinction is None else asdict(found.extinction),
        "channels": _channels(found),
        "data_reduction": None
        if reduction is None
        else {
            "matrix": reduction.matrix.tolist(),
            "std_error": reduction.std_error.tolist(),
            "singular_values": reduction.singular_values.tolist(),
            "condition": reduction.condition,
        },
        "harmonics": _harmonics(found),
        "harmonics_told_apart": bool(found.harmonics),
        "regions": [
            {
                "name": name,
                "sense": one.axis.best.sense if one.axis.is_decided else None,
                "offset_deg": asdict(one.offset_deg),
                "diattenuation": _diattenuation(one),
                "harmonics": _harmonics(one),
            }
            for name, one in regions.items()
        ],
    }


def _harmonics(found: PolarizerCalibration) -> list[dict[str, Json]]:
    return [
        asdict(one) | {"is_seen": one.is_seen, "false_dolp": false_dolp(one, np.radians(DEFAULT_ANGLES_DEG))}
        for one in found.harmonics
    ]


def _diattenuation(found: PolarizerCalibration) -> dict[str, Json] | None:
    if found.diattenuation is None:
        return None
    return {"value": found.diattenuation, "std_error": found.diattenuation_error}


def _channels(found: PolarizerCalibration) -> list[dict[str, Json]] | None:
    one = found.channels
    if one is None or found.stage_rad is None:
        return None
    numbers = {
        "axis_deg": (np.degrees(one.axis_rad) % 180.0, np.degrees(one.axis_error_rad)),
        "throughput": (one.throughput, one.throughput_error),
        "diattenuation": (one.diattenuation, one.diattenuation_error),
    }
    return [
        {"stage_angle_deg": stage_deg}
        | {
            name: {"value": float(values[index]), "std_error": float(errors[index])}
            for name, (values, errors) in numbers.items()
        }
        for index, stage_deg in enumerate(np.degrees(found.stage_rad).tolist())
    ]


def rig_lines(found: PolarizerCalibration) -> str:
    """Return the table for the rig file, of a calibration whose sense is decided."""
    lines = ["[polarizer]", f"sense = {found.axis.best.sense}", f"offset_deg = {found.offset_deg.value:.4f}"]
    if found.extinction is not None and found.extinction.ratio is not None:
        lines.append(f"extinction_ratio = {found.extinction.ratio:.4g}")
    return "\n".join(lines)


_TABLE = re.compile(r"^\[polarizer\][^\n]*\n(?:(?!\[)[^\n]*(?:\n|\Z))*", re.MULTILINE)
_NO_LONGER_TRUE = re.compile(r"^(?:placeholder|offset_std_deg)\s*=[^\n]*(?:\n|\Z)", re.MULTILINE)
_OURS = "    # rigctl calibrate axis"
_PLACEHOLDER = "# a placeholder"


def require_writable_rig(path: Path) -> None:
    """Refuse a rig file that a calibration cannot be written into."""
    load_rig(path)
    _polarizer_table(path)


def write_into_rig(path: Path, found: PolarizerCalibration) -> tuple[str, ...]:
    """Write sense, offset with its error, and extinction ratio into a rig file; its comments stay."""
    require_writable_rig(path)
    text = _text(path)
    table = _polarizer_table(path)
    inside = _NO_LONGER_TRUE.sub("", table[0])
    for key, number in _numbers(found).items():
        # Comments after a number stay.
        line = re.compile(rf"^({key}\s*=\s*)[^#\r\n]*?([ \t]*#[^\r\n]*)?(\r?)$", re.MULTILINE)
        was = line.search(inside)
        if was is not None:
            inside = f"{inside[: was.start()]}{was[1]}{number}{_kept(was[2])}{was[3]}{inside[was.end() :]}"
        else:
            inside = inside.replace("\n", f"\n{key} = {number}{_OURS}\n", 1)
    write_durably(path, (text[: table.start()] + inside + text[table.end() :]).encode("utf-8"))
    load_rig(path)
    return _changes(table[0].splitlines(), inside.splitlines())


def _kept(comment: str | None) -> str:
    return _OURS if comment is None or comment.strip().startswith(_PLACEHOLDER) else comment


def _polarizer_table(path: Path) -> re.Match[str]:
    table = _TABLE.search(_text(path))
    if table is None:
        raise ConfigError(f"{path}: has no table [polarizer] to write into")
    return table


def _text(path: Path) -> str:
    # As bytes, to keep the ends of lines.
    return read_bounded(path, MOST_TEXT_BYTES).decode("utf-8")


def _numbers(found: PolarizerCalibration) -> dict[str, str]:
    offset = found.offset_deg
    numbers = {
        "sense": str(found.axis.best.sense),
        "offset_deg": f"{{ value = {offset.value:.4f}, std = {offset.std_error:.4f} }}",
    }
    if found.extinction is not None and found.extinction.ratio is not None:
        numbers["extinction_ratio"] = f"{found.extinction.ratio:.4g}"
    return numbers


def _changes(before: list[str], after: list[str]) -> tuple[str, ...]:
    went = [f"- {line}" for line in before if line not in after]
    return (*went, *(f"+ {line}" for line in after if line not in before))
