"""Calibrating the doubling interval of the dark current: noise calibrations of one camera, cold and warm, in."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calibration.sensor.curves import DoublingTemperature, doubling_temperature
from rigctl.calibrations.noise import NoiseParameters, StatedEstimate, read_noise_file
from rigctl.errors import ConfigError, DataError

_LEAST_FILES = 2


def calibrate_doubling(
    files: Sequence[Path], *, temperatures_c: Sequence[float] = (), by_variance: bool = False
) -> DoublingTemperature:
    """Return the rise of temperature that doubles the dark current, and its standard error.

    Parameters
    ----------
    files : sequence of Path
        Noise calibrations, two or more.
    temperatures_c : sequence of float
        Temperature of each [deg C]; none where the files say it.
    by_variance : bool
        Take the dark current by variance, for cameras that clamp their black level.

    Raises
    ------
    ConfigError, DataError, CalibrationError
        Too few files, or one without temperature or dark current, or of another camera.
    """
    if len(files) < _LEAST_FILES:
        raise ConfigError("give two calibrations or more, of one camera at different temperatures")
    if temperatures_c and len(temperatures_c) != len(files):
        raise ConfigError(f"--temperature-c is given {len(temperatures_c)} times for {len(files)} files")
    calibrations = [read_noise_file(path) for path in files]
    known = temperatures_c or [_temperature_c(*one) for one in zip(files, calibrations, strict=True)]
    currents = [_current(path, one, by_variance) for path, one in zip(files, calibrations, strict=True)]
    _require_one_camera(calibrations)
    return doubling_temperature(
        np.array(known),
        np.array([current.value for current in currents]),
        np.array([current.std_error for current in currents]),
    )


def _temperature_c(path: Path, noise: NoiseParameters) -> float:
    known = None if noise.made_for is None else noise.made_for.temperature_c
    if known is None:
        raise ConfigError(f"{path}: its frames did not say how warm the camera was: give --temperature-c for each file")
    return known


def _current(path: Path, noise: NoiseParameters, by_variance: bool) -> StatedEstimate:
    found = noise.dark_current_e_per_s
    if by_variance:
        found = None if noise.performance is None else noise.performance.dark_current_variance_e_per_s
    if found is None:
        raise DataError(f"{path}: has no dark current; it needs dark frames at two exposures or more")
    return found


def _require_one_camera(calibrations: list[NoiseParameters]) -> None:
    known = [None if one.made_for is None else one.made_for.camera_serial for one in calibrations]
    serials = {serial for serial in known if serial is not None}
    if len(serials) > 1:
        raise DataError(f"these are calibrations of different cameras: serial numbers {', '.join(sorted(serials))}")
