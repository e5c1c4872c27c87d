"""The content of ``polarizer.json``, of a calibration and the runs that it was made from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.polarimeter.analyzer import Extinction, Harmonic
from rigctl.calibrations.checked_values import Measured
from rigctl.calibrations.content_file import CalibrationFile, header_of, source_of_run
from rigctl.calibrations.polarizer.polarizer_calibration import PolarizerCalibration, candidate_offset_deg
from rigctl.calibrations.polarizer.polarizer_file import SCHEMA_VERSION
from rigctl.runs.run_folder import Run

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
