"""`rigctl paper`: the figures of [MK14], and a verdict on every sentence of its text about them."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter
from cyclopts.validators import Number

from rigctl.console import Json, note
from rigctl.files.choices import SnrForm
from rigctl.verbs.options import FilePath, Files, Part, Result, Writes

if TYPE_CHECKING:
    from model.processing.dolp_studies import EstimatorError
    from rigctl.paper.check import CheckedPaper

SHIPPED = ("library", "rough")
# Names of the files that may be written.
_FILES = ("paper.html", "statements.csv", "statements.json", "curves.csv", "fig*.png", "estimators.png")
_LEAST_HEIGHT_M, _MOST_HEIGHT_M = 1.0, 90_000.0
_TRUE_SNR = (0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 8.0)
_PLOTTED_SNR = (0.0, 6.0, 121)


def paper(
    *,
    figures: Annotated[Sequence[int], Parameter(name="--figure")] = (),
    materials: Sequence[str] = SHIPPED,
    snr: SnrForm = "exact",
    height_m: Annotated[float, Parameter(validator=Number(gte=_LEAST_HEIGHT_M, lte=_MOST_HEIGHT_M))] = 3000.0,
    as_paper: bool = False,
    search: Annotated[int, Parameter(validator=Number(gte=0))] = 0,
    seed: Annotated[int, Parameter(validator=Number(gte=0))] = 1,
    digitised: FilePath | None = None,
    estimators: bool = False,
    out: Annotated[FilePath | None, Writes(kind="folder", names=_FILES)] = None,
) -> "PaperResult | EstimatorResult":
    """Reproduce the figures of Meng & Kerekes 2014, and judge each statement of the text about them.

    Verdicts are: holds, opposite, saturated at 1 (every target is detected), needs unpublished data, noise floor,
    ambiguous (some readings of the sentence hold). The exit code is 0 whatever the verdicts.

    Example: rigctl paper --out paper

    Example: rigctl paper --figure 9 --figure 13 --materials rough --as-paper --out paper

    Parameters
    ----------
    figures : sequence of int
        Figure to compute: 2, or 5 to 15; default: all. Repeatable.
    materials : sequence of str
        Materials: library, rough, or a scene file. Repeatable.
    snr : {"exact", "first-order"}
        Formula of the DoLP SNR: exact, or first-order as in the paper.
    height_m : float
        Height of the camera where the paper gives none [m].
    as_paper : bool
        Also compute with the authors' settings, and state their error.
    search : int
        Number of random sets of materials to try, within their uncertainties.
    seed : int
        Seed of the random numbers.
    digitised : path
        CSV of points of the paper's figures (figure,panel,label,x,y), drawn over ours.
    estimators : bool
        Instead, compare estimators of the true DoLP: bias and rms error against the signal-to-noise ratio.
    out : path
        Folder for paper.html, statements.csv and .json, curves.csv, and a picture of each figure; or estimators.png.
    """
    from rigctl.paper.check import check_paper

    found: PaperResult | EstimatorResult
    if estimators:
        found = _compared(_TRUE_SNR)
    else:
        found = PaperResult(
            check_paper(
                tuple(figures),
                materials,
                shipped=SHIPPED,
                snr=snr,
                height_m=height_m,
                as_paper=as_paper,
                sets=search,
                seed=seed,
                digitised=None if digitised is None else Path(digitised),
                tell=note,
            )
        )
    if out is not None:
        found.write(Path(out))
        names = (
            "estimators.png" if estimators else "paper.html, statements.csv, statements.json, curves.csv and pictures"
        )
        note(f"written: {names} in {out}", below=True)
    return found


@dataclass(frozen=True, eq=False)
class PaperResult(Result):
    """Verdicts on the statements of the paper, by set of materials."""

    found: "CheckedPaper"

    def content(self) -> Iterable[Part]:
        """Return the number of statements by verdict, each statement, and assumptions."""
        from rigctl.paper.check import search_lines, statement_table, tally

        yield from (f"{one.name}: {tally(one.results)}" for one in self.found.sets)
        yield from search_lines(self.found.search)
        yield statement_table(self.found.results)
        yield from self.found.remarks
        yield from dict.fromkeys(text for one in self.found.sets for text in one.assumed)

    def as_json(self) -> list[dict[str, Json]]:
        """Return the content of statements.json."""
        from rigctl.paper.check import statement_json

        return [statement_json(one) for one in self.found.results]

    def output_files(self) -> Files:
        """Return the page, statements, curves and pictures."""
        from rigctl.paper.check import paper_files

        return paper_files(self.found)


@dataclass(frozen=True, kw_only=True, eq=False)
class EstimatorResult(Result):
    """Bias and rms error of estimators of the true DoLP."""

    true_snr: Any  #: true DoLP over the standard deviation of S1/S0 and S2/S0, (k,) array
    errors: "dict[str, EstimatorError]"  #: in units of that deviation

    def content(self) -> Iterable[Part]:
        """Return the estimator with the least error at a true SNR of 2, and the table."""
        from rigctl.paper.check import estimator_plot, estimator_table

        place = list(self.true_snr).index(2.0)
        best = min(self.errors, key=lambda name: float(self.errors[name].rms[place]))
        yield f"at a true SNR of 2 {best} has the least rms error, {self.errors[best].rms[place]:.3f} deviations"
        yield estimator_table(self.errors, self.true_snr.tolist())
        yield lambda: estimator_plot(self.true_snr, self.errors)

    def as_json(self) -> dict[str, Json]:
        """Return the same for programs."""
        errors: dict[str, Json] = {
            name: {"bias": _numbers(one.bias), "rms": _numbers(one.rms)} for name, one in self.errors.items()
        }
        return {"true_snr": self.true_snr.tolist(), **errors}

    def output_files(self) -> Files:
        """Return the picture of the errors."""
        import numpy as np

        from rigctl.paper.check import estimator_plot

        plotted = _compared(np.linspace(*_PLOTTED_SNR))
        return {"estimators.png": estimator_plot(plotted.true_snr, plotted.errors)}


def _numbers(values: Iterable[float]) -> list[Json]:
    """Return numbers for JSON: undefined ones are null."""
    return [float(value) if math.isfinite(value) else None for value in values]


def _compared(true_snr: Any) -> EstimatorResult:
    import numpy as np

    from model.processing.dolp_studies import ESTIMATORS, bias_and_rms

    values = np.array(true_snr)
    return EstimatorResult(true_snr=values, errors={name: bias_and_rms(name, values) for name in ESTIMATORS})
