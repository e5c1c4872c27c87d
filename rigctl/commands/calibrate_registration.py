"""``rigctl calibrate registration``: how far the picture walks while the polarizer turns."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.console.failures import EXIT_DATA
from rigctl.console.terminal import print_json, results, warn
from rigctl.report.table import Column, Table, terminal_table

if TYPE_CHECKING:
    from rigctl.calibrations.registration import AngleShift, RunRegistration

_COLUMNS: tuple["Column[AngleShift]", ...] = (
    Column(title="angle [deg]", text=lambda row: f"{row.angle_deg:.2f}"),
    Column(title="right [pixel]", text=lambda row: _shift(row, 0)),
    Column(title="down [pixel]", text=lambda row: _shift(row, 1)),
    Column(title="std errors [pixel]", text=lambda row: _errors(row)),
)


def registration(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder of a scene with shapes in it.")],
    cycle: Annotated[int | None, typer.Option(help="Repeat of the set of angles; the first if not given.")] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="File for --register of stokes and compare, such as walk.json.")
    ] = None,
    valid_days: Annotated[
        float | None, typer.Option(metavar="DAYS", min=0.0, help="For how long it holds; 180 if not said.")
    ] = None,
    force_registration: Annotated[
        bool, typer.Option("--force-registration", help="Keep it though the pictures are not plainly shifted.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Report the shift of the picture at each angle, and the circle of a wedged polarizer.

    A shift of 0.1 pixel makes a false DoLP of 0.003 on a natural scene, and up to 0.05 at edges. With --out the shifts
    are kept, and `rigctl stokes --register FILE` and `rigctl compare --register FILE` move frames back by them. Where
    edges do not lie better on one another for a shift, in tiles that it was not fitted on, it is refused (4).

    Example: rigctl calibrate registration runs/panels --out walk.json
    """
    from rigctl.jobs.calibrate_registration import calibrate_registration

    calibrated = calibrate_registration(run, cycle=cycle, out=out, valid_days=valid_days, force=force_registration)
    if as_json:
        print_json(calibrated.file.as_json())
    else:
        _show(calibrated.found)
    if calibrated.found.doubt is not None:
        warn(calibrated.found.doubt + ("; --force-registration keeps it" if calibrated.is_refused else ""))
    if calibrated.is_refused:
        raise typer.Exit(EXIT_DATA)


def _show(found: "RunRegistration") -> None:
    from rigctl.calibrations.registration import before_and_after

    results().print(terminal_table(Table(columns=_COLUMNS, rows=found.rows())))
    for index in found.shifted:
        text = f"edges at {found.angle_deg[index]:.1f} deg that do not lie on one another: "
        results().print(text + before_and_after(found.found, index), markup=False)
    if found.wander is not None:
        radius = abs(found.wander.turning_pixels)
        results().print(f"circle of {radius:.3f} pixel, residual {found.wander.residual_pixels:.3f} pixel")
    if found.finding is not None:
        results().print(found.finding)


def _shift(row: "AngleShift", axis: int) -> str:
    return f"{row.shift_pixels[axis]:+.3f}"


def _errors(row: "AngleShift") -> str:
    x_error, y_error = row.std_error_pixels or (0.0, 0.0)
    return f"{x_error:.3f}, {y_error:.3f}"
