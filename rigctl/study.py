"""Studies: predictions of many cases of some scenes, on dask, each done once.

The cases of a study are every combination of some numbers, lists side by side, or draws from the laws of the numbers.
Cases under one sky are computed together, in batches that workers take. Each finished batch is a durable file in the
folder of the study, with the hash of each case: after a kill or a power cut the same command continues with the
unfinished ones. At the end the numbers are written as one Zarr store for xarray and as tables in Parquet. A study of
kind "sobol" also gives the sensitivity of each number to each uncertain input.
"""

from __future__ import annotations

import hashlib
import io
import itertools
import json
import math
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from model.numerics import ndtr, ndtri
from model.prediction import RegionPrediction, detections_of_sweep
from model.quantities import is_counts
from rigctl import mapped as on_dask
from rigctl.base.durable import (
    MOST_RECORD_BYTES,
    MOST_TEXT_BYTES,
    flush_folder,
    read_arrays,
    read_bounded,
    write_durably,
)
from rigctl.base.numbers import utc_text
from rigctl.errors import ConfigError, DataError
from rigctl.files.choices import ROC_KINDS
from rigctl.files.scene_file import load_scene
from rigctl.files.study_file import load_study
from rigctl.mapped import PARTS_FOLDER, held_folder, mapped
from rigctl.prediction.predict import ROC_RATES, SWEPT_RATES, ScenePredictor, parse_roc, roc_curves_of_sweep
from rigctl.prediction.sweep import SKY_KEYS
from rigctl.report.document import Column, Shown, Table
from rigctl.report.drawing import MEASURED, PREDICTED, png, subplots
from rigctl.report.files import write_folder
from rigctl.scene.light import SceneLight
from rigctl.scene.scene import get, require_within, with_values

if TYPE_CHECKING:
    from rigctl.console import Json
    from rigctl.files.scene_file import SceneFile
    from rigctl.files.study_file import CasesSection, StudyFile, VariedSection
    from rigctl.mapped import Engine, Outcome
    from rigctl.scene.scene import Parameter, Scene

FloatArray = NDArray[np.float64]

# The code that determines the numbers.
PACKAGES = ("model", "rigctl.files", "rigctl.scene", "rigctl.prediction", "rigctl.study")


@dataclass(frozen=True, kw_only=True)
class StudyScene:
    """A scene of a study; two scenes are the same if their digests are."""

    digest: str  #: SHA-256 of the file and of the files that it names
    name: str = field(compare=False)  #: name of the file without its ending
    #: Its content. Workers read the files that it names under the same paths.
    file: SceneFile = field(compare=False, repr=False)


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """Numbers that are computed of every case."""

    columns: tuple[tuple[str, str], ...]  #: quantity and statistic of each region
    detection: bool  #: compute probability of detection and area under the curve of every ordered pair
    roc: str | None  #: pair with whole curves
    tolerance: float | None  #: largest numerical error; None: the settings of the scene file


@dataclass(frozen=True, kw_only=True)
class Case:
    """One case: its index in the study, the index of its scene, and the numbers that replace the file's."""

    number: int
    scene: int
    values: tuple[tuple[str, float], ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Numbers:
    """Numbers of N cases, NaN where there are none."""

    regions: tuple[str, ...]  #: R of them
    pairs: tuple[str, ...]  #: P ordered pairs as "TARGET on BACKGROUND", if detection is computed
    values: FloatArray  #: of the columns, (N, R, columns)
    p_detection: FloatArray  #: at the rates of a sweep, (N, P, rates)
    auc: FloatArray  #: areas under the curves, (N, P)
    roc: FloatArray  #: P_D on Stokes parameters and on counts at `ROC_RATES`, (N, 2, rates), or (N, 0, rates)
    seconds: FloatArray  #: time of each case; of the first of a sky with that sky
    is_new_sky: NDArray[np.bool_]  #: True if the case before had another sky, or for the first
    reasons: tuple[str, ...]  #: reason of a failed case


@dataclass(frozen=True, kw_only=True, eq=False)
class StudyTable:
    """A study as its files hold it."""

    scenes: tuple[str, ...]  #: names
    axes: tuple[Parameter, ...]  #: the varied numbers
    grid: tuple[tuple[float, ...], ...]  #: values of each axis for a grid, else empty
    columns: tuple[tuple[str, str], ...]  #: quantity and statistic
    cases: tuple[Case, ...]
    numbers: Numbers
    attributes: Mapping[str, str]  #: attributes of the store: version, inputs, conventions


# The whole study.


def run_study(
    path: Path, out: Path, engine: Engine, tolerance: float | None, *, tell: Callable[[int, int], None]
) -> tuple[StudyTable, tuple[SobolIndex, ...], Outcome, int, list[str]]:
    """Compute the remaining cases of a study, and write it at the end.

    Returns the study, how much its inputs matter (of kind sobol, when whole), the outcome, how many cases were done
    before, and the parts of an earlier command that are damaged.
    """
    file = load_study(path)
    scenes = tuple(study_scene(scene) for scene in file.scenes)
    predictors = [ScenePredictor(scene.file, None) for scene in scenes]
    cases = cases_of(file.cases, [one.scene for one in predictors])
    wanted = _wanted(file, predictors, tolerance)
    hashes = _case_hashes(cases, scenes, wanted)
    texts = {one.name: read_bounded(one, MOST_TEXT_BYTES).decode("utf-8") for one in (path, *file.scenes)}
    varied = file.cases.parameters
    with held_folder(out):
        done, damaged = read_parts(out)
        left = [case for case, one in zip(cases, hashes, strict=True) if one not in done]
        before = len(cases) - len(left)
        outcome = mapped(
            engine,
            compute,
            lambda slots: batches_of(left, scenes, wanted, workers=slots),
            lambda batch, numbers: write_part(out, numbers, [hashes[case.number] for case in batch.cases]),
            command="study",
            packages=PACKAGES,
            size=lambda batch: len(batch.cases),
            parts=lambda batch: tuple(replace(batch, cases=(case,)) for case in batch.cases),
            lost=_failed,
            done=before,
            total=len(cases),
            tell=tell,
        )
        table = StudyTable(
            scenes=tuple(scene.name for scene in scenes),
            axes=tuple(get(predictors[0].scene, key) for key in varied),
            grid=tuple(tuple(one.steps) for one in varied.values()) if file.cases.kind == "grid" else (),
            columns=wanted.columns,
            cases=cases,
            numbers=_joined(hashes, read_parts(out)[0], wanted),
            attributes={
                "title": file.name,
                "created_by": f"rigctl {code_version()}",
                "created_utc": utc_text(time.time_ns()),
                "origin": "predicted by the analytical model; nothing here was measured",
                "conventions": _CONVENTIONS,
                **{f"input {name}": text for name, text in texts.items()},
            },
        )
        sobol: tuple[SobolIndex, ...] = ()
        if outcome == "whole":
            if file.cases.kind == "sobol":
                sobol = tuple(row for number, values in _numbers_of(table) for row in sobol_of(number, values, varied))
            write_study(out, table, sobol)
    return table, sobol, outcome, before, damaged


_DETECTION = ("p_detection", "auc")


def _wanted(file: StudyFile, predictors: Sequence[ScenePredictor], tolerance: float | None) -> Wanted:
    """Return the numbers to compute; quantities must exist in the prediction of a scene file."""
    known: dict[tuple[str, str], None] = {}
    for predictor in predictors:
        if file.roc is not None:
            parse_roc(file.roc, tuple(region.name for region in predictor.scene.regions))
        for region in predictor.predictions().values():
            known |= {(name, one): None for name, statistics in region.quantities.items() for one in statistics}
    columns: dict[tuple[str, str], None] = {}
    problems = []
    for quantity in file.quantities:
        name, _, statistic = quantity.partition(".")
        fitting = [one for one in known if one[0] == name and statistic in ("", one[1])]
        if not fitting and quantity not in _DETECTION:
            problems.append(quantity)
        columns |= dict.fromkeys(fitting)
    if problems:
        names = sorted({name for name, _ in known} | set(_DETECTION))
        raise ConfigError(f"quantities: no scene gives {', '.join(problems)}; there are {', '.join(names)}")
    if tolerance is None:
        own = [one.tolerance_of_series(file.cases.parameters) for one in predictors]
        tolerance = None if None in own else min(filter(None, own))
    detection = any(quantity in _DETECTION for quantity in file.quantities)
    return Wanted(columns=tuple(columns), detection=detection, roc=file.roc, tolerance=tolerance)


def study_scene(path: Path) -> StudyScene:
    """Return a scene with its digest."""
    file = load_scene(path)
    return StudyScene(digest=scene_digest(file), name=path.stem, file=file)


def scene_digest(file: SceneFile) -> str:
    """Return the hash of a scene's content and of the files that it names."""
    digest = hashlib.sha256(file.model_dump_json().encode())
    table = None if file.atmosphere is None else file.atmosphere.table
    materials = (Path(region.material) for region in file.regions if region.material is not None)
    for named in (*materials, *(() if table is None else (table,))):
        if named.is_file():  # others are names of the library
            digest.update(read_bounded(named, MOST_RECORD_BYTES))
    return digest.hexdigest()


def code_version() -> str:
    """Return the program's version with a hash of the code that determines the numbers."""
    return on_dask.code_version(PACKAGES)


def _case_hashes(cases: Sequence[Case], scenes: Sequence[StudyScene], wanted: Wanted) -> list[str]:
    """Return the hash of the inputs of each case, the requested numbers, and the code."""
    shared = [code_version(), wanted.columns, wanted.detection, wanted.roc, wanted.tolerance]
    begun = [hashlib.sha256(json.dumps([*shared, scene.digest]).encode()) for scene in scenes]
    hashes = []
    for case in cases:
        one = begun[case.scene].copy()
        one.update(json.dumps(sorted(case.values)).encode())
        hashes.append(one.hexdigest())
    return hashes


# Cases.


def cases_of(section: CasesSection, scenes: Sequence[Scene]) -> tuple[Case, ...]:
    """Return every case of a study: those of the first scene, then those of the second, and so on."""
    parameters = [_parameters(section, scene) for scene in scenes]
    tables = [_key_values(section, scene, found) for scene, found in zip(scenes, parameters, strict=True)]
    rows = ((place, row) for place, table in enumerate(tables) for row in table)
    keys = tuple(section.parameters)
    return tuple(
        Case(number=number, scene=place, values=tuple(zip(keys, map(float, row), strict=True)))
        for number, (place, row) in enumerate(rows)
    )


def unit_draws(kind: str, inputs: int, n: int, seed: int) -> FloatArray:
    """Return draws in the unit cube, shape (cases, inputs); of sobol in the order of its blocks.

    Of "sobol" the rows are A, B, and for each input A with that input's column of B, n each (Saltelli et al., Comput.
    Phys. Commun. 181 (2010) 259).
    """
    from scipy.stats import qmc

    rng = np.random.default_rng(seed)
    if kind == "latin":
        return np.asarray(qmc.LatinHypercube(inputs, rng=rng).random(n))
    if kind == "sobol":
        both = np.asarray(qmc.Sobol(2 * inputs, scramble=True, rng=rng).random(n))
        first, second = both[:, :inputs], both[:, inputs:]
        mixed = [np.where(np.arange(inputs) == k, second, first) for k in range(inputs)]
        return np.concatenate([first, second, *mixed])
    return rng.random((n, inputs))


def _parameters(section: CasesSection, scene: Scene) -> dict[str, Parameter]:
    parameters, problems = {}, []
    for key, varied in section.parameters.items():
        try:
            parameters[key] = get(scene, key)
            for value in varied.range or varied.values or (*varied.steps[:1], *varied.steps[-1:]):
                require_within(scene, {key: value}, option="cases.parameters")
            if varied.std == "stated" and parameters[key].std == 0.0:
                raise ConfigError(f'cases.parameters: {key}: std = "stated", but the scene states none')
        except ConfigError as error:
            problems.append(str(error))
    if problems:
        raise ConfigError(f"scene {scene.name}: " + "; ".join(problems))
    return parameters


def _key_values(section: CasesSection, scene: Scene, found: Mapping[str, Parameter]) -> Iterable[Sequence[float]]:
    varied = section.parameters
    steps = [one.steps for one in varied.values()]
    if section.kind == "grid":
        return itertools.product(*steps)
    if section.kind == "list":
        return zip(*steps, strict=True)
    n = section.n or 0
    cube = unit_draws(section.kind, len(varied), n, section.seed)
    if section.kind in ("random", "latin"):
        cube = _going_together(cube, section, scene)
    columns = [_at(one, found[key], cube[:, k]) for k, (key, one) in enumerate(varied.items())]
    rows: list[list[float]] = np.stack(columns, axis=1).tolist()
    return rows


def _going_together(cube: FloatArray, section: CasesSection, scene: Scene) -> FloatArray:
    """Return draws of numbers with correlated stated errors; all others stay independent."""
    places = {key: k for k, (key, one) in enumerate(section.parameters.items()) if one.std == "stated"}
    drawn = cube.copy()
    for keys, joint in scene.joint_errors:
        chosen = [k for k, key in enumerate(keys) if key in places]
        columns = [places[keys[k]] for k in chosen]
        covariance = joint[np.ix_(chosen, chosen)]
        std = np.sqrt(np.diag(covariance))
        if len(chosen) > 1 and np.all(std > 0.0):
            variances, axes = np.linalg.eigh(covariance / np.outer(std, std))
            root = axes * np.sqrt(np.maximum(variances, 0.0)) @ axes.T
            scores = ndtri(np.maximum(cube[:, columns], np.finfo(np.float64).tiny))
            drawn[:, columns] = ndtr(scores @ root)
    return drawn


def _at(varied: VariedSection, parameter: Parameter, share: FloatArray) -> FloatArray:
    """Return values of a law at shares of its probability; a normal law is truncated at the number's limits."""
    if varied.steps:
        values = np.array(varied.steps, dtype=np.float64)
        return np.asarray(values[np.minimum((share * values.size).astype(int), values.size - 1)])
    if varied.range is not None:
        low, high = varied.range
        return np.asarray(low + (high - low) * share)
    std = parameter.std if varied.std == "stated" else float(varied.std or 0.0)
    ends = ndtr((np.array([parameter.least, parameter.most]) - parameter.value) / std)
    drawn = parameter.value + std * ndtri(ends[0] + share * (ends[1] - ends[0]))
    return np.asarray(np.clip(drawn, parameter.least, parameter.most))  # of the last digit alone


# Batches of cases.

Predictions = Mapping[str, RegionPrediction]

# Cases of a batch, for some seconds of work and little loss when a worker ends; and batches per worker, for short waits
# at the end. With a tolerance larger batches need fewer error estimates.
_MOST_CASES, _ROUNDS = 64, 8
_MOST_TO_TOLERANCE, _ROUNDS_TO_TOLERANCE = 256, 2
_SKIES_EACH = 2
# Scenes cached by a worker.
_SCENES_KEPT = 2


@dataclass(frozen=True, kw_only=True)
class Batch:
    """Cases of one scene that are computed together, and the required code."""

    scene: StudyScene
    wanted: Wanted
    cases: tuple[Case, ...]
    code: str


def batches_of(cases: Sequence[Case], scenes: Sequence[StudyScene], wanted: Wanted, *, workers: int) -> Iterator[Batch]:
    """Yield batches in the order of skies, which are divided only if they have many cases."""
    largest, rounds = (_MOST_CASES, _ROUNDS) if wanted.tolerance is None else (_MOST_TO_TOLERANCE, _ROUNDS_TO_TOLERANCE)
    most = max(1, min(largest, math.ceil(len(cases) / (workers * rounds))))
    ordered = sorted(cases, key=lambda case: (case.scene, _sky_of(case), case.number))
    skies = [list(group) for _, group in groupby(ordered, key=lambda case: (case.scene, _sky_of(case)))]
    # With enough skies for all workers no sky is solved twice.
    piece = largest if len(skies) >= _SKIES_EACH * workers else most

    def batch(cases: Sequence[Case]) -> Batch:
        return Batch(scene=scenes[cases[0].scene], wanted=wanted, cases=tuple(cases), code=code_version())

    held: list[Case] = []
    for cut in (sky[k : k + piece] for sky in skies for k in range(0, len(sky), piece)):
        if held and (held[0].scene != cut[0].scene or len(held) + len(cut) > most):
            yield batch(held)
            held = []
        held += cut
    if held:
        yield batch(held)


def _sky_of(case: Case) -> tuple[float, ...]:
    """Return the numbers of a case on which its sky depends."""
    return tuple(value for key, value in case.values if key.startswith(SKY_KEYS))


def compute(batch: Batch) -> Numbers:
    """Return the prediction of each case of a batch; a failed case has a reason and does not affect others."""
    if batch.code != code_version():
        raise ConfigError(f"a worker has rigctl {code_version()}, the study {batch.code}: install the same on both")
    predictor, wanted = _predictor(batch.scene), batch.wanted
    results = _predicted_all(predictor, [dict(case.values) for case in batch.cases], wanted.tolerance)
    reasons = tuple(one if isinstance(one, str) else "" for one, _ in results)
    numbers = _no_numbers(predictor.scene.regions, wanted, reasons)
    skies = [_sky_of(case) for case in batch.cases]
    there, predictions = [], []
    for k, (prediction, seconds) in enumerate(results):
        numbers.seconds[k] = seconds
        numbers.is_new_sky[k] = batch.scene.file.atmosphere is not None and (k == 0 or skies[k] != skies[k - 1])
        if isinstance(prediction, str):
            continue
        there.append(k)
        predictions.append(prediction)
        numbers.values[k] = [
            [prediction[name].quantities.get(quantity, {}).get(of, math.nan) for quantity, of in wanted.columns]
            for name in numbers.regions
        ]
    if predictions and wanted.detection:
        for k, detections in zip(there, detections_of_sweep(predictions, SWEPT_RATES), strict=True):
            by_pair = {f"{one.target} on {one.background}": one for one in detections}
            numbers.p_detection[k] = [by_pair[name].p_detection for name in numbers.pairs]
            numbers.auc[k] = [by_pair[name].auc for name in numbers.pairs]
    if predictions and wanted.roc is not None:
        curves = roc_curves_of_sweep(predictions, parse_roc(wanted.roc, numbers.regions))
        for place, kind in enumerate(ROC_KINDS):
            numbers.roc[there, place] = [one.p_detection for one in curves[kind]]
    return numbers


def _no_numbers(regions: Sequence[Any], wanted: Wanted, reasons: tuple[str, ...]) -> Numbers:
    """Return an empty record of cases of a scene."""
    names = tuple(region.name for region in regions)
    pairs = tuple(f"{target} on {background}" for target in names for background in names if target != background)
    return _blank(names, pairs if wanted.detection else (), wanted, reasons)


def _blank(regions: tuple[str, ...], pairs: tuple[str, ...], wanted: Wanted, reasons: tuple[str, ...]) -> Numbers:
    cases = len(reasons)
    return Numbers(
        regions=regions,
        pairs=pairs,
        values=np.full((cases, len(regions), len(wanted.columns)), np.nan),
        p_detection=np.full((cases, len(pairs), len(SWEPT_RATES)), np.nan),
        auc=np.full((cases, len(pairs)), np.nan),
        roc=np.full((cases, 0 if wanted.roc is None else len(ROC_KINDS), ROC_RATES.size), np.nan),
        seconds=np.full(cases, np.nan),
        is_new_sky=np.zeros(cases, dtype=bool),
        reasons=reasons,
    )


def _failed(batch: Batch, reason: str) -> Numbers:
    """Return the result of a batch that no worker could compute."""
    return _no_numbers(batch.scene.file.regions, batch.wanted, (reason,) * len(batch.cases))


def _predicted_all(
    predictor: ScenePredictor, changes: Sequence[dict[str, float]], tolerance: float | None
) -> list[tuple[Predictions | str, float]]:
    """Return the prediction of each case or the reason of its failure, and the time [s].

    With a tolerance, errors are estimated for some cases and interpolated for others. If one fails, halves are tried.
    """
    if tolerance is None or len(changes) == 1:
        results = []
        for values in changes:
            start_s = time.perf_counter()
            prediction = _predicted(predictor, values, tolerance)
            results.append((prediction, time.perf_counter() - start_s))
        return results
    try:
        for values in changes:
            require_within(predictor.scene, values, option="case")
        scenes = [with_values(predictor.scene, values) for values in changes]
        points = np.array([list(values.values()) for values in changes])
        cases = predictor.series_to_tolerance(scenes, tolerance, points=points).cases
    except Exception:  # a failing case gives its reason when it is alone
        half = len(changes) // 2
        return _predicted_all(predictor, changes[:half], tolerance) + _predicted_all(
            predictor, changes[half:], tolerance
        )
    return [(one.result.predictions, sum((one.stage_s or one.result.stage_s).values())) for one in cases]


@lru_cache(maxsize=_SCENES_KEPT)
def _predictor(scene: StudyScene) -> ScenePredictor:
    if scene_digest(scene.file) != scene.digest:
        raise ConfigError(
            f"scene {scene.name}: files that it names are missing on a worker, or differ from the study's"
        )
    return ScenePredictor(scene.file, None, light=SceneLight(is_kept_between_runs=False))


def _predicted(predictor: ScenePredictor, values: dict[str, float], tolerance: float | None) -> Predictions | str:
    """Return the predictions of a case, or the reason of its failure."""
    try:
        scene = with_values(predictor.scene, values)
        require_within(predictor.scene, values, option="case")
        if tolerance is None:
            return predictor.predictions_of(scene)
        return predictor.series_to_tolerance((scene,), tolerance).cases[0].result.predictions
    except (ConfigError, DataError) as error:
        return str(error)
    except Exception as error:  # an error of the model in one case of a million is the reason of that case
        return f"{type(error).__name__}: {error}"


# Parts: what is done so far.

UNDONE = "not computed yet"


def write_part(out: Path, numbers: Numbers, hashes: Sequence[str]) -> None:
    """Return once a batch is on the disk, under the hash of its first case."""
    data = io.BytesIO()
    arrays: dict[str, Any] = {name: np.array(value) for name, value in vars(numbers).items()}
    np.savez(data, hashes=np.array(hashes), **arrays)
    write_durably(out / PARTS_FOLDER / f"{hashes[0]}.npz", data.getvalue())


def read_parts(out: Path) -> tuple[dict[str, tuple[Numbers, int]], list[str]]:
    """Return the hash of each finished case with its numbers and its row in them, and the damaged parts."""
    done: dict[str, tuple[Numbers, int]] = {}
    damaged = []
    for file in sorted((out / PARTS_FOLDER).glob("*.npz")):
        try:
            arrays: dict[str, Any] = read_arrays(file)
            hashes = arrays.pop("hashes").tolist()
            texts = {name: tuple(arrays[name].tolist()) for name in ("regions", "pairs", "reasons")}
            numbers = Numbers(**{**arrays, **texts})
        except DataError as error:
            damaged.append(str(error))
        except (KeyError, TypeError) as error:
            damaged.append(f"{file}: is not a part of a study: {error}")
        else:
            done |= {one: (numbers, row) for row, one in enumerate(hashes)}
    return done, damaged


def _joined(hashes: Sequence[str], done: Mapping[str, tuple[Numbers, int]], wanted: Wanted) -> Numbers:
    """Return the numbers of all cases; NaN for a missing region or an unfinished case."""
    parts = dict.fromkeys(done[one][0] for one in hashes if one in done)
    regions = tuple(dict.fromkeys(name for part in parts for name in part.regions))
    pairs = tuple(dict.fromkeys(name for part in parts for name in part.pairs))
    reasons = [done[one][0].reasons[done[one][1]] if one in done else UNDONE for one in hashes]
    whole = _blank(regions, pairs, wanted, tuple(reasons))
    for k, one in enumerate(hashes):
        if one not in done:
            continue
        part, row = done[one]
        whole.values[k, [regions.index(name) for name in part.regions]] = part.values[row]
        there = [pairs.index(name) for name in part.pairs]
        whole.p_detection[k, there], whole.auc[k, there] = part.p_detection[row], part.auc[row]
        whole.roc[k], whole.seconds[k], whole.is_new_sky[k] = part.roc[row], part.seconds[row], part.is_new_sky[row]
    return whole


# Files for others.

ZARR, REGIONS_TABLE, DETECTION_TABLE = "study.zarr", "study.parquet", "detection.parquet"
_STOKES = ("s0", "s1", "s2")
# Conventions, in words for readers of the store.
_CONVENTIONS = (
    "S1 = horizontal - vertical, S2 = (+45) - (-45), angles counter-clockwise from horizontal as the camera sees the "
    "scene, AoLP in [0, 180) deg; azimuths clockwise from north; counts and Stokes parameters in DN"
)


def write_study(out: Path, table: StudyTable, sobol: Sequence[SobolIndex]) -> tuple[str, ...]:
    """Write the store, the tables and the sensitivities into a folder; return the names of the files."""
    _write_zarr(out, table)
    _write_parquet(out, table)
    sensitivity = _write_sensitivity(sobol, out, created_by=table.attributes["created_by"]) if sobol else ()
    return (REGIONS_TABLE, DETECTION_TABLE, *sensitivity)


def _column_name(column: tuple[str, str]) -> str:
    """Return the name of a number in stores and tables, "dolp_mean"."""
    return "_".join(column)


def _write_zarr(out: Path, table: StudyTable) -> None:
    """Write the store; an old one is replaced once the new one is complete."""
    part, store = out / f"{ZARR}.part", out / ZARR
    shutil.rmtree(part, ignore_errors=True)
    _dataset(table).to_zarr(part, mode="w", zarr_format=2, consolidated=True)
    if store.exists():
        store.rename(out / f"{ZARR}.old")
    part.rename(store)
    shutil.rmtree(out / f"{ZARR}.old", ignore_errors=True)
    flush_folder(out)


def _dataset(table: StudyTable) -> Any:
    """Return the numbers as an `xarray.Dataset`: over scene and axes of a grid, else over cases."""
    import xarray as xr

    numbers = table.numbers
    dims, lengths, coords = _dimensions(table)
    coords |= {"region": ("region", _texts(numbers.regions))}

    def shaped(values: Any, *inner: str) -> tuple[tuple[str, ...], Any]:
        return (*dims, *inner), values.reshape(*lengths, *values.shape[1:])

    variables: dict[str, Any] = {
        _column_name(column): (*shaped(numbers.values[..., k], "region"), {"units": _unit(column[0])})
        for k, column in enumerate(table.columns)
    }
    variables["seconds"] = (*shaped(numbers.seconds), {"units": "s", "long_name": "time of computation"})
    variables["reason"] = (*shaped(_texts(numbers.reasons)), {"long_name": "reason for missing numbers"})
    if numbers.pairs:
        coords |= {"pair": ("pair", _texts(numbers.pairs)), "p_false_alarm": ("p_false_alarm", list(SWEPT_RATES))}
        variables["p_detection"] = (*shaped(numbers.p_detection, "pair", "p_false_alarm"), {"units": "1"})
        variables["auc"] = (*shaped(numbers.auc, "pair"), {"units": "1"})
    if numbers.roc.size:
        coords |= {"kind": ("kind", _texts(ROC_KINDS)), "roc_p_false_alarm": ("roc_p_false_alarm", ROC_RATES)}
        variables["roc_p_detection"] = (*shaped(numbers.roc, "kind", "roc_p_false_alarm"), {"units": "1"})
    return xr.Dataset(variables, coords=coords, attrs=dict(table.attributes))


def _dimensions(table: StudyTable) -> tuple[tuple[str, ...], tuple[int, ...], dict[str, Any]]:
    """Dimensions of the cases, their lengths, and the coordinates that describe each case."""
    scenes = _texts(table.scenes)
    facts = {axis.key: {"units": axis.unit or "1", "long_name": axis.meaning} for axis in table.axes}
    if table.grid:
        coords: dict[str, Any] = {
            axis.key: (axis.key, list(values), facts[axis.key])
            for axis, values in zip(table.axes, table.grid, strict=True)
        }
        lengths = (len(scenes), *map(len, table.grid))
        return ("scene", *(axis.key for axis in table.axes)), lengths, {"scene": ("scene", scenes)} | coords
    columns = np.array([[value for _, value in case.values] for case in table.cases])
    coords = {axis.key: ("case", columns[:, k], facts[axis.key]) for k, axis in enumerate(table.axes)}
    coords |= {"case": ("case", np.arange(len(table.cases)))}
    coords |= {"scene": ("case", scenes[[case.scene for case in table.cases]])}
    return ("case",), (len(table.cases),), coords


def _unit(quantity: str) -> str:
    if quantity.endswith("_deg"):
        return "deg"
    return "DN" if is_counts(quantity) or quantity in _STOKES else "1"


def _texts(words: Sequence[str]) -> Any:
    return np.array(words, dtype=f"U{max(map(len, words), default=1) or 1}")


def _write_parquet(out: Path, table: StudyTable) -> None:
    """Write a row for each case and region and, with detection, one for each case, pair and rate."""
    import pyarrow as pa
    from pyarrow import parquet

    numbers, n = table.numbers, len(table.cases)
    attributes = {key: value.encode() for key, value in table.attributes.items()}
    of_case = {"case": np.arange(n), "scene": np.array(table.scenes)[[case.scene for case in table.cases]]}
    of_case |= {axis.key: np.array([case.values[k][1] for case in table.cases]) for k, axis in enumerate(table.axes)}

    def write(name: str, inner: Mapping[str, Any], values: Mapping[str, Any], repeats: int) -> None:
        columns = {key: np.repeat(value, repeats) for key, value in of_case.items()}
        columns |= {key: np.tile(value, n) for key, value in inner.items()}
        made = pa.table(columns | {key: np.ravel(value) for key, value in values.items()})
        part = out / f"{name}.part"
        parquet.write_table(made.replace_schema_metadata(attributes), part)
        part.replace(out / name)

    per_region = len(numbers.regions)
    values = {_column_name(column): numbers.values[..., k] for k, column in enumerate(table.columns)}
    values |= {
        "seconds": np.repeat(numbers.seconds, per_region),
        "reason": np.repeat(_texts(numbers.reasons), per_region),
    }
    write(REGIONS_TABLE, {"region": _texts(numbers.regions)}, values, per_region)
    if numbers.pairs:
        rates = len(SWEPT_RATES)
        inner = {
            "pair": np.repeat(_texts(numbers.pairs), rates),
            "p_false_alarm": np.tile(SWEPT_RATES, len(numbers.pairs)),
        }
        auc = np.repeat(numbers.auc, rates, axis=-1)
        write(DETECTION_TABLE, inner, {"p_detection": numbers.p_detection, "auc": auc}, len(numbers.pairs) * rates)


# Sensitivity.

_LEVEL, _RESAMPLES = 0.95, 200
_VARIES = 1e-12


class SobolIndex(NamedTuple):
    """Shares of a number's variance due to one input."""

    scene: str
    region: str
    quantity: str  #: QUANTITY_STATISTIC
    input: str  #: key of the input
    first: float  #: by this input alone; NaN with a `reason`
    first_low: float  #: 95 % limits by bootstrap
    first_high: float
    total: float  #: with all interactions
    total_low: float
    total_high: float
    reason: str  #: reason for missing shares


def _numbers_of(table: StudyTable) -> Iterator[tuple[tuple[str, str, str], FloatArray]]:
    """Yield scene, region and quantity of every number with its values over the cases of that scene."""
    cases = len(table.cases) // len(table.scenes)
    for k, scene in enumerate(table.scenes):
        values = table.numbers.values[k * cases : (k + 1) * cases]
        for r, region in enumerate(table.numbers.regions):
            for q, column in enumerate(table.columns):
                if not np.all(np.isnan(values[:, r, q])):
                    yield (scene, region, _column_name(column)), values[:, r, q]


def sobol_of(number: tuple[str, str, str], values: FloatArray, inputs: Iterable[str]) -> tuple[SobolIndex, ...]:
    """Return the indices of a number, given by scene, region and quantity, to each input.

    Saltelli et al., Comput. Phys. Commun. 181 (2010) 259, doi:10.1016/j.cpc.2009.09.018, as in scipy.
    """
    keys, reason = tuple(inputs), ""
    missing = int(np.count_nonzero(np.isnan(values)))
    if missing:
        reason = f"{missing} of {values.size} cases lack this number"
    elif np.ptp(values) <= _VARIES * np.max(np.abs(values)):
        reason = "no input changes it"
    if reason:
        return tuple(_sobol_index(number, key, [math.nan] * 6, reason) for key in keys)
    from scipy.stats import sobol_indices

    blocks = values.reshape(len(keys) + 2, 1, -1)
    # Indices of an input without effect are 0, without limits from the bootstrap.
    acting = [k for k in range(len(keys)) if np.any(blocks[2 + k] != blocks[0])]
    found = sobol_indices(
        func={"f_A": blocks[0], "f_B": blocks[1], "f_AB": blocks[2:][acting]},
        n=blocks.shape[-1],
        rng=np.random.default_rng(1),
    )
    spread = found.bootstrap(confidence_level=_LEVEL, n_resamples=_RESAMPLES)
    first, total = spread.first_order.confidence_interval, spread.total_order.confidence_interval
    indices = np.zeros((len(keys), 6))
    indices[acting] = np.stack(
        [np.ravel(one) for one in (found.first_order, first.low, first.high, found.total_order, total.low, total.high)],
        axis=1,
    )
    return tuple(_sobol_index(number, key, indices[k].tolist(), "") for k, key in enumerate(keys))


def _sobol_index(number: tuple[str, str, str], key: str, indices: Sequence[float], reason: str) -> SobolIndex:
    first, first_low, first_high, total, total_low, total_high = indices
    return SobolIndex(*number, key, first, first_low, first_high, total, total_low, total_high, reason)


def sobol_table(rows: Sequence[SobolIndex]) -> Table[SobolIndex]:
    """Return the shares of variance, with the inputs of each number in order of their share."""
    numbers = list(dict.fromkeys(row[:3] for row in rows))
    return Table(
        columns=(
            Column(title="scene", key="scene", left=True),
            Column(title="region", key="region", left=True),
            Column(title="number", key="quantity", left=True),
            Column(title="input", key="input", left=True),
            *_shares("first", "alone"),
            *_shares("total", "with others"),
            Column(title="why none", key="reason", left=True),
        ),
        rows=tuple(sorted(rows, key=lambda row: (numbers.index(row[:3]), 0.0 if row.reason else -row.total))),
        title="share of the variance due to each input, with 95 % limits",
    )


def _shares(key: str, title: str) -> tuple[Column[SobolIndex], ...]:
    low, high = f"{key}_low", f"{key}_high"

    def text(row: SobolIndex) -> str:
        limits = f"{getattr(row, low):.2f} to {getattr(row, high):.2f}"
        return "" if row.reason else f"{getattr(row, key):.2f} ({limits})"

    return (
        Column(title=title, key=key, text=text),
        Column(key=low, shown=Shown.PROGRAMS),
        Column(key=high, shown=Shown.PROGRAMS),
    )


# Most panels; the tables have all.
_MOST_PANELS = 12
_COLUMNS = 3
_INCHES_A_BAR = 0.32


def sobol_figure(rows: Sequence[SobolIndex]) -> bytes:
    """Return bars of first and total index, one panel per number, the most important input on top."""
    known = [row for row in rows if not row.reason]
    numbers = list(dict.fromkeys(row[:3] for row in known))[:_MOST_PANELS]
    inputs = max((sum(row[:3] == number for row in known) for number in numbers), default=1)
    columns = max(min(_COLUMNS, len(numbers)), 1)
    lines = max(-(-len(numbers) // columns), 1)
    figure, axes = subplots(lines, columns, size=(1.0 + 4.2 * columns, lines * (1.3 + _INCHES_A_BAR * inputs)))
    several = len({scene for scene, _, _ in numbers}) > 1
    for ax, number in zip(axes, numbers, strict=False):
        shown = sorted((row for row in known if row[:3] == number), key=lambda row: -row.total)
        for shift, color, label, key in ((-0.2, PREDICTED, "alone", "first"), (0.2, MEASURED, "with others", "total")):
            values, low, high = (
                np.array([getattr(row, name) for row in shown]) for name in (key, f"{key}_low", f"{key}_high")
            )
            places, to_limits = np.arange(len(shown)) + shift, np.maximum([values - low, high - values], 0.0)
            ax.barh(places, values, 0.38, color=color, label=label)
            ax.errorbar(values, places, xerr=to_limits, fmt="none", ecolor="black", capsize=2)
        ax.set_xlim(min(0.0, ax.get_xlim()[0]), max(1.0, ax.get_xlim()[1]))
        ax.set_xlabel("share of the variance")
        ax.set_yticks(range(len(shown)), [row.input for row in shown], fontsize=8)
        ax.invert_yaxis()
        scene, region, quantity = number
        ax.set_title(f"{scene}\n{region}: {quantity}" if several else f"{region}: {quantity}", fontsize=9)
    if numbers:
        axes[0].legend(fontsize=8)
    for ax in axes[len(numbers) :]:
        ax.set_axis_off()
    return png(figure)


def _write_sensitivity(sobol: Sequence[SobolIndex], out: Path, *, created_by: str) -> tuple[str, ...]:
    """Write sensitivity.csv, sensitivity.json and sensitivity.png into a folder; return their names."""
    table = sobol_table(sobol)
    content: dict[str, Json] = {
        "schema_version": 1,
        "created_by": created_by,
        "method": "sobol",
        "rows": table.json(),
    }
    return write_folder(
        out, {"sensitivity.csv": table, "sensitivity.json": content, "sensitivity.png": sobol_figure(sobol)}
    )
