"""``rigctl sky``: the polarized sky of a scene."""

import json
from pathlib import Path
from typing import Annotated

import typer

from rigctl.durable_file import write_durably
from rigctl.files.scene_file import load_scene
from rigctl.reports.sky_sheet import sky_sheet
from rigctl.terminal import print_json, progress, results


def command(
    scene: Annotated[Path, typer.Argument(metavar="SCENE.toml", help="Scene file with [sun] and [atmosphere].")],
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for sky.png and sky.json.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Compute the sky of a scene: S0, S1, S2 and DoLP over the hemisphere, with the sun marked ([MK14] Fig. 2).

    Says the tier and its accuracy, the optical depth, and what is least known. Computed skies are kept in the user's
    cache folder and taken from there again.

    Example: rigctl sky examples/scene-airborne.toml --out sky
    """
    sheet = sky_sheet(load_scene(scene))
    if out is not None:
        from rigctl.reports.sky_figure import sky_picture  # half a second, wanted for a picture only

        out.mkdir(parents=True, exist_ok=True)
        write_durably(out / "sky.png", sky_picture(sheet))
        write_durably(out / "sky.json", (json.dumps(sheet.as_json(), allow_nan=False) + "\n").encode())
    if as_json:
        print_json(sheet.as_json())
        return
    for line in sheet.lines:
        results().print(line)
    if out is not None:
        progress().print(f"sky.png and sky.json in {out}", markup=False)
