"""Runs chapters by name, outside pytest."""

import importlib.util
import os
import time
from collections.abc import Sequence
from pathlib import Path

from tests.golden.cases import CHAPTERS
from tests.golden.harness import Chapter, check


def why_not(chapter: Chapter) -> str | None:
    """Return why a chapter cannot be run here; None where it can."""
    missing = [package for package in chapter.needs if importlib.util.find_spec(package) is None]
    if missing:
        return f"needs {', '.join(missing)}"
    if chapter.is_real and "RIGCTL_REAL_DATA" not in os.environ:
        return "set RIGCTL_REAL_DATA to the folder of real frames"
    return None


def run_chapters(
    names: Sequence[str], folder: Path, *, write: bool = False, long: bool = False, prose: bool = False
) -> bool:
    """Run chapters, all of them if none is named; print where they differ, and return whether none does."""
    is_same = True
    for name in names or [name for name, chapter in CHAPTERS.items() if long or not chapter.is_long]:
        reason, begin_s = why_not(CHAPTERS[name]), time.process_time()
        found = [] if reason else check(name, CHAPTERS[name], folder / name, write=write, prose=prose)
        print(f"{name}: {reason or f'{len(found)} differences, {time.process_time() - begin_s:.1f} s'}", flush=True)
        print(*(f"  {line}" for line in found), sep="\n")
        is_same &= not found
    return is_same
