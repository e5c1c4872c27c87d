"""``rigctl sky``: the polarized sky of a scene."""

import json
from pathlib import Path
from typing import Annotated

import typer

from rigctl.choices import Engine
from rigctl.durable_file import write_durably
from rigctl.files.scene_file import SceneFile, load_scene
from rigctl.reports.sky_kinds import kinds_json, kinds_table, skies_of_kinds
from rigctl.reports.sky_sheet import SkySheet, sky_sheet
from rigctl.reports.writers.terminal_table import terminal_table
from rigctl.terminal import print_json, progress, results


def command(
    scene: Annotated[Path, typer.Argument(metavar="SCENE.toml", help="Scene file with [sun] and [atmosphere].")],
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for sky.png and sky.json.")] = None,
    compare_aerosols: Annotated[
        bool, typer.Option("--compare-aerosols", help="One kind of aerosol after another, side by side.")
    ] = False,
    engine: Annotated[
        Engine, typer.Option(metavar="NAME", help="What solves it: own, or sasktran2 as an independent check.")
    ] = "own",
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Compute the sky of a scene: S0, S1, S2 and DoLP over the hemisphere, with the sun marked ([MK14] Fig. 2).

    Says the tier and its accuracy, the optical depth, and what is least known. Computed skies are kept in the user's
    cache folder and taken from there again; those of another engine are not.

    Example: rigctl sky examples/scene-airborne.toml --out sky

    Example: rigctl sky examples/scene-airborne.toml --compare-aerosols --out sky
    """
    read = load_scene(scene)
    if compare_aerosols:
        _compare(read, out, engine=engine, as_json=as_json)
        return
    sheet = sky_sheet(read, engine=engine)
    if out is not None:
        _write(out, sheet)
    if as_json:
        print_json(sheet.as_json())
        return
    for line in sheet.lines:
        results().print(line)


def _write(out: Path, sheet: SkySheet) -> None:
    from rigctl.reports.figures.sky_figure import sky_picture  # half a second, wanted for a picture only

    out.mkdir(parents=True, exist_ok=True)
    write_durably(out / "sky.png", sky_picture(sheet))
    write_durably(out / "sky.json", (json.dumps(sheet.as_json(), allow_nan=False) + "\n").encode())
    progress().print(f"sky.png and sky.json in {out}", markup=False)


def _compare(scene: SceneFile, out: Path | None, *, engine: Engine, as_json: bool) -> None:
    found = []
    for one in skies_of_kinds(scene, engine=engine):
        progress().print(f"{one.label}: computed", markup=False)
        found.append(one)
    kinds = tuple(found)
    if out is not None:
        from rigctl.reports.figures.sky_figure import kinds_picture  # half a second, wanted for a picture only

        out.mkdir(parents=True, exist_ok=True)
        write_durably(out / "sky-aerosols.png", kinds_picture(kinds))
        write_durably(out / "sky-aerosols.json", (json.dumps(kinds_json(kinds), allow_nan=False) + "\n").encode())
        progress().print(f"sky-aerosols.png and sky-aerosols.json in {out}", markup=False)
    if as_json:
        print_json(kinds_json(kinds))
        return
    results().print(terminal_table(kinds_table(kinds)))
    for line in (kinds[0].sheet.lines[0], *kinds[0].sheet.remarks[:1]):
        results().print(line)
