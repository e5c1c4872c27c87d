"""``rigctl surface``: what a material does to sunlight."""

import json
from pathlib import Path
from typing import Annotated

import typer

from model.surface.diffuse import DiffuseKind
from model.surface.materials import surface_of
from model.surface.shadowing import Shadowing
from rigctl.durable_file import write_durably
from rigctl.errors import ConfigError
from rigctl.files.material_file import NM_PER_M, find_material
from rigctl.reports.surface_sheet import SurfaceSheet, surface_sheet
from rigctl.reports.tables.surface_tables import surface_tables
from rigctl.reports.writers.terminal_table import terminal_table
from rigctl.terminal import print_json, progress, results


def command(
    material: Annotated[
        str, typer.Argument(metavar="MATERIAL", help="Material file, or black-paint, white-paint, asphalt, ...")
    ],
    wavelength_nm: Annotated[float, typer.Option(metavar="X", help="Wavelength in air [nm].")] = 550.0,
    sun_zenith_deg: Annotated[float, typer.Option(metavar="A", help="Angle of the sun from the normal [deg].")] = 45.0,
    shadowing: Annotated[Shadowing, typer.Option(help="How facets hide one another.")] = "v-cavity",
    diffuse: Annotated[DiffuseKind, typer.Option(help="Form of the diffuse term.")] = "coupled",
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for plots and numbers.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Print DoLP and reflectance of a material against angle, and where its values come from.

    With --out also surface.png (against angle), hemisphere.png (all directions of the camera) and surface.json.

    Example: rigctl surface black-paint --sun-zenith-deg 50 --out black-paint
    """
    if not 0.0 <= sun_zenith_deg < 90.0:
        raise ConfigError(f"--sun-zenith-deg: is {sun_zenith_deg:g}, must lie in [0, 90)")
    found = find_material(material, beside=Path())
    try:
        surface = surface_of(found, wavelength_m=wavelength_nm / NM_PER_M, shadowing=shadowing, diffuse=diffuse)
        sheet = surface_sheet(found, surface, wavelength_nm=wavelength_nm, sun_zenith_deg=sun_zenith_deg)
    except ValueError as error:
        raise ConfigError(str(error)) from error
    if out is not None:
        _write(sheet, out)
    if as_json:
        print_json(sheet.as_json())
        return
    for table in surface_tables(sheet):
        results().print(terminal_table(table))
        results().print()
    for finding in sheet.findings:
        results().print(f"finding: {finding}")


def _write(sheet: SurfaceSheet, out: Path) -> None:
    from rigctl.reports.figures import surface_figures  # half a second, wanted for plots only

    contents = {
        "surface.png": surface_figures.against_angle(sheet),
        "hemisphere.png": surface_figures.hemisphere(sheet),
        "surface.json": (json.dumps(sheet.as_json(), indent=2, allow_nan=False) + "\n").encode(),
    }
    out.mkdir(parents=True, exist_ok=True)
    for name, data in contents.items():
        write_durably(out / name, data)
    progress().print(f"{', '.join(contents)} in {out}")
