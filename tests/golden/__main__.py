"""Compares chapters with what is stored, or stores them anew: `python -m tests.golden --help`."""

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def main() -> int:
    """Run the chapters that are asked for; return 1 where one differs."""
    parser = argparse.ArgumentParser(prog="python -m tests.golden", description=__doc__)
    parser.add_argument("chapters", nargs="*", metavar="CHAPTER", help="all that take seconds, if none is named")
    parser.add_argument("--write", action="store_true", help="store what is found")
    parser.add_argument("--long", action="store_true", help="the chapters that take minutes too")
    parser.add_argument("--prose", action="store_true", help="compare sentences too")
    parser.add_argument("--keep", type=Path, help="run in this folder and keep it")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="rigctl-golden-") as made:
        os.environ["XDG_STATE_HOME"] = os.environ["XDG_CACHE_HOME"] = made
        from tests.golden.run import run_chapters

        folder = arguments.keep or Path(made)
        is_same = run_chapters(
            arguments.chapters, folder, write=arguments.write, long=arguments.long, prose=arguments.prose
        )
    print(f"{time.process_time():.1f} s of processor")
    return 0 if is_same else 1


if __name__ == "__main__":
    sys.exit(main())
