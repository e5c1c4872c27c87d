"""What the trials share: workers, scratch folders, repeated attempts, limits of counts and of scores.

A trial is a function that prints a table and returns whether everything is as stated. `__main__` turns its arguments
into options. Two kinds of evidence occur:

- a count, such as runs named wrongly. A rate p explains k of n if so extreme a count has a chance above `CHANCE`.
- scores z = (measured - true) / stated standard error over many seeds. Their mean should be 0 and their variance 1,
  within the sampling errors 1/sqrt(n) and sqrt(2/(n-1)).
"""

import os
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import TypeVar

import numpy as np
from scipy.special import bdtr, bdtrc

Item = TypeVar("Item")
Result = TypeVar("Result")
Row = TypeVar("Row")

CHANCE = 1e-3
# Of 100 rows with a mean and a variance each, one is 4 standard errors off in seventy trials by chance.
_SUSPICIOUS = 4.0
_SHOWN = 5


def over(work: Callable[[Item], Result], items: Iterable[Item], *, chunk: int = 1) -> Iterator[Result]:
    """Yield the result of each item in order; the work is done in one process per core."""
    # Forked, so that the workers have what the trial prepared.
    with ProcessPoolExecutor(mp_context=get_context("fork")) as pool:
        yield from pool.map(work, items, chunksize=chunk)


@contextmanager
def scratch() -> Iterator[Path]:
    """Give an empty folder, in memory if possible, because durable writing takes time and changes no number."""
    memory = "/dev/shm"
    with tempfile.TemporaryDirectory(dir=memory if os.access(memory, os.W_OK) else None) as folder:
        yield Path(folder)


def attempts(name: str, count: int, attempt: Callable[[int], Sequence[str]]) -> bool:
    """Make attempts, which return what went wrong, and print each; return whether nothing went wrong."""
    failures = 0
    for number in range(1, count + 1):
        problems = attempt(number)
        failures += bool(problems)
        print(f"{name} {number}: {'; '.join(problems) or 'sound'}", flush=True)
    print(f"{name}: {failures} of {count} failed")
    return failures == 0


def is_high_enough(count: int, n: int, rate: float) -> bool:
    """Return whether `count` of `n` is explained by a rate of at least `rate`."""
    return bool(bdtr(count, n, rate) > CHANCE)


def is_low_enough(count: int, n: int, rate: float) -> bool:
    """Return whether `count` of `n` is explained by a rate of at most `rate`."""
    return count == 0 or bool(bdtrc(count - 1, n, rate) > CHANCE)


def by_row(outcomes: Iterable[Mapping[Row, float]]) -> dict[Row, list[float]]:
    """Return the scores of each row, of the scores that each attempt found."""
    scores: dict[Row, list[float]] = defaultdict(list)
    for outcome in outcomes:
        for row, score in outcome.items():
            scores[row].append(score)
    return scores


def are_normal(
    title: str,
    scores: Mapping[tuple[object, ...], Sequence[float]],
    *,
    may_be_small: Callable[[tuple[object, ...]], bool] = lambda _: False,
) -> bool:
    """Print the rows whose scores are farthest from standard normal; return whether none is too far.

    Scores of rows that `may_be_small` may have a variance below 1: their errors are wide on purpose.
    """
    found = []
    for row, values in scores.items():
        z = np.array(values)
        mean, variance = float(z.mean()), float(z.var(ddof=1))
        off = mean * np.sqrt(z.size), (variance - 1.0) / np.sqrt(2.0 / (z.size - 1))
        worst = max(abs(off[0]), off[1] if may_be_small(row) else abs(off[1]))
        found.append((worst, row, z.size, mean, variance, off))
    found.sort(key=lambda entry: -entry[0])
    too_far = sum(entry[0] > _SUSPICIOUS for entry in found)
    variances = np.mean([entry[4] for entry in found])
    print(f"{title}: {too_far} of {len(found)} rows too far from mean 0 and variance 1; mean variance {variances:.3f}")
    for worst, row, n, mean, variance, off in found[: max(_SHOWN, too_far)]:
        flag = "  <--" if worst > _SUSPICIOUS else ""
        words = " ".join(map(str, row))
        print(f"  {words:44} n {n:4d}  mean {mean:+.3f} ({off[0]:+.1f})  variance {variance:.3f} ({off[1]:+.1f}){flag}")
    return too_far == 0
