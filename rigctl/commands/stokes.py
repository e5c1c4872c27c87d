"""``rigctl stokes``: Stokes, DoLP and AoLP images of a run."""

from pathlib import Path
from typing import Annotated

import typer

from rigctl.files.regions import load_regions
from rigctl.measurement.measurement import measure
from rigctl.reports.number_table import quantity_tables
from rigctl.reports.stokes_files import write_stokes
from rigctl.reports.tables_json import measurement_json
from rigctl.runs.run_folder import read_run
from rigctl.terminal import print_json, progress, results


def command(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder.")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for images, pictures and numbers.")],
    regions: Annotated[Path | None, typer.Option(metavar="FILE", help="Regions file.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Write Stokes, DoLP and AoLP images of a run, masks, pictures, and the numbers of its regions.

    stokes.fits holds (S0, S1, S2) after the dark level, in DN, or in DN/s where exposures differ.

    Example: rigctl stokes runs/panels --regions examples/regions.toml --out stokes
    """
    areas = [] if regions is None else load_regions(regions)
    measurement = measure(read_run(run), regions=areas)
    names = write_stokes(measurement, areas, out)
    if as_json:
        print_json(measurement_json(measurement))
        return
    for table in quantity_tables(measurement_json(measurement)["regions"]):
        results().print(table)
    progress().print(f"{', '.join(names)} in {out}", markup=False)
