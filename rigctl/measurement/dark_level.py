"""The dark level of a run, taken off its counts before anything is made of them, and its source."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.calibrations.noise.noise_file import NoiseParameters
from rigctl.errors import DataError
from rigctl.measurement.frame_grid import FrameGrid
from rigctl.runs.frame_record import FrameRecord
from rigctl.runs.run_folder import Run

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class DarkLevel:
    """One number per polarizer angle that is taken off every pixel.

    Attributes
    ----------
    level_dn : (N,) array
        [DN].
    std_error_dn : float
        Standard error of it, common to all angles [DN].
    source : str
        Where it comes from, in words for a report.
    """

    level_dn: FloatArray
    std_error_dn: float
    source: str


def find_dark_level(run: Run, grid: FrameGrid, noise: NoiseParameters | None) -> DarkLevel:
    """Return the dark level by the best source there is.

    In this order: dark frames of the run at the exposure of its scene frames; the black level that the frames
    state; black level and dark current of a noise calibration.

    Raises
    ------
    DataError
        There is no source. A dark level that stays in lowers every DoLP, so none is made up.
    """
    darks = _matching_darks(run, grid)
    if darks:
        return _from_dark_frames(run, grid, darks)
    stated = [record.black_level_dn for record in grid.records[0]]
    known = [level for level in stated if level is not None]
    if len(known) == len(stated):
        return DarkLevel(
            level_dn=np.array(known), std_error_dn=0.0, source="the black level that the frames state, taken as exact"
        )
    if noise is not None:
        return _from_calibration(grid, noise)
    raise DataError(
        f"{run.path}: nothing says how many counts there are without light: add dark frames of the same exposure "
        "(rigctl import --kind dark), a black level (--black-level-dn), or a calibration (--noise)"
    )


def _matching_darks(run: Run, grid: FrameGrid) -> list[FrameRecord]:
    """Return the dark frames of the scene frames' exposure and gain, where that is one."""
    first = grid.records[0][0]
    if not grid.is_one_exposure:
        return []
    return [
        record
        for record in run.frames
        if record.kind == "dark"
        and record.gain_db == first.gain_db
        and (record.width, record.height) == (first.width, first.height)
        and _same_exposure(record.exposure_s, first.exposure_s)
    ]


def _same_exposure(one_s: float | None, other_s: float | None) -> bool:
    if one_s is None or other_s is None:
        return one_s is other_s
    return abs(one_s - other_s) <= 1e-6 * other_s


def _from_dark_frames(run: Run, grid: FrameGrid, darks: list[FrameRecord]) -> DarkLevel:
    mean = np.zeros((grid.height, grid.width))
    for record in darks:
        mean += run.counts(record)
    mean /= len(darks)
    error = float(mean.std() / np.sqrt(mean.size))
    plural = "frame" if len(darks) == 1 else "frames"
    return DarkLevel(
        level_dn=np.full(grid.angles, mean.mean()),
        std_error_dn=error,
        source=f"{len(darks)} dark {plural} of this run at the same exposure (black level and dark current)",
    )


def _from_calibration(grid: FrameGrid, noise: NoiseParameters) -> DarkLevel:
    black, dark_current = noise.black_level_dn, noise.dark_current_e_per_s
    level = np.full(grid.angles, black.value)
    known = dark_current is not None and grid.exposures_s is not None
    if dark_current is not None and grid.exposures_s is not None:
        level += noise.gain_dn_per_e.value * dark_current.value * grid.exposures_s
    what = "black level and dark current" if known else "black level (the dark current is not known and stays in)"
    return DarkLevel(level_dn=level, std_error_dn=black.std_error, source=f"the noise calibration: {what}")
