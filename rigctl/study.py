"""A case of a study and the scene it is of, each known by the hash of what its numbers follow from.

The cases of a study: every combination, lists side by side, or draws from the laws of the numbers.

Batches of cases: what a worker computes at a time, and what comes back; cases of one sky stand together.

What of a study is done: a durable file for each batch; a kill or a power cut takes what was in flight alone.

Numbers of a study in the order of its cases, from its parts.

The files of a study as others read them: one Zarr store for xarray, tables in Parquet.

How much each uncertain input matters to each number: Sobol's indices.

How much inputs matter to the numbers of a study, as tables for terminal, CSV and JSON.

Pictures of a study: which input deserves a measurement.

The files of a study for people: how much each input matters.
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
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri
from scipy.stats import qmc, sobol_indices

from model.prediction import RegionPrediction, detections_of_sweep
from model.quantities import is_counts
from rigctl import mapped as on_dask
from rigctl.base.arrays import read_arrays
from rigctl.base.durable import MOST_RECORD_BYTES, flush_folder, read_bounded, write_durably
from rigctl.errors import ConfigError, DataError
from rigctl.files.choices import ROC_KINDS
from rigctl.files.scene_file import load_scene
from rigctl.files.study_file import MOST_CASES
from rigctl.mapped import PARTS_FOLDER
from rigctl.prediction.predict import ROC_RATES, SWEPT_RATES, ScenePredictor, parse_roc, roc_curves_of_sweep
from rigctl.prediction.sweep import SKY_KEYS
from rigctl.report.data_files import csv_rows, json_file, json_rows
from rigctl.report.drawing import MEASURED, PREDICTED, png, subplots
from rigctl.report.output import write_folder
from rigctl.report.table import Column, Shown, Table
from rigctl.scene.light import SceneLight
from rigctl.scene.scene import get, require_within, with_values

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from model.prediction import PairDetection
    from rigctl.console.json_text import Json
    from rigctl.files.scene_file import SceneFile
    from rigctl.files.study_file import CasesSection, VariedSection
    from rigctl.scene.scene import Parameter, Scene


# What a number hangs on, beside the inputs.
PACKAGES = ("model", "rigctl.files", "rigctl.scene", "rigctl.prediction", "rigctl.study")


@dataclass(frozen=True, kw_only=True)
class StudyScene:
    """A scene of a study; two are one where their digests are."""

    digest: str  #: SHA-256 of the file and of the files that it names.
    name: str = field(compare=False)  #: The file's name without ending: what cases are told by.
    #: Its content. Files that it names are read where a case is computed, under the same paths.
    file: SceneFile = field(compare=False, repr=False)


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """What is computed of every case."""

    columns: tuple[tuple[str, str], ...]  #: Quantity and statistic of each region.
    detection: bool  #: Whether every ordered pair's probability of detection and area under the curve is wanted.
    roc: str | None  #: Pair whose whole curves are wanted.
    tolerance: float | None  #: Largest numerical error; None: the settings of the scene file.


@dataclass(frozen=True, kw_only=True)
class Case:
    """One case: its place in the study, that of its scene among the scenes, and numbers in the place of the file's."""

    number: int
    scene: int
    values: tuple[tuple[str, float], ...]


def case_hash(case: Case, scene: StudyScene, wanted: Wanted) -> str:
    """Return what a case is known by: the hash of its inputs, of what is wanted, and of the code."""
    said = [scene.digest, sorted(case.values), wanted.columns, wanted.detection, wanted.roc, wanted.tolerance]
    return hashlib.sha256(json.dumps([code_version(), *said]).encode()).hexdigest()


def study_scene(path: Path) -> StudyScene:
    """Return a scene with its digest."""
    file = load_scene(path)
    return StudyScene(digest=scene_digest(file), name=path.stem, file=file)


def scene_digest(file: SceneFile) -> str:
    """Return the hash of a scene's content and of the files that it names, as they are here and now."""
    digest = hashlib.sha256(file.model_dump_json().encode())
    table = None if file.atmosphere is None else file.atmosphere.table
    materials = (Path(region.material) for region in file.regions if region.material is not None)
    for named in (*materials, *(() if table is None else (table,))):
        if named.is_file():  # others are names of the library
            digest.update(read_bounded(named, MOST_RECORD_BYTES))
    return digest.hexdigest()


def code_version() -> str:
    """Return the program's version with a hash of the code that numbers follow from."""
    return on_dask.code_version(PACKAGES)


FloatArray = NDArray[np.float64]


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
    found, problems = {}, []
    for key, varied in section.parameters.items():
        try:
            found[key] = get(scene, key)
            for value in varied.range or varied.steps:
                require_within(scene, {key: value}, option="cases.parameters")
            if varied.std == "stated" and found[key].std == 0.0:
                raise ConfigError(f'cases.parameters: {key}: std = "stated", and the scene states none')
        except ConfigError as error:
            problems.append(str(error))
    if problems:
        raise ConfigError(f"scene {scene.name}: " + "; ".join(problems))
    return found


def _key_values(section: CasesSection, scene: Scene, found: Mapping[str, Parameter]) -> Iterable[Sequence[float]]:
    varied = section.parameters
    steps = [one.steps for one in varied.values()]
    if section.kind == "grid":
        _require_few(int(np.prod([float(len(one)) for one in steps])))
        return itertools.product(*steps)
    if section.kind == "list":
        return zip(*steps, strict=True)
    n = section.n or 0
    _require_few(n * (len(varied) + 2 if section.kind == "sobol" else 1))
    cube = unit_draws(section.kind, len(varied), n, section.seed)
    if section.kind in ("random", "latin"):
        cube = _going_together(cube, section, scene)
    columns = [_at(one, found[key], cube[:, k]) for k, (key, one) in enumerate(varied.items())]
    rows: list[list[float]] = np.stack(columns, axis=1).tolist()
    return rows


def _going_together(cube: FloatArray, section: CasesSection, scene: Scene) -> FloatArray:
    """Return draws of numbers with their stated errors as those errors go together; all others stay independent."""
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


def _require_few(cases: int) -> None:
    if cases > MOST_CASES:
        raise ConfigError(f"cases: the study has {cases} cases of each scene, allowed is {MOST_CASES}")


def _at(varied: VariedSection, parameter: Parameter, share: FloatArray) -> FloatArray:
    """Return values of a law at shares of its probability; a normal law is cut at the number's limits."""
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


Predictions = Mapping[str, RegionPrediction]

# Enough for a worker to be busy some seconds, few enough that little is lost when it ends; and batches of each worker,
# so that none waits long for the last of another. To a tolerance few cases are judged, the fewer the larger a batch is.
_MOST_CASES, _ROUNDS = 64, 8
_MOST_TO_TOLERANCE, _ROUNDS_TO_TOLERANCE = 256, 2
_SKIES_EACH = 2
# A worker keeps what it knows of this many scenes.
_SCENES_KEPT = 2


@dataclass(frozen=True, kw_only=True)
class Batch:
    """Cases of one scene that are computed together, and the code by which they have to be."""

    scene: StudyScene
    wanted: Wanted
    cases: tuple[Case, ...]
    code: str


@dataclass(frozen=True, kw_only=True, eq=False)
class BatchResult:
    """What came of a batch, n cases."""

    numbers: tuple[int, ...]  #: The cases.
    #: Regions of the scene in the order of its file, R of them, and its ordered pairs as ``TARGET on BACKGROUND``.
    regions: tuple[str, ...]
    pairs: tuple[str, ...]
    values: FloatArray  #: Of the wanted columns; NaN where there is none.
    p_detection: FloatArray  #: At the rates of a sweep; empty where it is not wanted, as are the next two.
    auc: FloatArray  #: Areas under the curves.
    roc: FloatArray  #: Probability of detection on Stokes parameters and on counts, at `ROC_RATES`.
    seconds: FloatArray  #: Time of each case; of the first of a sky with that sky.
    is_new_sky: NDArray[np.bool_]  #: Whether the case before was under another sky, or there was none.
    reasons: tuple[str, ...]  #: Why a case failed; empty where it did not.


def batches_of(cases: Sequence[Case], scenes: Sequence[StudyScene], wanted: Wanted, *, workers: int) -> Iterator[Batch]:
    """Yield batches; those of one sky come one after another, and are cut only where there are many."""
    largest, rounds = (_MOST_CASES, _ROUNDS) if wanted.tolerance is None else (_MOST_TO_TOLERANCE, _ROUNDS_TO_TOLERANCE)
    most = max(1, min(largest, math.ceil(len(cases) / (workers * rounds))))
    ordered = sorted(cases, key=lambda case: (case.scene, sky_of(case), case.number))
    skies = [list(group) for _, group in groupby(ordered, key=lambda case: (case.scene, sky_of(case)))]
    # With enough skies for all workers none is solved twice.
    piece = largest if len(skies) >= _SKIES_EACH * workers else most
    held: list[Case] = []
    for cut in (sky[k : k + piece] for sky in skies for k in range(0, len(sky), piece)):
        if held and (held[0].scene != cut[0].scene or len(held) + len(cut) > most):
            yield _batch(held, scenes[held[0].scene], wanted)
            held = []
        held += cut
    if held:
        yield _batch(held, scenes[held[0].scene], wanted)


def sky_of(case: Case) -> tuple[float, ...]:
    """Return the numbers of a case that its sky hangs on."""
    return tuple(value for key, value in case.values if key.startswith(SKY_KEYS))


def _batch(cases: Sequence[Case], scene: StudyScene, wanted: Wanted) -> Batch:
    return Batch(scene=scene, wanted=wanted, cases=tuple(cases), code=code_version())


def compute(batch: Batch) -> BatchResult:
    """Return what the model says of each case of a batch; a case that fails is told, and ends no other."""
    if batch.code != code_version():
        raise ConfigError(f"a worker has rigctl {code_version()}, the study {batch.code}: install the same on both")
    predictor = _predictor(batch.scene)
    found = _computed(predictor, [dict(case.values) for case in batch.cases], batch.wanted.tolerance)
    return _result(batch, predictor, found, [sky_of(case) for case in batch.cases])


def _computed(
    predictor: ScenePredictor, changes: Sequence[dict[str, float]], tolerance: float | None
) -> list[tuple[Predictions | str, float]]:
    """Return the prediction of each case, or the reason why it has none, and the time that it took [s].

    To a tolerance some are judged, and the others follow from those around them. Where one fails, halves are tried.
    """
    if tolerance is None or len(changes) == 1:
        return [_timed(predictor, values, tolerance) for values in changes]
    try:
        for values in changes:
            require_within(predictor.scene, values, option="case")
        scenes = [with_values(predictor.scene, values) for values in changes]
        points = np.array([list(values.values()) for values in changes])
        cases = predictor.series_to_tolerance(scenes, tolerance, points=points).cases
    except Exception:  # the case that fails says why when it is alone
        half = len(changes) // 2
        return _computed(predictor, changes[:half], tolerance) + _computed(predictor, changes[half:], tolerance)
    return [(one.result.predictions, sum((one.stage_s or one.result.stage_s).values())) for one in cases]


def _timed(
    predictor: ScenePredictor, values: dict[str, float], tolerance: float | None
) -> tuple[Predictions | str, float]:
    start_s = time.perf_counter()
    found = _predicted(predictor, values, tolerance)
    return found, time.perf_counter() - start_s


@lru_cache(maxsize=_SCENES_KEPT)
def _predictor(scene: StudyScene) -> ScenePredictor:
    if scene_digest(scene.file) != scene.digest:
        raise ConfigError(
            f"scene {scene.name}: files that it names are missing on a worker, or differ from the study's"
        )
    return ScenePredictor(scene.file, None, light=SceneLight(is_kept_between_runs=False))


def _predicted(predictor: ScenePredictor, values: dict[str, float], tolerance: float | None) -> Predictions | str:
    """Return the predictions of a case, or why there are none."""
    try:
        scene = with_values(predictor.scene, values)
        require_within(predictor.scene, values, option="case")
        if tolerance is None:
            return predictor.predictions_of(scene)
        return predictor.series_to_tolerance((scene,), tolerance).cases[0].result.predictions
    except (ConfigError, DataError) as error:
        return str(error)
    except Exception as error:  # whatever the model trips over in one case of a million is that case's reason
        return f"{type(error).__name__}: {error}"


def _result(
    batch: Batch,
    predictor: ScenePredictor,
    timed: Sequence[tuple[Predictions | str, float]],
    skies: Sequence[tuple[float, ...]],
) -> BatchResult:
    found = [one for one, _ in timed]
    regions = tuple(region.name for region in predictor.scene.regions)
    there = [place for place, one in enumerate(found) if not isinstance(one, str)]
    predictions = [one for one in found if not isinstance(one, str)]
    pairs = tuple(f"{target} on {background}" for target in regions for background in regions if target != background)
    p_detection, auc = _detection(batch.wanted, predictions, there, len(found), pairs)
    return BatchResult(
        numbers=tuple(case.number for case in batch.cases),
        regions=regions,
        pairs=pairs,
        values=_values(batch.wanted.columns, regions, found),
        p_detection=p_detection,
        auc=auc,
        roc=_rocs(batch.wanted, regions, predictions, there, len(found)),
        seconds=np.array([seconds for _, seconds in timed]),
        is_new_sky=np.array(
            [batch.scene.file.atmosphere is not None and (k == 0 or sky != skies[k - 1]) for k, sky in enumerate(skies)]
        ),
        reasons=tuple(one if isinstance(one, str) else "" for one in found),
    )


def _values(
    columns: Sequence[tuple[str, str]], regions: Sequence[str], found: Sequence[Predictions | str]
) -> FloatArray:
    values = np.full((len(found), len(regions), len(columns)), np.nan)
    for k, one in enumerate(found):
        if not isinstance(one, str):
            values[k] = [
                [one[name].quantities.get(quantity, {}).get(statistic, math.nan) for quantity, statistic in columns]
                for name in regions
            ]
    return values


def _detection(
    wanted: Wanted, predictions: Sequence[Predictions], there: Sequence[int], cases: int, pairs: Sequence[str]
) -> tuple[FloatArray, FloatArray]:
    if not wanted.detection:
        return np.empty((cases, 0, 0)), np.empty((cases, 0))
    p_detection, auc = np.full((cases, len(pairs), len(SWEPT_RATES)), np.nan), np.full((cases, len(pairs)), np.nan)
    if predictions:
        for k, of_case in zip(there, detections_of_sweep(predictions, SWEPT_RATES), strict=True):
            by_name: dict[str, PairDetection] = {f"{one.target} on {one.background}": one for one in of_case}
            p_detection[k] = [by_name[name].p_detection for name in pairs]
            auc[k] = [by_name[name].auc for name in pairs]
    return p_detection, auc


def _rocs(
    wanted: Wanted, regions: tuple[str, ...], predictions: Sequence[Predictions], there: Sequence[int], cases: int
) -> FloatArray:
    if wanted.roc is None:
        return np.empty((cases, 0, 0))
    roc = np.full((cases, len(ROC_KINDS), ROC_RATES.size), np.nan)
    if predictions:
        curves = roc_curves_of_sweep(predictions, parse_roc(wanted.roc, regions))
        for kind, of_kind in enumerate(ROC_KINDS):
            roc[there, kind] = [one.p_detection for one in curves[of_kind]]
    return roc


def parts_of(batch: Batch) -> tuple[Batch, ...]:
    """Return a batch as batches of one case each."""
    return tuple(replace(batch, cases=(case,)) for case in batch.cases)


def failed(batch: Batch, reason: str) -> BatchResult:
    """Return the result of a batch that no worker could compute."""
    cases = len(batch.cases)
    regions = tuple(region.name for region in batch.scene.file.regions)
    return BatchResult(
        numbers=tuple(case.number for case in batch.cases),
        regions=regions,
        pairs=(),
        values=np.full((cases, len(regions), len(batch.wanted.columns)), np.nan),
        p_detection=np.empty((cases, 0, 0)),
        auc=np.empty((cases, 0)),
        roc=np.empty((cases, 0, 0)),
        seconds=np.full(cases, np.nan),
        is_new_sky=np.zeros(cases, dtype=bool),
        reasons=(reason,) * cases,
    )


@dataclass(frozen=True, kw_only=True)
class DoneCases:
    """Cases that are done: each hash with the part and the row where its numbers stand."""

    parts: tuple[BatchResult, ...]
    places: dict[str, tuple[int, int]]
    damaged: tuple[str, ...]


def write_part(out: Path, result: BatchResult, hashes: Sequence[str]) -> None:
    """Return once a batch is on the disk, under the hash of its first case."""
    data = io.BytesIO()
    np.savez(
        data,
        hashes=np.array(hashes),
        numbers=np.array(result.numbers),
        regions=np.array(result.regions),
        pairs=np.array(result.pairs, dtype=str),
        values=result.values,
        p_detection=result.p_detection,
        auc=result.auc,
        roc=result.roc,
        seconds=result.seconds,
        is_new_sky=result.is_new_sky,
        reasons=np.array(result.reasons, dtype=str),
    )
    write_durably(out / PARTS_FOLDER / f"{hashes[0]}.npz", data.getvalue())


def read_parts(out: Path) -> DoneCases:
    """Return what is done; a part that is damaged is named, and its cases are not done."""
    parts: list[BatchResult] = []
    places: dict[str, tuple[int, int]] = {}
    damaged = []
    for file in sorted((out / PARTS_FOLDER).glob("*.npz")):
        try:
            hashes, result = _part(file)
        except DataError as error:
            damaged.append(str(error))
            continue
        places |= {one: (len(parts), row) for row, one in enumerate(hashes)}
        parts.append(result)
    return DoneCases(parts=tuple(parts), places=places, damaged=tuple(damaged))


def _part(file: Path) -> tuple[list[str], BatchResult]:
    arrays = read_arrays(file)
    try:
        hashes, texts = (
            arrays["hashes"].tolist(),
            {name: arrays[name].tolist() for name in ("regions", "pairs", "reasons")},
        )
        return hashes, BatchResult(
            numbers=tuple(arrays["numbers"].tolist()),
            regions=tuple(texts["regions"]),
            pairs=tuple(texts["pairs"]),
            reasons=tuple(texts["reasons"]),
            **{name: arrays[name] for name in ("values", "p_detection", "auc", "roc", "seconds", "is_new_sky")},
        )
    except KeyError as error:
        raise DataError(f"{file}: is no part of a study: {error} is missing") from error


UNDONE = "not computed yet"


@dataclass(frozen=True, kw_only=True, eq=False)
class StudyArrays:
    """Numbers of N cases."""

    #: Those of all scenes, each once, in the order of the scenes; a case whose scene has none of them holds NaN there.
    regions: tuple[str, ...]
    pairs: tuple[str, ...]
    values: FloatArray  #: Of the wanted columns.
    p_detection: FloatArray  #: At the rates of a sweep; without pairs where it is not wanted, as is the next.
    auc: FloatArray  #: Areas under the curves.
    roc: FloatArray | None  #: Probability of detection on Stokes parameters and on counts, where it is wanted.
    seconds: FloatArray  #: Time of each case; NaN where it is not done.
    is_new_sky: NDArray[np.bool_]  #: Whether that time holds a sky.
    reasons: tuple[str, ...]  #: Why a case has no numbers; empty where it has.


def arrays_of(
    cases: Sequence[Case], hashes: Sequence[str], done: DoneCases, wanted: Wanted, *, rates: int, curve: int
) -> StudyArrays:
    """Return the numbers of all cases; those that are not done hold NaN."""
    used = {done.places[one][0] for one in hashes if one in done.places}
    parts = [done.parts[k] for k in sorted(used)]
    regions = tuple(dict.fromkeys(name for part in parts for name in part.regions))
    pairs = tuple(dict.fromkeys(name for part in parts for name in part.pairs)) if wanted.detection else ()
    shape = len(cases)
    found = StudyArrays(
        regions=regions,
        pairs=pairs,
        values=np.full((shape, len(regions), len(wanted.columns)), np.nan),
        p_detection=np.full((shape, len(pairs), rates), np.nan),
        auc=np.full((shape, len(pairs)), np.nan),
        roc=None if wanted.roc is None else np.full((shape, 2, curve), np.nan),
        seconds=np.full(shape, np.nan),
        is_new_sky=np.zeros(shape, dtype=bool),
        reasons=tuple(_reason(done, one) for one in hashes),
    )
    places = [{name: k for k, name in enumerate(names)} for names in (regions, pairs)]
    for row, one in enumerate(hashes):
        if one in done.places:
            part, line = done.places[one]
            _fill(found, row, done.parts[part], line, *places)
    return found


def _reason(done: DoneCases, case: str) -> str:
    if case not in done.places:
        return UNDONE
    part, line = done.places[case]
    return done.parts[part].reasons[line]


def _fill(
    found: StudyArrays, row: int, part: BatchResult, line: int, regions: Mapping[str, int], pairs: Mapping[str, int]
) -> None:
    found.values[row, [regions[name] for name in part.regions]] = part.values[line]
    found.seconds[row], found.is_new_sky[row] = part.seconds[line], part.is_new_sky[line]
    if found.pairs and part.auc.size:
        there = [pairs[name] for name in part.pairs]
        found.p_detection[row, there], found.auc[row, there] = part.p_detection[line], part.auc[line]
    if found.roc is not None and part.roc.size:
        found.roc[row] = part.roc[line]


ZARR, REGIONS_TABLE, DETECTION_TABLE = "study.zarr", "study.parquet", "detection.parquet"
_STOKES = ("s0", "s1", "s2")
# How signs are meant, in words for whoever opens the store.
CONVENTIONS = (
    "S1 = horizontal - vertical, S2 = (+45) - (-45), angles counter-clockwise from horizontal as the camera sees the "
    "scene, AoLP in [0, 180) deg; azimuths clockwise from north; counts and Stokes parameters in DN"
)


@dataclass(frozen=True, kw_only=True)
class Axis:
    """A number that is varied: its key, unit and meaning; on a grid its values too."""

    key: str
    unit: str
    meaning: str
    values: tuple[float, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class StudyTable:
    """A study as its files hold it."""

    scenes: tuple[str, ...]  #: Names.
    axes: tuple[Axis, ...]  #: What is varied; each with its values where all combinations are there, else with none.
    columns: tuple[tuple[str, str], ...]  #: Quantity and statistic.
    cases: tuple[Case, ...]  #: N of them.
    arrays: StudyArrays  #: Their numbers.
    said: Mapping[str, str]  #: Attributes of the store: version, inputs, conventions.

    @property
    def is_grid(self) -> bool:
        """Whether every combination of the axes is there."""
        return all(axis.values for axis in self.axes)


def column_name(column: tuple[str, str]) -> str:
    """Return the name of a number in stores and tables, "dolp_mean"."""
    return "_".join(column)


def write_zarr(out: Path, table: StudyTable) -> None:
    """Write the store; one that is there is replaced once the new one is whole."""
    part, store = out / f"{ZARR}.part", out / ZARR
    shutil.rmtree(part, ignore_errors=True)
    dataset(table).to_zarr(part, mode="w", zarr_format=2, consolidated=True)
    if store.exists():
        store.rename(out / f"{ZARR}.old")
    part.rename(store)
    shutil.rmtree(out / f"{ZARR}.old", ignore_errors=True)
    flush_folder(out)


def dataset(table: StudyTable) -> Any:
    """Return the numbers as an `xarray.Dataset`: over scene and axes of a grid, else over cases."""
    import xarray as xr

    arrays = table.arrays
    dims, lengths, coords = _dimensions(table)
    coords |= {"region": ("region", _texts(arrays.regions))}

    def shaped(values: Any, *inner: str) -> tuple[tuple[str, ...], Any]:
        return (*dims, *inner), values.reshape(*lengths, *values.shape[1:])

    variables: dict[str, Any] = {
        column_name(column): (*shaped(arrays.values[..., k], "region"), {"units": _unit(column[0])})
        for k, column in enumerate(table.columns)
    }
    variables["seconds"] = (*shaped(arrays.seconds), {"units": "s", "long_name": "time of computation"})
    variables["reason"] = (*shaped(_texts(arrays.reasons)), {"long_name": "why a case has no numbers"})
    if arrays.pairs:
        coords |= {"pair": ("pair", _texts(arrays.pairs)), "p_false_alarm": ("p_false_alarm", list(SWEPT_RATES))}
        variables["p_detection"] = (*shaped(arrays.p_detection, "pair", "p_false_alarm"), {"units": "1"})
        variables["auc"] = (*shaped(arrays.auc, "pair"), {"units": "1"})
    if arrays.roc is not None:
        coords |= {"kind": ("kind", _texts(ROC_KINDS)), "roc_p_false_alarm": ("roc_p_false_alarm", ROC_RATES)}
        variables["roc_p_detection"] = (*shaped(arrays.roc, "kind", "roc_p_false_alarm"), {"units": "1"})
    return xr.Dataset(variables, coords=coords, attrs=dict(table.said))


def _dimensions(table: StudyTable) -> tuple[tuple[str, ...], tuple[int, ...], dict[str, Any]]:
    """Dimensions of the cases, their lengths, and the coordinates that say what each case is."""
    scenes = _texts(table.scenes)
    facts = {axis.key: {"units": axis.unit or "1", "long_name": axis.meaning} for axis in table.axes}
    if table.is_grid:
        coords: dict[str, Any] = {axis.key: (axis.key, list(axis.values), facts[axis.key]) for axis in table.axes}
        lengths = (len(scenes), *(len(axis.values) for axis in table.axes))
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


def write_parquet(out: Path, table: StudyTable) -> None:
    """Write a row for each case and region and, where it is wanted, one for each case, pair and rate."""
    import pyarrow as pa
    from pyarrow import parquet

    arrays, n = table.arrays, len(table.cases)
    said = {key: value.encode() for key, value in table.said.items()}
    of_case = {"case": np.arange(n), "scene": np.array(table.scenes)[[case.scene for case in table.cases]]}
    of_case |= {axis.key: np.array([case.values[k][1] for case in table.cases]) for k, axis in enumerate(table.axes)}

    def write(name: str, inner: Mapping[str, Any], values: Mapping[str, Any], repeats: int) -> None:
        columns = {key: np.repeat(value, repeats) for key, value in of_case.items()}
        columns |= {key: np.tile(value, n) for key, value in inner.items()}
        made = pa.table(columns | {key: np.ravel(value) for key, value in values.items()})
        part = out / f"{name}.part"
        parquet.write_table(made.replace_schema_metadata(said), part)
        part.replace(out / name)

    per_region = len(arrays.regions)
    numbers = {column_name(column): arrays.values[..., k] for k, column in enumerate(table.columns)}
    numbers |= {
        "seconds": np.repeat(arrays.seconds, per_region),
        "reason": np.repeat(_texts(arrays.reasons), per_region),
    }
    write(REGIONS_TABLE, {"region": _texts(arrays.regions)}, numbers, per_region)
    if arrays.pairs:
        rates = len(SWEPT_RATES)
        inner = {
            "pair": np.repeat(_texts(arrays.pairs), rates),
            "p_false_alarm": np.tile(SWEPT_RATES, len(arrays.pairs)),
        }
        auc = np.repeat(arrays.auc, rates, axis=-1)
        write(DETECTION_TABLE, inner, {"p_detection": arrays.p_detection, "auc": auc}, len(arrays.pairs) * rates)


_LEVEL, _RESAMPLES = 0.95, 200
_VARIES = 1e-12


@dataclass(frozen=True, kw_only=True)
class Number:
    """A number of a study: QUANTITY_STATISTIC of a region of a scene."""

    scene: str
    region: str
    quantity: str


@dataclass(frozen=True, kw_only=True)
class SobolIndex:
    """Shares of a number's variance that one input makes."""

    number: Number  #: The number.
    input: str  #: Key of the input.
    first: float  #: By this input alone, and with all that it makes together with others; NaN where `reason` says why.
    first_low: float  #: 95 % limits by bootstrap.
    first_high: float
    total: float
    total_low: float
    total_high: float
    reason: str  #: Why there is none; empty where there is.


def numbers_of(
    arrays: StudyArrays, scenes: Sequence[str], columns: Sequence[str]
) -> Iterator[tuple[Number, FloatArray]]:
    """Yield every number of every scene with its values over that scene's cases."""
    of_scene = len(arrays.values) // len(scenes)
    for k, scene in enumerate(scenes):
        values = arrays.values[k * of_scene : (k + 1) * of_scene]
        for r, region in enumerate(arrays.regions):
            for q, quantity in enumerate(columns):
                if not np.all(np.isnan(values[:, r, q])):
                    yield Number(scene=scene, region=region, quantity=quantity), values[:, r, q]


def sobol_of(number: Number, values: FloatArray, inputs: Sequence[str]) -> tuple[SobolIndex, ...]:
    """Return the indices of a number to each input.

    Saltelli et al., Comput. Phys. Commun. 181 (2010) 259, doi:10.1016/j.cpc.2009.09.018, as scipy has it.
    """
    reason = _why_none(values)
    if reason:
        gone = dict.fromkeys(("first", "first_low", "first_high", "total", "total_low", "total_high"), math.nan)
        return tuple(SobolIndex(number=number, input=key, reason=reason, **gone) for key in inputs)
    blocks = values.reshape(len(inputs) + 2, 1, -1)
    # Of an input that changes nothing the indices are 0, without limits that could be found by drawing.
    acting = [k for k in range(len(inputs)) if np.any(blocks[2 + k] != blocks[0])]
    found = sobol_indices(
        func={"f_A": blocks[0], "f_B": blocks[1], "f_AB": blocks[2:][acting]},
        n=blocks.shape[-1],
        rng=np.random.default_rng(1),
    )
    spread = found.bootstrap(confidence_level=_LEVEL, n_resamples=_RESAMPLES)
    indices = np.zeros((len(inputs), 2, 3))
    for j, (one, limits) in enumerate(
        (
            (found.first_order, spread.first_order.confidence_interval),
            (found.total_order, spread.total_order.confidence_interval),
        )
    ):
        indices[acting, j] = np.stack([np.ravel(one), np.ravel(limits.low), np.ravel(limits.high)], axis=1)
    return tuple(_sobol_index(number, key, *indices[k].ravel().tolist()) for k, key in enumerate(inputs))


def _sobol_index(number: Number, key: str, *found: float) -> SobolIndex:
    first, first_low, first_high, total, total_low, total_high = found
    return SobolIndex(
        number=number,
        input=key,
        first=first,
        first_low=first_low,
        first_high=first_high,
        total=total,
        total_low=total_low,
        total_high=total_high,
        reason="",
    )


def _why_none(values: FloatArray) -> str:
    missing = int(np.count_nonzero(np.isnan(values)))
    if missing:
        return f"{missing} of {values.size} cases have no such number"
    if np.ptp(values) <= _VARIES * np.max(np.abs(values)):
        return "no input changes it"
    return ""


_OF_NUMBER = (
    Column[Any](title="scene", key="scene", value=lambda row: row.number.scene, left=True),
    Column[Any](title="region", key="region", value=lambda row: row.number.region, left=True),
    Column[Any](title="number", key="quantity", value=lambda row: row.number.quantity, left=True),
    Column[Any](title="input", key="input", left=True),
)


def sobol_table(rows: Sequence[SobolIndex]) -> Table[SobolIndex]:
    """Return the shares of variance; of each number the input that makes most stands first."""
    return Table(
        columns=(
            *_OF_NUMBER,
            *_shares("first", "alone"),
            *_shares("total", "with others"),
            Column(title="why none", key="reason", left=True),
        ),
        rows=_ranked(rows, lambda row: row.total),
        title="share of the variance that each input makes, with 95 % limits",
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


def _ranked(rows: Sequence[Any], by: Callable[[Any], float]) -> tuple[Any, ...]:
    numbers = list(dict.fromkeys(row.number for row in rows))
    return tuple(sorted(rows, key=lambda row: (numbers.index(row.number), -by(row) if not row.reason else 0.0)))


# More panels than this no one reads; the tables have all.
_MOST_PANELS = 12
_COLUMNS = 3
_INCHES_A_BAR = 0.32


def sobol_figure(rows: Sequence[SobolIndex]) -> bytes:
    """Return bars of first and total index for each number, a panel each, at most twelve."""

    def draw(ax: Axes, found: Sequence[SobolIndex]) -> None:
        for shift, color, label, key in ((-0.2, PREDICTED, "alone", "first"), (0.2, MEASURED, "with others", "total")):
            ends = [_to_limits(row, key) for row in found]
            _bars(ax, found, key, shift=shift, color=color, label=label, ends=ends)
        ax.set_xlim(min(0.0, ax.get_xlim()[0]), max(1.0, ax.get_xlim()[1]))
        ax.set_xlabel("share of the variance")

    return _panels(rows, draw, by="total")


def _to_limits(row: SobolIndex, key: str) -> tuple[float, float]:
    """From an index down to its lower limit and up to its upper one."""
    value = getattr(row, key)
    return max(value - getattr(row, f"{key}_low"), 0.0), max(getattr(row, f"{key}_high") - value, 0.0)


def _bars(
    ax: Axes,
    found: Sequence[Any],
    key: str,
    *,
    shift: float,
    color: str,
    label: str,
    ends: Sequence[tuple[float, float]] = (),
) -> None:
    places, values = [k + shift for k in range(len(found))], [getattr(row, key) for row in found]
    ax.barh(places, values, 0.38, color=color, label=label)
    if ends:
        ax.errorbar(values, places, xerr=list(zip(*ends, strict=True)), fmt="none", ecolor="black", capsize=2)


def _panels(rows: Sequence[Any], draw: Callable[[Axes, Sequence[Any]], None], *, by: str) -> bytes:
    """Return a figure with a panel for each number, the input that matters most on top."""
    known = [row for row in rows if not row.reason]
    numbers = list(dict.fromkeys(row.number for row in known))[:_MOST_PANELS]
    inputs = max((sum(row.number == number for row in known) for number in numbers), default=1)
    columns = max(min(_COLUMNS, len(numbers)), 1)
    lines = max(-(-len(numbers) // columns), 1)
    figure, axes = subplots(lines, columns, size=(1.0 + 4.2 * columns, lines * (1.3 + _INCHES_A_BAR * inputs)))
    several = len({number.scene for number in numbers}) > 1
    for ax, number in zip(axes, numbers, strict=False):
        found = sorted((row for row in known if row.number == number), key=lambda row: -getattr(row, by))
        draw(ax, found)
        ax.set_yticks(range(len(found)), [row.input for row in found], fontsize=8)
        ax.invert_yaxis()
        scene = f"{number.scene}\n" if several else ""
        ax.set_title(f"{scene}{number.region}: {number.quantity}", fontsize=9)
    if numbers:
        axes[0].legend(fontsize=8)
    for ax in axes[len(numbers) :]:
        ax.set_axis_off()
    return png(figure)


SCHEMA_VERSION = 1


def write_sensitivity(sobol: Sequence[SobolIndex], out: Path, *, created_by: str) -> tuple[str, ...]:
    """Write sensitivity.csv, sensitivity.json and sensitivity.png into a folder; return their names."""
    table = sobol_table(sobol)
    content: dict[str, Json] = {
        "schema_version": SCHEMA_VERSION,
        "created_by": created_by,
        "method": "sobol",
        "rows": list(json_rows(table)),
    }
    files = {
        "sensitivity.csv": csv_rows(table),
        "sensitivity.json": json_file(content),
        "sensitivity.png": sobol_figure(sobol),
    }
    return write_folder(out, files)
