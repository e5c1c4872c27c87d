"""What must be so before a frame counts, and before the next is taken: each check says what it found."""

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceError, LimitError, ProtocolError
from drivers.interfaces import CameraSettings
from rigctl.errors import DataError
from rigctl.files.interlock_section import InterlockSection
from rigctl.sessions.shot import Shot

Name = Literal[
    "angle", "button", "settings", "identical", "black", "saturated", "sum_rule", "disk", "clock", "queue", "gone"
]
# A camera that takes another exposure than it was told, by more than its own clock's step, is not to be trusted.
_EXPOSURE_TOLERANCE = 0.01
_BYTES_PER_MB = 1_000_000


@dataclass(frozen=True, kw_only=True)
class Trip:
    """An interlock that is not satisfied.

    Attributes
    ----------
    name : str
        Which; its action stands under this name in the session file.
    message : str
        What was found, and what to try.
    """

    name: Name
    message: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Taken:
    """One frame as it came, with what was asked for.

    Attributes
    ----------
    kind : str
        "scene", "dark" or "flat".
    shot : Shot
        The frame, and how it came about.
    tolerance_deg : float
        How far the readback may be off.
    last_counts : array or None
        The frame before.
    """

    kind: str
    shot: Shot
    tolerance_deg: float
    last_counts: NDArray[np.uint16] | None


def frame_trips(taken: Taken, section: InterlockSection) -> Iterator[Trip]:
    """Give every interlock that a frame violates."""
    shot = taken.shot
    yield from _stage_trips(shot, taken.tolerance_deg)
    if shot.frame.settings != shot.settings:
        text = f"camera: was set to {shot.settings} and took the frame with {shot.frame.settings}"
        yield Trip(name="settings", message=f"{text}: switch its automatic exposure and gain off")
    if _is_repeated(taken):
        text = f"camera: frame {shot.frame.sequence} is identical to the one before, down to the noise"
        yield Trip(name="identical", message=f"{text}: it sent an old picture again. Restart the camera")
    if _is_black(taken):
        text = f"camera: frame {shot.frame.sequence} has the value {shot.frame.counts.flat[0]} everywhere"
        yield Trip(name="black", message=f"{text}: no picture came. Check cable, bandwidth and lens cap")
    if taken.kind == "scene" and shot.saturated_fraction > section.saturated_fraction:
        text = f"{100 * shot.saturated_fraction:.2f} % of the pixels are saturated"
        yield Trip(name="saturated", message=f"{text}, allowed are {100 * section.saturated_fraction:g} %")


def settings_trip(*, exposure_s: float, gain_db: float, read_back: CameraSettings) -> Trip | None:
    """Return a trip where a camera says that it took other settings than it was told."""
    if abs(read_back.exposure_s - exposure_s) > _EXPOSURE_TOLERANCE * exposure_s:
        text = f"asked for an exposure of {exposure_s:g} s it says that it took {read_back.exposure_s:g} s"
        return Trip(name="settings", message=f"camera: {text}")
    if read_back.gain_db != gain_db:
        text = f"asked for a gain of {gain_db:g} dB it says that it took {read_back.gain_db:g} dB"
        return Trip(name="settings", message=f"camera: {text}")
    return None


def disk_trip(run: Path, section: InterlockSection) -> Trip | None:
    """Return a trip where the disk of a run is nearly full."""
    free_mb = shutil.disk_usage(run).free / _BYTES_PER_MB
    if free_mb >= section.disk_free_mb:
        return None
    text = f"{run}: {free_mb:.0f} MB are free on this disk, {section.disk_free_mb:g} MB are to stay so"
    return Trip(name="disk", message=f"{text}: make room")


def clock_trip(jump_s: float, section: InterlockSection) -> Trip | None:
    """Return a trip where the host's clock was set."""
    if abs(jump_s) <= section.clock_jump_s:
        return None
    text = f"the host's clock was set by {jump_s:+.1f} s; the schedule keeps to the time by which it began"
    return Trip(name="clock", message=text)


def failure_of(trip: Trip) -> DeviceError | DataError:
    """Return the error that ends a session for an interlock."""
    if trip.name in ("disk", "clock", "sum_rule", "saturated"):
        return DataError(f"{trip.message} (interlock {trip.name!r}); `rigctl resume` goes on")
    if trip.name in ("identical", "black"):
        return ProtocolError(trip.message)
    return LimitError(trip.message)


def _stage_trips(shot: Shot, tolerance_deg: float) -> Iterator[Trip]:
    if shot.move is None or not shot.is_new_move:
        return
    move = shot.move
    off_deg = (move.position.angle_deg - move.target_deg + 180.0) % 360.0 - 180.0
    if abs(off_deg) > tolerance_deg:
        text = f"stage: asked for {move.target_deg:g} deg it stands at {move.position.angle_deg:g} deg"
        yield Trip(name="angle", message=f"{text}, allowed are {tolerance_deg:g} deg")
    if move.remarks:
        yield Trip(name="button", message=f"stage: {'; '.join(move.remarks)}: was it touched?")


def _is_repeated(taken: Taken) -> bool:
    """Return whether a picture has the very noise of the last one; one of a single value has none to know it by."""
    counts, last = taken.shot.frame.counts, taken.last_counts
    return last is not None and not _is_flat(counts) and np.array_equal(counts, last)


def _is_black(taken: Taken) -> bool:
    counts = taken.shot.frame.counts
    if taken.kind != "scene":
        return not counts.any()
    is_saturated = counts.flat[0] >= 2**taken.shot.settings.bit_depth - 1
    return _is_flat(counts) and not is_saturated


def _is_flat(counts: NDArray[np.uint16]) -> bool:
    return bool(counts.min() == counts.max())
