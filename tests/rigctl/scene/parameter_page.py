"""The page on a scene's parameters, from their table (python -m tests.rigctl.scene.parameter_page)."""

import math
import sys

from rigctl.scene.scene import describe

HEAD = """# Parameters of a scene

Every number of a scene file by its key: as it may be uncertain there, be swept (`rigctl sweep`), and stand in reports.
NAME is that of a region, ANGLE one of the polarizer in degrees. Written from the table in
`rigctl/scene/scene.py`.

| key | unit | range | meaning |
|---|---|---|---|
"""


def page() -> str:
    """Return the page."""
    rows = [
        f"| `{row.key}` | {row.unit or '1'} | {_range(row.least, row.most)} | {row.meaning} |" for row in describe()
    ]
    return HEAD + "\n".join(rows) + "\n"


def _range(least: float, most: float) -> str:
    if math.isinf(least) and math.isinf(most):
        return "any"
    return f"from {least:g}" if math.isinf(most) else f"{least:g} to {most:g}"


if __name__ == "__main__":
    sys.stdout.write(page())
