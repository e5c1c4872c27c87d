"""The analyzer over the picture: throughput, diattenuation and axis of each stage angle, block by block."""

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.polarimeter.analyzer import AnalyzerChannels, analyzer_channels, block_means, half_turn
from rigctl.calibrations.polarizer.generator_file import GeneratorAngle
from rigctl.calibrations.polarizer.scan_frames import GeneratorCells, dark_frames, generator_cells, scene_frames
from rigctl.errors import DataError
from rigctl.runs.frame_record import FrameRecord
from rigctl.runs.run_folder import Run

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

# Blocks with less than this share of the median light are left out: their numbers would be noise.
_LEAST_LIGHT = 0.05
# Scans of more are fitted in bands of rows of blocks.
_BAND_BYTES = 256_000_000


@dataclass(frozen=True, kw_only=True, eq=False)
class PolarimeterMaps:
    """Each block of the picture by itself.

    Attributes
    ----------
    side_pixels : int
        Of a block.
    lit : (h, w) array of bool
        Blocks that have light and are not saturated; V of them.
    stage_rad : (N,) array
        Stage angles [rad].
    channels : AnalyzerChannels
        Of the V blocks, row by row: arrays (N, V).
    """

    side_pixels: int
    lit: BoolArray
    stage_rad: FloatArray
    channels: AnalyzerChannels

    def picture(self, values: FloatArray) -> FloatArray:
        """Return numbers of the lit blocks (..., V) as pictures (..., h, w); not a number where there is no light."""
        found = np.full((*values.shape[:-1], *self.lit.shape), np.nan)
        found[..., self.lit] = values
        return found

    def axis_off_mean_rad(self) -> FloatArray:
        """Return how far the axis of each block is from the mean over blocks, (N, V) [rad]."""
        axis = self.channels.axis_rad
        mean = 0.5 * np.angle(np.mean(np.exp(2j * axis), axis=1))
        return half_turn(axis - mean[:, None])

    def named(self) -> Mapping[str, FloatArray]:
        """Return the maps by their names, as the file holds them."""
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
    """Return the maps of a generator scan.

    Parameters
    ----------
    run : Run
        Of one exposure, with dark frames of it or a black level.
    generator_deg : callable
        Generator angle of a frame [deg].
    side_pixels : int
        Of a block; 1 for each pixel by itself. Beyond 256 MB the picture is fitted in bands of rows, and each frame is
        read twice for every band.
    generator_dolp : float
        Degree of linear polarization that the generator makes.

    Raises
    ------
    DataError
        Pairs of angles have no frame, there is no dark level, or no block has light.
    CalibrationError
        Blocks do not fit into the picture, or angles do not determine the fit.
    """
    records = scene_frames(run)
    cells = generator_cells(run, records, generator_deg)
    dark = _dark(run, records[0], side_pixels)
    rows = max(1, _BAND_BYTES // (8 * cells.generator_rad.size * cells.stage_rad.size * dark.shape[1]))
    bands = [slice(first, first + rows) for first in range(0, len(dark), rows)]

    @lru_cache(maxsize=1)
    def scan_of(place: int) -> tuple[FloatArray, BoolArray]:
        return _scan(run, records, cells, dark[bands[place]], side_pixels, first_row=bands[place].start)

    seen = [_light(*scan_of(place)) for place in range(len(bands))]
    light, saturated = (np.concatenate(parts) for parts in zip(*seen, strict=True))
    lit = ~saturated & (light > _LEAST_LIGHT * np.median(light))
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
    """Return counts less dark of a band of rows of blocks, (K, N, rows, w), and what is saturated in any frame."""
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


def _light(scan: FloatArray, saturated: BoolArray) -> tuple[FloatArray, BoolArray]:
    """Return the least light of a band over the stage angles, and what is saturated."""
    return scan.mean(axis=0).min(axis=0), saturated


def _joined(parts: Sequence[AnalyzerChannels]) -> AnalyzerChannels:
    """Return the channels of all bands."""
    scans = [part.scan for part in parts]
    return AnalyzerChannels(
        throughput=np.concatenate([part.throughput for part in parts], axis=1),
        throughput_error=np.concatenate([part.throughput_error for part in parts], axis=1),
        diattenuation=np.concatenate([part.diattenuation for part in parts], axis=1),
        diattenuation_error=np.concatenate([part.diattenuation_error for part in parts], axis=1),
        axis_rad=np.concatenate([part.axis_rad for part in parts], axis=1),
        axis_error_rad=np.concatenate([part.axis_error_rad for part in parts], axis=1),
        scan=replace(
            scans[0],
            terms=np.concatenate([scan.terms for scan in scans], axis=2),
            variance=np.concatenate([scan.variance for scan in scans], axis=1),
        ),
    )


def _dark(run: Run, scene: FrameRecord, side_pixels: int) -> FloatArray:
    darks = dark_frames(run, scene)
    if darks:
        return np.asarray(np.mean([block_means(run.counts(record), side_pixels) for record in darks], axis=0))
    if scene.black_level_dn is None:
        raise DataError(f"{run.path}: nothing says how many counts there are without light: add dark frames")
    return np.full_like(block_means(run.counts(scene), side_pixels), scene.black_level_dn)
