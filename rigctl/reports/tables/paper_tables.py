"""What comes out of the paper as tables and text: its statements, and what noise does to DoLP."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from model.processing.dolp_studies import DolpAgainstSnr, EstimatorError
from rigctl.console.json_text import Json
from rigctl.paper.descriptions import DESCRIPTIONS, Description
from rigctl.paper.numbers import Number
from rigctl.paper.results import IN_WORDS, Result
from rigctl.paper.search import Search
from rigctl.paper.statements import STATEMENTS
from rigctl.reports.table import Column, Table
from rigctl.reports.writers.data_files import csv_rows, finite

# More numbers of a statement stand in CSV and JSON.
_MOST_SHOWN = 8
_HEAD = """# What [MK14] says of its figures, and what comes out

Every sentence of sections II-C to VI about what a figure shows, checked through the whole chain with two sets of
materials, for the optical properties of the paper stand in a reference that is not at hand. Written by `rigctl paper`
(`python -m tests.rigctl.paper.statements_page > docs/paper-statements.md`); a test fails when page and program differ.

- **library**: black paint (slope 0.15) and asphalt (slope 0.30) of the material library, with a texture that
  multiplies all Stokes parameters of the asphalt alike (`examples/paper/library.toml`);
- **rough**: paint of slope 0.30, asphalt of slope 0.40, and the diagonal texture of eq. (10), 5 % of the reflected S0
  in S0, S1 and S2 each (`examples/paper/rough.toml`). Nothing was tuned beyond these two sets.

| verdict | means |
|---|---|
| holds | every inequality of the sentence holds, by more than three numerical errors |
| opposite | at least one is reversed, by more than three numerical errors |
| cannot be seen | every P_D compared is above .999; or it needs the authors' measured points, which nobody here has |
| noise floor | exact DoLP SNRs compared lie below 2.1: those of light without polarization are 1.913 |
| ambiguous | readings of the sentence differ, each is named; or the margin is within the numerical error |

"""
_NOTES = """
**What brings them about.** Fig. 9a: at a view of 10 deg and phi 0 all these ratios lie near 1.913, the exact SNR of
unpolarised light; to first order (`--snr first-order`) they may be any number down to 0. Fig. 10: near the glint the
smooth paint of the library is so bright that the path dilutes its polarization more than it adds; rougher paint is
darker there, and the path's own polarization, which grows with altitude, makes up for it. Fig. 13: with the library's
slopes the paint is 1.5 times as bright as the asphalt at a view of 40 deg (S0 2408 to 1642 DN) and is found by its
brightness; with those of the rough set the two are alike there (1346 to 1409 DN). How model and data agree cannot be
judged without the authors' points.
"""
_SAID = """
## Sentences that say what is drawn

The other sentences of the text about these figures claim nothing that could hold or not. (Figs 1, 3 and 4 are drawings
of the model.)

| figure | sentence | here |
|---|---|---|
"""
# Heading, and what stands under it.
_FIG5 = (
    ("mean: first", "first_mean"),
    ("Gaussian", "mean"),
    ("Poisson", "poisson_mean"),
    ("drawn", "drawn_mean"),
    ("std: first", "first_std"),
    ("Gaussian", "std"),
    ("Poisson", "poisson_std"),
    ("drawn", "drawn_std"),
)


def statement_json(found: Sequence[Result]) -> list[dict[str, Json]]:
    """Return the statements as programs read them."""
    return [_object(one) for one in found]


def _object(one: Result) -> dict[str, Json]:
    content: dict[str, Json] = {
        "id": one.id,
        "figure": one.statement.figure,
        "sentence": one.statement.sentence,
        "geometry": one.statement.geometry,
        "check": one.statement.check,
        "numbers": {label: finite(number.value) for label, number in one.numbers},
        "margin": one.margin,
        "numerical_error": one.numerical_error,
        "verdict": one.verdict,
        "materials": one.materials,
        "readings": {reading.name: reading.verdict for reading in one.readings},
    }
    if one.as_paper:
        content["as_paper"] = {
            "numbers": {label: finite(number.value) for label, number in one.as_paper_numbers},
            "verdict": one.as_paper_verdict,
        }
    return content


def statement_csv(found: Sequence[Result]) -> bytes:
    """Return a row a statement."""
    columns: tuple[Column[Result], ...] = (
        Column(key="id"),
        *(Column(key=name, value=_of_statement(name)) for name in ("figure", "sentence", "geometry", "check")),
        Column(key="numbers", value=lambda one: "; ".join(_number(*pair, digits=8) for pair in one.numbers)),
        Column(key="margin"),
        Column(key="numerical_error"),
        Column(key="verdict"),
        Column(key="materials"),
        Column(key="readings", value=lambda one: "; ".join(f"{r.name}: {r.verdict}" for r in one.readings)),
        Column(
            key="as_paper_numbers",
            value=lambda one: "; ".join(_number(*pair, digits=8) for pair in one.as_paper_numbers),
        ),
        Column(key="as_paper_verdict"),
    )
    return csv_rows(Table(columns=columns, rows=tuple(found)))


def _of_statement(name: str) -> Any:
    return lambda one: getattr(one.statement, name)


def _number(label: str, number: Number, *, digits: int = 4) -> str:
    return f"{label} {number.value:.{digits}g}"


def statement_table(found: Sequence[Result], *, title: str = "") -> Table[Result]:
    """Return the statements with their verdicts, and the numbers of each."""
    columns: tuple[Column[Result], ...] = (
        Column(title="id", text=lambda one: one.id, left=True, unbroken=True),
        Column(title="sentence", text=lambda one: one.statement.sentence, left=True, wide=True),
        Column(title="where", text=lambda one: one.statement.geometry, left=True),
        Column(title="check", text=lambda one: one.statement.check, left=True),
        Column(title="numbers", text=_numbers_text, left=True),
        Column(title="margin", text=lambda one: "–" if one.margin is None else f"{one.margin:.3g}"),
        Column(
            title="num. error", text=lambda one: "–" if one.numerical_error is None else f"{one.numerical_error:.1g}"
        ),
        Column(title="verdict", text=verdict_text, brief=lambda one: IN_WORDS[one.verdict], left=True),
    )
    return Table(title=title, columns=columns, rows=tuple(found), is_off=lambda one: one.verdict == "opposite")


def description_table(figure: int) -> Table[Description]:
    """Return the sentences that say what a figure shows, and how the figure here follows them."""
    columns: tuple[Column[Description], ...] = (
        Column(title="what the text says is drawn", text=lambda one: one.sentence, left=True, wide=True),
        Column(title="here", text=lambda one: one.here, left=True),
    )
    return Table(columns=columns, rows=tuple(one for one in DESCRIPTIONS if one.figure == figure))


def terminal_statements(found: Sequence[Result]) -> Table[Result]:
    """Return what fits a terminal: id, check, margin, verdict."""
    whole = statement_table(found)
    kept = {"id", "check", "margin", "num. error", "verdict"}
    return Table(columns=tuple(column for column in whole.columns if column.title in kept), rows=whole.rows)


def _numbers_text(one: Result) -> str:
    pairs = one.numbers
    more = f"; {len(pairs) - _MOST_SHOWN} more in statements.json" if len(pairs) > _MOST_SHOWN else ""
    text = "; ".join(_number(*pair) for pair in pairs[:_MOST_SHOWN]) + more
    if not one.as_paper:
        return text
    costs = {label: number.value for label, number in one.as_paper_numbers}
    shown = [f"{label} {costs[label]:.4g} ({costs[label] - number.value:+.2g})" for label, number in pairs[:_MOST_SHOWN]
             if label in costs]  # fmt: skip
    return f"{text} | as the paper computes: {'; '.join(shown)}"


def verdict_text(one: Result) -> str:
    """Return the verdict, with that of each reading where they differ."""
    text = IN_WORDS[one.verdict]
    if len({reading.verdict for reading in one.readings}) > 1:
        text += " (" + "; ".join(f"{reading.name}: {IN_WORDS[reading.verdict]}" for reading in one.readings) + ")"
    if one.as_paper_verdict is not None and one.as_paper_verdict != one.verdict:
        text += f"; as the paper computes: {IN_WORDS[one.as_paper_verdict]}"
    return text


def tally(found: Sequence[Result]) -> str:
    """Return how many statements have each verdict."""
    counts = Counter(one.verdict for one in found)
    return ", ".join(f"{IN_WORDS[name]} {counts[name]}" for name in IN_WORDS if counts[name])


def statements_page(found: Sequence[Result], materials: Sequence[str]) -> str:
    """Return the page of docs/ on the statements.

    Parameters
    ----------
    found : sequence of Result
        Of every statement and set.
    materials : sequence of str
        Names of the sets, in the order of the columns.
    """
    by_key = {(one.materials, one.statement.id): one for one in found}
    head = "| figure | id | sentence | where | check | " + " | ".join(materials) + " |\n"
    rule = "|---" * (5 + len(materials)) + "|\n"
    rows = []
    for one in STATEMENTS:
        cells = [verdict_cell(by_key[name, one.id]) for name in materials]
        rows.append(
            f"| {one.figure} | {one.id} | {one.sentence} | {one.geometry} | {one.check} | {' | '.join(cells)} |\n"
        )
    said = "".join(f"| {one.figure} | {one.sentence} | {one.here} |\n" for one in DESCRIPTIONS)
    return _HEAD + head + rule + "".join(rows) + _NOTES + _SAID + said


def verdict_cell(one: Result) -> str:
    """Return verdict and deciding numbers of a statement, as a cell of the page."""
    text = IN_WORDS[one.verdict]
    if len({reading.verdict for reading in one.readings}) > 1:
        text += ": " + "; ".join(f"{reading.name}: {IN_WORDS[reading.verdict]}" for reading in one.readings)
    test = one.readings[0].deciding
    numbers = ", ".join(f"{number.label} {number.value:.3g}" for number in (() if test is None else test.numbers[:2]))
    return f"**{text}**. {numbers}".rstrip(". ") if numbers else f"**{text}**"


def search_lines(found: Search | None) -> Iterable[str]:
    """Return what a search came to."""
    if found is None:
        return
    start = next(one for one in found.tried if not one.numbers)
    yield (
        f"search: {len(found.tried)} sets of materials tried, the first set itself among them, and {found.impossible} "
        f"draws that are no possible surface; most statements that hold {found.best.held} of "
        f"{len(found.best.verdicts)}, with the first set {start.held}"
    )
    for key, value in found.best.numbers.items():
        yield f"  {key} = {value:.4g}"


def verdict_lines(found: Iterable[Result]) -> tuple[str, ...]:
    """Return a line a statement, as it stands under a picture."""
    return tuple(f"{one.statement.id} {verdict_text(one)}: {one.statement.check}" for one in found)


def fig5_table(found: DolpAgainstSnr) -> Table[int]:
    """Return mean and deviation of DoLP against the SNR of S0: first order, exact, drawn."""
    columns: tuple[Column[int], ...] = (
        Column(title="SNR [dB]", text=lambda k: f"{20 * np.log10(found.snr[k]):.0f}"),
        Column(title="S0 [e-]", text=lambda k: f"{found.s0_e[k]:.4g}"),
        *(Column(title=title, text=partial(_five_digits, values=getattr(found, name))) for title, name in _FIG5),
    )
    return Table(columns=columns, rows=tuple(range(len(found.snr))))


def estimator_table(found: Mapping[str, EstimatorError], true_snr: Sequence[float]) -> Table[int]:
    """Return bias and rms error of estimators of the true DoLP, a row a true signal-to-noise ratio."""
    columns: tuple[Column[int], ...] = (
        Column(title="true SNR", text=lambda k: f"{true_snr[k]:g}"),
        *(Column(title=name, text=partial(_errors, found=error), unbroken=True) for name, error in found.items()),
    )
    return Table(title="bias/rms error", columns=columns, rows=tuple(range(len(true_snr))))


def _five_digits(k: int, values: Sequence[float]) -> str:
    return "-" if np.isnan(values[k]) else f"{values[k]:.5f}"


def _errors(k: int, found: EstimatorError) -> str:
    return f"{found.bias[k]:+.3f}/{found.rms[k]:.3f}"
