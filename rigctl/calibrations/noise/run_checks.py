"""Flags of a run by its records: exposures in a wrong unit, a camera that warms up."""

from collections.abc import Sequence
from itertools import pairwise

from calibration.results import Flag
from rigctl.runs.frame_record import FrameRecord

_NS_PER_S = 1e9
# A camera may read one frame out while it exposes the next, but exposes only one.
_LEAST_SPACING = 0.5
_DRIFT_C = 3.0


def record_flags(records: Sequence[FrameRecord]) -> tuple[Flag, ...]:
    """Return what is odd in how frames were taken.

    Parameters
    ----------
    records : sequence of FrameRecord
        Dark and flat frames, in the order in which they were taken.
    """
    found = (_too_close(records), _temperature_drift(records))
    return tuple(flag for flag in found if flag is not None)


def _too_close(records: Sequence[FrameRecord]) -> Flag | None:
    for before, after in pairwise(records):
        if before.start_monotonic_ns is None or after.start_monotonic_ns is None or not before.exposure_s:
            continue
        spacing_s = (after.start_monotonic_ns - before.start_monotonic_ns) / _NS_PER_S
        if 0.0 < spacing_s < _LEAST_SPACING * before.exposure_s:
            return Flag(
                name="wrong_time_unit",
                message=f"frame {before.sequence} was exposed for {before.exposure_s:g} s by its record, but the next "
                f"one began {spacing_s:.3g} s later: exposures are stated in another unit than seconds (ms?), "
                f"and dark current would be as much too small: correct the exposures",
                refuses=True,
            )
    return None


def _temperature_drift(records: Sequence[FrameRecord]) -> Flag | None:
    temperatures = [one.camera_temperature_c for one in records if one.camera_temperature_c is not None]
    if not temperatures or max(temperatures) - min(temperatures) < _DRIFT_C:
        return None
    return Flag(
        name="temperature_drift",
        message=f"the camera was {min(temperatures):.1f} to {max(temperatures):.1f} C warm (at most {_DRIFT_C:g} C of "
        f"drift is expected): dark current doubles every 6 to 8 C, and darks may not fit their flats: let it warm up",
    )
