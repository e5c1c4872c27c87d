"""Polarizer scans of runs: sense, axis, extinction and W of a polarizer in its stage, and maps over the picture.

Either the stage turns in front of a fixed reference (`analyzer_scan`, `from_references`), or a second polarizer, the
generator, turns, and all stage angles are taken at each of its angles (`generator_scan`, `from_generator`), which also
gives each block of the picture its own throughput, diattenuation and axis (`polarimeter_maps`).
"""

import io
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from calibration.polarimeter.analyzer import (
    AnalyzerChannels,
    AxisCandidate,
    AxisFit,
    DataReduction,
    Extinction,
    FourierFit,
    Harmonic,
    analyzer_channels,
    block_means,
    extinction,
    fit_axis,
    fit_scan,
    half_turn,
    linear_states,
    measured_data_reduction,
    pooled_diattenuation,
)
from rigctl.base.numbers import wild_numbers
from rigctl.calibrations.kinds import Measured
from rigctl.errors import ConfigError, DataError
from rigctl.files.csv_table import csv_rows
from rigctl.files.regions import Region, masks
from rigctl.files.toml import Section, Uncertain, load
from rigctl.runs.folder import Run
from rigctl.runs.records import FrameRecord

GeneratorAngle = Callable[[FrameRecord], float]

_CSV_KEYS = ("sequence", "cycle")
_ANGLE = "angle_deg"


class _GeneratorFile(Section):
    schema_version: Literal[1] = 1
    angle_deg: Annotated[list[float], Field(min_length=4)]


def load_generator(path: Path) -> GeneratorAngle:
    """Return the function that gives a frame's generator angle [deg], from a TOML or CSV file."""
    key, table = _read_csv(path) if path.suffix.lower() == ".csv" else ("cycle", _read_toml(path))

    def angle_deg(record: FrameRecord) -> float:
        number = record.cycle if key == "cycle" else record.sequence
        if number is None or number not in table:
            raise DataError(f"{path}: has no generator angle for frame {record.sequence} ({key} {number})")
        return table[number]

    return angle_deg


def _read_toml(path: Path) -> dict[int, float]:
    return dict(enumerate(load(path, _GeneratorFile).angle_deg))


def _read_csv(path: Path) -> tuple[str, dict[int, float]]:
    rows = csv_rows(path)
    columns = set(rows[0]) if rows else set()
    keys = [key for key in _CSV_KEYS if key in columns]
    if len(keys) != 1 or _ANGLE not in columns:
        raise ConfigError(f"{path}: needs the column {_ANGLE} and one of {', '.join(_CSV_KEYS)} in its first line")
    try:
        angles = {int(row[keys[0]] or ""): float(row[_ANGLE] or "") for row in rows}
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{path}: {error}; wanted are whole numbers of {keys[0]} and angles in degrees") from error
    wild = [f"{key}: {problem}" for key, problem in wild_numbers(angles, _ANGLE)]
    if wild:
        raise ConfigError("\n  ".join([f"{path}:", *wild]))
    return keys[0], angles


FloatArray = NDArray[np.float64]

# Largest difference of stage angles that are one angle [deg]; stages land within hundredths.
_ONE_ANGLE_DEG = 0.2
# Number of pixels of a region that may be saturated, as hot ones are; they are left out of all frames of a scan.
_FEW_SATURATED = 1e-3


def analyzer_scan(run: Run, region: Region | None) -> tuple[FloatArray, FloatArray]:
    """Return angles of the stage (K,) [rad] in front of a fixed reference, and mean counts of a region (K,) [DN]."""
    records = scene_frames(run)
    return np.radians([_stage_deg(run, record) for record in records]), _signals_dn(run, records, region)


def generator_scan(
    run: Run, region: Region | None, generator_deg: GeneratorAngle
) -> tuple["GeneratorCells", FloatArray]:
    """Return the cells of a generator scan, and mean counts of a region at each of them, repeats averaged [DN]."""
    records = scene_frames(run)
    cells = generator_cells(run, records, generator_deg)
    signals = _signals_dn(run, records, region)
    return cells, np.array([[np.mean(signals[list(cell)]) for cell in row] for row in cells.frames])


@dataclass(frozen=True, kw_only=True, eq=False)
class GeneratorCells:
    """Frames at each generator angle (K,) and stage angle (N,) [rad]: indices in a list of records."""

    generator_rad: FloatArray
    stage_rad: FloatArray
    frames: tuple[tuple[tuple[int, ...], ...], ...]


def generator_cells(run: Run, records: Sequence[FrameRecord], generator_deg: GeneratorAngle) -> GeneratorCells:
    """Return the frames of a generator scan at each pair of angles."""
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
    """Return the number of the stage angle of each frame, and these angles, ascending from 0 [deg].

    A readback differs a little from frame to frame, also across 0: 359.998 and 0.003 deg are one angle.
    """
    # From just below 0, so that angles near 0 stay together.
    turned = (angles_deg + _ONE_ANGLE_DEG) % 360.0 - _ONE_ANGLE_DEG
    order = np.argsort(turned, kind="stable")
    numbers = np.cumsum(np.diff(turned[order], prepend=turned[order[0]]) > _ONE_ANGLE_DEG)
    groups = np.empty(len(turned), dtype=np.int64)
    groups[order] = numbers
    means = np.array([turned[groups == group].mean() for group in range(int(numbers[-1]) + 1)])
    return groups.tolist(), means


def scene_frames(run: Run) -> list[FrameRecord]:
    """Return the scene frames of a run, which have one exposure."""
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
    return means - float(_dark(run, records[0], lambda counts: np.asarray(counts[inside].mean())))


def _saturated(run: Run, records: Sequence[FrameRecord], inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the pixels that are saturated in any frame; refuse a region where they are more than a few hot pixels."""
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


def _dark(run: Run, scene: FrameRecord, of: Callable[[NDArray[np.uint16]], FloatArray]) -> FloatArray:
    """Return means of counts without light, at the exposure of a scene frame."""
    darks = [record for record in run.frames if record.kind == "dark" and record.exposure_s == scene.exposure_s]
    if darks:
        return np.asarray(np.mean([of(run.counts(record)) for record in darks], axis=0))
    if scene.black_level_dn is not None:
        return np.full_like(of(run.counts(scene)), scene.black_level_dn)
    raise DataError(
        f"{run.path}: the counts without light are not known; a dark level that stays in lowers the extinction ratio: "
        f"add dark frames at the exposure of the scan"
    )


# A number is significant if it is this many of its standard errors above 0.
_SEEN_SIGMAS = 5.0


@dataclass(frozen=True, kw_only=True)
class KnownLight:
    """Light of a scan that is known beforehand."""

    axis_error_rad: float = 0.0  #: Standard error of the direction of reference or generator [rad].
    dolp: Uncertain | None = None  #: Degree of linear polarization of reference or generator.
    expected_rad: float | None = None  #: The offset, roughly, and its error [rad].
    expected_error_rad: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class ScanCurve:
    """Light against the angle of what turned, and the law fitted to it."""

    label: str  #: the element that stood still, such as "stage at 45.0 deg"
    angle_rad: FloatArray  #: Points of the scan.
    signal_dn: FloatArray
    fit: FourierFit  #: Malus' law.
    harmonics: tuple[Harmonic, ...]  #: of the residual

    @classmethod
    def of(cls, label: str, angle_rad: FloatArray, signal_dn: FloatArray) -> "ScanCurve":
        """Return the curve of a scan."""
        fit, harmonics = fit_scan(angle_rad, signal_dn)
        if float(fit.terms[0]) < _SEEN_SIGMAS * float(fit.mean_error()):
            raise DataError(f"{label}: there is no light above the dark level: check dark frames and region")
        if float(fit.modulation) < _SEEN_SIGMAS * float(fit.modulation_error()):
            raise DataError(
                f"{label}: the light changes with the angle by no more than noise ({float(fit.modulation):.2%} +- "
                f"{float(fit.modulation_error()):.2%}): is the polarizer, and what polarizes the light, in its place?"
            )
        return cls(
            label=label,
            angle_rad=angle_rad,
            signal_dn=signal_dn,
            fit=fit,
            harmonics=harmonics,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class PolarizerCalibration:
    """A polarizer in its stage; None where the scans cannot give a number."""

    axis: AxisFit  #: sense and offset
    extinction: Extinction | None  #: extinction ratio
    diattenuation: float | None
    diattenuation_error: float | None
    channels: AnalyzerChannels | None = None  #: each analyzer angle by itself
    stage_rad: FloatArray | None = None  #: stage angles of the channels [rad]
    reduction: DataReduction | None = None  #: W, for intensities over twice their mean
    #: residuals of Malus' law, each of the scan that shows it best; none where no scan determines them
    harmonics: tuple[Harmonic, ...]
    curves: tuple[ScanCurve, ...]  #: the scans
    frames: int  #: number of frames

    @property
    def offset_deg(self) -> Measured[float]:
        """Polarizer angle where the stage stands at 0, of the sense that fits better [deg]."""
        return candidate_offset_deg(self.axis.best)


def candidate_offset_deg(candidate: AxisCandidate) -> Measured[float]:
    """Return the offset of a sense [deg]."""
    value, error = np.degrees([candidate.offset_rad, candidate.std_error_rad]).tolist()
    return Measured(value=value, std_error=error)


def from_references(
    scans: Sequence[tuple[FloatArray, FloatArray]], references_rad: Sequence[float], known: KnownLight
) -> PolarizerCalibration:
    """Return the calibration by scans of the stage in front of fixed references, each as `analyzer_scan` has it."""
    curves = tuple(
        ScanCurve.of(f"reference at {np.degrees(reference):.1f} deg", *scan)
        for scan, reference in zip(scans, references_rad, strict=True)
    )
    fits = [curve.fit for curve in curves]
    axis = _axis(
        known,
        axis_rad=np.array(references_rad),
        stage_rad=np.array([float(fit.phase_rad) for fit in fits]),
        std_error_rad=np.array([float(fit.phase_error_rad()) for fit in fits]),
    )
    weights = np.array([float(fit.modulation_error()) for fit in fits]) ** -2.0
    modulation = float(weights @ [float(fit.modulation) for fit in fits] / weights.sum())
    return _calibration(axis, curves, modulation, float(weights.sum() ** -0.5), known.dolp)


def from_generator(cells: GeneratorCells, signal_dn: FloatArray, known: KnownLight) -> PolarizerCalibration:
    """Return the calibration by a generator that turns; without a stated DoLP it is taken as perfect."""
    dolp = known.dolp or Uncertain(value=1.0)
    channels = analyzer_channels(cells.generator_rad, signal_dn, generator_dolp=dolp.value)
    curves = tuple(
        ScanCurve.of(f"stage at {np.degrees(stage):.1f} deg", cells.generator_rad, column)
        for stage, column in zip(cells.stage_rad.tolist(), signal_dn.T, strict=True)
    )
    if not any(curve.harmonics for curve in curves):
        # Harmonics of the generator may turn all channels equally.
        squares = [float(curve.fit.phase_error_rad()) ** 2 for curve in curves] - np.square(channels.axis_error_rad)
        known = replace(known, axis_error_rad=float(np.hypot(known.axis_error_rad, np.sqrt(np.mean(squares)))))
    axis = _axis(
        known,
        axis_rad=channels.axis_rad,
        stage_rad=cells.stage_rad,
        std_error_rad=channels.axis_error_rad,
    )
    pooled, pooled_error = (float(number) for number in pooled_diattenuation(channels))
    return replace(
        _calibration(axis, curves, pooled * dolp.value, pooled_error * dolp.value, dolp),
        channels=channels,
        stage_rad=cells.stage_rad,
        reduction=_reduction(cells, signal_dn, dolp.value),
        frames=sum(len(cell) for row in cells.frames for cell in row),
    )


def _axis(known: KnownLight, *, axis_rad: FloatArray, stage_rad: FloatArray, std_error_rad: FloatArray) -> AxisFit:
    return fit_axis(
        axis_rad=axis_rad,
        stage_rad=stage_rad,
        std_error_rad=std_error_rad,
        common_error_rad=known.axis_error_rad,
        expected_rad=known.expected_rad,
        expected_error_rad=known.expected_error_rad,
    )


def _calibration(
    axis: AxisFit, curves: tuple[ScanCurve, ...], modulation: float, error: float, dolp: Uncertain | None
) -> PolarizerCalibration:
    """Return the calibration of scans that show a modulation; the DoLP of their light gives the extinction."""
    clearest: dict[int, Harmonic] = {}
    for one in (harmonic for curve in curves for harmonic in curve.harmonics):
        before = clearest.get(one.order)
        if before is None or one.amplitude * before.std_error > before.amplitude * one.std_error:
            clearest[one.order] = one
    diattenuation = diattenuation_error = ratio = None
    if dolp is not None:
        diattenuation = modulation / dolp.value
        diattenuation_error = float(np.hypot(error / dolp.value, diattenuation * dolp.std / dolp.value))
        ratio = extinction(diattenuation, diattenuation_error)
    return PolarizerCalibration(
        axis=axis,
        extinction=ratio,
        diattenuation=diattenuation,
        diattenuation_error=diattenuation_error,
        harmonics=tuple(clearest[order] for order in sorted(clearest)),
        curves=curves,
        frames=sum(len(curve.signal_dn) for curve in curves),
    )


def _reduction(cells: GeneratorCells, signal_dn: FloatArray, dolp: float) -> DataReduction | None:
    if len(cells.stage_rad) < 3:
        return None
    # A perfect analyzer passes half of unpolarized light, so that W gives Stokes parameters of S0 = 1.
    scaled = signal_dn / (2.0 * signal_dn.mean())
    return measured_data_reduction(linear_states(cells.generator_rad, dolp=dolp), scaled.T)


BoolArray = NDArray[np.bool_]

# Blocks with less than this share of the median light would give noise and are left out.
_LEAST_LIGHT = 0.05
# Scans of more are fitted in bands of rows of blocks.
_BAND_BYTES = 256_000_000


@dataclass(frozen=True, kw_only=True, eq=False)
class PolarimeterMaps:
    """Each block of the picture by itself."""

    side_pixels: int  #: Of a block.
    lit: BoolArray  #: Blocks that have light and are not saturated; V of them.
    stage_rad: FloatArray  #: Stage angles [rad].
    channels: AnalyzerChannels  #: Of the V blocks, row by row: arrays (N, V).

    def picture(self, values: FloatArray) -> FloatArray:
        """Return numbers of the lit blocks (..., V) as pictures (..., h, w), NaN elsewhere."""
        found = np.full((*values.shape[:-1], *self.lit.shape), np.nan)
        found[..., self.lit] = values
        return found

    def axis_off_mean_rad(self) -> FloatArray:
        """Return the axis of each block minus the mean over blocks, (N, V) [rad]."""
        axis = self.channels.axis_rad
        mean = 0.5 * np.angle(np.mean(np.exp(2j * axis), axis=1))
        return half_turn(axis - mean[:, None])

    def named(self) -> Mapping[str, FloatArray]:
        """Return the maps of the file by name."""
        one = self.channels
        return {
            "stage_angle_deg": np.degrees(self.stage_rad),
            "side_pixels": np.array(float(self.side_pixels)),
            "axis_deg": self.picture(np.degrees(one.axis_rad) % 180.0),
            "axis_error_deg": self.picture(np.degrees(one.axis_error_rad)),
            "throughput": self.picture(one.throughput),
            "throughput_error": self.picture(one.throughput_error),
            "diattenuation": self.picture(one.diattenuation),
            "diattenuation_error": self.picture(one.diattenuation_error),
        }

    def npz(self) -> bytes:
        """Return the maps as the bytes of a NumPy archive."""
        buffer = io.BytesIO()
        arrays: dict[str, Any] = dict(self.named())
        np.savez_compressed(buffer, **arrays)
        return buffer.getvalue()


def polarimeter_maps(
    run: Run, generator_deg: GeneratorAngle, *, side_pixels: int, generator_dolp: float
) -> PolarimeterMaps:
    """Return the maps of a generator scan."""
    records = scene_frames(run)
    cells = generator_cells(run, records, generator_deg)
    dark = _dark(run, records[0], lambda counts: block_means(counts, side_pixels))
    rows = max(1, _BAND_BYTES // (8 * cells.generator_rad.size * cells.stage_rad.size * dark.shape[1]))
    bands = [slice(first, first + rows) for first in range(0, len(dark), rows)]

    @lru_cache(maxsize=1)
    def scan_of(place: int) -> tuple[FloatArray, BoolArray]:
        return _scan(run, records, cells, dark[bands[place]], side_pixels, first_row=bands[place].start)

    scans = (scan_of(place) for place in range(len(bands)))
    # Smallest light of each block over the stage angles.
    lights, saturated = zip(*((scan.mean(axis=0).min(axis=0), full) for scan, full in scans), strict=True)
    light = np.concatenate(lights)
    lit = ~np.concatenate(saturated) & (light > _LEAST_LIGHT * np.median(light))
    if not lit.any():
        raise DataError(f"{run.path}: no block of the picture has light without being saturated")
    parts = [
        analyzer_channels(cells.generator_rad, scan_of(place)[0][..., lit[band]], generator_dolp=generator_dolp)
        for place, band in enumerate(bands)
        if lit[band].any()
    ]
    return PolarimeterMaps(side_pixels=side_pixels, lit=lit, stage_rad=cells.stage_rad, channels=_joined(parts))


def _scan(
    run: Run,
    records: Sequence[FrameRecord],
    cells: GeneratorCells,
    dark: FloatArray,
    side_pixels: int,
    *,
    first_row: int,
) -> tuple[FloatArray, BoolArray]:
    """Return counts minus dark of a band of rows of blocks, (K, N, rows, w), and the pixels saturated in any frame."""
    scan = np.zeros((cells.generator_rad.size, cells.stage_rad.size, *dark.shape))
    saturated = np.zeros(dark.shape, dtype=np.bool_)
    rows = slice(first_row * side_pixels, (first_row + len(dark)) * side_pixels)
    for k, n in np.ndindex(scan.shape[:2]):
        for place in cells.frames[k][n]:
            counts = run.counts(records[place])[rows]
            saturated |= block_means(counts >= records[place].saturation_dn, side_pixels) > 0.0
            scan[k, n] += block_means(counts, side_pixels) - dark
        scan[k, n] /= len(cells.frames[k][n])
    return scan, saturated


def _joined(parts: Sequence[AnalyzerChannels]) -> AnalyzerChannels:
    """Return the channels of all bands."""
    scans = [part.scan for part in parts]
    terms = np.concatenate([scan.terms for scan in scans], axis=2)
    variance = np.concatenate([scan.variance for scan in scans], axis=1)
    joined = {
        field.name: np.concatenate([getattr(part, field.name) for part in parts], axis=1)
        for field in fields(AnalyzerChannels)
        if field.name != "scan"
    }
    return AnalyzerChannels(**joined, scan=replace(scans[0], terms=terms, variance=variance))
