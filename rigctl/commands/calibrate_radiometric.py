"""``rigctl calibrate radiometric``: the counts that a radiance makes, by a panel of known reflectance."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.console.terminal import print_json, progress, results, warn
from rigctl.report.table import Table, terminal_table, text_columns

if TYPE_CHECKING:
    from rigctl.calibrations.radiometric import Response
    from rigctl.jobs.calibrate_radiometric import CalibratedResponse

_SHOWN = 6
_LEAST_SHARE = 0.01


def radiometric(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder with the panel in its pictures.")],
    panel: Annotated[str, typer.Option(metavar="NAME", help="Region of the scene file that is the panel.")],
    scene: Annotated[Path, typer.Option(metavar="FILE", help="Scene file: what the panel is made of, and the light.")],
    out: Annotated[Path, typer.Option(metavar="FILE", help="Calibration file to write, such as radiometric.json.")],
    noise: Annotated[Path | None, typer.Option(metavar="FILE", help="Noise calibration of the camera.")] = None,
    valid_days: Annotated[
        float | None, typer.Option(metavar="DAYS", min=0.0, help="For how long it holds; 90 if not said.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the calibration as JSON.")] = False,
) -> None:
    """Find the counts per unit of radiance, for each polarizer angle and for all, with their errors.

    The radiance of the panel is predicted from its material and the sun of the run (or is given by the scene file as
    stokes_radiance), with the uncertainties that the scene file states: they are most of the error.
    rigctl compare --scale panel --radiometric FILE uses it.

    Example: rigctl calibrate radiometric runs/panels --panel white_panel --scene scene.toml --out radiometric.json
    """
    from rigctl.jobs.calibrate_radiometric import RadiometricRequest, calibrate_radiometric

    request = RadiometricRequest(run=run, panel=panel, scene=scene, out=out, noise=noise, valid_days=valid_days)
    found = calibrate_radiometric(request)
    for doubt in found.doubts:
        warn(doubt)
    if as_json:
        print_json(found.file.as_json())
    else:
        _print(found)


def _print(found: "CalibratedResponse") -> None:
    console, scale = results(), found.found.scale
    rows = [
        (f"{one.polarizer_angle_deg:.2f}", *_texts(one.response_dn_per_radiance)) for one in found.file.body.channels
    ]
    rows.append(("all", *_texts(found.file.body.response_dn_per_radiance)))
    columns = text_columns("angle [deg]", "DN per W m-2 sr-1", "std error", left=())
    console.print(terminal_table(Table(columns=columns, rows=tuple(rows))))
    console.print(f"{scale.common:.4g} +- {scale.common_error:.2g} times what the scene file says of the sensor")
    shares = [(name, part) for name, part in found.found.shares.items() if part >= _LEAST_SHARE]
    if shares:
        console.print("variance: " + ", ".join(f"{part:.0%} {name}" for name, part in shares[:_SHOWN]))
    for remark in found.found.remarks:
        progress().print(remark)


def _texts(response: "Response") -> tuple[str, str]:
    return f"{response.value:.5g}", f"{response.std_error:.2g}"
