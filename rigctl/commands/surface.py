"""``rigctl surface``: what a material does to sunlight."""

from pathlib import Path
from typing import Annotated

import typer

from rigctl.choices import DiffuseKind, Shadowing
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
    from rigctl.jobs.surface import look_at_surface
    from rigctl.reports.tables.surface_tables import surface_json, surface_tables
    from rigctl.reports.writers.terminal_table import terminal_table

    sheet = look_at_surface(
        material,
        wavelength_nm=wavelength_nm,
        sun_zenith_deg=sun_zenith_deg,
        shadowing=shadowing,
        diffuse=diffuse,
        out=out,
    )
    if out is not None:
        progress().print(f"surface.png, hemisphere.png, surface.json in {out}")
    if as_json:
        print_json(surface_json(sheet))
        return
    for table in surface_tables(sheet):
        results().print(terminal_table(table))
        results().print()
    for finding in sheet.findings:
        results().print(f"finding: {finding}")
