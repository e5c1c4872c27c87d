"""Mean counts of a region in the frames of a polarizer scan, dark taken off."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.calibrations.polarizer.generator_file import GeneratorAngle
from rigctl.errors import DataError
from rigctl.files.regions import Region, masks
from rigctl.runs.frame_record import FrameRecord
from rigctl.runs.run_folder import Run

FloatArray = NDArray[np.float64]

# Frames whose stage angles are no further apart were taken at one angle [deg]; stages land within hundredths.
_ONE_ANGLE_DEG = 0.2
# So many pixels of a region may be saturated, as hot ones are; they are left out of all frames of a scan.
_FEW_SATURATED = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class AnalyzerScan:
    """A region's light against the stage's angle: angles (K,) [rad], mean counts (K,) [DN]."""

    stage_rad: FloatArray
    signal_dn: FloatArray
    frames: int


@dataclass(frozen=True, kw_only=True, eq=False)
class GeneratorScan:
    """A region's light at each generator angle (K,) and stage angle (N,): mean counts (K, N) [DN]."""

    generator_rad: FloatArray
    stage_rad: FloatArray
    signal_dn: FloatArray
    frames: int


def analyzer_scan(run: Run, region: Region | None) -> AnalyzerScan:
    """Return the scan of the stage in front of a fixed reference.

    Raises
    ------
    DataError
        Frames lack stage angles or a dark level, or are saturated in the region.
    """
    records = scene_frames(run)
    return AnalyzerScan(
        stage_rad=np.radians([_stage_deg(run, record) for record in records]),
        signal_dn=_signals_dn(run, records, region),
        frames=len(records),
    )


def generator_scan(run: Run, region: Region | None, generator_deg: GeneratorAngle) -> GeneratorScan:
    """Return the scan of a generator, at each of the stage's angles; repeats are averaged.

    Raises
    ------
    DataError
        As `analyzer_scan`; or some stage angle lacks a generator angle that others have.
    """
    records = scene_frames(run)
    cells = generator_cells(run, records, generator_deg)
    signals = _signals_dn(run, records, region)
    return GeneratorScan(
        generator_rad=cells.generator_rad,
        stage_rad=cells.stage_rad,
        signal_dn=np.array([[np.mean(signals[list(cell)]) for cell in row] for row in cells.frames]),
        frames=len(records),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class GeneratorCells:
    """Frames at each generator angle (K,) and stage angle (N,) [rad]: places in a list of records."""

    generator_rad: FloatArray
    stage_rad: FloatArray
    frames: tuple[tuple[tuple[int, ...], ...], ...]


def generator_cells(run: Run, records: Sequence[FrameRecord], generator_deg: GeneratorAngle) -> GeneratorCells:
    """Return which frames of a generator scan belong to which pair of angles.

    Raises
    ------
    DataError
        Some stage angle lacks a generator angle that others have, or a frame has no angle.
    """
    groups, stages_deg = _one_angle(np.array([_stage_deg(run, record) for record in records]))
    cells: dict[tuple[float, int], list[int]] = defaultdict(list)
    for index, (record, group) in enumerate(zip(records, groups, strict=True)):
        cells[generator_deg(record), group].append(index)
    generators, stages = sorted({generator for generator, _ in cells}), range(len(stages_deg))
    missing = [(g, s) for g in generators for s in stages if (g, s) not in cells]
    if missing:
        raise DataError(
            f"{run.path}: {len(missing)} of {len(generators) * len(stages)} pairs of generator and stage angle have no "
            f"frame, such as generator {missing[0][0]:g} deg at stage {stages_deg[missing[0][1]]:.2f} deg"
        )
    return GeneratorCells(
        generator_rad=np.radians(generators),
        stage_rad=np.radians(stages_deg),
        frames=tuple(tuple(tuple(cells[g, s]) for s in stages) for g in generators),
    )


def _one_angle(angles_deg: FloatArray) -> tuple[list[int], FloatArray]:
    """Return which of the stage's angles each frame was taken at, and these angles, ascending from 0 [deg].

    A readback differs a little from frame to frame, also across 0: 359.998 and 0.003 deg are one angle.
    """
    # From just below 0, so that no angle near it is at the other end.
    turned = (angles_deg + _ONE_ANGLE_DEG) % 360.0 - _ONE_ANGLE_DEG
    order = np.argsort(turned, kind="stable")
    numbers = np.cumsum(np.diff(turned[order], prepend=turned[order[0]]) > _ONE_ANGLE_DEG)
    groups = np.empty(len(turned), dtype=np.int64)
    groups[order] = numbers
    means = np.array([turned[groups == group].mean() for group in range(int(numbers[-1]) + 1)])
    return groups.tolist(), means


def scene_frames(run: Run) -> list[FrameRecord]:
    """Return the scene frames of a run, which have one exposure.

    Raises
    ------
    DataError
        There are none, or they have several exposures.
    """
    records = [record for record in run.frames if record.kind == "scene"]
    if not records:
        raise DataError(f"{run.path}: has no scene frames")
    exposures = {record.exposure_s for record in records}
    if len(exposures) > 1:
        raise DataError(f"{run.path}: scene frames have {len(exposures)} exposures; a polarizer scan needs one")
    return records


def _stage_deg(run: Run, record: FrameRecord) -> float:
    if record.stage_angle_deg is None:
        raise DataError(f"{run.path}: frame {record.sequence} has no stage angle; a polarizer calibration needs it")
    return record.stage_angle_deg


def _signals_dn(run: Run, records: Sequence[FrameRecord], region: Region | None) -> FloatArray:
    inside = _inside(records[0], region)
    inside &= ~_saturated(run, records, inside)
    means = np.array([float(run.counts(record)[inside].mean()) for record in records])
    return means - _dark_dn(run, records[0], inside)


def _saturated(run: Run, records: Sequence[FrameRecord], inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which pixels are saturated in any frame, where those of the region are as few as hot pixels are."""
    saturated = np.zeros_like(inside)
    most = max(1, int(_FEW_SATURATED * np.count_nonzero(inside)))
    for record in records:
        saturated |= run.counts(record) >= record.saturation_dn
        count = int(np.count_nonzero(saturated & inside))
        if count > most:
            raise DataError(
                f"{run.path}: frame {record.sequence} has {count} saturated pixels in the region (allowed are {most}, "
                f"as hot pixels): take a shorter exposure, or give another region"
            )
    return saturated


def _inside(record: FrameRecord, region: Region | None) -> NDArray[np.bool_]:
    if region is None:
        return np.ones((record.height, record.width), dtype=np.bool_)
    return masks([region], width=record.width, height=record.height)[region.name]


def dark_frames(run: Run, scene: FrameRecord) -> list[FrameRecord]:
    """Return the dark frames of the exposure of a scene frame."""
    return [record for record in run.frames if record.kind == "dark" and record.exposure_s == scene.exposure_s]


def _dark_dn(run: Run, scene: FrameRecord, inside: NDArray[np.bool_]) -> float:
    darks = dark_frames(run, scene)
    if darks:
        return float(np.mean([run.counts(record)[inside].mean() for record in darks]))
    if scene.black_level_dn is not None:
        return scene.black_level_dn
    raise DataError(
        f"{run.path}: nothing says how many counts there are without light; a dark level that stays in lowers the "
        f"extinction ratio: add dark frames at the exposure of the scan"
    )
