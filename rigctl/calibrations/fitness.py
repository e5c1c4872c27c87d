"""Fitness of a calibration for frames: refused for another camera or setting, warned of where it is stale."""

from collections.abc import Iterable

from rigctl.calibrations.made_for import MadeFor
from rigctl.errors import DataError
from rigctl.numbers.utc_time import utc_moment

# What has to be the same, by what it is called, as far as both sides know it. A gain is a number that was read back.
_CAMERA = {
    "camera serial number": "camera_serial",
    "gain setting [dB]": "gain_db",
    "bit depth": "bit_depth",
    "binning": "binning",
}
_STAGE = {"stage serial number": "stage_serial"}
_GAIN_STEP_DB = 0.05
# Dark current doubles every 6 to 8 K: beyond this it is off by a half and more.
_TEMPERATURE_STEP_K = 5.0
# Dark current is what an exposure much longer shows, and the calibration has hardly seen: a choice.
_LONGER = 10.0
_SECONDS_A_DAY = 86400.0


def require_fit(
    what: str, calibration: MadeFor, used: MadeFor, *, stage: bool = False, gain: bool = True
) -> tuple[str, ...]:
    """Return what is doubtful about using a calibration for frames, in words.

    Parameters
    ----------
    what : str
        Name of the calibration in messages, such as "noise calibration".
    calibration, used : MadeFor
        What it was made for, and what it is to be used for. What one of the two does not know is not compared.
    stage : bool
        Whether it is one of the stage too.
    gain : bool
        Whether it depends on the camera's gain and format; that of a polarizer does not.

    Raises
    ------
    DataError
        It is of another camera, stage, gain, bit depth or binning.
    """
    wrong = misfits(calibration, used, stage=stage, gain=gain)
    if wrong:
        raise DataError(
            f"the {what} is not of these devices as they were set: {'; '.join(wrong)}; "
            "give the calibration that belongs to them, or make one (rigctl calibrate)"
        )
    return tuple(_doubts(what, calibration, used))


def misfits(calibration: MadeFor, used: MadeFor, *, stage: bool, gain: bool) -> tuple[str, ...]:
    """Return which devices and settings are others than a calibration was made for, in words; arguments as above."""
    facts = (_CAMERA if gain else {"camera serial number": "camera_serial"}) | (_STAGE if stage else {})
    return tuple(
        f"{name}: calibrated {getattr(calibration, key)}, used {getattr(used, key)}"
        for name, key in facts.items()
        if _differ(getattr(calibration, key), getattr(used, key))
    )


def age_days(calibration: MadeFor, used: MadeFor) -> float | None:
    """Return how many days lie between a calibration and frames, below 0 where it came after; None is not known."""
    if calibration.taken_utc is None or used.taken_utc is None:
        return None
    return (utc_moment(used.taken_utc) - utc_moment(calibration.taken_utc)).total_seconds() / _SECONDS_A_DAY


def is_too_old(calibration: MadeFor, used: MadeFor) -> bool:
    """Return whether more days lie between a calibration and frames than it holds for."""
    days = age_days(calibration, used)
    return days is not None and calibration.valid_days is not None and abs(days) > calibration.valid_days


def temperature_step_k(calibration: MadeFor, used: MadeFor) -> float | None:
    """Return by how much frames were warmer than a calibration where that matters [K]; None where it does not."""
    if calibration.temperature_c is None or used.temperature_c is None:
        return None
    step_k = used.temperature_c - calibration.temperature_c
    return step_k if abs(step_k) > _TEMPERATURE_STEP_K else None


def is_beyond_exposures(calibration: MadeFor, used: MadeFor) -> bool:
    """Return whether frames were exposed so much longer than those of a calibration that it says little of them."""
    made, now = calibration.exposure_range_s, used.exposure_range_s
    return made is not None and now is not None and now[1] > _LONGER * made[1]


def _differ(one: object, other: object) -> bool:
    if one is None or other is None:
        return False
    if isinstance(one, float) and isinstance(other, float):
        return abs(one - other) > _GAIN_STEP_DB
    return one != other


def _doubts(what: str, calibration: MadeFor, used: MadeFor) -> Iterable[str]:
    days = age_days(calibration, used)
    if days is not None and is_too_old(calibration, used):
        yield (
            f"{what}: {abs(days):.0f} days lie between it and the frames, and it holds for "
            f"{calibration.valid_days:g}: make a new one, or say --valid-days when you make one"
        )
    if temperature_step_k(calibration, used) is not None:
        yield (
            f"{what}: made at {calibration.temperature_c:.1f} deg C, used at {used.temperature_c:.1f} deg C; dark "
            "current doubles every 6 to 8 K: calibrate at the temperature of use"
        )
    if _differ(calibration.pixel_format, used.pixel_format):
        yield f"{what}: made with pixel format {calibration.pixel_format}, used with {used.pixel_format}"
    if is_beyond_exposures(calibration, used):
        longest_s = [1000.0 * one.exposure_range_s[1] for one in (calibration, used) if one.exposure_range_s]
        yield f"{what}: made with exposures up to {longest_s[0]:g} ms, used with {longest_s[1]:g} ms"
