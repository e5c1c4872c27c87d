"""`rigctl predict` and `rigctl sweep`: the analytical model of a scene, and of a scene over ranges of its numbers."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, Unpack

from cyclopts import Parameter

from rigctl.console import Json, note, solving_shown, warn
from rigctl.errors import ConfigError
from rigctl.files.choices import RocKind, SnrKind
from rigctl.verbs.options import (
    FilePath,
    Files,
    Part,
    PredictOptions,
    Result,
    ScenePath,
    Writes,
    changes_of,
    scene_file_of,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from model.accuracy.predict import Predicted, Predictions
    from model.effects.effect import EffectPlan
    from model.prediction import PairDetection, RegionPrediction
    from rigctl.calibrations.store import RigSelection
    from rigctl.prediction.predict import (
        Axis,
        Performance,
        PredictedUncertainty,
        RocPair,
        ScenePrediction,
        ScenePredictor,
    )
    from rigctl.prediction.sweep import Sweep
    from rigctl.report.document import AnyTable

    Ranges: TypeAlias = str | Sequence[str]
    Values: TypeAlias = Sequence[float] | NDArray[np.float64]
else:
    Ranges, Values = list[str], Any

_PREDICTED = ("prediction.json", "prediction.csv", "counts.png", "laws.png", "roc.csv", "roc.png")
_SWEPT = ("sweep.csv", "sweep.json", "sweep.png", "roc.csv", "roc.png")


def predict(
    scene: ScenePath,
    /,
    *,
    uncertainty: bool = False,
    write_truth: Annotated[FilePath | None, Writes()] = None,
    out: Annotated[FilePath | None, Writes(kind="folder", names=_PREDICTED)] = None,
    **options: Unpack[PredictOptions],
) -> "Prediction":
    """Predict the regions of a scene by the analytical model: counts, Stokes parameters, DoLP and their noise.

    A region is given by its radiance, or by its material; then the sun and the atmosphere light it, and the answer also
    lists the parts of the light at the aperture.

    Inputs may be uncertain: { value = 1.2, std = 0.1 } or { range = [1.0, 1.4] }. With --uncertainty, each result has a
    standard uncertainty, and the inputs are ranked by their share of it.

    Example: rigctl predict examples/scene-airborne.toml --tolerance 0.01

    Example: rigctl predict examples/scene-airborne.toml --set acquisition.exposure_ms=0.0003 --roc black_paint,asphalt
    --out dim

    Parameters
    ----------
    scene : path or SceneFile
        Scene file.
    uncertainty : bool
        Also propagate the uncertainties of the inputs to each number.
    write_truth : path
        Also write a scene file with the radiances, for simulators (.toml).
    out : path
        Folder for tables, JSON and pictures: counts at each angle, distributions of s1, s2 and DoLP.
    **options
        Changed numbers, calibrations, effects, tolerance, see `PredictOptions`.

    Returns
    -------
    Prediction
        Numbers of each region, as a table and as prediction.json has them.

    Raises
    ------
    ConfigError, DataError
        A file is wrong or does not fit, there is no such number, or the tolerance cannot be kept.
    """
    from rigctl.prediction.predict import performance_of, roc_curves
    from rigctl.scene.scene import only_uncertain

    tolerance = _tolerance(options)
    if tolerance is not None and uncertainty:
        raise ConfigError(
            "--tolerance is for numerical errors, --uncertainty for errors of the inputs; give one of them"
        )
    with solving_shown() as tell:
        predictor, doubts, selected = _predictor(scene, options, tell=tell)
        pair = _pair(options.get("roc"), predictor)
        light: ScenePrediction | None = None
        accuracy: Predicted | None = None
        effects: EffectPlan | None = None
        errors: PredictedUncertainty | None = None
        if tolerance is None:
            light = predictor.predict()
            predictions, remarks = light.predictions, light.remarks
            if uncertainty:
                from rigctl.prediction.predict import predicted_uncertainty

                errors = predicted_uncertainty(predictor, predictions)
        else:
            effects = predictor.effect_plan(tolerance, rule=options.get("effects") or "safe")
            accuracy = predictor.to_tolerance(
                tolerance, effects=effects, estimated_only=options.get("estimated_only", False)
            )
            effects = predictor.with_unstated(effects, accuracy)
            predictions, remarks = accuracy.result.predictions, (*predictor.remarks, *effects.remarks)
        found = Prediction(
            predictions=predictions,
            performance=performance_of(predictions),
            scene_remarks=remarks,
            doubts=doubts,
            rocs={} if pair is None else roc_curves(predictions, pair),
            selected=selected,
            light=light,
            uncertain_inputs=only_uncertain(predictor.inputs).names,
            uncertainty=errors,
            accuracy=accuracy,
            effects=effects,
            snr=options.get("snr", "exact"),
        )
    _report(selected, doubts)
    if out is not None:
        with solving_shown():
            note(f"written: {', '.join(found.write(Path(out)))} in {out}", below=True)
    if write_truth is not None:
        from rigctl.prediction.truth_file import write_truth as write

        if not isinstance(scene, str | Path):
            raise ConfigError("--write-truth: needs the scene as a file")
        write(Path(scene), Path(write_truth), changes=changes_of(options.get("changes", ())))
        note(f"truth: {write_truth}", below=True)
    return found


def sweep(
    scene: ScenePath,
    ranges: Ranges,
    values: Annotated[Values | None, Parameter(parse=False)] = None,
    /,
    *,
    out: Annotated[FilePath | None, Writes(kind="folder", names=_SWEPT)] = None,
    **options: Unpack[PredictOptions],
) -> "SweepResult":
    """Predict a scene over a range of one of its numbers, or over a grid of several.

    Where light is computed from materials, --tolerance is 0.01 if it is not given; a scene with [rig] errors or with
    rule = "midpoint" for its field of view keeps the settings of its file. Settings and errors are determined at some
    points and used for the points between them.

    Example: rigctl sweep examples/scene-airborne.toml sun.zenith_deg=10:80:8 --out sweep

    Example: rigctl sweep examples/scene-airborne.toml sun.zenith_deg=20:60:3 sensor.f_number=2:4:3 --tolerance 0.001

    Parameters
    ----------
    scene : path or SceneFile
        Scene file.
    ranges : KEY=start:stop:n
        Key of a number of the scene, with first value, last value and number of values; a second range makes a grid.
        In Python also the key alone, such as "sun.zenith_deg", followed by its values.
    values : sequence of float
        Values of one key, in the unit that the key ends in (Python only).
    out : path
        Folder for sweep.csv, sweep.json and a plot, or maps of a grid; with --roc also the curves.
    **options
        Changed numbers, calibrations, effects, tolerance, see `PredictOptions`.

    Returns
    -------
    SweepResult
        Numbers of each region at each point.

    Raises
    ------
    ConfigError, DataError
        A file is wrong or does not fit, there is no such number, or a value is outside its range.
    """
    from rigctl.prediction.sweep import sweep_over, sweep_to_tolerance

    axes = _axes(ranges, values)
    twice = [axis.key for axis in axes if axis.key in changes_of(options.get("changes", ()))]
    if twice:
        raise ConfigError(f"RANGES: {twice[0]} is set by --set as well; leave one of them out")
    with solving_shown() as tell:
        predictor, doubts, selected = _predictor(scene, options, tell=tell)
        pair = _pair(options.get("roc"), predictor)
        tolerance = _tolerance(options, default=predictor.tolerance_of_series(axis.key for axis in axes))
        accuracy: Predictions | None = None
        if tolerance is None:
            swept = sweep_over(predictor, axes, roc=pair)
        else:
            swept, accuracy = sweep_to_tolerance(
                predictor,
                axes,
                tolerance,
                roc=pair,
                rule=options.get("effects") or "safe",
                estimated_only=options.get("estimated_only", False),
            )
    found = SweepResult(
        found=swept,
        scene_remarks=predictor.remarks,
        doubts=doubts,
        accuracy=accuracy,
        selected=selected,
        snr=options.get("snr", "exact"),
    )
    _report(selected, doubts)
    if out is not None:
        note(f"written: {', '.join(found.write(Path(out)))} in {out}", below=True)
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction(Result):
    """Prediction of a scene: tables, and the content of prediction.json."""

    predictions: "dict[str, RegionPrediction]"
    performance: "Performance"  #: distribution of DoLP and detection
    scene_remarks: tuple[str, ...]  #: assumptions, and the least known inputs
    doubts: tuple[str, ...]  #: doubts about the calibrations
    rocs: "dict[RocKind, PairDetection]"  #: ROC curves; empty unless requested
    selected: "RigSelection"  #: calibrations that were selected from the store
    uncertain_inputs: tuple[str, ...]  #: inputs with a stated uncertainty
    light: "ScenePrediction | None" = None  #: geometry and parts of the light; None with a tolerance
    uncertainty: "PredictedUncertainty | None" = None  #: uncertainty of each number by the inputs, if requested
    accuracy: "Predicted | None" = None  #: numerical errors, with a tolerance
    effects: "EffectPlan | None" = None  #: effects that act, with a tolerance
    snr: SnrKind = "exact"  #: DoLP SNR that tables show

    def __repr__(self) -> str:
        return f"<prediction of {', '.join(self.predictions)}{self.selected}>"

    @property
    def calibrations(self) -> dict[str, Json]:
        """Calibrations by kind: file, sha256, why, age_days; empty without a store."""
        return self.selected.used

    @property
    def warnings(self) -> tuple[str, ...]:
        """Different doubts about regions and their detection."""
        from rigctl.prediction.predict import model_warnings

        pairs = (*self.performance.detections, *self.rocs.values())
        of_pairs = (f"{pair.target} on {pair.background}: {text}" for pair in pairs for text in pair.warnings)
        return tuple(dict.fromkeys((*model_warnings(self.predictions), *of_pairs)))

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks about calibrations, scene, regions and detection."""
        return (*self.doubts, *self.scene_remarks, *self.warnings)

    @property
    def notes(self) -> tuple[str, ...]:
        """Calibrations that were selected, and doubts about them."""
        return (*self.selected.lines, *self.doubts)

    def content(self) -> Iterable[Part]:
        """Return the DoLP of each region, the light, all numbers with their errors, and assumptions."""
        yield self._answer()
        yield from self._light()
        yield from self._tables()
        yield from self._lines()

    def _answer(self) -> str:
        return f"DoLP of single pixels: {'; '.join(_dolp_text(name, one) for name, one in self.predictions.items())}"

    def _light(self) -> Iterable[Part]:
        from rigctl.report.light import geometry_lines, light_tables

        if self.light is not None:
            yield from geometry_lines(self.light)
            yield from light_tables(self.light)

    def _tables(self) -> Iterable[Part]:
        from rigctl.report.detection import roc_table
        from rigctl.report.prediction import input_effect_tables, quantity_tables

        yield from quantity_tables(self._regions(), snr=self.snr)
        if self.uncertainty is not None:
            yield from input_effect_tables(self.uncertainty)
        if self.rocs:
            yield roc_table({kind: (one,) for kind, one in self.rocs.items()})

    def _lines(self) -> Iterable[Part]:
        if self.accuracy is not None and self.effects is not None:
            from rigctl.report.effects import left_out_line, unstated_line
            from rigctl.report.tradeoff import accuracy_lines, accuracy_table

            yield accuracy_table(self.accuracy)
            yield from (*accuracy_lines(self.accuracy), left_out_line(self.effects))
            if unstated := unstated_line(self.effects):
                yield f"{unstated} (`rigctl effects` shows by how much)"
        yield from (*self.scene_remarks, *self.warnings)
        if self.uncertainty is not None:
            from rigctl.report.prediction import correlation_lines

            yield from correlation_lines(self.uncertainty)
            none = () if self.uncertain_inputs else ("no input has a stated uncertainty: all are taken as exact",)
            yield from self.uncertainty.remarks or none
        elif self.uncertain_inputs and self.accuracy is None:
            yield f"{len(self.uncertain_inputs)} inputs have a stated uncertainty: --uncertainty propagates it"
        if self.light is not None and self.light.lights and self.uncertainty is None:
            yield "the numerical error of every number: --tolerance 0.01"

    def _regions(self) -> "Mapping[str, Mapping[str, Mapping[str, float]]]":
        from rigctl.report.prediction import with_input_errors, with_numerical_errors

        if self.uncertainty is not None:
            return with_input_errors(self.predictions, self.uncertainty)
        if self.accuracy is not None:
            return with_numerical_errors(self.accuracy)
        return {name: one.quantities for name, one in self.predictions.items()}

    def as_json(self) -> dict[str, Json]:
        """Return the content of prediction.json."""
        from model.prediction import reason_missing
        from rigctl.report.detection import roc_json
        from rigctl.report.effects import effects_json
        from rigctl.report.light import light_json
        from rigctl.report.prediction import input_effects_json, prediction_json
        from rigctl.report.tradeoff import accuracy_json

        content = prediction_json(self.predictions, self.performance, remarks=(*self.doubts, *self.scene_remarks))
        content |= {} if self.light is None else light_json(self.light)
        content["reasons"] = [
            {"number": f"{name}.{quantity}", "reason": reason}
            for name, one in self.predictions.items()
            for quantity, reason in reason_missing(one).items()
        ]
        if self.rocs:
            content["roc"] = roc_json({kind: (one,) for kind, one in self.rocs.items()}, ())
        content |= self.selected.as_json()
        if self.uncertainty is not None:
            content |= {"regions": self._regions(), **input_effects_json(self.uncertainty)}
        if self.accuracy is not None and self.effects is not None:
            content |= {"accuracy": accuracy_json(self.accuracy), "effects": effects_json(self.effects, None)}
        return content

    def output_files(self) -> Files:
        """Return numbers, plots and curves."""
        from rigctl.report.detection import roc_png, roc_points
        from rigctl.report.prediction import counts_png, laws_png

        warnings = [f"{name}: {text}" for name, one in self.predictions.items() for text in one.warnings]
        contents: dict[str, Any] = {
            "prediction.json": self.as_json(),
            "prediction.csv": _csv_table(self._numbers(), self.remarks),
            "counts.png": counts_png(self.predictions, warnings=warnings),
            "laws.png": laws_png(self.predictions, warnings=warnings),
        }
        if self.rocs:
            curves = {kind: (one,) for kind, one in self.rocs.items()}
            contents |= {"roc.csv": roc_points(curves), "roc.png": roc_png(curves)}
        return contents

    def _numbers(self) -> Iterable[tuple[str, str, str, float]]:
        for region, prediction in self.predictions.items():
            for quantity, statistics in prediction.quantities.items():
                for statistic, value in statistics.items():
                    yield region, quantity, statistic, value

    def table(self, *, backend: Literal["pandas", "polars"] = "pandas") -> Any:
        """Return every predicted number: region, quantity, statistic, value, std_error_inputs.

        Parameters
        ----------
        backend : {"pandas", "polars"}
            Library of the data frame. The error is given after ``predict(..., uncertainty=True)``.
        """
        from rigctl.report.document import Table, value_columns

        errors = {} if self.uncertainty is None else self.uncertainty.std_errors
        rows = tuple(
            (region, quantity, statistic, value, errors.get(region, {}).get(quantity, {}).get(statistic))
            for region, quantity, statistic, value in self._numbers()
        )
        columns = value_columns("region", "quantity", "statistic", "value", "std_error_inputs")
        return Table(columns=columns, rows=rows).data_frame(backend)


@dataclass(frozen=True, kw_only=True, eq=False)
class SweepResult(Result):
    """Prediction of a scene over ranges of its numbers: tables, and the content of sweep.json."""

    found: "Sweep"
    scene_remarks: tuple[str, ...]
    doubts: tuple[str, ...]
    selected: "RigSelection"
    accuracy: "Predictions | None" = None  #: numerical errors, with a tolerance
    snr: SnrKind = field(default="exact")

    def __repr__(self) -> str:
        values = self.found.values
        span = f"{len(values)} values from {values[0]:g} to {values[-1]:g}"
        return f"<sweep of {self.found.key}, {span}{self.selected}>"

    @property
    def calibrations(self) -> dict[str, Json]:
        """Calibrations by kind: file, sha256, why, age_days; empty without a store."""
        return self.selected.used

    @property
    def notes(self) -> tuple[str, ...]:
        """Calibrations that were selected, and doubts about them."""
        return (*self.selected.lines, *self.doubts)

    def content(self) -> Iterable[Part]:
        """Return the range of DoLP of each region, tables, warnings and assumptions."""
        from rigctl.report.sweep import MOST_AXES, sweep_png, sweep_tables, warning_lines
        from rigctl.report.tradeoff import series_lines

        yield self._answer()
        if len(self.found.axes) <= MOST_AXES:
            yield lambda: sweep_png(self.found)
        yield from sweep_tables(self.found, snr=self.snr)
        if self.accuracy is not None:
            yield from series_lines(self.accuracy)
        yield from warning_lines(self.found)
        yield from self.scene_remarks
        yield from dict.fromkeys(f"{number}: missing where {reason}" for _, number, reason in self.found.missing)

    def _answer(self) -> str:
        import numpy as np

        spans = []
        for region in self.found.regions:
            dolp = self.found.series(region, "dolp_pixels", "mean")
            known = dolp[np.isfinite(dolp)]
            spans.append(f"{region} {known.min():.4g} to {known.max():.4g}" if known.size else f"{region} undefined")
        return f"mean DoLP of pixels over {self.found.key}: {'; '.join(spans)}"

    def as_json(self) -> dict[str, Json]:
        """Return the content of sweep.json, with numerical errors and calibrations."""
        from rigctl.report.tradeoff import series_json

        accuracy = {} if self.accuracy is None else {"accuracy": series_json(self.accuracy)}
        return self._json() | accuracy | self.selected.as_json()

    def _json(self) -> dict[str, Json]:
        from rigctl.report.sweep import sweep_json

        return sweep_json(self.found, remarks=(*self.doubts, *self.scene_remarks))

    def output_files(self) -> Files:
        """Return numbers, plot and curves."""
        from rigctl.report.detection import roc_png, roc_points
        from rigctl.report.sweep import MOST_AXES, sweep_png, sweep_table

        remarks = (*self.doubts, *self.scene_remarks)
        contents: dict[str, Any] = {
            "sweep.csv": sweep_table(self.found, remarks=remarks),
            "sweep.json": self._json(),
        }
        if len(self.found.axes) <= MOST_AXES:
            contents["sweep.png"] = sweep_png(self.found, snr=self.snr, remarks=remarks)
        if self.found.rocs:
            contents |= {"roc.csv": roc_points(self.found.rocs), "roc.png": roc_png(self.found.rocs, self._labels())}
        return contents

    def _labels(self) -> tuple[str, ...]:
        points = [""]
        for axis in self.found.axes:
            points = [
                ", ".join(filter(None, (text, f"{axis.key}={value:g}"))) for text in points for value in axis.values
            ]
        return tuple(points)

    def table(self, *, backend: Literal["pandas", "polars"] = "pandas") -> Any:
        """Return every number at every value: key, at, region, quantity, statistic, value."""
        from rigctl.report.document import Table, value_columns

        found = self.found
        rows = tuple(
            (float(at), region, quantity, statistic, value)
            for at, step in zip(found.values, found.quantities, strict=True)
            for region, quantities in step.items()
            for quantity, statistics in quantities.items()
            for statistic, value in statistics.items()
        )
        columns = value_columns(found.key, "region", "quantity", "statistic", "value")
        return Table(columns=columns, rows=rows).data_frame(backend)


def _csv_table(numbers: Iterable[tuple[str, str, str, float]], remarks: Iterable[str]) -> "AnyTable":
    """Return a row for each number, then one for each remark."""
    from rigctl.report.document import Table, value_columns

    rows = [(*number, "") for number in numbers] + [("", "", "", None, text) for text in remarks]
    return Table(columns=value_columns("region", "quantity", "statistic", "value", "remark"), rows=tuple(rows))


def _dolp_text(name: str, prediction: "RegionPrediction") -> str:
    from rigctl.base.numbers import plus_minus

    dolp = prediction.quantities.get("dolp", {})
    mean, std = dolp.get("mean"), dolp.get("std")
    if mean is None or std is None or math.isnan(mean):
        return f"{name} undefined"
    if std > 1.0:
        return f"{name} not determined (no light above the noise)"
    return f"{name} {plus_minus(mean, std)}"


def _report(selected: "RigSelection", doubts: Iterable[str]) -> None:
    selected.report()
    for doubt in doubts:
        warn(doubt)


def _tolerance(options: PredictOptions, *, default: float | None = None) -> float | None:
    """Return the tolerance; raise ConfigError if it is missing and another option needs it."""
    given = options.get("tolerance")
    tolerance = default if given is None else given
    for option, value in (("effects", options.get("effects")), ("estimated-only", options.get("estimated_only"))):
        if tolerance is None and value:
            raise ConfigError(f"--{option}: needs a tolerance; give --tolerance T too")
    return tolerance


def _axes(ranges: Ranges, values: "Values | None") -> "tuple[Axis, ...]":
    import numpy as np

    from rigctl.prediction.predict import Axis, parse_sweeps

    texts = [ranges] if isinstance(ranges, str) else list(ranges)
    if values is None:
        return parse_sweeps(texts)
    at = np.atleast_1d(np.asarray(values, dtype=np.float64))
    if at.ndim != 1 or not len(at) or not np.all(np.isfinite(at)) or len(texts) != 1:
        raise ConfigError("values: give one key and one finite number or more")
    return (Axis(key=texts[0], values=at),)


def _pair(roc: str | None, predictor: "ScenePredictor") -> "RocPair | None":
    from rigctl.prediction.predict import parse_roc

    return None if roc is None else parse_roc(roc, tuple(region.name for region in predictor.scene.regions))


def _predictor(
    scene: ScenePath, options: PredictOptions, *, tell: Any
) -> "tuple[ScenePredictor, tuple[str, ...], RigSelection]":
    """Return the predictor of the scene, doubts about the calibrations, and the selected ones."""
    import time
    from functools import partial

    from rigctl.base.numbers import utc_text
    from rigctl.calibrations.kinds import MadeFor
    from rigctl.calibrations.store import NONE, selected_for_scene
    from rigctl.prediction.predict import ScenePredictor
    from rigctl.scene.light import SceneLight, require_engine
    from rigctl.scene.scene import with_choices

    engine, noise, radiometric = options.get("engine", "own"), options.get("noise"), options.get("radiometric")
    file = with_choices(
        scene_file_of(scene),
        switched_on=tuple(options.get("switched_on", ())),
        left_out=tuple(options.get("left_out", ())),
    )
    require_engine(engine, tier=None if file.atmosphere is None else file.atmosphere.tier)
    # A prediction states no camera, so only format and age can be unfit.
    used = MadeFor(bit_depth=file.sensor.bit_depth, taken_utc=utc_text(time.time_ns()))
    named, store = (None if path is None else Path(path) for path in (noise, options.get("calibrations")))
    place = Path(scene) if isinstance(scene, str | Path) else None
    selected = selected_for_scene(place, used, store, named)
    calibration = selected.files.get("noise", None if named == NONE else named)
    parameters, scaled, doubts = None, None, tuple[str, ...]()
    # Imports for calibrations take a tenth of a second, which a prediction without one saves.
    if calibration is not None:
        from rigctl.calibrations.noise import read_noise_file

        parameters = read_noise_file(calibration)
        doubts = parameters.doubts(used)
    if radiometric is not None:
        from rigctl.calibrations.radiometric import RadiometricResponse
        from rigctl.comparison.scale import with_panel_scale

        response = RadiometricResponse.read(Path(radiometric))
        scaled = partial(with_panel_scale, radiometric=response)
        doubts += response.doubts(used)
    predictor = ScenePredictor(
        file,
        parameters,
        light=SceneLight(engine=engine, tell=tell),
        source=options.get("light", "total"),
        scaled=scaled,
        changes=changes_of(options.get("changes", ())),
    )
    return predictor, doubts, selected
