"""``rigctl point``: where camera and panels point."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.base.numbers import time_option
from rigctl.console.terminal import print_json, progress, results, warn

if TYPE_CHECKING:
    from rigctl.jobs.point import Pointed

# Pairs of angles that are shown, and the least correlation of them; --write has all.
_SHOWN, _WORTH_A_LINE = 6, 0.1


def command(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder: time, site, size of the picture.")],
    *,
    lens: Annotated[Path | None, typer.Option(metavar="FILE", help="Lens, by `rigctl calibrate lens`.")] = None,
    focal_px: Annotated[
        str | None, typer.Option(metavar="F+-S", help="Focal length over pixel pitch, without a lens file.")
    ] = None,
    sun: Annotated[str | None, typer.Option(metavar="X,Y", help="Where the sun stands in the picture.")] = None,
    shadow: Annotated[
        str | None,
        typer.Option(metavar="X,Y,X,Y", help="Shadow of an upright rod on level ground: from its foot to its tip."),
    ] = None,
    compass: Annotated[str | None, typer.Option(metavar="DEG+-S", help="Whereto the camera looks, magnetic.")] = None,
    declination: Annotated[
        str | None, typer.Option(metavar="DEG+-S", help="Of the compass, east positive, or 11.3 W.")
    ] = None,
    level: Annotated[
        str | None, typer.Option(metavar="E,R+-S", help="Elevation (down is negative) and roll of the camera.")
    ] = None,
    camera_at: Annotated[
        str | None, typer.Option(metavar="LAT,LON,H+-M", help="Place of the camera, its error in metres.")
    ] = None,
    target_at: Annotated[str | None, typer.Option(metavar="LAT,LON,H+-M", help="Place of the target.")] = None,
    panel: Annotated[
        list[str] | None, typer.Option(metavar="NAME=WxH", help="A panel and its sides [m]. Repeatable.")
    ] = None,
    level_panel: Annotated[
        list[str] | None, typer.Option(metavar="NAME=S", help="A panel that lies level within S deg. Repeatable.")
    ] = None,
    outlines: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Scene or regions file with the corners of panels.")
    ] = None,
    pixel_std: Annotated[
        float, typer.Option(metavar="PX", min=0.001, help="How well sun, shadow and corners are placed.")
    ] = 0.5,
    at: Annotated[
        str | None, typer.Option(metavar="TIME", help="When sun or shadow was seen; the middle of the run if left out.")
    ] = None,
    write: Annotated[
        Path | None, typer.Option(metavar="SCENE.toml", help="Write the angles into this scene file.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Find azimuth, zenith angle and roll of the camera and tilt of panels, each with its standard uncertainty.

    Every source that is given counts by its error; one that the others exclude is said. --write puts the angles into
    the scene file as { value = ..., std = ... }, and how their errors go together into its [pointing], so that a
    comparison allows for them.

    Example: rigctl point runs/panels --compass "171 +- 2" --declination "-11.3 +- 0.3" --level "-35,0.4 +- 0.3"
    """
    from rigctl.jobs.point import point
    from rigctl.jobs.point_request import PointRequest

    found = point(
        PointRequest(
            run=run,
            outlines=outlines,
            lens=lens,
            focal_px=focal_px,
            compass=compass,
            declination=declination,
            level=level,
            camera_at=camera_at,
            target_at=target_at,
            sun=sun,
            shadow=shadow,
            pixel_std=pixel_std,
            at_ns=time_option("--at", at),
            panels=tuple(panel or ()),
            level_panels=tuple(level_panel or ()),
            write=write,
        )
    )
    for text in found.contradictions:
        warn(text)
    for name, text in found.unclear.items():
        warn(f"{name}: {text}")
    if as_json:
        print_json(found.as_json())
    else:
        _print(found)


def _print(found: "Pointed") -> None:
    console = results()
    console.print(f"from {', '.join(found.sources)}", markup=False)
    if found.sun_deg is not None:
        console.print(f"sun: azimuth {found.sun_deg[0]:.3f}, elevation {found.sun_deg[1]:.3f} deg", markup=False)
    for key, (value, std) in found.geometry.items():
        console.print(f"geometry.{key:<20} {value:9.3f} +- {std:.3f}", markup=False)
    for name, numbers in found.regions.items():
        for key, (value, std) in numbers.items():
            console.print(f"{name}.{key:<20} {value:9.3f} +- {std:.3f}", markup=False)
    for line in _going_together(found):
        console.print(line, markup=False)
    for line in found.changes:
        progress().print(line, markup=False)


def _going_together(found: "Pointed") -> Iterable[str]:
    """Give the pairs of angles whose errors go together, the closest first."""
    together = found.pointing
    if together is None:
        return
    rows = [
        (one, other, together.correlation[i][k])
        for i, one in enumerate(together.parameters)
        for k, other in enumerate(together.parameters[:i])
    ]
    for one, other, correlation in sorted(rows, key=lambda row: -abs(row[2]))[:_SHOWN]:
        if abs(correlation) >= _WORTH_A_LINE:
            yield f"errors of {other} and {one} go together: correlation {correlation:+.2f}"
