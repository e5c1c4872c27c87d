"""The page of hard cases, docs/hard-cases.md with its picture: made in one pass over all cases.

Usage: OPENBLAS_NUM_THREADS=1 python -m tests.hard_cases.page [--workers 2]

All answers are stored in tests/hard_cases/found.json; the tests compare the present ones with them.
"""

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from tests.hard_cases.cases import HARD_CASES, HardCase
from tests.hard_cases.matrix import TOLERANCE, Row, row_of
from tests.hard_cases.references import Known, reference_text
from tests.hard_cases.round_earth import round_earth_lines

ROOT = Path(__file__).parents[2]
PAGE, PICTURE = ROOT / "docs" / "hard-cases.md", ROOT / "docs" / "pictures" / "hard-cases.svg"
FOUND = Path(__file__).with_name("found.json")
_LEAST_SHOWN = 1e-17

_READING = """
If your scene is near such an edge, this page shows how accurate its numbers are, and what is refused. In each case one
quantity of the scene is at its limit (`tests/hard_cases/cases.py` has the files). These commands run on each case:
`predict`, `predict --tolerance 0.01`, `sweep`, `predict --uncertainty`, `effects`, `compare`, and `tradeoff` where
every radiance is stated (under a sky it takes minutes); `found.json` next to the cases has all answers. A fault is an
exit code of 70, a number that is not finite, a refusal without an explanation, a DoLP that differs from the stated one,
or a run that disagrees with its own scene.

- **Reference.** Where the radiance is stated, the reference is the stated DoLP, to rounding (1e-14). Where a material
  is under a sky, sasktran2 solves the sky (discrete ordinates, an independent program). The difference between its fast
  and its standard settings is the reference's own error. SNR and P_D come from a million draws from the normal law of
  the pixels, and have a sampling error.
- **Own run.** The light of the reference is drawn pixel by pixel and goes through the simulated camera, which shares no
  formula with the model. It takes four cycles of frames. `compare` then compares this run with the scene file.
"""

_ANSWERED = """
## Answers and references

DoLP and P_D (at a false alarm rate of 1e-3) are those of the target. `off` is the difference from the reference.
"no SNR" means that mean and deviation of DoLP do not exist because S0 is too near to 0, or that nothing fluctuates.

| case | reference: DoLP | `predict` off | `--tolerance` off | SNR | off | P_D | off | own run |
|---|---|---|---|---|---|---|---|---|"""

_REFUSED = """
## Refused

Every command refuses these cases with exit code 2 (the scene file is wrong).

| case | message |
|---|---|"""

_DEEP = """
## Limits

**Deep air.** The time of a solution rises with the square of the optical depth. Beyond a depth of 12, a prediction to a
tolerance stops at coarse settings and lists the numbers for which these are not enough. `tradeoff` refuses such a
scene.
"""


def main() -> int:
    """Write the page; return 1 where a case has a fault."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as cache:
        os.environ["XDG_CACHE_HOME"] = cache
        with ProcessPoolExecutor(max_workers=arguments.workers, mp_context=get_context("spawn")) as pool:
            for row in pool.map(_row, HARD_CASES):
                rows.append(row)
                sys.stderr.write(f"{len(rows)} of {len(HARD_CASES)}: {row.name}, {row.seconds:.1f} s{_said(row)}\n")
                sys.stderr.flush()
    FOUND.write_text(json.dumps([asdict(row) for row in rows], indent=1) + "\n")
    PAGE.write_text("\n".join(page_lines(rows)) + "\n", encoding="utf-8")
    _draw(rows)
    return 1 if any(row.faults for row in rows) else 0


def _row(case: HardCase) -> Row:
    with tempfile.TemporaryDirectory() as folder:
        return row_of(case, Path(folder))


def _said(row: Row) -> str:
    return f", {row.verdict} {row.reason} {'; '.join(row.faults)}"


def stored_rows() -> list[Row]:
    """Return the rows that the page shows."""
    return [_of_json(one) for one in json.loads(FOUND.read_text())]


def _of_json(one: dict[str, Any]) -> Row:
    known = {name: None if one[name] is None else Known(**one[name]) for name in ("dolp", "snr", "p_detection")}
    return Row(**{**one, **known, "faults": tuple(one["faults"])})


def page_lines(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the lines of the page."""
    answered = [row for row in rows if not row.refused]
    yield "# Hard cases\n"
    yield _answer(rows)
    yield from _summary(rows)
    yield "\n![Error of DoLP by case, and the reference's own error](pictures/hard-cases.svg)"
    yield _READING
    yield "Written by `python -m tests.hard_cases.page`; do not edit."
    yield _ANSWERED
    yield from (_answered_line(row) for row in answered)
    yield from _own_runs(answered)
    yield _REFUSED
    yield from (f"| {row.name} | {row.refused} |" for row in rows if row.refused)
    yield _DEEP
    yield from round_earth_lines()
    yield reference_text()


def _answer(rows: Sequence[Row]) -> str:
    refused, faults = sum(bool(row.refused) for row in rows), sum(len(row.faults) for row in rows)
    disagree = sum(row.verdict == "disagrees" for row in rows)
    return (
        f"Of {len(rows)} scenes at the edges of what can be computed, rigctl answers {len(rows) - refused} and refuses "
        f"{refused} with an explanation. There are {faults} faults. {_count(disagree)} with its own scene.\n"
    )


def _count(number: int) -> str:
    return "No run of a case disagrees" if number == 0 else f"{number} runs disagree, each"


def _summary(rows: Sequence[Row]) -> Iterator[str]:
    answered = [row for row in rows if not row.refused]
    stated = [row for row in answered if row.source == "stated" and row.error is not None]
    solved = [row for row in answered if row.source == "sasktran2" and row.error is not None]
    agreeing = sum(row.verdict.startswith("agrees") for row in answered)
    yield "| | |\n|---|---|"
    yield f"| cases | {len(rows)} |"
    yield f"| answered | {len(answered)} |"
    yield f"| refused, with an explanation | {len(rows) - len(answered)} |"
    yield f"| faults | {sum(len(row.faults) for row in rows)} |"
    yield f"| own run agrees | {agreeing} of {len(answered)} |"
    yield f"| own run cannot be judged, with a reason | {sum(_is_unjudged(row) for row in answered)} |"
    yield f"| own run disagrees | {sum(row.verdict == 'disagrees' for row in answered)} |"
    yield f"| largest error of DoLP where the radiance is stated | {max(_errors(stated)):.1e} |"
    for name, errors in (
        ("`predict`, the fast settings of the file", _errors(solved)),
        (f"`predict --tolerance {TOLERANCE:g}`", [_number(row.error_to_tolerance) for row in solved]),
    ):
        place = max(range(len(solved)), key=errors.__getitem__)
        yield f"| largest error of DoLP against sasktran2, {name} | {errors[place]:.1e} ({solved[place].name}) |"
    broken = [row.name for row in answered if not row.answers["--tolerance"].endswith("kept")]
    yield f"| cases with numbers that `--tolerance {TOLERANCE:g}` does not promise | {', '.join(broken) or 'none'} |"


def _errors(rows: Sequence[Row]) -> list[float]:
    return [_number(row.error) for row in rows]


def _number(value: float | None) -> float:
    return 0.0 if value is None else value


def _is_unjudged(row: Row) -> bool:
    return not row.verdict.startswith("agrees") and row.verdict != "disagrees"


def _answered_line(row: Row) -> str:
    cells = [
        _known(row.dolp, row.source),
        _off(row.error),
        _off(row.error_to_tolerance),
        _known(row.snr, "no SNR"),
        _difference(row.snr, row.ours.get("snr")),
        _known(row.p_detection, "-"),
        _difference(row.p_detection, row.ours.get("p_detection")),
        row.verdict,
    ]
    faults = f" **{'; '.join(row.faults)}**" if row.faults else ""
    return f"| {row.name}{faults} | {' | '.join(cells)} |"


def _known(found: Known | None, otherwise: str) -> str:
    return otherwise if found is None else f"{found.value:.5g} ± {found.error:.0e}"


def _difference(found: Known | None, ours: float | None) -> str:
    return "-" if found is None or ours is None else _off(abs(ours - found.value))


def _off(error: float | None) -> str:
    return "-" if error is None else "0" if error < _LEAST_SHOWN else f"{error:.1e}"


def _own_runs(rows: Sequence[Row]) -> Iterator[str]:
    """Yield why runs are held with reservations or cannot be judged, cases of one reason together."""
    by_reason: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        if row.reason:
            by_reason.setdefault((row.verdict, row.reason), []).append(row.name)
    if by_reason:
        yield "\nReasons:\n"
    for (verdict, reason), names in by_reason.items():
        yield f"- {', '.join(names)}: {verdict}: {reason}"


def _draw(rows: Sequence[Row]) -> None:
    """Draw the error of DoLP of each case, and the reference's own error."""
    from matplotlib import rcParams
    from matplotlib.figure import Figure

    rcParams.update({"svg.hashsalt": "hard-cases", "svg.fonttype": "none"})
    shown = [row for row in rows if row.error is not None and row.dolp is not None][::-1]
    figure = Figure(figsize=(9.0, 1.2 + 0.2 * len(shown)), layout="constrained")
    axes = figure.subplots()
    places, least = range(len(shown)), 1e-17
    own = [max(row.dolp.error, least) for row in shown if row.dolp is not None]
    axes.barh(places, own, left=least, color="0.85", height=0.9, label="error of the reference itself")
    axes.plot([max(_number(row.error), least) for row in shown], places, "o", ms=4, label="predict")
    tolerant = [
        (max(_number(row.error_to_tolerance), least), k) for k, row in enumerate(shown) if row.ours.get("tolerance")
    ]
    axes.plot(*zip(*tolerant, strict=True), "x", ms=5, label=f"predict --tolerance {TOLERANCE:g}")
    axes.axvline(TOLERANCE, color="black", lw=0.8, ls="--")
    axes.set_xscale("log")
    axes.set_xlim(least, 1.0)
    axes.set_ylim(-0.6, len(shown) - 0.4)
    axes.set_yticks(places, [row.name for row in shown], fontsize=7)
    axes.set_xlabel("error of DoLP (dashed: the tolerance)")
    figure.legend(loc="outside upper center", ncols=3, fontsize=8)
    figure.savefig(PICTURE, metadata={"Date": None})


if __name__ == "__main__":
    sys.exit(main())
