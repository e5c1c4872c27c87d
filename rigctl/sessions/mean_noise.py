"""What a noise calibration says of the mean of a frame, for the sum rule."""

from collections.abc import Callable, Mapping
from typing import Any

from model.sensor import SensorNoise, temporal_variance_dn2
from rigctl.errors import ConfigError

# Variance of the mean of a frame's pixels [DN^2], from its mean count [DN], its exposure [s] and its pixels.
VarianceOfMean = Callable[[float, float, int], float]
_NEEDED = ("gain_dn_per_e", "read_noise_e", "black_level_dn")


def noise_numbers(calibration: Mapping[str, Any]) -> dict[str, float]:
    """Return the numbers of a noise calibration that the sum rule needs: they go into the run.

    Raises
    ------
    ConfigError
        The calibration lacks one.
    """
    missing = [name for name in _NEEDED if calibration.get(name) is None]
    if missing:
        raise ConfigError(f"--noise: the calibration has no {', '.join(missing)}")
    dark = calibration.get("dark_current_e_per_s")
    numbers = {name: float(calibration[name]["value"]) for name in _NEEDED}
    # An estimate may lie below 0 by its error; no sensor does.
    numbers["dark_current_e_per_s"] = 0.0 if dark is None else max(0.0, float(dark["value"]))
    return numbers


def variance_of_mean(numbers: Mapping[str, float]) -> VarianceOfMean:
    """Return what noise does to a frame's mean."""
    noise = SensorNoise(**numbers, prnu=0.0, dsnu_e=0.0)

    def variance_dn2(mean_dn: float, exposure_s: float, pixels: int) -> float:
        dark_dn = noise.gain_dn_per_e * noise.dark_current_e_per_s * exposure_s
        signal_dn = max(0.0, mean_dn - noise.black_level_dn - dark_dn)
        return float(temporal_variance_dn2(signal_dn, noise=noise, exposure_s=exposure_s)) / pixels

    return variance_dn2
