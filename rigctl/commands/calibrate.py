"""``rigctl calibrate``: parameters of the sensor and of the polarizer from frames."""

from pathlib import Path
from typing import Annotated, Any

import cv2
import typer
from rich.progress import Progress

from calibration.errors import RefusedFramesError
from calibration.flags import Flag
from drivers.cameras.raw_files import PLANES, Plane
from rigctl.calibrations.content_file import write_content
from rigctl.calibrations.noise.calibrate_files import FrameCalibration, calibrate_frames
from rigctl.calibrations.noise.folder_frames import folder_frames
from rigctl.calibrations.noise.frame_table import table_frames
from rigctl.calibrations.noise.noise_file import QUANTITIES
from rigctl.calibrations.noise.noise_frames import FrameSet, emva_frames, run_frames
from rigctl.calibrations.noise.noise_json import flags_json
from rigctl.commands.calibrate_axis import axis
from rigctl.commands.calibrate_doubling import doubling
from rigctl.commands.calibrate_flat import flat
from rigctl.commands.calibrate_radiometric import radiometric
from rigctl.commands.calibrate_registration import registration
from rigctl.durable_file import write_durably
from rigctl.errors import ConfigError, DataError
from rigctl.reports.tables.calibration_table import calibration_rows, calibration_table
from rigctl.reports.writers.terminal_table import terminal_table
from rigctl.terminal import print_json, progress, results

app = typer.Typer(add_completion=False, no_args_is_help=True, rich_markup_mode=None)
app.command()(axis)
app.command()(doubling)
app.command()(flat)
app.command()(radiometric)
app.command()(registration)


@app.callback()
def calibrate() -> None:
    """Calibrate sensor and polarizer from frames."""


@app.command()
def noise(
    out: Annotated[Path, typer.Option(metavar="FILE", help="Calibration file to write, such as noise.json.")],
    run: Annotated[Path | None, typer.Option(metavar="RUN", help="Run folder with dark and flat frames.")] = None,
    emva: Annotated[Path | None, typer.Option(metavar="FILE", help="Descriptor of an EMVA 1288 data set.")] = None,
    folder: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder of PNG, TIFF, FITS or RAW images.")] = None,
    table: Annotated[Path | None, typer.Option(metavar="FILE.csv", help="Table: file, kind, exposure_ms, ...")] = None,
    bit_depth: Annotated[int | None, typer.Option(min=1, max=16, help="Bits per sample of a folder's images.")] = None,
    plane: Annotated[str | None, typer.Option(metavar="NAME", help="Colour of RAW files, such as green.")] = None,
    plot: Annotated[Path | None, typer.Option(metavar="FILE.png", help="Draw the photon-transfer curve.")] = None,
    report: Annotated[Path | None, typer.Option(metavar="FILE.html", help="Write a page with curves and maps.")] = None,
    defects: Annotated[Path | None, typer.Option(metavar="FILE.png", help="Write the map of defect pixels.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the calibration as JSON.")] = False,
) -> None:
    """Gain, read noise, dark current, black level, saturation, PRNU and DSNU, each with its standard error.

    Wanted are two flats and two darks at each of some ten exposures up to saturation, and a stack of 16 of each at
    one of them. Frames that make every number wrong are refused by name (exit 4), and no file is written.

    A folder's images say in their names what they are (dark_10ms_001.png, flat/10ms/001.fits); a table says it of any
    (columns file, kind, exposure_ms, photons, level). Both need --bit-depth.

    Example: rigctl calibrate noise --run runs/noise --out noise.json --report noise.html
    """
    _require_folders(out, plot, report, defects)
    try:
        frames = _frames(run=run, emva=emva, folder=folder, table=table, bit_depth=bit_depth, plane=_plane(plane))
        calibration = _calibrate(frames)
    except RefusedFramesError as error:
        if as_json:
            print_json({**dict.fromkeys(QUANTITIES), "flags": flags_json(error.flags)})
        raise
    content = calibration.as_json()
    write_content(out, content)
    if plot is not None:
        _write_plot(plot, calibration)
    if report is not None:
        _write_report(report, calibration, content)
    if defects is not None:
        _write_defects(defects, calibration)
    if as_json:
        print_json(content)
    else:
        _print_table(content, calibration.noise.flags)


def _plane(name: str | None) -> Plane | None:
    for plane in PLANES:
        if name == plane:
            return plane
    if name is not None:
        raise ConfigError(f"--plane: is {name!r}, must be one of {', '.join(PLANES)}")
    return None


def _frames(
    *,
    run: Path | None,
    emva: Path | None,
    folder: Path | None,
    table: Path | None,
    bit_depth: int | None,
    plane: Plane | None,
) -> FrameSet:
    if sum(given is not None for given in (run, emva, folder, table)) != 1:
        raise ConfigError(
            "give either --run RUN (a run folder), --emva FILE (the descriptor of an EMVA 1288 data set), "
            "--folder DIR (images) or --table FILE.csv (a list of images)"
        )
    if run is not None:
        return run_frames(run)
    if emva is not None:
        return emva_frames(emva)
    if bit_depth is None:
        raise ConfigError("images do not say how many bits the camera has: give --bit-depth, such as --bit-depth 12")
    if folder is not None:
        return folder_frames(folder, bit_depth=bit_depth, plane=plane)
    return table_frames(table or Path(), bit_depth=bit_depth, plane=plane)


def _require_folders(*paths: Path | None) -> None:
    missing = [f"{path}: there is no folder {path.parent}" for path in paths if path and not path.parent.is_dir()]
    if missing:
        raise ConfigError("\n".join(missing))


def _calibrate(frames: FrameSet) -> FrameCalibration:
    with Progress(console=progress(), transient=True) as bar:
        task = bar.add_task("levels", total=len(frames.groups))
        return calibrate_frames(frames, level_done=lambda done, total: bar.update(task, completed=done, total=total))


def _write_plot(path: Path, calibration: FrameCalibration) -> None:
    from rigctl.reports.figures.photon_transfer_figure import photon_transfer_png  # matplotlib, wanted for a plot only

    _write(path, photon_transfer_png(calibration.noise))


def _write_report(path: Path, calibration: FrameCalibration, content: dict[str, Any]) -> None:
    from rigctl.reports.pages.calibration_page import calibration_report  # matplotlib, as above
    from rigctl.reports.writers.report_file import report_file

    _write(path, report_file(calibration_report(calibration, content), path))


def _write_defects(path: Path, calibration: FrameCalibration) -> None:
    if calibration.pattern is None:
        raise DataError(f"{path}: there is no defect map, since no flat is brighter than its dark")
    done, encoded = cv2.imencode(".png", calibration.pattern.defects.mask)
    if not done:
        raise ConfigError(f"{path}: a map of this size cannot be written as PNG")
    _write(path, encoded.tobytes())


def _write(path: Path, data: bytes) -> None:
    try:
        write_durably(path, data)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}") from error


def _print_table(content: dict[str, Any], flags: tuple[Flag, ...]) -> None:
    console = results()
    console.print(terminal_table(calibration_table(calibration_rows(content))))
    for flag in flags:
        console.print(f"{flag.name}: {flag.message}", markup=False)
