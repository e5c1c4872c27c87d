"""``rigctl stokes``: Stokes, DoLP and AoLP images of a run."""

from pathlib import Path
from typing import Annotated, Any

import typer

from rigctl.files.regions import load_regions
from rigctl.measurement.region_texture import region_textures
from rigctl.measurement.run_calibrations import CalibrationPaths, correction_remarks, read_calibrations
from rigctl.measurement.temporal_noise import temporal_noise
from rigctl.reports.stokes_files import write_stokes
from rigctl.reports.tables.comparison_json import measurement_json
from rigctl.reports.tables.quantity_tables import quantity_tables
from rigctl.reports.writers.terminal_table import terminal_table
from rigctl.runs.run_folder import read_run
from rigctl.terminal import print_json, progress, results, warn


def command(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder.")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for images, pictures and numbers.")],
    regions: Annotated[Path | None, typer.Option(metavar="FILE", help="Regions file.")] = None,
    noise: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Noise calibration: tells texture from noise, and a dark level.")
    ] = None,
    register: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Registration: move frames to lie on one another.")
    ] = None,
    polarizer: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Polarizer calibration: divide by the throughput of each angle.")
    ] = None,
    flat: Annotated[Path | None, typer.Option(metavar="FILE", help="Flat fields: divide frames by them.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Write Stokes, DoLP and AoLP images of a run, masks, pictures, and the numbers of its regions.

    stokes.fits holds (S0, S1, S2) after the dark level, in DN, or in DN/s where exposures differ.

    Example: rigctl stokes runs/panels --regions examples/regions.toml --out stokes
    """
    areas = [] if regions is None else load_regions(regions)
    folder = read_run(run)
    paths = CalibrationPaths(noise=noise, registration=register, flat=flat, polarizer=polarizer)
    given = read_calibrations(paths, folder)
    measurement = given.measure(folder, areas)
    for remark in (*given.doubts, *correction_remarks(measurement, areas)):
        warn(remark)
    calibration = given.noise
    content = measurement_json(
        measurement, None if calibration is None else region_textures(measurement, temporal_noise(calibration))
    )
    names = write_stokes(measurement, areas, out, numbers=content)
    if as_json:
        print_json(content)
        return
    for table in quantity_tables(content["regions"]):
        results().print(terminal_table(table))
    for name, texture in content.get("texture", {}).items():
        results().print(texture_line(name, texture), markup=False)
    progress().print(f"{', '.join(names)} in {out}", markup=False)


def texture_line(name: str, texture: dict[str, Any]) -> str:
    """Return the texture of a region in a line."""
    share = texture["rank_one_share"]
    if share is None:
        return f"{name}: no texture above the noise"
    return (
        f"{name}: texture of {100 * texture['common_factor_rms']:.2f} % as a factor common to S0, S1, S2; "
        f"{100 * share:.0f} % of it is one common variation" + (f" ({texture['remark']})" if texture["remark"] else "")
    )
