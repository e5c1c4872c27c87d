"""The options of a simulated camera's address: where the truth is noted, and what goes wrong on its network."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from rigctl.errors import ConfigError
from sim_devices.cameras.device_clock import ClockTruth
from sim_devices.cameras.gige_faults import GigeFaults
from sim_devices.micro_polarizers import MicroPolarizers
from sim_devices.truth_log import TruthLog

# A camera at this address is on the network, at that of this machine: ``sim:gige?lost=0.001&hang=20``.
ON_NETWORK = "sim:gige"
THIS_MACHINE = "127.0.0.1"
# A camera with polarizers on its pixels: ``sim:mosaic?cell=90,45,135,0&crosstalk=0.02&angle_error_deg=0.5``.
MOSAIC = "sim:mosaic"
# The camera behind one that is served to other programs; nobody writes it into a rig file.
SERVED = "sim:served"
_SIMULATED = ("sim:gc780", ON_NETWORK, MOSAIC)
_TRUTH = "truth="


def split_truth(address: str) -> tuple[str, TruthLog | None]:
    """Return an address without its truth option, and the log that the option asks for.

    Parameters
    ----------
    address : str
        A simulated camera's, such as ``sim:gc780?truth=/tmp/truth.jsonl``. A relative file lies where the program
        runs: give an absolute one if the session is to be resumed from elsewhere.

    Raises
    ------
    ConfigError
        There are several files, an empty name, or the file cannot be written.
    """
    scheme, _, tail = address.partition("?")
    options = [option for option in tail.split("&") if option]
    files = [option.removeprefix(_TRUTH) for option in options if option.startswith(_TRUTH)]
    rest = "&".join(option for option in options if not option.startswith(_TRUTH))
    plain = f"{scheme}?{rest}" if rest else scheme
    if not files:
        return plain, None
    if len(files) > 1 or not files[0]:
        raise ConfigError(f"camera.address: truth={','.join(files)}: must be one file, such as truth=/tmp/truth.jsonl")
    try:
        return plain, TruthLog(Path(files[0]))
    except OSError as error:
        raise ConfigError(f"camera.address: truth={files[0]}: cannot be written: {error.strerror}") from error


def require_known_camera(address: str, *, is_mosaic: bool = False) -> None:
    """Raise ConfigError for the address of a simulated camera that there is not, or that is no mosaic as it should."""
    name, _, options = address.partition("?")
    if is_mosaic and name.startswith("sim:") and name not in (MOSAIC, ON_NETWORK, SERVED):
        raise ConfigError(f"camera.address: {name} has no polarizers on its pixels; {MOSAIC} and {ON_NETWORK} may have")
    if name == MOSAIC and not is_mosaic:
        raise ConfigError(f"camera.address: {name} has polarizers on its pixels: state mosaic_deg = [90, 45, 135, 0]")
    if name.startswith("sim:") and name not in (*_SIMULATED, SERVED):
        raise ConfigError(f"camera.address: there is no simulated camera {name!r}; there are {', '.join(_SIMULATED)}")
    unknown = [option for option in options.split("&") if option and not option.startswith(_TRUTH)]
    if name == _SIMULATED[0] and unknown:
        raise ConfigError(f"camera.address: {unknown[0]!r} is no key of {name}: allowed is {_TRUTH}FILE")
    if name == MOSAIC:
        _, rest = split_polarizers("&".join(unknown))
        if rest:
            raise ConfigError(
                f"camera.address: {rest!r}: of {name} allowed are {_TRUTH}FILE, {', '.join(sorted(_POLARIZERS))}"
            )


def split_polarizers(options: str) -> tuple[MicroPolarizers, str]:
    """Return the polarizers on the pixels that options of an address ask for, and the options that are none.

    Parameters
    ----------
    options : str
        ``cell`` are the true axes, row by row; ``angle_error_deg`` and ``pixel_error_deg`` the deviations of those of a
        place and of a pixel; ``crosstalk`` the share of light that leaks into each neighbour.

    Raises
    ------
    ConfigError
        A value is not allowed.
    """
    values: dict[str, Any] = {}
    rest = []
    for option in filter(None, options.split("&")):
        key, _, text = option.partition("=")
        if key not in _POLARIZERS:
            rest.append(option)
            continue
        field, read = _POLARIZERS[key]
        try:
            values[field] = read(text)
        except ValueError as error:
            raise ConfigError(f"camera.address: {option}: is no number") from error
    try:
        return MicroPolarizers(**values), "&".join(rest)
    except ValueError as error:
        raise ConfigError(f"camera.address: {error}") from error


def split_faults(options: str) -> tuple[GigeFaults, str]:
    """Return the faults that options of an address ask for, and the options that are none.

    Parameters
    ----------
    options : str
        ``key=value&key=value``. ``lost`` is the share of packets that are lost, ``resend`` 0 for a camera that sends
        none of them again; ``die``, ``restart``, ``hang`` and
        ``forget`` are the picture, counted from the camera's power-up, at which its power goes for good, goes and
        comes back, at which it answers nobody for a while, and after which its exposure is not what was set;
        ``off_s`` and ``hang_s`` say for how long. ``clock_ppm`` gives it a clock that can be read and is so much too
        fast; ``ptp_offset_ns`` one that follows a PTP master, where the driver's ``ptp=1`` asks for it, so far off.

    Raises
    ------
    ConfigError
        Values are not allowed, or given twice: all are named.
    """
    values: dict[str, Any] = {}
    rest, problems = [], []
    for option in filter(None, options.split("&")):
        key, _, text = option.partition("=")
        if key not in _FAULTS:
            rest.append(option)
            continue
        field, read, allowed = _FAULTS[key]
        value = _read_or_none(text, read)
        if value is None or field in values:
            problems.append(f"{option}: must be one {allowed}")
        values[field] = value
    if problems:
        raise ConfigError(f"camera.address: {'; '.join(problems)}")
    clock = {name: values.pop(name) for name in ("drift_ppm", "ptp_offset_ns") if name in values}
    if clock:
        values["clock"] = ClockTruth(**clock, has_ptp="ptp_offset_ns" in clock)
    return GigeFaults(**values), "&".join(rest)


def _share(text: str) -> float | None:
    share = float(text)
    return share if 0.0 <= share < 1.0 else None


def _picture(text: str) -> int | None:
    number = int(text)
    return number if number >= 2 else None


def _seconds(text: str) -> float | None:
    seconds = float(text)
    return seconds if 0.0 <= seconds <= 3600.0 else None


def _ppm(text: str) -> float | None:
    ppm = float(text)
    return ppm if abs(ppm) <= 1000.0 else None


def _nanoseconds(text: str) -> int | None:
    number = int(text)
    return number if abs(number) <= 10**9 else None


def _switch(text: str) -> bool | None:
    return {"0": False, "1": True}.get(text)


def _angles(text: str) -> tuple[float, ...]:
    return tuple(map(float, text.split(",")))


_POLARIZERS: dict[str, tuple[str, Callable[[str], float | tuple[float, ...]]]] = {
    "cell": ("cell_deg", _angles),
    "angle_error_deg": ("place_error_deg", float),
    "pixel_error_deg": ("pixel_error_deg", float),
    "crosstalk": ("crosstalk", float),
}
_Reader = Callable[[str], float | int | None]
_PICTURE = "whole number from 2 on: the driver takes the first picture when it opens the camera"
_FAULTS: dict[str, tuple[str, _Reader, str]] = {
    "lost": ("lost_share", _share, "number from 0 to below 1"),
    "resend": ("resends", _switch, "of 0 and 1"),
    "die": ("die", _picture, _PICTURE),
    "restart": ("restart", _picture, _PICTURE),
    "off_s": ("off_s", _seconds, "number of seconds, 0 to 3600"),
    "hang": ("hang", _picture, _PICTURE),
    "hang_s": ("hang_s", _seconds, "number of seconds, 0 to 3600"),
    "forget": ("forget", _picture, _PICTURE),
    "clock_ppm": ("drift_ppm", _ppm, "number from -1000 to 1000"),
    "ptp_offset_ns": ("ptp_offset_ns", _nanoseconds, "whole number of nanoseconds, a second at most"),
}


def _read_or_none(text: str, read: _Reader) -> float | int | None:
    try:
        return read(text)
    except ValueError:
        return None
