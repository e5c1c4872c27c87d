"""``rigctl predict``: what the model says that a scene will give."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.choices import Engine, LightPart
from rigctl.errors import ConfigError
from rigctl.reports.writers.terminal_table import terminal_table
from rigctl.terminal import print_json, progress, results, warn

if TYPE_CHECKING:
    from rigctl.jobs.predict import PredictedScene, PredictRequest


def command(
    scene: Annotated[Path, typer.Argument(metavar="SCENE.toml", help="Scene file.")],
    noise: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Noise calibration; takes the place of the assumed noise.")
    ] = None,
    radiometric: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Radiometric calibration, in place of optics and efficiency.")
    ] = None,
    light: Annotated[
        LightPart, typer.Option(metavar="PART", help="Light of materials: total, reflected, reflected_sun, ..., path.")
    ] = "total",
    key_and_range: Annotated[
        str | None, typer.Option("--sweep", metavar="KEY=start:stop:n", help="Any number of the scene, over a range.")
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for table and plot of a sweep.")] = None,
    engine: Annotated[
        Engine, typer.Option(metavar="NAME", help="What solves the sky: own, or sasktran2 as an independent check.")
    ] = "own",
    tolerance: Annotated[
        float | None,
        typer.Option(metavar="T", help="Largest numerical error, 1e-6 to 0.1; settings are chosen, errors estimated."),
    ] = None,
    estimated_only: Annotated[
        bool,
        typer.Option("--estimated-only", help="With --tolerance: aerosol = spheres too; its errors are no promises."),
    ] = False,
    switched_on: Annotated[
        list[str] | None, typer.Option("--with", metavar="NAME", help="Let an effect act (rigctl effects lists them).")
    ] = None,
    left_out: Annotated[
        list[str] | None, typer.Option("--without", metavar="NAME", help="Leave an effect out, whatever it changes.")
    ] = None,
    uncertainty: Annotated[
        bool,
        typer.Option("--uncertainty", help="Also what the stated uncertainties of the inputs make of each number."),
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Print what the analytical model predicts for each region: counts, Stokes parameters, DoLP, deviations, SNR.

    Regions are given by their radiance, or by material, sun and atmosphere; then it also says what the light at the
    aperture is made of. --light predicts as if only that part of it came. --tolerance is absolute in DoLP, s1, s2 and
    P_D, relative in radiance, counts, deviations and SNR; what cannot be kept is said (docs/accuracy.md).

    Inputs may be { value = 1.2, std = 0.1 } or { range = [1.0, 1.4] }: --uncertainty gives each number its standard
    uncertainty by all of them, [rig] included, and ranks them (docs/comparison.md).

    Example: rigctl predict examples/scene-airborne.toml --tolerance 0.01

    --tolerance goes with --sweep: some values are judged, those between them take the plans and errors of these.

    Example: rigctl predict examples/scene-airborne.toml --sweep sun.zenith_deg=10:80:8 --out sweep
    """
    from rigctl.jobs.predict import PredictRequest

    if key_and_range is not None and uncertainty:
        raise ConfigError("--uncertainty: is of one prediction; leave out --sweep")
    if estimated_only and tolerance is None:
        raise ConfigError("--estimated-only: is of a tolerance; give --tolerance T too")
    if tolerance is not None and uncertainty:
        raise ConfigError("--tolerance: is of the computation, --uncertainty of the inputs; give one of them")
    if key_and_range is None and out is not None:
        raise ConfigError("--out: is for a sweep; give --sweep KEY=start:stop:n too")
    request = PredictRequest(
        scene=scene,
        noise=noise,
        radiometric=radiometric,
        light=light,
        engine=engine,
        switched_on=tuple(switched_on or ()),
        left_out=tuple(left_out or ()),
    )
    if key_and_range is not None:
        _sweep(request, key_and_range, out=out, tolerance=tolerance, estimated_only=estimated_only, as_json=as_json)
    elif tolerance is not None:
        _predict_to(request, tolerance, estimated_only=estimated_only, as_json=as_json)
    else:
        _predict(request, uncertainty=uncertainty, as_json=as_json)


def _predict(request: "PredictRequest", *, uncertainty: bool, as_json: bool) -> None:
    from rigctl.jobs.predict import predict_scene
    from rigctl.reports.tables.comparison_json import prediction_json
    from rigctl.reports.tables.light_tables import geometry_lines, light_json, light_tables
    from rigctl.reports.tables.quantity_tables import quantity_tables
    from rigctl.reports.tables.uncertainty_tables import input_effect_tables, input_effects_json, with_input_errors

    predicted = predict_scene(request, uncertainty=uncertainty)
    found, errors = predicted.found, predicted.uncertainty
    _warn_of(predicted.doubts)
    content = prediction_json(found.predictions, predicted.performance, remarks=found.remarks) | light_json(found)
    if errors is not None:
        content |= {"regions": with_input_errors(found.predictions, errors)} | input_effects_json(errors)
    if as_json:
        print_json(content)
        return
    for line in geometry_lines(found):
        results().print(line)
    effects = () if errors is None else input_effect_tables(errors)
    for table in (*light_tables(found), *quantity_tables(content["regions"]), *effects):
        results().print(terminal_table(table))
    for remark in (*found.remarks, *_warnings(predicted), *_of_uncertainty(predicted)):
        progress().print(remark, markup=False)


def _warnings(predicted: "PredictedScene") -> Iterable[str]:
    from rigctl.comparison.remarks import model_warnings

    return model_warnings(predicted.found.predictions)


def _of_uncertainty(predicted: "PredictedScene") -> Iterable[str]:
    uncertain, errors = predicted.uncertain_inputs, predicted.uncertainty
    if errors is not None:
        yield from errors.remarks or (
            () if uncertain else ("no input has a stated uncertainty: all are taken as exact",)
        )
    elif uncertain:
        yield f"{len(uncertain)} inputs have a stated uncertainty: --uncertainty says what that makes of these numbers"


def _predict_to(request: "PredictRequest", tolerance: float, *, estimated_only: bool, as_json: bool) -> None:
    from rigctl.jobs.predict import predict_scene_to
    from rigctl.reports.tables.accuracy_tables import accuracy_json, accuracy_lines, accuracy_table
    from rigctl.reports.tables.comparison_json import prediction_json
    from rigctl.reports.tables.effects_tables import effects_json, left_out_line
    from rigctl.reports.tables.quantity_tables import quantity_tables

    predicted = predict_scene_to(request, tolerance=tolerance, estimated_only=estimated_only)
    found, effects = predicted.found, predicted.effects
    _warn_of(predicted.doubts)
    content = prediction_json(found.result.predictions, predicted.performance, remarks=predicted.remarks)
    if as_json:
        print_json(content | {"accuracy": accuracy_json(found), "effects": effects_json(effects, None)})
        return
    for table in (*quantity_tables(content["regions"]), accuracy_table(found)):
        results().print(terminal_table(table))
    for line in (*accuracy_lines(found), left_out_line(effects), *predicted.remarks):
        progress().print(line, markup=False)


def _sweep(
    request: "PredictRequest",
    key_and_range: str,
    *,
    out: Path | None,
    tolerance: float | None,
    estimated_only: bool,
    as_json: bool,
) -> None:
    from rigctl.jobs.predict import sweep_scene
    from rigctl.reports.tables.accuracy_tables import series_json, series_lines
    from rigctl.reports.tables.sweep_tables import sweep_json, sweep_tables

    swept = sweep_scene(request, key_and_range, out=out, tolerance=tolerance, estimated_only=estimated_only)
    _warn_of(swept.doubts)
    if as_json:
        accuracy = {} if swept.accuracy is None else {"accuracy": series_json(swept.accuracy)}
        print_json(sweep_json(swept.found) | accuracy | {"remarks": list(swept.remarks)})
        return
    results().print(f"sweep of {swept.found.key}", markup=False)
    for table in sweep_tables(swept.found):
        results().print(terminal_table(table))
    for remark in (*(() if swept.accuracy is None else series_lines(swept.accuracy)), *swept.remarks):
        progress().print(remark, markup=False)
    if out is not None:
        progress().print(f"sweep.csv, sweep.json and sweep.png in {out}", markup=False)


def _warn_of(doubts: Iterable[str]) -> None:
    for doubt in doubts:
        warn(doubt)
