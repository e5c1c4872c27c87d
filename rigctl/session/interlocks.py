"""Interlocks on devices, disk and clocks: each says what it found where something is not as it must be."""

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from drivers.errors import DeviceError, LimitError, ProtocolError
from drivers.interfaces import CameraSettings, StageStatus
from rigctl.errors import DataError, RunFolderError
from rigctl.files.interlock_section import InterlockSection

# A camera that takes another exposure than it was told, by more than its own clock's step, is not to be trusted.
_EXPOSURE_TOLERANCE = 0.01
_BYTES_PER_MB = 1_000_000
_OF_THE_DATA = ("cell", "clock", "disk", "drift", "low_signal", "saturated", "sum_rule", "synchronised")

Name = Literal[
    "angle",
    "black",
    "button",
    "cell",
    "clock",
    "counter",
    "disk",
    "drift",
    "fault",
    "gone",
    "homed",
    "identical",
    "low_signal",
    "queue",
    "saturated",
    "settings",
    "sum_rule",
    "synchronised",
    "temperature",
]


@dataclass(frozen=True, kw_only=True)
class InterlockViolation:
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


def disk_violation(run: Path, section: InterlockSection) -> InterlockViolation | None:
    """Return a violation where the disk of a run is nearly full."""
    free_mb = _free_bytes(run) / _BYTES_PER_MB
    if free_mb >= section.disk_free_mb:
        return None
    text = f"{run}: {free_mb:.0f} MB are free on this disk, {section.disk_free_mb:g} MB are to stay so"
    return InterlockViolation(name="disk", message=f"{text}: make room")


def disk_shortage(run: Path, *, frames: int, frame_bytes: int, section: InterlockSection) -> str | None:
    """Return in words that the disk of a run has no room for so many frames more, or None."""
    room = int((_free_bytes(run) - section.disk_free_mb * _BYTES_PER_MB) // frame_bytes)
    if room >= frames:
        return None
    need_mb = frames * frame_bytes / _BYTES_PER_MB
    return f"{run}: {frames} frames are to come, {need_mb:.0f} MB; the disk has room for {max(room, 0)} of them"


def _free_bytes(run: Path) -> int:
    try:
        return shutil.disk_usage(run).free
    except OSError as error:
        text = "its folder was moved or deleted while the session ran, or its disk is gone"
        raise RunFolderError(f"{run}: {text}: {error.strerror}; what was taken until then is in it") from error


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
