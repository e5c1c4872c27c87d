"""``rigctl calibrate``: parameters of the sensor and of the polarizer from frames."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.progress import Progress

from calibration.results import RefusedFramesError
from drivers.cameras.raw_planes import PLANES
from rigctl.base.durable import MOST_FRAME_MB
from rigctl.commands.calibrate_axis import axis
from rigctl.commands.calibrate_doubling import doubling
from rigctl.commands.calibrate_flat import flat
from rigctl.commands.calibrate_lens import lens
from rigctl.commands.calibrate_radiometric import radiometric
from rigctl.commands.calibrate_registration import registration
from rigctl.console.failures import EXIT_DATA, failure_content
from rigctl.console.options import MaxFrameMb, OptionTexts, frame_bytes
from rigctl.console.terminal import print_json, progress, results
from rigctl.errors import ConfigError
from rigctl.files.choices import EXPOSURE_UNITS

if TYPE_CHECKING:
    from rigctl.jobs.calibrate_noise import CalibratedNoise, NoiseRequest

app = typer.Typer(add_completion=False, no_args_is_help=True, rich_markup_mode=None)
app.command()(axis)
app.command()(doubling)
app.command()(flat)
app.command()(radiometric)
app.command()(registration)
app.command()(lens)


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
    exposure_unit: Annotated[
        str | None, typer.Option(metavar="ns|us|ms|s", help="Unit of stated exposures, where it is not the usual one.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(metavar="FILE.png", help="Draw the photon-transfer curve.")] = None,
    report: Annotated[Path | None, typer.Option(metavar="FILE.html", help="Write a page with curves and maps.")] = None,
    defects: Annotated[Path | None, typer.Option(metavar="FILE.png", help="Write the map of defect pixels.")] = None,
    max_frame_mb: MaxFrameMb = MOST_FRAME_MB,
    as_json: Annotated[bool, typer.Option("--json", help="Print the calibration as JSON.")] = False,
) -> None:
    """Gain, read noise, dark current, black level, saturation, PRNU and DSNU, each with its standard error.

    Wanted are two flats and two darks at each of some ten exposures up to saturation, and a stack of 16 of each at
    one of them. Frames that make every number wrong are refused by name (exit 4), and no file is written.

    A folder's images say in their names what they are (dark_10ms_001.png, flat/10ms/001.fits); a table says it of any
    (columns file, kind, exposure_ms, photons, level). Both need --bit-depth.

    Exposures are read in nanoseconds from a descriptor, milliseconds from a table, seconds from a header, and in the
    unit that stands beside them in a name; --exposure-unit states another, and the unit of exp000522 in a name.

    Example: rigctl calibrate noise --run runs/noise --out noise.json --report noise.html
    """
    from rigctl.calibrations.noise import QUANTITIES
    from rigctl.calibrations.noise_calibration import flags_json
    from rigctl.jobs.calibrate_noise import NoiseRequest

    texts = OptionTexts()
    request = NoiseRequest(
        out=out,
        run=run,
        emva=emva,
        most_bytes=frame_bytes(max_frame_mb),
        folder=folder,
        table=table,
        bit_depth=bit_depth,
        plane=texts.choice("--plane", plane, PLANES),
        exposure_unit=texts.choice("--exposure-unit", exposure_unit, EXPOSURE_UNITS),
        plot=plot,
        report=report,
        defects=defects,
    )
    if texts.problems:
        raise ConfigError("\n".join(texts.problems))
    try:
        found = _calibrated(request)
    except RefusedFramesError as error:
        if not as_json:
            raise
        # One answer for programs: the flags beside the failure.
        failed = failure_content(EXIT_DATA, str(error), verb="calibrate")
        print_json({**dict.fromkeys(QUANTITIES), "flags": flags_json(error.flags), **failed})
        progress().print(f"rigctl: {error}")
        raise typer.Exit(EXIT_DATA) from error
    if as_json:
        print_json(found.as_json())
    else:
        _print_table(found)


def _calibrated(request: "NoiseRequest") -> "CalibratedNoise":
    from rigctl.jobs.calibrate_noise import calibrate_noise

    with Progress(console=progress(), transient=True) as bar:
        task = bar.add_task("levels", total=None)
        return calibrate_noise(request, level_done=lambda done, total: bar.update(task, completed=done, total=total))


def _print_table(found: "CalibratedNoise") -> None:
    from calibration.sensor.noise import first_lines
    from rigctl.report.calibration import calibration_rows, calibration_table, unknown_lines
    from rigctl.report.table import terminal_table

    console = results()
    for line in first_lines(found.calibration.noise):
        console.print(line, markup=False)
    console.print(terminal_table(calibration_table(calibration_rows(found.calibration.noise))))
    for line in unknown_lines(found.calibration.noise):
        console.print(line, markup=False)
    for flag in found.calibration.noise.flags:
        console.print(f"{flag.name}: {flag.message}", markup=False)
