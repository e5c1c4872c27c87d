"""How things are timed, and the row of docs/benchmarks.md that each figure becomes.

Everything is processor time unless a row says otherwise: other work on the machine changes it by a tenth or two, and
time on the clock by any factor. What is compared takes turns, so that both meet the same machine, and the least of the
turns counts.
"""

import os
import resource
import subprocess
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

Work = Callable[[], object]

# Installed programs have compiled files; without them each start takes half as long again.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


@dataclass(frozen=True, kw_only=True)
class Row:
    """What a piece of work takes, what it is set beside, and what is wanted."""

    work: str
    ours: float
    unit: str = "s"
    beside: str = ""  # a peer, or a limit that no program can beat
    theirs: float | None = None
    most: float | None = None  # of ours
    most_ratio: float | None = None  # of ours over theirs

    @property
    def ratio(self) -> float | None:
        return None if self.theirs is None else self.ours / self.theirs

    @property
    def is_met(self) -> bool:
        by_itself = self.most is None or self.ours <= self.most
        return by_itself and (self.most_ratio is None or self.ratio is None or self.ratio <= self.most_ratio)

    @property
    def cells(self) -> tuple[str, ...]:
        """Its cells in the table."""
        wanted = "" if self.most is None else f"{self.most:g} {self.unit}"
        wanted = wanted if self.most_ratio is None else f"ratio {self.most_ratio:.2g}"
        return (
            self.work,
            f"{self.ours:.3g} {self.unit}",
            self.beside,
            "" if self.theirs is None else f"{self.theirs:.3g} {self.unit}",
            "" if self.ratio is None else f"{self.ratio:.2g}",
            wanted if self.is_met else f"**{wanted}: missed**",
        )


def spent_s(work: Work) -> float:
    """Return the processor time of one call, of all its threads."""
    start_s = time.process_time()
    work()
    return time.process_time() - start_s


def least_s(*works: Work, rounds: int = 7) -> list[float]:
    """Return the least processor time of each piece of work; they take turns, and the first round is not counted."""
    times = [[spent_s(work) for work in works] for _ in range(rounds + 1)]
    return [min(of_one) for of_one in zip(*times[1:], strict=True)]


def command_s(words: Sequence[str], *, runs: int = 3, before: Work = lambda: None) -> float:
    """Return the least processor time of a command, with its system calls, threads and the processes it waits for."""
    times = []
    for _ in range(runs):
        before()
        start = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(words, check=True, capture_output=True)
        end = resource.getrusage(resource.RUSAGE_CHILDREN)
        times.append(end.ru_utime + end.ru_stime - start.ru_utime - start.ru_stime)
    return min(times)
