"""Runs the monkey at length: command lines, files, calibrations, runs and images that are wrong in one place.

Usage: python -m tests.monkey [--cases 5000] [--first-seed 0] [--memory-mb 3000]
"""

import argparse
import resource
import shutil
import sys
import tempfile
import time
import warnings
from pathlib import Path

from tests.monkey.cases import make_case
from tests.monkey.judge import problems_of
from tests.monkey.workspace import make_workspace

_BYTES_PER_MB = 1_000_000


def run_monkey(cases: int = 5000, *, first_seed: int = 0, memory_mb: int = 3000) -> bool:
    """Run cases, print every one that does what none may do, and return whether there is none."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (memory_mb * _BYTES_PER_MB, before[1]))
    warnings.simplefilter("ignore")
    start_s, bad = time.monotonic(), 0
    with tempfile.TemporaryDirectory() as scratch:
        sound = make_workspace(Path(scratch) / "sound")
        for seed in range(first_seed, first_seed + cases):
            folder = Path(scratch) / "case"
            shutil.copytree(sound, folder)
            case = make_case(seed, folder)
            problems = problems_of(case, folder)
            if problems:
                bad += 1
                print(f"seed {seed}, {case.done}: rigctl {' '.join(case.arguments)[:200]}\n  " + "\n  ".join(problems))
            shutil.rmtree(folder)
    resource.setrlimit(resource.RLIMIT_AS, before)
    print(f"monkey: {cases} cases from seed {first_seed}, {bad} bad, {time.monotonic() - start_s:.0f} s")
    return bad == 0


def main() -> int:
    """Run the monkey; return 1 where a case fails."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=5000)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--memory-mb", type=int, default=3000, help="Address space that the process may take.")
    arguments = parser.parse_args()
    return 0 if run_monkey(arguments.cases, first_seed=arguments.first_seed, memory_mb=arguments.memory_mb) else 1


if __name__ == "__main__":
    sys.exit(main())
