"""Batches of cases: what a worker computes at a time, and what comes back; cases of one sky stand together."""

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from model.prediction import PairDetection, RegionPrediction, detections_of_sweep
from rigctl.errors import ConfigError, DataError
from rigctl.files.choices import ROC_KINDS
from rigctl.prediction.performance import SWEPT_RATES
from rigctl.prediction.roc_curves import ROC_RATES, parse_roc, roc_curves_of_sweep
from rigctl.prediction.scene_prediction import ScenePredictor
from rigctl.prediction.sweep import SKY_KEYS
from rigctl.scene.parameters import require_within, with_values
from rigctl.scene.scene_light import SceneLight
from rigctl.study.study_case import Case, StudyScene, Wanted, code_version, scene_digest

FloatArray = NDArray[np.float64]
Predictions = Mapping[str, RegionPrediction]

# Enough for a worker to be busy some seconds, few enough that little is lost when it ends.
_MOST_CASES = 64
# Batches of each worker, so that none waits long for the last of another.
_ROUNDS = 8
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
    """What came of a batch, n cases.

    Attributes
    ----------
    numbers : tuple of int
        The cases.
    regions, pairs : tuple of str
        Regions of the scene in the order of its file, R of them, and its ordered pairs as ``TARGET on BACKGROUND``.
    values : (n, R, Q) array
        Of the wanted columns; NaN where there is none.
    p_detection : (n, P, K) array
        At the rates of a sweep; empty where it is not wanted, as are the next two.
    auc : (n, P) array
        Areas under the curves.
    roc : (n, 2, L) array
        Probability of detection on Stokes parameters and on counts, at `ROC_RATES`.
    seconds : (n,) array
        Time of each case; of the first of a sky with that sky.
    is_new_sky : (n,) array
        Whether the case before was under another sky, or there was none.
    reasons : tuple of str
        Why a case failed; empty where it did not.
    """

    numbers: tuple[int, ...]
    regions: tuple[str, ...]
    pairs: tuple[str, ...]
    values: FloatArray
    p_detection: FloatArray
    auc: FloatArray
    roc: FloatArray
    seconds: FloatArray
    is_new_sky: NDArray[np.bool_]
    reasons: tuple[str, ...]


def batches_of(cases: Sequence[Case], scenes: Sequence[StudyScene], wanted: Wanted, *, workers: int) -> Iterator[Batch]:
    """Yield batches; those of one sky come one after another, and are cut only where there are many.

    Parameters
    ----------
    cases : sequence of Case
        In any order.
    scenes : sequence of StudyScene
        The scenes that they are of.
    wanted : Wanted
        What is computed.
    workers : int
        How many share them, 1 or more.
    """
    most = max(1, min(_MOST_CASES, math.ceil(len(cases) / (workers * _ROUNDS))))
    ordered = sorted(cases, key=lambda case: (case.scene, sky_of(case), case.number))
    skies = [list(group) for _, group in groupby(ordered, key=lambda case: (case.scene, sky_of(case)))]
    # With enough skies for all workers none is solved twice.
    piece = _MOST_CASES if len(skies) >= _SKIES_EACH * workers else most
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
    """Return what the model says of each case of a batch; a case that fails is told, and ends no other.

    Raises
    ------
    ConfigError
        This program is of another version than the batch, or files that the scene names differ here.
    """
    if batch.code != code_version():
        raise ConfigError(f"a worker has rigctl {code_version()}, the study {batch.code}: install the same on both")
    predictor = _predictor(batch.scene)
    found: list[Predictions | str] = []
    seconds, skies = [], []
    for case in batch.cases:
        start_s = time.perf_counter()
        found.append(_predicted(predictor, dict(case.values), batch.wanted.tolerance))
        seconds.append(time.perf_counter() - start_s)
        skies.append(sky_of(case))
    return _result(batch, predictor, found, seconds, skies)


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
    found: Sequence[Predictions | str],
    seconds: Sequence[float],
    skies: Sequence[tuple[float, ...]],
) -> BatchResult:
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
        seconds=np.array(seconds),
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
