"""``rigctl predict``: what the model says that a scene will give."""

import json
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import typer

from model.scene.field_light import Source
from rigctl.calibrations.made_for import MadeFor
from rigctl.calibrations.noise.noise_file import NoiseParameters, read_noise_file, require_noise_fits
from rigctl.calibrations.radiometric_file import RadiometricResponse, read_radiometric_file, require_radiometric_fits
from rigctl.comparison.performance import performance_of
from rigctl.comparison.predicted_uncertainty import PredictedUncertainty, predicted_uncertainty
from rigctl.comparison.propagated_rows import only_uncertain
from rigctl.comparison.remarks import model_warnings
from rigctl.comparison.scene_prediction import ScenePredictor
from rigctl.comparison.sweep import Sweep, sweep
from rigctl.durable_file import write_durably
from rigctl.errors import ConfigError
from rigctl.files.scene_file import load_scene
from rigctl.reports.tables.accuracy_tables import accuracy_json, accuracy_lines, accuracy_table
from rigctl.reports.tables.comparison_json import prediction_json
from rigctl.reports.tables.effects_tables import effects_json, left_out_line
from rigctl.reports.tables.light_tables import geometry_lines, light_json, light_tables
from rigctl.reports.tables.quantity_tables import quantity_tables
from rigctl.reports.tables.sweep_tables import sweep_csv, sweep_json, sweep_png, sweep_tables
from rigctl.reports.tables.uncertainty_tables import input_effect_tables, input_effects_json, with_input_errors
from rigctl.scene.effect_choice import with_choices
from rigctl.scene.scene_light import SceneLight
from rigctl.scene.skies.engine import Engine, require_engine
from rigctl.terminal import print_json, progress, results, warn
from rigctl.utc_time import utc_text


def command(
    scene: Annotated[Path, typer.Argument(metavar="SCENE.toml", help="Scene file.")],
    noise: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Noise calibration; takes the place of the assumed noise.")
    ] = None,
    radiometric: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Radiometric calibration, in place of optics and efficiency.")
    ] = None,
    light: Annotated[
        Source, typer.Option(metavar="PART", help="Light of materials: total, reflected, reflected_sun, ..., path.")
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

    Example: rigctl predict examples/scene-airborne.toml --sweep sun.zenith_deg=10:80:8 --out sweep
    """
    scene_file = with_choices(load_scene(scene), switched_on=switched_on or [], left_out=left_out or [])
    require_engine(engine, tier=None if scene_file.atmosphere is None else scene_file.atmosphere.tier)
    calibration = None if noise is None else _fitting_noise(noise, bit_depth=scene_file.sensor.bit_depth)
    predictor = ScenePredictor(
        scene_file,
        calibration,
        light=SceneLight(engine=engine),
        source=light,
        radiometric=None if radiometric is None else _fitting_radiometric(radiometric, scene_file.sensor.bit_depth),
    )
    if key_and_range is not None and (tolerance is not None or uncertainty):
        raise ConfigError("--tolerance and --uncertainty: are of one prediction; leave out --sweep")
    if tolerance is not None and uncertainty:
        raise ConfigError("--tolerance: is of the computation, --uncertainty of the inputs; give one of them")
    if key_and_range is not None:
        _show_sweep(sweep(predictor, key_and_range), predictor.inputs.remarks, out=out, as_json=as_json)
        return
    if out is not None:
        raise ConfigError("--out: is for a sweep; give --sweep KEY=start:stop:n too")
    if tolerance is not None:
        _show_accurate(predictor, tolerance, as_json=as_json)
        return
    _show(predictor, uncertainty=uncertainty, as_json=as_json)


def _fitting_noise(path: Path, *, bit_depth: int) -> NoiseParameters:
    """Return a noise calibration; a prediction names no camera, so that only format and age can be unfit."""
    calibration = read_noise_file(path)
    for doubt in require_noise_fits(calibration, MadeFor(bit_depth=bit_depth, taken_utc=utc_text(time.time_ns()))):
        warn(doubt)
    return calibration


def _fitting_radiometric(path: Path, bit_depth: int) -> RadiometricResponse:
    calibration = read_radiometric_file(path)
    used = MadeFor(bit_depth=bit_depth, taken_utc=utc_text(time.time_ns()))
    for doubt in require_radiometric_fits(calibration, used):
        warn(doubt)
    return calibration


def _show(predictor: ScenePredictor, *, uncertainty: bool, as_json: bool) -> None:
    found = predictor.predict()
    errors = predicted_uncertainty(predictor, found.predictions) if uncertainty else None
    content = prediction_json(found.predictions, performance_of(found.predictions), remarks=found.remarks) | light_json(
        found
    )
    if errors is not None:
        content |= {"regions": with_input_errors(found.predictions, errors)} | input_effects_json(errors)
    if as_json:
        print_json(content)
        return
    for line in geometry_lines(found):
        results().print(line)
    effects = () if errors is None else input_effect_tables(errors)
    for table in (*light_tables(found), *quantity_tables(content["regions"]), *effects):
        results().print(table)
    for remark in (*content["remarks"], *model_warnings(found.predictions), *_of_uncertainty(predictor, errors)):
        progress().print(remark, markup=False)


def _of_uncertainty(predictor: ScenePredictor, errors: PredictedUncertainty | None) -> Iterable[str]:
    uncertain = only_uncertain(predictor.inputs).names
    if errors is not None:
        yield from errors.remarks or (
            () if uncertain else ("no input has a stated uncertainty: all are taken as exact",)
        )
    elif uncertain:
        yield f"{len(uncertain)} inputs have a stated uncertainty: --uncertainty says what that makes of these numbers"


def _show_accurate(predictor: ScenePredictor, tolerance: float, *, as_json: bool) -> None:
    effects = predictor.effect_plan(tolerance)
    found = predictor.to_tolerance(tolerance, effects=effects)
    remarks = (*predictor.inputs.remarks, *effects.remarks)
    predictions = found.result.predictions
    content = prediction_json(predictions, performance_of(predictions), remarks=remarks)
    if as_json:
        print_json(content | {"accuracy": accuracy_json(found), "effects": effects_json(effects, None)})
        return
    for table in (*quantity_tables(content["regions"]), accuracy_table(found)):
        results().print(table)
    for line in (*accuracy_lines(found), left_out_line(effects), *content["remarks"]):
        progress().print(line, markup=False)


def _show_sweep(found: Sweep, remarks: tuple[str, ...], *, out: Path | None, as_json: bool) -> None:
    content = sweep_json(found) | {"remarks": list(remarks)}
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        write_durably(out / "sweep.csv", sweep_csv(found))
        write_durably(out / "sweep.json", (json.dumps(content, indent=2, allow_nan=False) + "\n").encode())
        write_durably(out / "sweep.png", sweep_png(found))
    if as_json:
        print_json(content)
        return
    results().print(f"sweep of {found.key}", markup=False)
    for table in sweep_tables(found):
        results().print(table)
    for remark in remarks:
        progress().print(remark, markup=False)
    if out is not None:
        progress().print(f"sweep.csv, sweep.json and sweep.png in {out}", markup=False)
