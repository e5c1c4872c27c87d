"""`rigctl study`: thousands of predictions on dask, each done once and kept as it comes, as files that others read."""

import os
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter
from cyclopts.validators import Number

from rigctl.console.failures import EXIT_INCOMPLETE
from rigctl.console.json_text import Json
from rigctl.console.terminal import warn
from rigctl.errors import ConfigError
from rigctl.verbs.options import FilePath, Writes
from rigctl.verbs.result import Part, Result

if TYPE_CHECKING:
    from rigctl.files.study_file import StudyFile
    from rigctl.mapped import Engine, Outcome
    from rigctl.prediction.predict import ScenePredictor
    from rigctl.study import Axis, Case, DoneCases, SobolIndex, StudyScene, StudyTable, Wanted

_FILES = ("study.parquet", "detection.parquet", *(f"sensitivity.{end}" for end in ("csv", "json", "png")))
_MS_PER_S = 1000.0
_MOST_REASONS = 5
_DETECTION = ("p_detection", "auc")


def study(
    file: FilePath,
    /,
    *,
    out: Annotated[FilePath, Writes(kind="folder", names=_FILES)],
    scheduler: str | None = None,
    workers: Annotated[int | None, Parameter(validator=Number(gte=1))] = None,
    tolerance: Annotated[float | None, Parameter(validator=Number(gte=1e-6, lte=0.1))] = None,
) -> "StudyResult":
    """Predict many cases of a scene: grids, lists or random draws of its numbers, with Sobol sensitivity indices.

    Writes study.zarr (for xarray), study.parquet (a row for each case and region), detection.parquet if detection is
    requested, and sensitivity.csv, .json and .png for studies of kind sobol.

    Finished cases are kept. Ctrl-C stops (exit code 75), and the same command continues. A case that fails is a row
    with its reason. Cases under the same sky are computed together, which saves most of the time. With --tolerance,
    settings are determined for some cases of a batch and used for their neighbours.

    Example: rigctl study examples/study-panels.toml --out panels-study --workers 2

    Parameters
    ----------
    file : path
        Study file.
    out : path
        Folder for study.zarr, tables, and the finished cases.
    scheduler : str
        Address of a dask scheduler, such as tcp://HOST:8786; default: this machine.
    workers : int
        Processes on this machine; default: one per core.
    tolerance : float
        Largest numerical error of each case, 1e-6 to 0.1; default: the settings of the scene file.

    Returns
    -------
    StudyResult
        Cases, numbers, and how much each input matters.

    Raises
    ------
    ConfigError
        A file is wrong, a number or quantity does not exist, or dask or a scheduler is not there.
    DataError
        The folder is in use, or the scheduler went away; finished cases are kept.
    """
    from rigctl.mapped import Engine, count_shown

    if scheduler is not None and workers is not None:
        raise ConfigError("--workers: is of this machine; a scheduler has its own")
    engine = Engine(scheduler=scheduler, workers=workers or os.cpu_count() or 1)
    with count_shown("cases") as tell:
        found = _study(Path(file), Path(out), engine, tolerance, tell=tell)
    for text in found.damaged:
        warn(f"{text}; its cases were computed again")
    for text in found.reasons:
        warn(text)
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class StudyResult(Result):
    """Cases and numbers of a study."""

    table: "StudyTable"
    out: Path
    outcome: "Outcome"  #: whether all cases were tried
    done_before: int  #: cases that an earlier command had done
    damaged: tuple[str, ...]  #: parts of an earlier command that could not be read; their cases were computed again
    sobol: "tuple[SobolIndex, ...]" = ()  #: how much each input matters, of a whole study of that kind

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

    @property
    def reasons(self) -> list[str]:
        """Why cases failed, each reason once with how many."""
        from rigctl.study import UNDONE

        counted = Counter(reason for reason in self.table.arrays.reasons if reason and reason != UNDONE)
        several = [f"{times} cases failed: {reason}" for reason, times in counted.most_common(_MOST_REASONS)]
        more = len(counted) - _MOST_REASONS
        return several + ([f"and {more} other reasons"] if more > 0 else [])

    @property
    def exit_code(self) -> int:
        """75 where the study was stopped on request."""
        return EXIT_INCOMPLETE if self.outcome == "stopped" else 0

    def content(self) -> Iterable[Part]:
        """Return how many cases there are, their time, and how much each input matters."""
        cases = len(self.table.cases)
        if self.outcome == "stopped":
            yield f"stopped: {cases - self.failed} of {cases} cases are done; the same command goes on"
            return
        yield f"{cases} cases, {self.done_before} of them done before, {self.failed} failed; in {self.out}"
        new, same = (_MS_PER_S * one for one in (self.seconds_of_new_sky, self.seconds_of_same_sky))
        skies = int(self.table.arrays.is_new_sky.sum())
        if skies:
            yield f"{skies} skies: {new:.3g} ms for a case with its sky, {same:.3g} ms for one under the same sky"
        if self.sobol:
            from rigctl.study import sobol_table

            yield sobol_table(self.sobol)

    def as_json(self) -> dict[str, Json]:
        """Return the outcome for programs; the numbers are in the store."""
        return {
            "schema_version": 1,
            "out": str(self.out),
            "outcome": self.outcome,
            "cases": len(self.table.cases),
            "done_before": self.done_before,
            "failed": self.failed,
            "seconds_of_new_sky": self.seconds_of_new_sky,
            "seconds_of_same_sky": self.seconds_of_same_sky,
            "created_by": self.table.said["created_by"],
        }

    def write(self, folder: Path) -> tuple[str, ...]:
        """Write the store, the tables and the sensitivities into a folder; return the names of the files."""
        from rigctl.study import write_parquet, write_sensitivity, write_zarr

        write_zarr(folder, self.table)
        write_parquet(folder, self.table)
        if not self.sobol:
            return _FILES[:2]
        return (*_FILES[:2], *write_sensitivity(self.sobol, folder, created_by=self.table.said["created_by"]))


def _mean(values: Any) -> float:
    import numpy as np

    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else float("nan")


@dataclass(frozen=True, kw_only=True)
class _Plan:
    """A study made ready: its scenes, what is wanted, and its cases with their hashes."""

    file: "StudyFile"
    texts: dict[str, str]  #: the study file and its scenes, as they were
    scenes: "tuple[StudyScene, ...]"
    wanted: "Wanted"
    axes: "tuple[Axis, ...]"
    cases: "tuple[Case, ...]"
    hashes: tuple[str, ...]


def _study(
    path: Path, out: Path, engine: "Engine", tolerance: float | None, *, tell: Callable[[int, int], None]
) -> StudyResult:
    """Compute a study as far as it was not before, and write it once all of its cases were tried."""
    from rigctl.mapped import held_folder, mapped
    from rigctl.study import PACKAGES, batches_of, compute, failed, parts_of, read_parts, write_part

    plan = _plan(path, tolerance)
    with held_folder(out):
        done = read_parts(out)
        left = [case for case, one in zip(plan.cases, plan.hashes, strict=True) if one not in done.places]
        before = len(plan.cases) - len(left)
        outcome = mapped(
            engine,
            compute,
            lambda slots: batches_of(left, plan.scenes, plan.wanted, workers=slots),
            lambda batch, result: write_part(out, result, [plan.hashes[case.number] for case in batch.cases]),
            command="study",
            packages=PACKAGES,
            size=lambda batch: len(batch.cases),
            parts=parts_of,
            lost=failed,
            done=before,
            total=len(plan.cases),
            tell=tell,
        )
        table = _table(plan, read_parts(out))
        result = StudyResult(
            table=table,
            out=out,
            outcome=outcome,
            done_before=before,
            damaged=done.damaged,
            sobol=_sobol(plan, table) if outcome == "whole" else (),
        )
        if outcome == "whole":
            result.write(out)
    return result


def _plan(path: Path, tolerance: float | None) -> _Plan:
    from rigctl.base.durable import MOST_TEXT_BYTES, read_bounded
    from rigctl.files.study_file import load_study
    from rigctl.prediction.predict import ScenePredictor
    from rigctl.scene.scene import get
    from rigctl.study import Axis, case_hash, cases_of, study_scene

    file = load_study(path)
    scenes = tuple(study_scene(scene) for scene in file.scenes)
    predictors = [ScenePredictor(scene.file, None) for scene in scenes]
    cases = cases_of(file.cases, [one.scene for one in predictors])
    wanted = _wanted(file, predictors, tolerance)
    is_grid = file.cases.kind == "grid"
    axes = tuple(
        Axis(key=key, unit=one.unit, meaning=one.meaning, values=varied.steps if is_grid else ())
        for key, varied in file.cases.parameters.items()
        for one in (get(predictors[0].scene, key),)
    )
    return _Plan(
        file=file,
        texts={one.name: read_bounded(one, MOST_TEXT_BYTES).decode("utf-8") for one in (path, *file.scenes)},
        scenes=scenes,
        wanted=wanted,
        axes=axes,
        cases=cases,
        hashes=tuple(case_hash(case, scenes[case.scene], wanted) for case in cases),
    )


def _wanted(file: "StudyFile", predictors: "Sequence[ScenePredictor]", tolerance: float | None) -> "Wanted":
    """Return what is computed; quantities are sought in the prediction of each scene as its file has it."""
    from rigctl.prediction.predict import parse_roc
    from rigctl.study import Wanted

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
        names = sorted({name for name, _ in known} | set(_DETECTION))
        raise ConfigError(f"quantities: no scene gives {', '.join(problems)}; there are {', '.join(names)}")
    detection = any(asked in _DETECTION for asked in file.quantities)
    return Wanted(columns=tuple(columns), detection=detection, roc=file.roc, tolerance=tolerance)


def _table(plan: _Plan, done: "DoneCases") -> "StudyTable":
    import time

    from rigctl.base.numbers import utc_text
    from rigctl.prediction.predict import ROC_RATES, SWEPT_RATES
    from rigctl.study import CONVENTIONS, StudyTable, arrays_of, code_version

    return StudyTable(
        scenes=tuple(scene.name for scene in plan.scenes),
        axes=plan.axes,
        columns=plan.wanted.columns,
        cases=plan.cases,
        arrays=arrays_of(plan.cases, plan.hashes, done, plan.wanted, rates=len(SWEPT_RATES), curve=ROC_RATES.size),
        said={
            "title": plan.file.name,
            "created_by": f"rigctl {code_version()}",
            "created_utc": utc_text(time.time_ns()),
            "origin": "predicted by the analytical model; nothing here was measured",
            "conventions": CONVENTIONS,
            **{f"input {name}": text for name, text in plan.texts.items()},
        },
    )


def _sobol(plan: _Plan, table: "StudyTable") -> "tuple[SobolIndex, ...]":
    """Return how much each input matters to each number; nothing of other kinds of study."""
    if plan.file.cases.kind != "sobol":
        return ()
    from rigctl.study import column_name, numbers_of, sobol_of

    columns = [column_name(column) for column in plan.wanted.columns]
    inputs = tuple(plan.file.cases.parameters)
    numbers = numbers_of(table.arrays, list(table.scenes), columns)
    return tuple(row for number, values in numbers for row in sobol_of(number, values, inputs))
