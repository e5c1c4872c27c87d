"""A noise calibration from its frames to its file."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from calibration.errors import CalibrationError
from calibration.flags import Flag
from calibration.frame_statistics import LevelStatistics, level_statistics
from calibration.noise import NoiseCalibration, calibrate_noise
from rigctl.errors import DataError
from rigctl.noise.noise_file import noise_json, write_noise_file
from rigctl.noise.noise_frames import FrameGroup, FrameSet, run_frames

# Levels that are measured at a time; more only press on the memory.
_WORKERS = min(4, os.cpu_count() or 1)

LevelDone = Callable[[int, int], None]


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameCalibration:
    """A noise calibration, and the frames that it was made from."""

    noise: NoiseCalibration
    frames: FrameSet

    def as_json(self) -> dict[str, Any]:
        """Return the content of noise.json."""
        return noise_json(self.noise, self.frames)


def calibrate_run(run: Path, out: Path) -> None:
    """Calibrate from the dark and flat frames of a run folder, and write the calibration file.

    Raises
    ------
    DataError, CalibrationError
        The frames are unfit; nothing is written.
    """
    write_noise_file(out, calibrate_frames(run_frames(run)).as_json())


def calibrate_frames(frames: FrameSet, *, level_done: LevelDone | None = None) -> FrameCalibration:
    """Return the noise calibration of a set of frames.

    Parameters
    ----------
    frames : FrameSet
        Dark and flat frames.
    level_done : callable or None
        Told after each level how many of how many are done.

    Raises
    ------
    DataError
        A frame cannot be read.
    CalibrationError
        The frames are unfit; a ``RefusedFramesError`` holds the flags.
    """
    groups = [group for group in frames.groups if len(group.loaders) > 1]
    levels = []
    # Reading and arithmetic both let go of the interpreter; a level in work holds a few pictures.
    with ThreadPoolExecutor(max_workers=_WORKERS) as pool:
        for done, level in enumerate(pool.map(_measure, groups), start=1):
            levels.append(level)
            if level_done is not None:
                level_done(done, len(groups))
    noise = calibrate_noise(levels, bit_depth=frames.camera.bit_depth)
    singles = len(frames.groups) - len(groups)
    if singles:
        noise = replace(noise, flags=(*noise.flags, _single_frames(singles)))
    return FrameCalibration(noise=noise, frames=frames)


def _measure(group: FrameGroup) -> LevelStatistics:
    try:
        return level_statistics(
            (load() for load in group.loaders), kind=group.kind, exposure_s=group.exposure_s, photons=group.photons
        )
    except CalibrationError as error:
        raise DataError(f"{group.kind} frames at {group.exposure_s} s: {error}") from error


def _single_frames(levels: int) -> Flag:
    return Flag(
        name="single_frames",
        message=f"single dark or flat frames ({levels} of them) show no noise of their own and are left out: "
        f"take two frames or more at each exposure",
    )
