"""Frames divided by the throughput of their polarizer angle, as a polarizer calibration has measured it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.calibrations.polarizer.polarizer_file import Channel, PolarizerParameters
from rigctl.errors import DataError
from rigctl.measurement.frame_grid import FrameGrid
from rigctl.numbers.angles import wrapped
from rigctl.runs.frame_record import FrameRecord

FloatArray = NDArray[np.float64]

# A frame this near to a calibrated stage angle has its throughput.
_NEAR_DEG = 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Throughput:
    """Response to unpolarized light by channel, mean over the calibrated angles 1, and its standard error, (N,)."""

    value: FloatArray
    error: FloatArray


def together(one: Throughput | None, other: Throughput | None) -> Throughput | None:
    """Return two throughputs as one; None where there is none."""
    if one is None or other is None:
        return one or other
    return Throughput(value=one.value * other.value, error=np.hypot(one.error, other.error))


def throughput_of(grid: FrameGrid, polarizer: PolarizerParameters) -> Throughput | None:
    """Return the throughput of each channel of a run; None where the calibration did not measure it.

    Parameters
    ----------
    grid : FrameGrid
        Of the run.
    polarizer : PolarizerParameters
        A polarizer calibration. References alone do not measure throughput; a generator does.

    Raises
    ------
    DataError
        It was measured, but not at a stage angle of the run.
    """
    if polarizer.channels is None:
        return None
    found = [_nearest(polarizer.channels, record).throughput for record in grid.records[0]]
    return Throughput(
        value=np.array([one.value for one in found]),
        error=np.array([one.std_error for one in found]),
    )


def _nearest(channels: Sequence[Channel], record: FrameRecord) -> Channel:
    known = np.array([one.stage_angle_deg for one in channels])
    if record.stage_angle_deg is None:
        raise DataError(f"{record.file} has no stage angle; the throughput of a polarizer goes by it")
    apart = np.abs(wrapped(known - record.stage_angle_deg, turn=360.0))
    if apart.min() > _NEAR_DEG:
        raise DataError(
            f"{record.file} was taken at stage angle {record.stage_angle_deg:.2f} deg; the polarizer calibration has "
            f"throughput at {', '.join(f'{angle:.1f}' for angle in known)} deg: calibrate at the angles that are used"
        )
    return channels[int(np.argmin(apart))]
