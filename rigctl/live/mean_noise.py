"""Noise of the mean of many pixels, by a noise calibration: for the sum rule, and for whoever watches."""

from dataclasses import asdict, dataclass

from model.sensor import SensorNoise, temporal_variance_dn2
from rigctl.calibrations.noise.noise_file import NoiseParameters
from rigctl.errors import ConfigError
from rigctl.runs.session_record import SessionNoise

_NEEDED = ("gain_dn_per_e", "read_noise_e", "black_level_dn")


@dataclass(frozen=True, kw_only=True)
class MeanNoise:
    """The temporal noise of means.

    Attributes
    ----------
    sensor : SensorNoise
        Of the camera, as calibrated; fixed pattern stays in a mean and is left out.
    """

    sensor: SensorNoise

    def dark_dn(self, exposure_s: float) -> float:
        """Return the mean count without light [DN]."""
        return self.sensor.black_level_dn + self.sensor.gain_dn_per_e * self.sensor.dark_current_e_per_s * exposure_s

    def variance_dn2(self, mean_dn: float, *, exposure_s: float, pixels: int) -> float:
        """Return the variance of the mean of so many pixels whose mean count is that [DN^2]."""
        signal_dn = max(0.0, mean_dn - self.dark_dn(exposure_s))
        return float(temporal_variance_dn2(signal_dn, noise=self.sensor, exposure_s=exposure_s)) / pixels


def noise_numbers(calibration: NoiseParameters) -> SessionNoise:
    """Return the numbers of a noise calibration that a session needs: they go into the run.

    Raises
    ------
    ConfigError
        The calibration lacks one.
    """
    missing = [name for name in _NEEDED if name not in calibration.known]
    if missing:
        raise ConfigError(f"--noise: the calibration has no {', '.join(missing)}")
    sensor = calibration.sensor_noise()
    return SessionNoise(
        gain_dn_per_e=sensor.gain_dn_per_e,
        read_noise_e=sensor.read_noise_e,
        black_level_dn=sensor.black_level_dn,
        dark_current_e_per_s=sensor.dark_current_e_per_s,
    )


def mean_noise(numbers: SessionNoise) -> MeanNoise:
    """Return the noise of means by the numbers that `noise_numbers` gave."""
    return MeanNoise(sensor=SensorNoise(**asdict(numbers)))
