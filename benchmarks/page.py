"""Writes the table of docs/benchmarks.md (`make bench`); `python -m benchmarks.page GROUP ...` prints some rows only.

Groups: commands, images, session, predictions, physics, noise. `python -m benchmarks.peers` makes what is set beside.
"""

import argparse
import importlib
import os
import platform
import re
import sys
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from benchmarks.timing import Row

PAGE = Path(__file__).resolve().parents[1] / "docs" / "benchmarks.md"
GROUPS = ("commands", "images", "session", "predictions", "physics", "noise")
_HEAD = ("work", "ours", "beside", "theirs", "ratio", "wanted, at most")
_BEGIN, _END = "<!-- begin -->", "<!-- end -->"


def _machine() -> str:
    found = re.search(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text()) if sys.platform == "linux" else None
    processor = found[1] if found else platform.processor() or platform.machine()
    has = "AVX-512" if found and "avx512f" in Path("/proc/cpuinfo").read_text() else "no AVX-512"
    return (
        f"{datetime.now(tz=UTC):%Y-%m-%d}, {processor}, {os.cpu_count()} processors, {has}, load "
        f"{os.getloadavg()[0]:.1f} at the start, Python {platform.python_version()}, numpy {version('numpy')}."
    )


def main() -> int:
    """Time every group and write the page, or print those that are named; return 1 where a bar is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("groups", nargs="*", metavar="GROUP", choices=(*GROUPS, []))
    groups = parser.parse_args().groups
    lines = [_machine(), "", f"| {' | '.join(_HEAD)} |", "|---|---:|---|---:|---:|---:|"]
    print(*lines, sep="\n")
    rows: list[Row] = []
    for group in groups or GROUPS:
        for row in importlib.import_module(f"benchmarks.speed_{group}").rows():
            rows.append(row)
            lines.append(f"| {' | '.join(row.cells)} |")
            print(lines[-1], flush=True)
    if not groups:
        before, _, rest = PAGE.read_text(encoding="utf-8").partition(_BEGIN)
        text = "\n".join((_BEGIN, *lines, _END))
        PAGE.write_text(before + text + rest.partition(_END)[2], encoding="utf-8")
    return 0 if all(row.is_met for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
