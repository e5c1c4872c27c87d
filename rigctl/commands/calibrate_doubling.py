"""``rigctl calibrate doubling``: the doubling interval of the dark current, from calibrations when cold and warm."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from calibration.sensor.doubling import doubling_temperature
from rigctl.calibrations.noise.noise_file import Estimate, NoiseParameters, read_noise_file
from rigctl.errors import ConfigError, DataError
from rigctl.terminal import print_json, results

_LEAST_FILES = 2


def doubling(
    files: Annotated[list[Path], typer.Argument(metavar="NOISE.json...", help="Calibrations of one camera.")],
    temperature_c: Annotated[
        list[float] | None, typer.Option(help="Temperature of each file, where the frames do not say it.")
    ] = None,
    by_variance: Annotated[
        bool, typer.Option("--by-variance", help="Take the dark current by variance: cameras that clamp black.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Find the rise of temperature that doubles the dark current, with its standard error (EMVA 1288).

    Example: rigctl calibrate doubling noise_20c.json noise_30c.json noise_40c.json
    """
    if len(files) < _LEAST_FILES:
        raise ConfigError("give two calibrations or more, of one camera at different temperatures")
    if temperature_c and len(temperature_c) != len(files):
        raise ConfigError(f"--temperature-c is given {len(temperature_c)} times for {len(files)} files")
    calibrations = [read_noise_file(path) for path in files]
    temperatures = temperature_c or [_temperature_c(*one) for one in zip(files, calibrations, strict=True)]
    currents = [_current(path, one, by_variance) for path, one in zip(files, calibrations, strict=True)]
    _require_one_camera(calibrations)
    found = doubling_temperature(
        np.array(temperatures),
        np.array([current.value for current in currents]),
        np.array([current.std_error for current in currents]),
    )
    if as_json:
        print_json(asdict(found))
        return
    results().print(
        f"the dark current doubles every {found.value_k:.2f} +- {found.std_error_k:.2f} K "
        f"({found.n_temperatures} temperatures)"
    )


def _temperature_c(path: Path, noise: NoiseParameters) -> float:
    known = None if noise.made_for is None else noise.made_for.temperature_c
    if known is None:
        raise ConfigError(f"{path}: its frames did not say how warm the camera was: give --temperature-c for each file")
    return known


def _current(path: Path, noise: NoiseParameters, by_variance: bool) -> Estimate:
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
