"""`rigctl study`: thousands of predictions on dask, each done once and kept as it comes, as files that others read."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Unpack

from cyclopts import Parameter
from cyclopts.validators import Number

from rigctl.console import EXIT_INCOMPLETE, Json, warn
from rigctl.verbs.options import EngineOptions, FilePath, Part, Result, Writes, engine_of

if TYPE_CHECKING:
    from rigctl.mapped import Outcome
    from rigctl.study import SobolIndex, StudyTable

_FILES = ("study.parquet", "detection.parquet", *(f"sensitivity.{end}" for end in ("csv", "json", "png")))
_MS_PER_S = 1000.0
_MOST_REASONS = 5


def study(
    file: FilePath,
    /,
    *,
    out: Annotated[FilePath, Writes(kind="folder", names=_FILES)],
    tolerance: Annotated[float | None, Parameter(validator=Number(gte=1e-6, lte=0.1))] = None,
    **options: Unpack[EngineOptions],
) -> "StudyResult":
    """Predict many cases of a scene: grids, lists or random draws of its numbers, with Sobol sensitivity indices.

    Writes study.zarr (for xarray), study.parquet (a row for each case and region), detection.parquet if detection is
    requested, and sensitivity.csv, .json and .png for studies of kind sobol.

    Finished cases are kept. Ctrl-C stops (exit code 75), and the same command continues. A case that fails is a row
    with its reason. Cases under the same sky are computed together, which saves most of the time. With a tolerance,
    settings are determined for some cases of a batch and used for their neighbours.

    Example: rigctl study examples/study-panels.toml --out panels-study --workers 2

    Parameters
    ----------
    file : path
        Study file.
    out : path
        Folder for study.zarr, tables, and the finished cases.
    tolerance : float
        Largest numerical error of each case, 1e-6 to 0.1; default: 0.01 where light is computed from materials.
    **options
        Where the cases are computed, see `EngineOptions`.
    """
    from rigctl.mapped import count_shown
    from rigctl.study import run_study

    engine = engine_of(options)
    with count_shown("cases") as tell:
        table, sobol, outcome, before, damaged = run_study(Path(file), Path(out), engine, tolerance, tell=tell)
    for text in damaged:
        warn(f"{text}; its cases were computed again")
    result = StudyResult(
        table=table, out=Path(out), outcome=outcome, done_before=before, damaged=tuple(damaged), sobol=sobol
    )
    for text in result.reasons:
        warn(text)
    return result


@dataclass(frozen=True, kw_only=True, eq=False)
class StudyResult(Result):
    """Cases and numbers of a study."""

    table: "StudyTable"
    out: Path
    outcome: "Outcome"  #: all cases were tried
    done_before: int  #: number of cases from earlier commands
    damaged: tuple[str, ...]  #: unreadable parts of an earlier command; their cases were computed again
    sobol: "tuple[SobolIndex, ...]" = ()  #: sensitivity to each input, for a complete study of that kind

    @property
    def failed(self) -> int:
        """Number of cases that have a reason instead of numbers."""
        return sum(1 for reason in self.table.numbers.reasons if reason)

    @property
    def seconds_of_new_sky(self) -> float:
        """Mean time of the cases that solved a sky of their own; NaN without such cases."""
        return _mean(self.table.numbers.seconds[self.table.numbers.is_new_sky])

    @property
    def seconds_of_same_sky(self) -> float:
        """Mean time of the cases that used the sky of the case before; NaN without such cases."""
        return _mean(self.table.numbers.seconds[~self.table.numbers.is_new_sky])

    @property
    def reasons(self) -> list[str]:
        """Texts on the reasons of failed cases, with their numbers."""
        from rigctl.study import UNDONE

        counted = Counter(reason for reason in self.table.numbers.reasons if reason and reason != UNDONE)
        several = [f"{times} cases failed: {reason}" for reason, times in counted.most_common(_MOST_REASONS)]
        more = len(counted) - _MOST_REASONS
        return several + ([f"and {more} other reasons"] if more > 0 else [])

    @property
    def exit_code(self) -> int:
        """75 if the study was stopped on request."""
        return EXIT_INCOMPLETE if self.outcome == "stopped" else 0

    def content(self) -> Iterable[Part]:
        """Return the number of cases, their time, and the sensitivity to each input."""
        cases = len(self.table.cases)
        if self.outcome == "stopped":
            yield f"stopped: {cases - self.failed} of {cases} cases are done; the same command continues"
            return
        yield f"{cases} cases, {self.done_before} of them done before, {self.failed} failed; in {self.out}"
        new, same = (_MS_PER_S * one for one in (self.seconds_of_new_sky, self.seconds_of_same_sky))
        skies = int(self.table.numbers.is_new_sky.sum())
        if skies:
            yield f"{skies} skies: {new:.3g} ms for a case with its sky, {same:.3g} ms for one under the same sky"
        if self.sobol:
            from rigctl.study import sobol_table

            yield sobol_table(self.sobol)

    def as_json(self) -> dict[str, Json]:
        """Return the outcome; the numbers are in the store."""
        return {
            "schema_version": 1,
            "out": str(self.out),
            "outcome": self.outcome,
            "cases": len(self.table.cases),
            "done_before": self.done_before,
            "failed": self.failed,
            "seconds_of_new_sky": self.seconds_of_new_sky,
            "seconds_of_same_sky": self.seconds_of_same_sky,
            "created_by": self.table.attributes["created_by"],
        }

    def write(self, folder: Path) -> tuple[str, ...]:
        """Write the store, the tables and the sensitivities into a folder; return the names of the files."""
        from rigctl.study import write_study

        return write_study(folder, self.table, self.sobol)


def _mean(values: Any) -> float:
    import numpy as np

    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else float("nan")
