"""Names of levels in messages."""

from collections.abc import Sequence

from calibration.sensor.frame_statistics import LevelStatistics

_NAMED = 3


def describe_level(level: LevelStatistics) -> str:
    """Return a level's name for a message."""
    exposure = "unknown exposure" if level.exposure_s is None else f"{level.exposure_s * 1e3:.6g} ms"
    photons = "" if level.photons is None else f"{level.photons:.6g} photons, "
    return f"{level.kind} at {exposure} ({photons}mean {level.mean_dn:.4g} DN)"


def level_names(levels: Sequence[LevelStatistics]) -> str:
    """Return the names of several levels, the first three in full."""
    named = ", ".join(describe_level(level) for level in levels[:_NAMED])
    return named if len(levels) <= _NAMED else f"{named} and {len(levels) - _NAMED} more"
