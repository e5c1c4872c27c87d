"""What must be so before a frame counts, and before the next is taken: each check says what it found."""

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceError, LimitError, ProtocolError
from drivers.interfaces import CameraSettings, StageStatus
from rigctl.errors import DataError
from rigctl.files.interlock_section import InterlockSection
from rigctl.live.drift import Drift
from rigctl.session.captured_frame import CapturedFrame
from rigctl.session.interlock_violation import InterlockViolation

# A camera that takes another exposure than it was told, by more than its own clock's step, is not to be trusted.
_EXPOSURE_TOLERANCE = 0.01
_BYTES_PER_MB = 1_000_000
_SIGMAS = 5.0
_OF_THE_DATA = ("clock", "disk", "drift", "low_signal", "saturated", "sum_rule", "synchronised")


@dataclass(frozen=True, kw_only=True, eq=False)
class Taken:
    """One frame as it came, with what was asked for.

    Attributes
    ----------
    kind : str
        "scene", "dark" or "flat".
    shot : CapturedFrame
        The frame, and how it came about.
    tolerance_deg : float
        How far the readback may be off.
    last_counts : array or None
        The frame before.
    """

    kind: str
    shot: CapturedFrame
    tolerance_deg: float
    last_counts: NDArray[np.uint16] | None


def frame_violations(taken: Taken, section: InterlockSection) -> Iterator[InterlockViolation]:
    """Give every interlock that a frame violates."""
    shot = taken.shot
    yield from _stage_violations(shot, taken.tolerance_deg)
    yield from shot.violations
    if shot.frame.settings != shot.settings:
        text = f"camera: was set to {shot.settings} and took the frame with {shot.frame.settings}"
        yield InterlockViolation(name="settings", message=f"{text}: switch its automatic exposure and gain off")
    if _is_repeated(taken):
        text = f"camera: frame {shot.frame.sequence} is identical to the one before, down to the noise"
        yield InterlockViolation(name="identical", message=f"{text}: it sent an old picture again. Restart the camera")
    if _is_black(taken):
        text = f"camera: frame {shot.frame.sequence} has the value {shot.frame.counts.flat[0]} everywhere"
        yield InterlockViolation(name="black", message=f"{text}: no picture came. Check cable, bandwidth and lens cap")
    elif taken.kind == "scene":
        yield from _light_violations(shot, section)


def settings_violation(*, exposure_s: float, gain_db: float, read_back: CameraSettings) -> InterlockViolation | None:
    """Return a violation where a camera says that it took other settings than it was told."""
    if abs(read_back.exposure_s - exposure_s) > _EXPOSURE_TOLERANCE * exposure_s:
        text = f"asked for an exposure of {exposure_s:g} s it says that it took {read_back.exposure_s:g} s"
        return InterlockViolation(name="settings", message=f"camera: {text}")
    if read_back.gain_db != gain_db:
        text = f"asked for a gain of {gain_db:g} dB it says that it took {read_back.gain_db:g} dB"
        return InterlockViolation(name="settings", message=f"camera: {text}")
    return None


def homed_violation(status: StageStatus) -> InterlockViolation | None:
    """Return a violation where a stage does not say, after its search, that it has found its reference mark."""
    if status.homed:
        return None
    text = f"stage: after its search for the reference mark it says {status.meaning} ({status.code})"
    return InterlockViolation(name="homed", message=f"{text}, and not that it has found it: its angles mean nothing")


def temperature_violation(temperature_c: float | None, section: InterlockSection) -> InterlockViolation | None:
    """Return a violation where a camera is too cold or too warm; one that tells no temperature is neither."""
    least_c, most_c = section.temperature_least_c, section.temperature_most_c
    if temperature_c is None or least_c <= temperature_c <= most_c:
        return None
    text = f"camera: it is at {temperature_c:.1f} deg C, allowed are {least_c:g} to {most_c:g} deg C"
    return InterlockViolation(
        name="temperature", message=f"{text}: its dark current is not the calibrated one. Shade or warm it"
    )


def drift_violation(drift: Drift | None, section: InterlockSection) -> InterlockViolation | None:
    """Return a violation where the light has changed within a cycle by more than is allowed, noise apart."""
    if drift is None or abs(drift.change) <= section.drift_tolerance + _SIGMAS * (drift.sigma or 0.0):
        return None
    text = f"the light changed by {100 * drift.change:+.2f} % in {drift.over_s:.1f} s"
    allowed = f"allowed are {100 * section.drift_tolerance:g} % from cycle to cycle"
    return InterlockViolation(name="drift", message=f"{text}, {allowed}: polarization of this cycle is doubtful")


def disk_violation(run: Path, section: InterlockSection) -> InterlockViolation | None:
    """Return a violation where the disk of a run is nearly full."""
    free_mb = shutil.disk_usage(run).free / _BYTES_PER_MB
    if free_mb >= section.disk_free_mb:
        return None
    text = f"{run}: {free_mb:.0f} MB are free on this disk, {section.disk_free_mb:g} MB are to stay so"
    return InterlockViolation(name="disk", message=f"{text}: make room")


def disk_shortage(run: Path, *, frames: int, frame_bytes: int, section: InterlockSection) -> str | None:
    """Return in words that the disk of a run has no room for so many frames more, or None."""
    room = int((shutil.disk_usage(run).free - section.disk_free_mb * _BYTES_PER_MB) // frame_bytes)
    if room >= frames:
        return None
    need_mb = frames * frame_bytes / _BYTES_PER_MB
    return f"{run}: {frames} frames are to come, {need_mb:.0f} MB; the disk has room for {max(room, 0)} of them"


def clock_violation(jump_s: float, section: InterlockSection) -> InterlockViolation | None:
    """Return a violation where the host's clock was set."""
    if abs(jump_s) <= section.clock_jump_s:
        return None
    text = f"the host's clock was set by {jump_s:+.1f} s; the schedule keeps to the time by which it began"
    return InterlockViolation(name="clock", message=text)


def synchronised_violation(problem: str | None) -> InterlockViolation | None:
    """Return a violation where the host's clock follows no time server."""
    if problem is None:
        return None
    return InterlockViolation(
        name="synchronised", message=f"the host's clock is {problem}: times and the sun's place rest on it"
    )


def failure_of(violation: InterlockViolation) -> DeviceError | DataError:
    """Return the error that ends a session for an interlock."""
    if violation.name in _OF_THE_DATA:
        return DataError(f"{violation.message} (interlock {violation.name!r}); `rigctl resume` goes on")
    if violation.name in ("identical", "black"):
        return ProtocolError(violation.message)
    return LimitError(violation.message)


def _light_violations(shot: CapturedFrame, section: InterlockSection) -> Iterator[InterlockViolation]:
    if shot.saturated_fraction > section.saturated_fraction:
        text = f"{100 * shot.saturated_fraction:.2f} % of the pixels are saturated"
        yield InterlockViolation(
            name="saturated", message=f"{text}, allowed are {100 * section.saturated_fraction:g} %"
        )
    level_dn = section.low_signal_level * (2**shot.frame.settings.bit_depth - 1)
    low = float(np.count_nonzero(shot.frame.counts < level_dn) / shot.frame.counts.size)
    if low > section.low_signal_fraction:
        text = f"{100 * low:.1f} % of the pixels have less than {level_dn:.0f} DN"
        allowed = f"allowed are {100 * section.low_signal_fraction:g} %"
        yield InterlockViolation(name="low_signal", message=f"{text}, {allowed}: expose longer, or bracket")


def _stage_violations(shot: CapturedFrame, tolerance_deg: float) -> Iterator[InterlockViolation]:
    if shot.move is None or not shot.is_new_move:
        return
    move = shot.move
    off_deg = (move.position.angle_deg - move.target_deg + 180.0) % 360.0 - 180.0
    if abs(off_deg) > tolerance_deg:
        text = f"stage: asked for {move.target_deg:g} deg it stands at {move.position.angle_deg:g} deg"
        yield InterlockViolation(name="angle", message=f"{text}, allowed are {tolerance_deg:g} deg")
    if move.remarks:
        yield InterlockViolation(name="button", message=f"stage: {'; '.join(move.remarks)}: was it touched?")


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
