"""``rigctl sky``: the polarized sky of a scene."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.console.terminal import print_json, progress, results, solving_shown
from rigctl.files.choices import Engine

if TYPE_CHECKING:
    from rigctl.scene.sky_map import SkyOfKind


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
    from rigctl.jobs.sky import compute_sky
    from rigctl.reports.tables.light_tables import sky_json, sky_lines

    if compare_aerosols:
        _compare(scene, out, engine=engine, as_json=as_json)
        return
    with solving_shown() as tell:
        sky = compute_sky(scene, engine=engine, out=out, tell=tell)
    if out is not None:
        progress().print(f"sky.png and sky.json in {out}", markup=False)
    if as_json:
        print_json(sky_json(sky))
        return
    for line in sky_lines(sky):
        results().print(line)


def _compare(scene: Path, out: Path | None, *, engine: Engine, as_json: bool) -> None:
    from rigctl.jobs.sky import compute_skies_by_aerosol
    from rigctl.reports.tables.light_tables import kinds_json, kinds_table, sky_lines
    from rigctl.reports.writers.terminal_table import terminal_table

    kinds = compute_skies_by_aerosol(scene, engine=engine, out=out, progress=_say)
    if out is not None:
        progress().print(f"sky-aerosols.png and sky-aerosols.json in {out}", markup=False)
    if as_json:
        print_json(kinds_json(kinds))
        return
    results().print(terminal_table(kinds_table(kinds)))
    own = kinds[0].sky
    for line in (sky_lines(own)[0], *own.remarks[:1]):
        results().print(line)


def _say(one: "SkyOfKind") -> None:
    progress().print(f"{one.label}: computed", markup=False)
