"""The analyzer over the picture: throughput, diattenuation and axis of each stage angle, block by block."""

import io
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.polarimeter.analyzer import AnalyzerChannels, analyzer_channels
from calibration.polarimeter.axis import half_turn
from calibration.polarimeter.data_reduction import block_means
from rigctl.calibrations.polarizer.generator_file import GeneratorAngle
from rigctl.calibrations.polarizer.scan_frames import dark_frames, generator_cells, scene_frames
from rigctl.errors import DataError
from rigctl.runs.frame_record import FrameRecord
from rigctl.runs.run_folder import Run

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

# Blocks with less than this share of the median light are left out: their numbers would be noise.
_LEAST_LIGHT = 0.05


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
        Of a block; 1 for each pixel by itself, which takes the memory of all frames.
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
    saturated, means = np.zeros(dark.shape, dtype=np.bool_), []
    for record in records:
        counts = run.counts(record)
        saturated |= block_means(counts >= record.saturation_dn, side_pixels) > 0.0
        means.append(block_means(counts, side_pixels) - dark)
    signals = np.array(means)
    scan = np.array([[signals[list(cell)].mean(axis=0) for cell in row] for row in cells.frames])
    light = scan.mean(axis=0).min(axis=0)
    lit = ~saturated & (light > _LEAST_LIGHT * np.median(light))
    if not lit.any():
        raise DataError(f"{run.path}: no block of the picture has light without being saturated")
    return PolarimeterMaps(
        side_pixels=side_pixels,
        lit=lit,
        stage_rad=cells.stage_rad,
        channels=analyzer_channels(cells.generator_rad, scan[..., lit], generator_dolp=generator_dolp),
    )


def _dark(run: Run, scene: FrameRecord, side_pixels: int) -> FloatArray:
    darks = dark_frames(run, scene)
    if darks:
        return np.asarray(np.mean([block_means(run.counts(record), side_pixels) for record in darks], axis=0))
    if scene.black_level_dn is None:
        raise DataError(f"{run.path}: nothing says how many counts there are without light: add dark frames")
    return np.full_like(block_means(run.counts(scene), side_pixels), scene.black_level_dn)
