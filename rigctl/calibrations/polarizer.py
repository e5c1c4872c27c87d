"""The file that a polarizer calibration is kept in: ``polarizer.json``, as a record.

The content of ``polarizer.json``, of a calibration and the runs that it was made from.

Sense and offset of a calibration, written into a rig file in the place of those that stand there.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from calibration.polarimeter.analyzer import Extinction, Harmonic
from rigctl.base.durable import write_durably
from rigctl.base.numbers import wrapped
from rigctl.calibrations.made_for import (
    Bounded,
    MadeFor,
    Measured,
    UtcText,
    at_least,
    made_for,
    made_for_of_file,
    require_fit,
)
from rigctl.calibrations.polarizer_scan import PolarizerCalibration, candidate_offset_deg
from rigctl.calibrations.record import CalibrationFile, header_of, read_record, source_of_run
from rigctl.errors import ConfigError, DataError
from rigctl.files.rig_file import PolarizerSection, load_rig
from rigctl.runs.folder import Run
from rigctl.runs.records import PolarizerAsTaken

SCHEMA_VERSION = 2
# For how long it is trusted where it does not say so itself: until the polarizer is taken out of its mount. A choice.
VALID_DAYS = 180.0
# Rounding of the lines that are copied into a rig file.
_COPIED_DEG = 1e-4
_SIGMAS = 3.0

Angle = Measured[Bounded]
# Over the mean of the angles: of a thousand angles one alone would have to pass light.
Passed = Measured[Annotated[float, Field(gt=0, le=1e3)]]


@dataclass(frozen=True, kw_only=True)
class Channel:
    """Polarizer at one angle of the stage: throughput is the response to unpolarized light over the angles' mean."""

    stage_angle_deg: Bounded
    throughput: Passed


@dataclass(frozen=True, kw_only=True)
class PolarizerParameters:
    """A polarizer calibration as its file holds it."""

    schema_version: Annotated[int, Field(ge=SCHEMA_VERSION, le=SCHEMA_VERSION)]
    sense: Literal[1, -1]  #: Of the polarizer angle against the stage angle.
    offset_deg: Angle  #: Polarizer angle where the stage stands at 0 [deg].
    #: Each stage angle by itself; None where fixed references were used, which do not measure throughput.
    channels: Annotated[tuple[Channel, ...], at_least(1)] | None = None
    made_for: MadeFor | None = None  #: Devices, settings and time.
    created_utc: UtcText | None = None  #: When the file was written.

    @property
    def origin(self) -> MadeFor:
        """What it was made for, and until when it holds."""
        return made_for_of_file(self.made_for, created_utc=self.created_utc, valid_days=VALID_DAYS)


def read_polarizer_file(path: str | Path) -> PolarizerParameters:
    """Return a polarizer calibration.

    Raises
    ------
    DataError
        The file cannot be read, is no polarizer calibration, or is of another version: every problem at once.
    """
    return read_record(
        Path(path), PolarizerParameters, made_by="a polarizer calibration is made by `rigctl calibrate axis`"
    )


def read_fitting_polarizer(path: Path, run: Run) -> tuple[PolarizerParameters, tuple[str, ...]]:
    """Return a polarizer calibration for the scene frames of a run, and what is doubtful about it, in words."""
    found = read_polarizer_file(path)
    used = made_for(run, [record for record in run.frames if record.kind == "scene"])
    doubts = require_polarizer_fits(found, used, polarizer=run.session.polarizer)
    if found.channels is None:
        doubts += (
            "polarizer calibration: made with fixed references, it holds no throughput: nothing is divided by it",
        )
    return found, doubts


def require_polarizer_fits(
    calibration: PolarizerParameters, used: MadeFor, *, polarizer: PolarizerSection | PolarizerAsTaken
) -> tuple[str, ...]:
    """Return what is doubtful about frames of a rig by its polarizer calibration, in words."""
    doubts = require_fit("polarizer calibration", calibration.origin, used, stage=True, gain=False)
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


# What a harmonic of the residual is a sign of.
HARMONIC_MEANING = {1: "a wedge or a tilted element", 3: "a wedge or a tilted element", 4: "a detector not linear"}


@dataclass(frozen=True, kw_only=True)
class CandidateNumbers:
    """An axis that the scans allow: sense, offset with its error [deg], and how well it fits."""

    sense: int
    value: float
    std_error: float
    chi2: float


@dataclass(frozen=True, kw_only=True)
class ChannelNumbers:
    """A stage angle by itself, angles in degrees."""

    stage_angle_deg: float
    axis_deg: Measured[float]
    throughput: Measured[float]
    diattenuation: Measured[float]


@dataclass(frozen=True, kw_only=True)
class ReductionNumbers:
    """The data reduction matrix as `DataReduction` has it."""

    matrix: list[list[float]]
    std_error: list[list[float]]
    singular_values: list[float]
    condition: float


@dataclass(frozen=True, kw_only=True)
class HarmonicNumbers:
    """What Malus' law leaves at one frequency, as `Harmonic` has it."""

    order: int
    amplitude: float
    std_error: float
    is_seen: bool


@dataclass(frozen=True, kw_only=True)
class RegionNumbers:
    """Numbers of one region, as they stand beside those of the result."""

    name: str
    sense: int | None
    offset_deg: Measured[float]
    diattenuation: Measured[float] | None
    harmonics: tuple[HarmonicNumbers, ...]


@dataclass(frozen=True, kw_only=True)
class PolarizerNumbers:
    """A polarizer calibration in the order in which its file has it, angles in degrees; None is what is not decided."""

    frames: int
    axis: str = "polarizer angle = sense * stage angle + offset, counter-clockwise as the camera sees the scene"
    sense: int | None
    offset_deg: Measured[float] | None
    scatter_deg: float
    candidates: tuple[CandidateNumbers, ...]
    diattenuation: Measured[float] | None
    extinction_ratio: Extinction | None
    channels: tuple[ChannelNumbers, ...] | None
    data_reduction: ReductionNumbers | None
    harmonics: tuple[HarmonicNumbers, ...]
    harmonics_told_apart: bool
    regions: tuple[RegionNumbers, ...]


def polarizer_file(
    found: PolarizerCalibration,
    runs: Sequence[Run],
    *,
    regions: Mapping[str, PolarizerCalibration],
    valid_days: float | None = None,
) -> CalibrationFile[PolarizerNumbers]:
    """Return the file; of several runs it is for the devices of the last."""
    frames = [record for record in runs[-1].frames if record.kind == "scene"]
    source = tuple(source_of_run(run) for run in runs)
    return CalibrationFile(
        header=header_of(
            "polarizer", SCHEMA_VERSION, source=source, run=runs[-1], records=frames, valid_days=valid_days
        ),
        body=PolarizerNumbers(
            frames=found.frames,
            sense=_sense(found),
            offset_deg=found.offset_deg if found.axis.is_decided else None,
            scatter_deg=float(np.degrees(found.axis.scatter_rad)),
            candidates=_candidates(found),
            diattenuation=_diattenuation(found),
            extinction_ratio=found.extinction,
            channels=_channels(found),
            data_reduction=_reduction(found),
            harmonics=_harmonics(found.harmonics),
            harmonics_told_apart=found.harmonics_told_apart,
            regions=tuple(_region(name, one) for name, one in regions.items()),
        ),
    )


def rig_lines(found: PolarizerCalibration) -> str:
    """Return the table for the rig file, of a calibration whose sense is decided."""
    lines = ["[polarizer]", f"sense = {found.axis.best.sense}", f"offset_deg = {found.offset_deg.value:.4f}"]
    if found.extinction is not None and found.extinction.ratio is not None:
        lines.append(f"extinction_ratio = {found.extinction.ratio:.4g}")
    return "\n".join(lines)


def _sense(found: PolarizerCalibration) -> int | None:
    return found.axis.best.sense if found.axis.is_decided else None


def _candidates(found: PolarizerCalibration) -> tuple[CandidateNumbers, ...]:
    offsets = [(one, candidate_offset_deg(one)) for one in (found.axis.best, found.axis.other)]
    return tuple(
        CandidateNumbers(sense=one.sense, value=offset.value, std_error=offset.std_error, chi2=one.chi2)
        for one, offset in offsets
    )


def _region(name: str, found: PolarizerCalibration) -> RegionNumbers:
    return RegionNumbers(
        name=name,
        sense=_sense(found),
        offset_deg=found.offset_deg,
        diattenuation=_diattenuation(found),
        harmonics=_harmonics(found.harmonics),
    )


def _harmonics(found: Sequence[Harmonic]) -> tuple[HarmonicNumbers, ...]:
    return tuple(
        HarmonicNumbers(order=one.order, amplitude=one.amplitude, std_error=one.std_error, is_seen=one.is_seen)
        for one in found
    )


def _diattenuation(found: PolarizerCalibration) -> Measured[float] | None:
    value, error = found.diattenuation, found.diattenuation_error
    return None if value is None or error is None else Measured(value=value, std_error=error)


def _channels(found: PolarizerCalibration) -> tuple[ChannelNumbers, ...] | None:
    channels, stage_rad = found.channels, found.stage_rad
    if channels is None or stage_rad is None:
        return None
    return tuple(
        ChannelNumbers(
            stage_angle_deg=float(np.degrees(stage_rad[index])),
            axis_deg=_pair(np.degrees(channels.axis_rad) % 180.0, np.degrees(channels.axis_error_rad), index),
            throughput=_pair(channels.throughput, channels.throughput_error, index),
            diattenuation=_pair(channels.diattenuation, channels.diattenuation_error, index),
        )
        for index in range(len(stage_rad))
    )


def _pair(values: NDArray[np.float64], errors: NDArray[np.float64], index: int) -> Measured[float]:
    return Measured(value=float(values[index]), std_error=float(errors[index]))


def _reduction(found: PolarizerCalibration) -> ReductionNumbers | None:
    if found.reduction is None:
        return None
    return ReductionNumbers(
        matrix=found.reduction.matrix.tolist(),
        std_error=found.reduction.std_error.tolist(),
        singular_values=found.reduction.singular_values.tolist(),
        condition=found.reduction.condition,
    )


_TABLE = re.compile(r"^\[polarizer\][^\n]*\n(?:(?!\[)[^\n]*(?:\n|\Z))*", re.MULTILINE)
_NO_LONGER_TRUE = re.compile(r"^(?:placeholder|offset_std_deg)\s*=[^\n]*(?:\n|\Z)", re.MULTILINE)
_OURS = "    # rigctl calibrate axis"
_PLACEHOLDER = "# a placeholder"


def require_writable_rig(path: Path) -> None:
    """Refuse a file that a calibration cannot be written into, before there is one."""
    load_rig(path)
    _polarizer_table(path)


def write_into_rig(path: Path, found: PolarizerCalibration) -> tuple[str, ...]:
    """Write sense, offset with its error, and extinction ratio into a rig file; its comments stay."""
    require_writable_rig(path)
    text = _text(path)
    table = _polarizer_table(path)
    inside = _NO_LONGER_TRUE.sub("", table[0])
    for key, number in _numbers(found).items():
        # What a person has noted behind a number stays there.
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
    # As bytes: the ends of lines stay what they are.
    return path.read_bytes().decode("utf-8")


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
