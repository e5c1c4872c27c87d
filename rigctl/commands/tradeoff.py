"""``rigctl tradeoff``: what accuracy costs in time, of the computation or, with --acquisition, of the session."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.console.terminal import print_json, progress, results, solving_shown
from rigctl.errors import ConfigError
from rigctl.reports.writers.terminal_table import terminal_table

if TYPE_CHECKING:
    from rigctl.prediction.accuracy_curves import Curves
    from rigctl.prediction.acquisition_tradeoff import AcquisitionTradeoff

_TOLERANCES = "0.1,0.03,0.01,0.003,0.001"
_SMALLEST, _LARGEST = 1e-5, 0.1
_MS_PER_S = 1000.0
_PERCENT_A_MINUTE = 0.01 / 60.0


def command(
    scene: Annotated[Path, typer.Argument(metavar="SCENE.toml", help="Scene file.")],
    noise: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Noise calibration; takes the place of the assumed noise.")
    ] = None,
    tolerances: Annotated[
        str, typer.Option(metavar="T,T,...", help="Tolerances to show, 1e-5 to 0.1; small ones take longest.")
    ] = _TOLERANCES,
    also: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY=VALUE,...", help="Own choice beside the paper's: tiles_per_side=3,rule=midpoint."),
    ] = None,
    acquisition: Annotated[
        bool, typer.Option("--acquisition", help="Frames, angles and exposure instead: error of DoLP against time.")
    ] = False,
    target_dolp_sigma: Annotated[
        float | None, typer.Option(metavar="SIGMA", help="With --acquisition: the shortest session that reaches it.")
    ] = None,
    p_detection: Annotated[
        float | None, typer.Option(metavar="P", help="With --acquisition: wanted probability of detection.")
    ] = None,
    p_false_alarm: Annotated[float, typer.Option(metavar="P", help="With --acquisition: at which false alarm.")] = 1e-3,
    region: Annotated[str | None, typer.Option(metavar="NAME", help="With --acquisition: whose DoLP counts.")] = None,
    pair: Annotated[
        str | None, typer.Option(metavar="TARGET,BACKGROUND", help="With --acquisition: what is to be detected.")
    ] = None,
    pixels: Annotated[int, typer.Option(help="With --acquisition: pixels averaged before DoLP is taken.")] = 1,
    drift_percent_per_min: Annotated[float, typer.Option(help="With --acquisition: drift of the light.")] = 1.0,
    settling_time_ms: Annotated[float, typer.Option(help="With --acquisition: of the polarizer.")] = 0.0,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for table, numbers and plot.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Print error against time: of each numerical setting and of the whole chain, and the floor of uncertain inputs.

    Beside them stand choices of the paper (midpoint tiles, a sky kept every 10 deg, first-order DoLP, draws for the
    ROC, one wavelength, single scattering), and your own by --also. Times are measured on this machine, now. True
    errors are against finer settings of all.

    Example: rigctl tradeoff examples/scene-airborne.toml --out tradeoff

    Example: rigctl tradeoff examples/scene-airborne.toml --acquisition --target-dolp-sigma 0.002
    """
    if not acquisition:
        if any(option is not None for option in (target_dolp_sigma, p_detection, region, pair)):
            raise ConfigError(
                "--target-dolp-sigma, --p-detection, --region and --pair: are for --acquisition; give it too"
            )
        _show_accuracy(_curves(scene, noise, _numbers(tolerances), out, tuple(also or ())), out, as_json=as_json)
        return
    from model.acquisition import Disturbances, Wanted
    from rigctl.jobs.tradeoff import trade_acquisition
    from rigctl.prediction.acquisition_tradeoff import TradeoffRequest

    try:
        request = TradeoffRequest(
            wanted=Wanted(dolp_total=target_dolp_sigma, p_detection=p_detection, p_false_alarm=p_false_alarm),
            region=region,
            pair=_pair(pair),
            pixels=pixels,
            disturbances=Disturbances(
                drift_per_s=drift_percent_per_min * _PERCENT_A_MINUTE, settling_time_s=settling_time_ms / _MS_PER_S
            ),
        )
    except ValueError as error:
        raise ConfigError(f"--acquisition: {error}") from error
    with solving_shown():
        found = trade_acquisition(scene, request, noise=noise, out=out)
    _show_acquisition(found, out, as_json=as_json)


def _curves(
    scene: Path, noise: Path | None, tolerances: list[float], out: Path | None, also: tuple[str, ...]
) -> "Curves":
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    from rigctl.jobs.tradeoff import trade_accuracy

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=progress(), transient=True) as bar:
        task = bar.add_task("", total=None)

        def told(text: str, done: int, steps: int) -> None:
            bar.update(task, completed=done, total=steps, description=text)

        return trade_accuracy(scene, tolerances, noise=noise, also=also, out=out, progress=told)


def _show_accuracy(curves: "Curves", out: Path | None, *, as_json: bool) -> None:
    from rigctl.reports.tables.accuracy_tables import choice_table, curve_json, curve_table, floor_lines, named_table

    if as_json:
        print_json(curve_json(curves))
        return
    results().print(terminal_table(curve_table(curves)))
    results().print(terminal_table(choice_table(curves)))
    results().print(terminal_table(named_table(curves)))
    for line in floor_lines(curves):
        results().print(line)
    progress().print(f"the finest settings took {curves.reference_s:.3g} s")
    if out is not None:
        progress().print(f"tradeoff.csv, tradeoff.json, tradeoff.png and digits.png in {out}")


def _show_acquisition(found: "AcquisitionTradeoff", out: Path | None, *, as_json: bool) -> None:
    from rigctl.reports.tables.acquisition_tables import (
        assumptions,
        curve_table,
        proposal,
        reached_table,
        reasons,
        tradeoff_json,
    )

    if as_json:
        print_json(tradeoff_json(found))
        return
    for line in assumptions(found):
        results().print(line, markup=False)
    results().print(terminal_table(curve_table(found)))
    if found.reached:
        results().print(terminal_table(reached_table(found)))
        text = proposal(found)
        results().print("nothing that was tried reaches it" if text is None else text, markup=False)
    for line in (*reasons(found), *found.remarks):
        progress().print(line, markup=False)
    if out is not None:
        progress().print(f"acquisition.csv, acquisition.json and acquisition.png in {out}", markup=False)


def _pair(text: str | None) -> tuple[str, str] | None:
    if text is None:
        return None
    names = [name.strip() for name in text.split(",")]
    if len(names) != 2 or not all(names):
        raise ConfigError(f"--pair: is {text!r}, must be TARGET,BACKGROUND")
    return names[0], names[1]


def _numbers(text: str) -> list[float]:
    try:
        found = [float(part) for part in text.split(",")]
    except ValueError as error:
        raise ConfigError(f"--tolerances: is {text!r}, must be numbers with commas, such as {_TOLERANCES}") from error
    if not all(_SMALLEST <= number <= _LARGEST for number in found):
        raise ConfigError(f"--tolerances: is {text!r}, allowed is {_SMALLEST:g} to {_LARGEST:g}")
    return found
