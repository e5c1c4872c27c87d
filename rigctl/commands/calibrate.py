"""``rigctl calibrate``: the sensor's parameters from frames of it."""

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import Progress
from rich.table import Table

from calibration.errors import RefusedFramesError
from calibration.flags import Flag
from rigctl.durable_file import write_durably
from rigctl.errors import ConfigError
from rigctl.noise.calibrate_files import FrameCalibration, calibrate_frames
from rigctl.noise.noise_file import QUANTITIES, flags_json, write_noise_file
from rigctl.noise.noise_frames import FrameSet, emva_frames, run_frames
from rigctl.terminal import print_json, progress, results

app = typer.Typer(add_completion=False, no_args_is_help=True, rich_markup_mode=None)

# Quantity -> (what it is called, unit, factor from the file's unit to this one)
_ROWS = {
    "gain_dn_per_e": ("gain", "DN/e-", 1.0),
    "read_noise_e": ("read noise", "e-", 1.0),
    "dark_current_e_per_s": ("dark current", "e-/s", 1.0),
    "black_level_dn": ("black level", "DN", 1.0),
    "saturation_e": ("saturation", "e-", 1.0),
    "prnu": ("PRNU", "%", 100.0),
    "dsnu_e": ("DSNU", "e-", 1.0),
}


@app.callback()
def calibrate() -> None:
    """Calibrate the sensor from frames of it."""


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
    for title in ("quantity", "value", "std error", "unit", "frames"):
        table.add_column(title, justify="left" if title in ("quantity", "unit") else "right")
    for name, (title, unit, factor) in _ROWS.items():
        table.add_row(title, *_cells(content[name], factor)[:2], unit, _cells(content[name], factor)[2])
    console = results()
    console.print(table)
    for flag in flags:
        console.print(f"{flag.name}: {flag.message}", markup=False)


def _cells(found: dict[str, Any] | None, factor: float) -> tuple[str, str, str]:
    """Return value and standard error to two digits of the error, and the number of frames."""
    if found is None:
        return "not known", "", ""
    value, error = factor * found["value"], factor * found["std_error"]
    digits = max(0, 1 - _exponent(error))
    return f"{value:.{digits}f}", f"{error:.{digits}f}", str(found["n"])


def _exponent(number: float) -> int:
    return int(f"{number:.0e}".partition("e")[2])
