"""``rigctl calibrate``: parameters of the sensor and of the polarizer from frames."""

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import Progress
from rich.table import Table

from calibration.errors import RefusedFramesError
from calibration.flags import Flag
from rigctl.commands.calibrate_axis import axis
from rigctl.commands.calibrate_registration import registration
from rigctl.durable_file import write_durably
from rigctl.errors import ConfigError
from rigctl.noise.calibrate_files import FrameCalibration, calibrate_frames
from rigctl.noise.noise_file import QUANTITIES, flags_json, write_noise_file
from rigctl.noise.noise_frames import FrameSet, emva_frames, run_frames
from rigctl.terminal import print_json, progress, results

app = typer.Typer(add_completion=False, no_args_is_help=True, rich_markup_mode=None)
app.command()(axis)
app.command()(registration)

# Quantity -> (what it is called, unit, factor from the file's unit to this one, the standard's name for it)
_ROWS = {
    "gain_dn_per_e": ("gain", "DN/e-", 1.0, "gain_dn_per_e"),
    "read_noise_e": ("read noise", "e-", 1.0, "temporal_dark_noise_e"),
    "dark_current_e_per_s": ("dark current", "e-/s", 1.0, "dark_current_mean_e_per_s"),
    "black_level_dn": ("black level", "DN", 1.0, None),
    "saturation_e": ("saturation", "e-", 1.0, "saturation_e"),
    "prnu": ("PRNU", "%", 100.0, "prnu"),
    "dsnu_e": ("DSNU", "e-", 1.0, "dsnu_e"),
}
# Numbers that only the standard has.
_EMVA_ROWS = {
    "temporal_dark_noise_dn": ("dark noise, 1/12 DN^2 in it", "DN", 1.0),
    "quantum_efficiency": ("quantum efficiency", "%", 100.0),
    "threshold_e": ("absolute sensitivity threshold", "e-", 1.0),
    "threshold_photons": ("absolute sensitivity threshold", "photons", 1.0),
    "dynamic_range": ("dynamic range", "", 1.0),
    "snr_max": ("largest SNR", "", 1.0),
    "linearity_error_min": ("linearity error, lowest", "%", 100.0),
    "linearity_error_max": ("linearity error, highest", "%", 100.0),
    "dark_current_variance_e_per_s": ("dark current by variance", "e-/s", 1.0),
    "prnu_row": ("PRNU of rows", "%", 100.0),
    "prnu_column": ("PRNU of columns", "%", 100.0),
    "prnu_pixel": ("PRNU of pixels", "%", 100.0),
    "dsnu_row_e": ("DSNU of rows", "e-", 1.0),
    "dsnu_column_e": ("DSNU of columns", "e-", 1.0),
    "dsnu_pixel_e": ("DSNU of pixels", "e-", 1.0),
}


@app.callback()
def calibrate() -> None:
    """Calibrate sensor and polarizer from frames."""


@app.command()
def noise(
    out: Annotated[Path, typer.Option(metavar="FILE", help="Calibration file to write, such as noise.json.")],
    run: Annotated[Path | None, typer.Option(metavar="RUN", help="Run folder with dark and flat frames.")] = None,
    emva: Annotated[Path | None, typer.Option(metavar="FILE", help="Descriptor of an EMVA 1288 data set.")] = None,
    plot: Annotated[Path | None, typer.Option(metavar="FILE.png", help="Draw the photon-transfer curve.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the calibration as JSON.")] = False,
) -> None:
    """Gain, read noise, dark current, black level, saturation, PRNU and DSNU, each with its standard error.

    Wanted are two flats and two darks at each of some ten exposures up to saturation, and a stack of 16 of each at
    one of them. Frames that make every number wrong are refused by name (exit 4), and no file is written.

    Example: rigctl calibrate noise --run runs/noise --out noise.json --plot noise.png
    """
    frames = _frames(run, emva)
    _require_folders(out, plot)
    try:
        calibration = _calibrate(frames)
    except RefusedFramesError as error:
        if as_json:
            print_json({**dict.fromkeys(QUANTITIES), "flags": flags_json(error.flags)})
        raise
    content = calibration.as_json()
    write_noise_file(out, content)
    if plot is not None:
        _write_plot(plot, calibration)
    if as_json:
        print_json(content)
    else:
        _print_table(content, calibration.noise.flags)


def _frames(run: Path | None, emva: Path | None) -> FrameSet:
    if run is not None and emva is None:
        return run_frames(run)
    if emva is not None and run is None:
        return emva_frames(emva)
    raise ConfigError("give either --run RUN (a run folder) or --emva FILE (the descriptor of an EMVA 1288 data set)")


def _require_folders(*paths: Path | None) -> None:
    missing = [f"{path}: there is no folder {path.parent}" for path in paths if path and not path.parent.is_dir()]
    if missing:
        raise ConfigError("\n".join(missing))


def _calibrate(frames: FrameSet) -> FrameCalibration:
    with Progress(console=progress(), transient=True) as bar:
        task = bar.add_task("levels", total=len(frames.groups))
        return calibrate_frames(frames, level_done=lambda done, total: bar.update(task, completed=done, total=total))


def _write_plot(path: Path, calibration: FrameCalibration) -> None:
    from rigctl.noise.noise_figure import photon_transfer_png

    try:
        write_durably(path, photon_transfer_png(calibration.noise))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}") from error


def _print_table(content: dict[str, Any], flags: tuple[Flag, ...]) -> None:
    table = Table(box=None, pad_edge=False)
    for title in ("quantity", "value", "std error", "EMVA 1288", "std error", "unit", "frames"):
        table.add_column(title, justify="left" if title in ("quantity", "unit") else "right")
    emva = content["emva1288"]
    for name, (title, unit, factor, emva_name) in _ROWS.items():
        value, error, frames = _cells(content[name], factor)
        beside = _cells(emva[emva_name], factor)[:2] if emva_name else ("", "")
        table.add_row(title, value, error, *beside, unit, frames)
    for name, (title, unit, factor) in _EMVA_ROWS.items():
        value, error, frames = _cells(emva[name], factor)
        table.add_row(title, "", "", value, error, unit, frames)
    console = results()
    console.print(table)
    for flag in flags:
        console.print(f"{flag.name}: {flag.message}", markup=False)


def _cells(found: dict[str, Any] | None, factor: float) -> tuple[str, str, str]:
    """Return value and standard error to two digits of the error, and the number of frames."""
    if found is None:
        return "not known", "", ""
    value = factor * found["value"]
    if found["std_error"] is None:
        return f"{value:.4g}", "", str(found["n"])
    error = factor * found["std_error"]
    digits = max(0, 1 - _exponent(error))
    return f"{value:.{digits}f}", f"{error:.{digits}f}", str(found["n"])


def _exponent(number: float) -> int:
    return int(f"{number:.0e}".partition("e")[2])
