"""``rigctl calibrate flat``: the response of each pixel behind the polarizer at each of its angles."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.console.terminal import print_json, results, warn
from rigctl.report.table import Column, Table, terminal_table

if TYPE_CHECKING:
    from rigctl.calibrations.flat import FlatAngle

_COLUMNS: tuple["Column[FlatAngle]", ...] = (
    Column(title="angle [deg]", text=lambda row: f"{row.polarizer_angle_deg:.1f}"),
    Column(title="frames", text=lambda row: str(row.frames)),
    Column(title="mean [DN]", text=lambda row: f"{row.mean_dn:.1f}"),
    Column(title="light over mean", text=lambda row: f"{row.throughput.value:.5f}"),
    Column(title="std error", text=lambda row: f"{row.throughput.std_error:.2g}"),
    Column(title="pattern [%]", text=lambda row: f"{100.0 * row.pattern_rms:.3f}"),
    Column(title="own noise [%]", text=lambda row: f"{100.0 * row.noise_rms:.3f}"),
)


def flat(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder with flat frames at each angle, and darks.")],
    out: Annotated[Path, typer.Option(metavar="FILE.npz", help="File to write, such as flat.npz.")],
    valid_days: Annotated[
        float | None, typer.Option(metavar="DAYS", min=0.0, help="For how long it holds; 30 if not said.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print its numbers as JSON.")] = False,
) -> None:
    """Measure flat fields, one for each polarizer angle, each pixel with its error, from frames of even light.

    `rigctl stokes --flat FILE` and `rigctl compare --flat FILE` divide by them. Dividing adds the noise of the flats as
    a pattern that differs from angle to angle: it is stated, and goes into predictions; take many bright frames.

    Example: rigctl calibrate flat runs/flats --out flat.npz
    """
    from rigctl.jobs.calibrate_flat import calibrate_flat

    found = calibrate_flat(run, out, valid_days=valid_days)
    if as_json:
        print_json(found.file.as_json())
        return
    results().print(terminal_table(Table(columns=_COLUMNS, rows=found.found.rows())))
    if found.doubt is not None:
        warn(found.doubt)
