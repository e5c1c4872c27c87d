"""``rigctl tradeoff``: what accuracy costs in time, of the computation or, with --acquisition, of the session."""

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from rigctl.calibrations.noise.noise_file import read_noise_file
from rigctl.commands.tradeoff_acquisition import show_acquisition_tradeoff
from rigctl.comparison.accuracy_curves import Curves, accuracy_curves, steps
from rigctl.comparison.scene_prediction import ScenePredictor
from rigctl.durable_file import write_durably
from rigctl.errors import ConfigError
from rigctl.files.scene_file import load_scene
from rigctl.reports.tables.tradeoff_tables import (
    choice_table,
    curve_csv,
    curve_json,
    curve_png,
    curve_table,
    floor_lines,
)
from rigctl.scene.scene_light import SceneLight
from rigctl.terminal import print_json, progress, results

_TOLERANCES = "0.1,0.03,0.01,0.003,0.001"
_SMALLEST, _LARGEST = 1e-5, 0.1


def command(
    scene: Annotated[Path, typer.Argument(metavar="SCENE.toml", help="Scene file.")],
    noise: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Noise calibration; takes the place of the assumed noise.")
    ] = None,
    tolerances: Annotated[
        str, typer.Option(metavar="T,T,...", help="Tolerances to show, 1e-5 to 0.1; small ones take longest.")
    ] = _TOLERANCES,
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
    """Print error against time: of each numerical knob and of the whole chain, and the floor of uncertain inputs.

    Times are measured on this machine, now. True errors are against finer settings of every knob.

    Example: rigctl tradeoff examples/scene-airborne.toml --out tradeoff

    Example: rigctl tradeoff examples/scene-airborne.toml --acquisition --target-dolp-sigma 0.002
    """
    scene_file = load_scene(scene)
    calibration = None if noise is None else read_noise_file(noise)
    if acquisition:
        show_acquisition_tradeoff(
            scene_file,
            calibration,
            target_dolp_sigma=target_dolp_sigma,
            p_detection=p_detection,
            p_false_alarm=p_false_alarm,
            region=region,
            pair=pair,
            pixels=pixels,
            drift_percent_per_min=drift_percent_per_min,
            settling_time_ms=settling_time_ms,
            out=out,
            as_json=as_json,
        )
        return
    if any(option is not None for option in (target_dolp_sigma, p_detection, region, pair)):
        raise ConfigError("--target-dolp-sigma, --p-detection, --region and --pair: are for --acquisition; give it too")
    _show(_curves(ScenePredictor(scene_file, calibration, light=SceneLight()), _numbers(tolerances)), out, as_json)


def _curves(predictor: ScenePredictor, tolerances: list[float]) -> Curves:
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=progress(), transient=True) as bar:
        task = bar.add_task("", total=steps(tolerances))
        for done, step in enumerate(accuracy_curves(predictor, tolerances)):
            if isinstance(step, Curves):
                return step
            bar.update(task, completed=done, description=step)
    raise RuntimeError("the curves ended without a result")


def _show(curves: Curves, out: Path | None, as_json: bool) -> None:
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        write_durably(out / "tradeoff.csv", curve_csv(curves))
        write_durably(out / "tradeoff.json", (json.dumps(curve_json(curves), allow_nan=False) + "\n").encode())
        write_durably(out / "tradeoff.png", curve_png(curves))
    if as_json:
        print_json(curve_json(curves))
        return
    results().print(curve_table(curves))
    results().print(choice_table(curves))
    for line in floor_lines(curves):
        results().print(line)
    progress().print(f"the finest settings took {curves.reference_s:.3g} s")
    if out is not None:
        progress().print(f"tradeoff.csv, tradeoff.json and tradeoff.png in {out}")


def _numbers(text: str) -> list[float]:
    try:
        found = [float(part) for part in text.split(",")]
    except ValueError as error:
        raise ConfigError(f"--tolerances: is {text!r}, must be numbers with commas, such as {_TOLERANCES}") from error
    if not all(_SMALLEST <= number <= _LARGEST for number in found):
        raise ConfigError(f"--tolerances: is {text!r}, allowed is {_SMALLEST:g} to {_LARGEST:g}")
    return found
