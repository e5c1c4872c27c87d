"""A study: thousands of predictions on dask, each done once, kept as they come, and written for others to read."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rigctl.base.numbers import utc_text
from rigctl.errors import ConfigError
from rigctl.files.study_file import SENSITIVITY_KINDS, StudyFile, load_study
from rigctl.mapped import Engine, Outcome, held_folder, mapped
from rigctl.predict.predict import ROC_RATES, SWEPT_RATES, ScenePredictor, parse_roc
from rigctl.scene.scene import get
from rigctl.study import (
    CONVENTIONS,
    PACKAGES,
    Axis,
    Case,
    MorrisEffect,
    SobolIndex,
    StudyArrays,
    StudyScene,
    StudyTable,
    Wanted,
    arrays_of,
    batches_of,
    case_hash,
    cases_of,
    code_version,
    column_name,
    compute,
    failed,
    morris_of,
    numbers_of,
    parts_of,
    read_parts,
    sobol_of,
    study_scene,
    write_parquet,
    write_part,
    write_zarr,
)

_DETECTION = ("p_detection", "auc")


@dataclass(frozen=True, kw_only=True)
class StudyRequest:
    """A study that is to be computed.

    Attributes
    ----------
    study : Path
        Study file.
    out : Path
        Folder; what is done there is not done again.
    engine : Engine
        Where.
    tolerance : float or None
        Largest numerical error of every case; None: the settings of the scene files.
    """

    study: Path
    out: Path
    engine: Engine
    tolerance: float | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class StudyResult:
    """What a study gave.

    Attributes
    ----------
    table : StudyTable
        Cases and numbers.
    outcome : {"whole", "stopped"}
        Whether all cases were tried.
    done_before : int
        Cases that an earlier command had done.
    damaged : tuple of str
        Parts of an earlier command that could not be read; their cases were computed again.
    sobol, morris : tuples
        How much each input matters, of a whole study of that kind.
    """

    table: StudyTable
    outcome: Outcome
    done_before: int
    damaged: tuple[str, ...]
    sobol: tuple[SobolIndex, ...] = ()
    morris: tuple[MorrisEffect, ...] = ()

    @property
    def failed(self) -> int:
        """Cases that have a reason in the place of numbers."""
        return sum(1 for reason in self.table.arrays.reasons if reason)

    @property
    def seconds_of_new_sky(self) -> float:
        """Mean time of a case for which a sky was solved; NaN where there is none."""
        return _mean(self.table.arrays.seconds[self.table.arrays.is_new_sky])

    @property
    def seconds_of_same_sky(self) -> float:
        """Mean time of a case under the sky of the one before; NaN where there is none."""
        return _mean(self.table.arrays.seconds[~self.table.arrays.is_new_sky])


def _mean(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else float("nan")


@dataclass(frozen=True, kw_only=True)
class _Plan:
    """A study made ready: its scenes, what is wanted, and its cases with their hashes."""

    file: StudyFile
    scenes: tuple[StudyScene, ...]
    wanted: Wanted
    axes: tuple[Axis, ...]
    cases: tuple[Case, ...]
    hashes: tuple[str, ...]
    inputs: Mapping[str, str] = field(default_factory=dict)


def run_study(request: StudyRequest, *, tell: Callable[[int, int], None] = lambda _done, _cases: None) -> StudyResult:
    """Return a study, computed as far as it was not before.

    Parameters
    ----------
    request : StudyRequest
        The study.
    tell : callable
        Takes how many cases are done, and how many there are, as they come.

    Raises
    ------
    ConfigError
        A file is wrong, a number or quantity does not exist, or dask or a scheduler is not there.
    DataError
        The folder is in use, or the scheduler went away: what was done is kept.
    """
    plan = _plan(request)
    with held_folder(request.out):
        done = read_parts(request.out)
        left = [case for case, one in zip(plan.cases, plan.hashes, strict=True) if one not in done.places]
        before = len(plan.cases) - len(left)
        outcome = mapped(
            request.engine,
            compute,
            lambda slots: batches_of(left, plan.scenes, plan.wanted, workers=slots),
            lambda batch, result: write_part(request.out, result, [plan.hashes[case.number] for case in batch.cases]),
            command="study",
            packages=PACKAGES,
            size=lambda batch: len(batch.cases),
            parts=parts_of,
            lost=failed,
            done=before,
            total=len(plan.cases),
            tell=tell,
        )
        result = _result(request.out, plan, outcome, before, done.damaged)
        if outcome == "whole":
            _write(request.out, result)
    return result


def _write(out: Path, result: StudyResult) -> None:
    write_zarr(out, result.table)
    write_parquet(out, result.table)
    if result.sobol or result.morris:
        from rigctl.study import write_sensitivity

        write_sensitivity(result.sobol, result.morris, out, created_by=result.table.said["created_by"])


def _plan(request: StudyRequest) -> _Plan:
    file = load_study(request.study)
    scenes = tuple(study_scene(path) for path in file.scenes)
    predictors = [ScenePredictor(scene.file, None) for scene in scenes]
    cases = cases_of(file.cases, [one.scene for one in predictors])
    wanted = _wanted(file, predictors, request.tolerance)
    is_grid = file.cases.kind == "grid"
    axes = tuple(
        Axis(key=key, unit=one.unit, meaning=one.meaning, values=varied.steps if is_grid else ())
        for key, varied in file.cases.parameters.items()
        for one in (get(predictors[0].scene, key),)
    )
    return _Plan(
        file=file,
        scenes=scenes,
        wanted=wanted,
        axes=axes,
        cases=cases,
        hashes=tuple(case_hash(case, scenes[case.scene], wanted) for case in cases),
        inputs=_inputs(request),
    )


def _inputs(request: StudyRequest) -> dict[str, str]:
    """Return the texts of the study and its scenes, as they were."""
    study = load_study(request.study)
    return {path.name: path.read_text(encoding="utf-8") for path in (request.study, *study.scenes)}


def _wanted(file: StudyFile, predictors: Sequence[ScenePredictor], tolerance: float | None) -> Wanted:
    """Return what is computed; quantities are sought in the prediction of each scene as its file has it."""
    known: dict[tuple[str, str], None] = {}
    for predictor in predictors:
        if file.roc is not None:
            parse_roc(file.roc, tuple(region.name for region in predictor.scene.regions))
        for region in predictor.predictions().values():
            known |= {(name, one): None for name, found in region.quantities.items() for one in found}
    columns: dict[tuple[str, str], None] = {}
    problems = []
    for asked in file.quantities:
        name, _, statistic = asked.partition(".")
        fitting = [one for one in known if one[0] == name and statistic in ("", one[1])]
        if not fitting and asked not in _DETECTION:
            problems.append(asked)
        columns |= dict.fromkeys(fitting)
    if problems:
        told = sorted({name for name, _ in known} | set(_DETECTION))
        raise ConfigError(f"quantities: no scene gives {', '.join(problems)}; there are {', '.join(told)}")
    detection = any(asked in _DETECTION for asked in file.quantities)
    return Wanted(columns=tuple(columns), detection=detection, roc=file.roc, tolerance=tolerance)


def _result(out: Path, plan: _Plan, outcome: Outcome, before: int, damaged: tuple[str, ...]) -> StudyResult:
    done = read_parts(out)
    arrays = arrays_of(plan.cases, plan.hashes, done, plan.wanted, rates=len(SWEPT_RATES), curve=ROC_RATES.size)
    table = StudyTable(
        scenes=tuple(scene.name for scene in plan.scenes),
        axes=plan.axes,
        columns=plan.wanted.columns,
        cases=plan.cases,
        arrays=arrays,
        said=_said(plan),
    )
    sobol, morris = _indices(plan, arrays) if outcome == "whole" else ((), ())
    return StudyResult(table=table, outcome=outcome, done_before=before, damaged=damaged, sobol=sobol, morris=morris)


def _said(plan: _Plan) -> dict[str, str]:
    return {
        "title": plan.file.name,
        "created_by": f"rigctl {code_version()}",
        "created_utc": utc_text(time.time_ns()),
        "origin": "predicted by the analytical model; nothing here was measured",
        "conventions": CONVENTIONS,
        **{f"input {name}": text for name, text in plan.inputs.items()},
    }


def _indices(plan: _Plan, arrays: StudyArrays) -> tuple[tuple[SobolIndex, ...], tuple[MorrisEffect, ...]]:
    section = plan.file.cases
    if section.kind not in SENSITIVITY_KINDS:
        return (), ()
    inputs = tuple(section.parameters)
    scenes = [scene.name for scene in plan.scenes]
    numbers = list(numbers_of(arrays, scenes, [column_name(column) for column in plan.wanted.columns]))
    if section.kind == "sobol":
        return tuple(row for number, values in numbers for row in sobol_of(number, values, inputs)), ()
    n = section.n or 0
    effects = (morris_of(number, values, inputs, n=n, seed=section.seed) for number, values in numbers)
    return (), tuple(row for found in effects for row in found)
