"""Trial: docs/paper-statements.md against the whole of `rigctl paper`, and its time.

python -m benchmarks.trial_paper
"""

import sys
import time
from pathlib import Path

from tests.rigctl.paper.statements_page import page

PAGE = Path(__file__).parents[1] / "docs" / "paper-statements.md"


def run_paper() -> bool:
    """Compute every statement with both sets of materials; return whether the page says the same."""
    start, cpu = time.perf_counter(), time.process_time()
    same = page() == PAGE.read_text(encoding="utf-8")
    print(f"paper: page and program {'agree' if same else 'DIFFER'}; {time.perf_counter() - start:.0f} s, "
          f"{time.process_time() - cpu:.0f} s of processor")  # fmt: skip
    return same


if __name__ == "__main__":
    sys.exit(0 if run_paper() else 1)
