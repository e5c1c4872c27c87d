"""A noise calibration from its frames to its file."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

from calibration.results import CalibrationError, Flag, RefusedFramesError, by_consequence
from calibration.sensor.levels import LevelStatistics, level_statistics
from calibration.sensor.noise import NoiseCalibration, calibrate_noise, with_pattern
from calibration.sensor.pattern import FixedPattern, fixed_pattern
from rigctl.calibrations.noise.noise_frames import FrameGroup, FrameSet
from rigctl.calibrations.noise.noise_json import noise_json, pattern_json
from rigctl.console.json_text import Json
from rigctl.errors import DataError

# Levels that are measured at a time; more only press on the memory.
_WORKERS = min(4, os.cpu_count() or 1)

LevelDone = Callable[[int, int], None]


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameCalibration:
    """A noise calibration, and the frames that it was made from.

    Attributes
    ----------
    noise : NoiseCalibration
        The numbers.
    pattern : FixedPattern or None
        The fixed pattern pixel by pixel; None where no flat is brighter than its dark.
    frames : FrameSet
        What it was made from.
    """

    noise: NoiseCalibration
    pattern: FixedPattern | None
    frames: FrameSet

    def as_json(self, *, created_ns: int) -> dict[str, Json]:
        """Return the content of noise.json, made at a time [ns since 1970 UTC]."""
        return noise_json(self.noise, self.frames, utc_ns=lambda: created_ns) | {
            "fixed_pattern": None if self.pattern is None else pattern_json(self.pattern)
        }


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

    Notes
    -----
    Each frame is read once. Where several levels have as many frames as the one that the fixed pattern is taken from,
    that one's are read a second time, so that memory does not grow with the number of levels.
    """
    if any(flag.refuses for flag in frames.flags):
        raise RefusedFramesError(frames.flags)
    groups = [group for group in frames.groups if len(group.loaders) > 1]
    levels = []
    # Reading and arithmetic both let go of the interpreter; a level in work holds a few pictures.
    with ThreadPoolExecutor(max_workers=_WORKERS) as pool:
        measured = pool.map(_measure, groups, [_is_the_stack(group, groups) for group in groups])
        for done, level in enumerate(measured, start=1):
            levels.append(level)
            if level_done is not None:
                level_done(done, len(groups))
    noise = calibrate_noise(levels, bit_depth=frames.camera.bit_depth, stated=frames.stated)
    pattern = _fixed_pattern(noise, dict(zip(map(id, levels), groups, strict=True)))
    noise = with_pattern(noise, pattern)
    flags = (*noise.flags, *frames.flags)
    if singles := len(frames.groups) - len(groups):
        flags += (_single_frames(singles),)
    return FrameCalibration(noise=replace(noise, flags=by_consequence(flags)), pattern=pattern, frames=frames)


def _is_the_stack(group: FrameGroup, groups: Sequence[FrameGroup]) -> bool:
    """Return whether a group has more frames than any other of its kind: the fixed pattern will be taken from it."""
    others = [len(other.loaders) for other in groups if other.kind == group.kind and other is not group]
    return len(group.loaders) > max(others, default=0)


def _measure(group: FrameGroup, keep_picture: bool) -> LevelStatistics:
    try:
        return level_statistics(
            (load() for load in group.loaders),
            kind=group.kind,
            exposure_s=group.exposure_s,
            photons=group.photons,
            keep_picture=keep_picture,
        )
    except CalibrationError as error:
        raise DataError(f"{group.kind} frames at {group.exposure_s} s: {error}") from error


def _fixed_pattern(noise: NoiseCalibration, groups: dict[int, FrameGroup]) -> FixedPattern | None:
    chosen = noise.darks[noise.spatial.dark], noise.flats[noise.spatial.flat]
    dark, flat = (
        level if level.picture is not None else _measure(groups[id(level)], keep_picture=True) for level in chosen
    )
    return fixed_pattern(dark, flat)


def _single_frames(levels: int) -> Flag:
    return Flag(
        name="single_frames",
        message=f"single dark or flat frames ({levels} of them) show no noise of their own and are left out: "
        f"take two frames or more at each exposure",
    )
