"""Three lines of a calibration to read first: what to trust, what is a bound or not known, what to do next."""

from calibration.sensor.level_influence import is_lamp_sweep
from calibration.sensor.noise import NoiseCalibration

_NAMES = {
    "read_noise_e": "read noise",
    "dark_current_e_per_s": "dark current",
    "saturation_e": "saturation",
    "prnu": "PRNU",
    "dsnu_e": "DSNU",
}
_NEXT = {
    "light_or_gain_changed": "take all levels again with automatic gain off and a lamp that is warm",
    "wrong_time_unit": "correct the unit of the exposures, as wrong_time_unit says",
    "light_in_darks": "cover the lens and take the dark frames again",
    "dark_current_or_light": "cover the lens, and take stacks of 16 flats and darks at one exposure",
    "wrong_bit_depth": "state the camera's own bit depth",
    "correlated_noise": "save raw frames, without filters",
    "frames_go_together": "switch noise reduction off",
    "banded_light": "use a lamp on direct current",
    "another_gain": "take the named level again, at the gain of the others",
    "wrong_level": "take the named level again",
    "wrong_dark": "take the named dark level again, with the lens covered",
    "wrong_variance": "take the named level again",
    "wrong_light": "correct exposure or photons of the named level",
    "unclear_level": "take the named level again, and more beside it",
    "dark_current_changed": "let the camera warm up, and take the dark frames in mixed order",
    "quantisation_limited": "raise the camera's gain, or save more bits",
    "too_few_levels": "take ten levels or more between dark and 80 % of saturation",
    "scattered_photon_transfer": "take more levels",
    "unsteady_lamp": "let the lamp warm up",
    "lamp_flicker": "use a steadier lamp",
    "dark_exposure_missing": "take dark frames at the exposures of the flats",
    "dark_current_not_resolved": "take dark frames of 10 s",
    "single_dark_exposure": "take dark frames of 10 s",
    "dsnu_not_resolved": "take a stack of 16 dark frames or more",
    "prnu_not_resolved": "take a stack of 16 flats or more",
    "short_stack": "take stacks of 16 frames or more",
}


def first_lines(calibration: NoiseCalibration) -> tuple[str, str, str]:
    """Return three lines to read first.

    Parameters
    ----------
    calibration : NoiseCalibration
        The calibration, its flags in the order of what they do.
    """
    gain = calibration.gain_dn_per_e
    share = gain.std_error / gain.value
    trust = f"trust the gain to {share:.1%}" if share >= 1e-3 else f"trust the gain to {share:.2%}"
    named = [flag.level for flag in calibration.flags if flag.level is not None and flag.name != "unclear_level"]
    if named:
        trust += f"; {len(dict.fromkeys(named))} level{'s are' if len(set(named)) > 1 else ' is'} named as wrong"
    return f"{trust}.", f"{_unknown(calibration)}.", f"{_next(calibration)}."


def _unknown(calibration: NoiseCalibration) -> str:
    missing = {name: word for name, word in _NAMES.items() if getattr(calibration, name) is None}
    bounds = [word for name, word in missing.items() if name in calibration.bounds]
    unknown = [word for name, word in missing.items() if name not in calibration.bounds]
    found = []
    if bounds:
        found.append(f"{_listed(bounds)} {'is a bound' if len(bounds) == 1 else 'are bounds'}")
    if unknown:
        found.append(f"{_listed(unknown)} {'is' if len(unknown) == 1 else 'are'} not known")
    return "; ".join(found) or "all best numbers are known"


def _listed(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _next(calibration: NoiseCalibration) -> str:
    for flag in calibration.flags:
        if flag.name == "saturation_not_reached":
            more = "a brighter lamp" if is_lamp_sweep(calibration.flats) else "longer exposures"
            return f"next: go on with {more} until pixels are full"
        if flag.name in _NEXT:
            return f"next: {_NEXT[flag.name]}"
    return "nothing needs to be taken again"
