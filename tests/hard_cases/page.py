"""The page of hard cases, docs/hard-cases.md: written from the matrix, whole.

Usage: OPENBLAS_NUM_THREADS=1 python -m tests.hard_cases.page [--only WORDS] [--out FILE.md] [--workers 2]

One pass over all cases, by two processes, and each row is written when it is there. With --only, cases whose names
contain the words are computed anew, and the others are kept as the page has them.
"""

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from tests.hard_cases.cases import HARD_CASES, HardCase
from tests.hard_cases.matrix import COLUMNS, Cell, cell
from tests.hard_cases.references import reference_lines, reference_of
from tests.hard_cases.round_earth import round_earth_lines

PAGE = Path(__file__).parents[2] / "docs" / "hard-cases.md"

_HEAD = """# Hard cases

Written by `python -m tests.hard_cases.page`; do not edit. Each row is a scene with one thing at its edge
(`tests/hard_cases/cases.py` has the files), each column a command; a cell is the number that it answers, or the words
and the exit code (2: the scene is refused) of its refusal. `tests/hard_cases/` holds that no cell is a fault of the
program (exit 70), a number that is not finite, or a refusal without words, and that DoLP of a given radiance is what
was given, to rounding.

- `reference`: what is known of DoLP and SNR of the target by other means: what the case states, the same scene with its
  sky solved by sasktran2 (discrete ordinates; an independent program), and draws from the normal law of the pixels,
  which have sampling errors of some 1e-3.
- `predict`: DoLP of the target and its SNR over the pixels. "no SNR": mean and deviation of DoLP do not exist, for S0
  is too near to 0, or nothing fluctuates.
- `--tolerance`: with `--tolerance 0.01`: the largest estimated error of any number, and whether all are promised.
- `sweep`: DoLP at two f-numbers. `uncertainty`: what f_number = 2.00 +- 0.02 makes of S0 [DN] and DoLP.
- `effects`: how many of all effects act at 0.01. `tradeoff`: the true error at a tolerance of 0.1.
- `ROC`: probability of detecting the target on the background at a false alarm rate of 1e-3, and the area under it.
- `compare`: the verdict on one and the same run, of a target like that of the first row.

**Deep air.** A solution takes time with the square of the optical depth. A prediction to a tolerance stops at coarse
settings beyond a depth of 12 and says what these do not keep; `tradeoff` refuses such a scene.
"""


def main() -> int:
    """Write the page; return 1 where a cell is not acceptable."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="")
    parser.add_argument("--out", type=Path, default=PAGE)
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    kept = rows_of(arguments.out if arguments.out.exists() else PAGE) if arguments.only else {}
    head = [_HEAD, *round_earth_lines()]
    tables = list(reference_lines())
    with tempfile.TemporaryDirectory() as cache:
        os.environ["XDG_CACHE_HOME"] = cache
        lines = []
        for line in _matrix(kept, arguments.only, arguments.workers):
            lines.append(line)
            # After each row, so that a run that is stopped leaves what it had.
            arguments.out.write_text("\n".join([*head, *lines, "", *tables, ""]), encoding="utf-8")
    faults = sum("**" in line for line in lines)
    sys.stderr.write(f"{arguments.out}: {len(lines) - 2} cases, {faults} with a fault\n")
    return 1 if faults else 0


def rows_of(page: Path) -> dict[str, str]:
    """Return the name of each case of a page with its line."""
    lines = page.read_text(encoding="utf-8").splitlines()
    names = {case.name for case in HARD_CASES}
    found = {line.split("|")[1].strip(): line for line in lines if line.startswith("|")}
    return {name: line for name, line in found.items() if name in names}


def _matrix(kept: Mapping[str, str], only: str, workers: int) -> Iterator[str]:
    yield f"| case | reference | {' | '.join(column.name for column in COLUMNS)} |"
    yield "|---" * (len(COLUMNS) + 2) + "|"
    begun = time.monotonic()
    with ProcessPoolExecutor(max_workers=workers, mp_context=get_context("spawn")) as pool:
        rows = {case.name: pool.submit(_row, case) for case in HARD_CASES if case.name not in kept or only in case.name}
        for done, case in enumerate(HARD_CASES, start=1):
            if case.name not in rows:
                yield kept[case.name]
                continue
            line, times = rows[case.name].result()
            so_far = time.monotonic() - begun
            sys.stderr.write(f"{done} of {len(HARD_CASES)}, {so_far:.0f} s: {case.name}: {times}\n")
            sys.stderr.flush()
            yield line


def _row(case: HardCase) -> tuple[str, str]:
    """Return the line of a case, and the time that each of its cells took, in words."""
    with tempfile.TemporaryDirectory() as folder:
        cells = [cell(case, column, Path(folder)) for column in COLUMNS]
        reference = reference_of(case, Path(folder))
    seconds = ", ".join(f"{column.name} {one.seconds:.1f}" for column, one in zip(COLUMNS, cells, strict=True))
    return f"| {case.name} | {reference} | {' | '.join(map(_text, cells))} |", f"{seconds} s"


def _text(one: Cell) -> str:
    return f"**{one.fault}**: {one.words}" if one.fault else one.words


if __name__ == "__main__":
    sys.exit(main())
