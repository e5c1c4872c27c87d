"""``rigctl predict``: what the model says that a scene will give."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.console.json_text import Json
from rigctl.console.options import CalibrationStore
from rigctl.console.terminal import print_json, progress, results, solving_shown, warn
from rigctl.errors import ConfigError
from rigctl.files.choices import EffectRule, Engine, LightPart, SnrKind
from rigctl.reports.writers.terminal_table import terminal_table

if TYPE_CHECKING:
    from model.prediction import PairDetection, Quantities, RegionPrediction
    from rigctl.calibrations.rig_picks import RigPicks
    from rigctl.files.choices import RocKind
    from rigctl.jobs.predict import PredictedScene, PredictedToTolerance, PredictRequest
    from rigctl.reports.table import AnyTable


def command(
    scene: Annotated[Path, typer.Argument(metavar="SCENE.toml", help="Scene file.")],
    noise: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Noise calibration in place of the assumed noise. none: pick none."),
    ] = None,
    radiometric: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Radiometric calibration, in place of optics and efficiency.")
    ] = None,
    light: Annotated[
        LightPart, typer.Option(metavar="PART", help="Light of materials: total, reflected, reflected_sun, ..., path.")
    ] = "total",
    changes: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="A number in place of the file's. Repeatable."),
    ] = None,
    ranges: Annotated[
        list[str] | None,
        typer.Option("--sweep", metavar="KEY=start:stop:n", help="A number over a range; a second one makes a grid."),
    ] = None,
    roc: Annotated[
        str | None,
        typer.Option(metavar="TARGET,BACKGROUND", help="Whole ROC curves of a pair, on Stokes and on intensity."),
    ] = None,
    snr: Annotated[
        SnrKind, typer.Option(metavar="KIND", help="DoLP SNR that is shown: exact, first-order ([MK14]), or both.")
    ] = "exact",
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for pictures, tables, JSON.")] = None,
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
    rule: Annotated[
        EffectRule | None,
        typer.Option(
            "--effects",
            metavar="RULE",
            help="With --tolerance: effects go by bounds (safe, the default), by estimates (estimated), or act (all).",
        ),
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
    write_truth: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Also write a scene file of plain radiances, for simulators (.toml)."),
    ] = None,
    store: CalibrationStore = None,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Print what the analytical model predicts for each region: counts, Stokes parameters, DoLP, deviations, SNR.

    Regions are given by their radiance, or by material, sun and atmosphere; then it also says what the light at the
    aperture is made of. --light predicts as if only that part of it came. --tolerance is absolute in DoLP, s1, s2 and
    P_D, relative in radiance, counts, deviations and SNR; what cannot be kept is said (docs/accuracy.md).

    Inputs may be { value = 1.2, std = 0.1 } or { range = [1.0, 1.4] }: --uncertainty gives each number its standard
    uncertainty by all of them, [rig] included, and ranks them (docs/comparison.md).

    --set and --sweep take any number of docs/parameters.md. With --out: counts behind each angle and the laws of s1, s2
    and DoLP ([MK14] Figs 7, 8b); of a sweep table and plot, of a grid of two maps; with --roc the curves.

    Example: rigctl predict examples/scene-airborne.toml --tolerance 0.01

    Example: rigctl predict examples/scene-airborne.toml --set sun.zenith_deg=25 --roc black_paint,asphalt --out noon

    --tolerance with --sweep: some points are judged, those between them take the plans and errors of these.

    Example: rigctl predict examples/scene-airborne.toml --sweep sun.zenith_deg=10:80:8 --out sweep
    """
    from rigctl.jobs.predict import PredictRequest
    from rigctl.scene.parameters import parse_changes

    if ranges and uncertainty:
        raise ConfigError("--uncertainty: is of one prediction; leave out --sweep")
    if tolerance is None:
        _require_no_tolerance_wanted(estimated_only=estimated_only, rule=rule)
    elif uncertainty:
        raise ConfigError("--tolerance: is of the computation, --uncertainty of the inputs; give one of them")
    request = PredictRequest(
        scene=scene,
        noise=noise,
        radiometric=radiometric,
        light=light,
        engine=engine,
        switched_on=tuple(switched_on or ()),
        left_out=tuple(left_out or ()),
        rule=rule or "safe",
        changes=parse_changes(changes or ()),
        roc=roc,
        store=store,
        picks=True,
    )
    shown = _Shown(out=out, snr=snr, as_json=as_json)
    if ranges:
        _sweep(request, ranges, shown, tolerance=tolerance, estimated_only=estimated_only)
    elif tolerance is not None:
        _predict_to(request, tolerance, shown, estimated_only=estimated_only)
    else:
        _predict(request, shown, uncertainty=uncertainty)
    if write_truth is not None:
        _write_truth(scene, write_truth, request.changes)


def _require_no_tolerance_wanted(*, estimated_only: bool, rule: EffectRule | None) -> None:
    if estimated_only:
        raise ConfigError("--estimated-only: is of a tolerance; give --tolerance T too")
    if rule is not None:
        raise ConfigError("--effects: is of a prediction to a tolerance; give --tolerance T too")


@dataclass(frozen=True, kw_only=True)
class _Shown:
    """Where and how results are shown."""

    out: Path | None
    snr: SnrKind
    as_json: bool


def _write_truth(scene: Path, file: Path, changes: Mapping[str, float]) -> None:
    from rigctl.jobs.write_truth import write_truth

    write_truth(scene, file, changes=changes)
    progress().print(f"truth: {file}", markup=False)


def _predict(request: "PredictRequest", shown: _Shown, *, uncertainty: bool) -> None:
    from rigctl.jobs.predict import predict_scene
    from rigctl.reports.tables.light_tables import geometry_lines, light_json, light_tables
    from rigctl.reports.tables.prediction_tables import (
        input_effect_tables,
        input_effects_json,
        quantity_tables,
        with_input_errors,
    )

    with solving_shown() as tell:
        predicted = predict_scene(request, uncertainty=uncertainty, tell=tell)
    found, errors = predicted.found, predicted.uncertainty
    _say_of_calibrations(predicted.picked, predicted.doubts)
    content = _content(predicted, found.predictions, light_json(found), remarks=(*predicted.doubts, *found.remarks))
    regions: Mapping[str, Quantities] = {name: one.quantities for name, one in found.predictions.items()}
    if errors is not None:
        regions = with_input_errors(found.predictions, errors)
        content |= {"regions": regions} | input_effects_json(errors)
    _write(content, found.predictions, predicted.rocs, shown, remarks=predicted.remarks)
    if shown.as_json:
        print_json(content)
        return
    for line in geometry_lines(found):
        results().print(line)
    effects = () if errors is None else input_effect_tables(errors)
    _print((*light_tables(found), *quantity_tables(regions, snr=shown.snr), *effects, *_roc_tables(predicted.rocs)))
    _say((*found.remarks, *predicted.warnings, *_of_uncertainty(predicted)))


def _content(
    predicted: "PredictedScene | PredictedToTolerance",
    predictions: "Mapping[str, RegionPrediction]",
    beside: dict[str, Json],
    *,
    remarks: "Sequence[str]",
) -> dict[str, Json]:
    """Return what is written of every prediction, as JSON holds it."""
    from rigctl.reports.tables.numbers_json import prediction_json

    content = prediction_json(predictions, predicted.performance, remarks=remarks) | beside
    return content | _reasons(predictions) | _roc(predicted.rocs) | predicted.picked.as_json()


def _write(
    content: dict[str, Json],
    predictions: "Mapping[str, RegionPrediction]",
    rocs: "Mapping[RocKind, PairDetection]",
    shown: _Shown,
    *,
    remarks: "Sequence[str]",
) -> None:
    """Write the files of a prediction, where they are wanted."""
    if shown.out is None:
        return
    from rigctl.reports.outputs.prediction_files import write_prediction  # half a second, wanted for plots only

    with solving_shown():
        written = write_prediction(content, predictions, rocs, shown.out, remarks=remarks)
    progress().print(f"{', '.join(written)} in {shown.out}", markup=False)


def _roc(rocs: "Mapping[RocKind, PairDetection]") -> dict[str, Json]:
    from rigctl.reports.tables.detection_tables import roc_json

    return {"roc": roc_json({kind: (one,) for kind, one in rocs.items()}, ())} if rocs else {}


def _roc_tables(rocs: "Mapping[RocKind, PairDetection]") -> "Iterable[AnyTable]":
    from rigctl.reports.tables.detection_tables import roc_table

    return [roc_table({kind: (one,) for kind, one in rocs.items()})] if rocs else []


def _reasons(predictions: "Mapping[str, RegionPrediction]") -> dict[str, Json]:
    """Return which numbers do not exist, and why."""
    from model.prediction import reason_missing

    return {
        "reasons": [
            {"number": f"{name}.{quantity}", "reason": reason}
            for name, one in predictions.items()
            for quantity, reason in reason_missing(one).items()
        ]
    }


def _of_uncertainty(predicted: "PredictedScene") -> Iterable[str]:
    uncertain, errors = predicted.uncertain_inputs, predicted.uncertainty
    if errors is not None:
        from rigctl.reports.tables.prediction_tables import correlation_lines

        yield from correlation_lines(errors)
        yield from errors.remarks or (
            () if uncertain else ("no input has a stated uncertainty: all are taken as exact",)
        )
    elif uncertain:
        yield f"{len(uncertain)} inputs have a stated uncertainty: --uncertainty says what that makes of these numbers"


def _predict_to(request: "PredictRequest", tolerance: float, shown: _Shown, *, estimated_only: bool) -> None:
    from rigctl.jobs.predict import predict_scene_to
    from rigctl.reports.tables.accuracy_tables import accuracy_json, accuracy_lines, accuracy_table
    from rigctl.reports.tables.effects_tables import effects_json, left_out_line
    from rigctl.reports.tables.prediction_tables import quantity_tables

    with solving_shown() as tell:
        predicted = predict_scene_to(request, tolerance=tolerance, estimated_only=estimated_only, tell=tell)
    found, effects, predictions = predicted.found, predicted.effects, predicted.found.result.predictions
    _say_of_calibrations(predicted.picked, predicted.doubts)
    remarks = (*predicted.doubts, *predicted.remarks)
    content = _content(predicted, predictions, {}, remarks=remarks)
    content |= {"accuracy": accuracy_json(found), "effects": effects_json(effects, None)}
    _write(content, predictions, predicted.rocs, shown, remarks=(*remarks, *predicted.warnings))
    if shown.as_json:
        print_json(content)
        return
    regions = {name: one.quantities for name, one in predictions.items()}
    _print((*quantity_tables(regions, snr=shown.snr), *_roc_tables(predicted.rocs), accuracy_table(found)))
    _say((*accuracy_lines(found), left_out_line(effects), *predicted.remarks, *predicted.warnings))


def _sweep(
    request: "PredictRequest",
    ranges: "Sequence[str]",
    shown: "_Shown",
    *,
    tolerance: float | None,
    estimated_only: bool,
) -> None:
    from rigctl.jobs.predict import sweep_scene
    from rigctl.prediction.sweep_axes import parse_sweeps
    from rigctl.reports.tables.accuracy_tables import series_json, series_lines
    from rigctl.reports.tables.sweep_tables import sweep_json, sweep_tables, warning_lines

    out, snr, axes = shown.out, shown.snr, parse_sweeps(ranges)
    with solving_shown() as tell:
        swept = sweep_scene(
            request, axes, out=out, snr=snr, tolerance=tolerance, estimated_only=estimated_only, tell=tell
        )
    _say_of_calibrations(swept.picked, swept.doubts)
    if shown.as_json:
        accuracy = {} if swept.accuracy is None else {"accuracy": series_json(swept.accuracy)}
        print_json(sweep_json(swept.found, remarks=(*swept.doubts, *swept.remarks)) | accuracy | swept.picked.as_json())
        return
    results().print(f"sweep of {swept.found.key}", markup=False)
    _print(sweep_tables(swept.found, snr=snr))
    _say((*(() if swept.accuracy is None else series_lines(swept.accuracy)), *warning_lines(swept.found)))
    missing = dict.fromkeys(f"{one.number}: missing where {one.reason}" for one in swept.found.missing)
    _say((*swept.remarks, *missing))
    if out is not None:
        _say((f"sweep.csv, sweep.json and plots in {out}",))


def _say_of_calibrations(picked: "RigPicks", doubts: Iterable[str]) -> None:
    _say(picked.lines)
    for doubt in doubts:
        warn(doubt)


def _say(lines: Iterable[str]) -> None:
    for line in lines:
        progress().print(line, markup=False)


def _print(tables: "Iterable[AnyTable]") -> None:
    for table in tables:
        results().print(terminal_table(table))
