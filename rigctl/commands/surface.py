"""``rigctl surface``: what a material does to sunlight."""

from pathlib import Path
from typing import Annotated

import typer

from rigctl.console.terminal import print_json, progress, results
from rigctl.errors import ConfigError
from rigctl.files.choices import DiffuseKind, Shadowing


def command(
    material: Annotated[
        str | None, typer.Argument(metavar="MATERIAL", help="Material file, or black-paint, white-paint, asphalt, ...")
    ] = None,
    listed: Annotated[
        bool, typer.Option("--list", help="List all materials that come with the program, each value with its source.")
    ] = False,
    wavelength_nm: Annotated[float, typer.Option(metavar="X", help="Wavelength in air [nm].")] = 550.0,
    sun_zenith_deg: Annotated[float, typer.Option(metavar="A", help="Angle of the sun from the normal [deg].")] = 45.0,
    shadowing: Annotated[Shadowing, typer.Option(help="How facets hide one another.")] = "v-cavity",
    diffuse: Annotated[DiffuseKind, typer.Option(help="Form of the diffuse term.")] = "coupled",
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for plots and numbers.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Print DoLP and reflectance of a material against angle, and where its values come from.

    --list shows every material with its values, uncertainties, sources, and what is assumed; in a scene file, name it
    as `material`, and for the diagonal texture of [MK14] eq. (10) give `texture_diagonal = [r0, r1, r2]`, deviations of
    S0, S1 and S2 as shares of the S0 that the surface reflects (examples/paper/rough.toml has both).

    With --out also surface.png (against angle), hemisphere.png (all directions of the camera) and surface.json.

    Example: rigctl surface --list

    Example: rigctl surface black-paint --sun-zenith-deg 50 --out black-paint
    """
    from rigctl.jobs.surface import list_materials, look_at_surface
    from rigctl.reports.tables.surface_tables import materials_json, materials_table, surface_json, surface_tables
    from rigctl.reports.writers.terminal_table import terminal_table

    if listed:
        found = list_materials()
        if as_json:
            print_json({"materials": materials_json(found)})
        else:
            results().print(terminal_table(materials_table(found)))
        return
    if material is None:
        raise ConfigError("MATERIAL: which? rigctl surface --list names those that come with the program")
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
