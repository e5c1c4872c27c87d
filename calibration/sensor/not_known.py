"""Reasons why a number of a calibration is not known, each with the one measurement that would tell."""

from calibration.sensor.level_influence import is_lamp_sweep
from calibration.sensor.noise import NoiseCalibration

_STACKS = "take a stack of 16 frames or more at half of saturation, and as many dark frames"
_BY_FLAG = {
    "read_noise_e": ("quantisation_limited", "read_noise_not_resolved"),
    "dark_current_e_per_s": (
        "wrong_time_unit",
        "light_in_darks",
        "dark_current_or_light",
        "dark_current_changed",
        "dark_current_not_resolved",
        "single_dark_exposure",
    ),
}
_REASONS = {
    "quantisation_limited": "rounding to whole counts hides the noise of dark frames: raise the camera's gain",
    "read_noise_not_resolved": "dark current or rounding hides it: take dark frames at the shortest exposure",
    "wrong_time_unit": "exposures seem to be in another unit than stated: wrong_time_unit says how to correct it",
    "light_in_darks": "light reached the dark frames: cover the lens and take them again",
    "dark_current_or_light": "it may be light: cover the lens and take stacks of 16 flats and darks at one exposure",
    "dark_current_changed": "it changed while the dark frames were taken: let the camera warm up and take them again",
    "dark_current_not_resolved": "dark exposures are too short: take dark frames of 1 s or more",
    "single_dark_exposure": "dark frames have one exposure: take dark frames of 1 s or more beside them",
}


def not_known(calibration: NoiseCalibration) -> dict[str, str]:
    """Return why each number that is not known is not, by the number's name.

    Parameters
    ----------
    calibration : NoiseCalibration
        The calibration; names of ``performance`` and ``emva1288`` are among the keys.
    """
    best, merit = calibration, calibration.performance
    names = {flag.name for flag in best.flags}
    found = {
        name: _REASONS[flags[0] if not names.intersection(flags) else next(one for one in flags if one in names)]
        for name, flags in _BY_FLAG.items()
        if getattr(best, name) is None
    }
    if best.prnu is None:
        found["prnu"] = f"noise in time hides it: {_STACKS}"
    if best.dsnu_e is None:
        found["dsnu_e"] = f"noise in time, or rounding, hides it: {_STACKS}, longer if it stays so"
    if best.saturation_e is None:
        found["saturation_e"] = f"the sweep ends below it: {_brighter(best)}"
    if merit.quantum_efficiency is None:
        found["quantum_efficiency"] = _no_efficiency(best)
    if merit.threshold_e is None:
        found["threshold_e"] = found.get("read_noise_e", "the read noise is not known")
    if merit.dynamic_range is None:
        found["dynamic_range"] = found.get("saturation_e") or found.get("read_noise_e", "saturation is not known")
    if merit.snr_max is None:
        found["snr_max"] = found.get("saturation_e", "saturation is not known")
    if merit.dark_current_variance_e_per_s is None:
        found["dark_current_variance_e_per_s"] = found.get("read_noise_e") or found.get(
            "dark_current_e_per_s", "dark frames have one exposure: take longer ones beside them"
        )
    return found | _standard(best, found)


def _brighter(best: NoiseCalibration) -> str:
    """Return how flats become brighter in a sweep of this kind."""
    return (
        "go on with a brighter lamp until pixels are full"
        if is_lamp_sweep(best.flats)
        else "go on with longer exposures until pixels are full"
    )


def _no_efficiency(best: NoiseCalibration) -> str:
    if any(flat.photons is None for flat in best.flats):
        return "photons per pixel are not stated: measure the irradiance with a calibrated photodiode"
    return "fewer than 7 levels have a light that is known: take more levels of stated photons"


def _standard(best: NoiseCalibration, found: dict[str, str]) -> dict[str, str]:
    """Return the reasons of the standard's own numbers."""
    missing = [name for name, figure in best.emva1288.items() if figure is None]
    reasons = {}
    for name in missing:
        if name.startswith("linearity"):
            reasons[name] = (
                f"it is over 5 to 95 % of saturation, which was not reached: {_brighter(best)}"
                if best.saturation_e is None
                else "fewer than three levels of known light lie within 5 to 95 % of saturation: take more"
            )
        elif name.startswith(("dsnu", "prnu")):
            reasons[name] = f"its variance is not above 0 once noise in time is taken off: {_STACKS}"
        elif name.startswith("dark_current"):
            reasons[name] = found.get("dark_current_e_per_s", "dark frames have fewer than three exposures: take more")
        elif name.startswith(("saturation", "dynamic", "snr")) and best.saturation_e is None:
            reasons[name] = found["saturation_e"]
        else:
            reasons[name] = _no_efficiency(best)
    return {name: reason for name, reason in reasons.items() if name not in found}
