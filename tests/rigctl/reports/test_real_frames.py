"""Reports of frames that nobody here made: closed loop, with what is wrong with them said by name."""

import json
import os
from pathlib import Path

import pytest

from rigctl.cli import main

REAL_DATA = os.environ.get("RIGCTL_REAL_DATA")
pytestmark = pytest.mark.skipif(
    REAL_DATA is None, reason="set RIGCTL_REAL_DATA to the folder of real frames (imx250_fruits, lasco_c2_triplet)"
)
FOLDER = Path(REAL_DATA or "")

FRUITS = """
[[regions]]
name = "apple"
rectangle = { x = 250, y = 260, width = 60, height = 60 }
[[regions]]
name = "orange"
rectangle = { x = 780, y = 330, width = 60, height = 60 }
[[regions]]
name = "banana"
rectangle = { x = 560, y = 660, width = 80, height = 40 }
[[regions]]
name = "table"
rectangle = { x = 900, y = 880, width = 200, height = 100 }
"""
CORONA = """
[[regions]]
name = "east"
rectangle = { x = 40, y = 200, width = 80, height = 80 }
[[regions]]
name = "west"
rectangle = { x = 400, y = 220, width = 60, height = 80 }
"""


def compared(folder: Path, imported: list[str], regions: str) -> dict[str, dict[str, str]]:
    """Import, compare, and return the checks by name."""
    assert main(["import", str(folder / "run"), *imported]) == 0
    (folder / "regions.toml").write_text(regions)
    words = ["--regions", str(folder / "regions.toml"), "--out", str(folder / "out")]
    assert main(["compare", str(folder / "run"), *words]) in (0, 5)
    assert (folder / "out" / "report.pdf").read_bytes().startswith(b"%PDF")
    content = json.loads((folder / "out" / "comparison.json").read_text())
    return {check["name"]: check for check in content["checks"]}


def test_a_real_mosaic_has_its_throughput_error_and_its_shift_flagged(tmp_path: Path) -> None:
    file = FOLDER / "imx250_fruits" / "fruits_IMX250MZR.png"
    checks = compared(tmp_path, [str(file), "--mosaic", "90,45,135,0", "--black-level-dn", "0"], FRUITS)
    # Two per cent between the pairs, by the set's own description; the planes of a mosaic lie half a cell apart.
    assert checks["pair sums of table"]["verdict"] == "flagged"
    assert checks["pair sums of table"]["text"].split("differ by ")[1].startswith(("1.9", "2.0", "2.1"))
    assert checks["registration"]["verdict"] == "flagged"
    assert checks["linear response"]["verdict"] == "sound"


def test_a_real_triplet_says_what_three_angles_cannot_test(tmp_path: Path) -> None:
    files = [str(FOLDER / "lasco_c2_triplet" / f"lasco_{angle}.fts") for angle in ("0", "+60", "-60")]
    words = ["--angles", "0,60,-60", "--exposure-key", "EXPTIME", "--black-level-key", "OFFSET", "--bit-depth", "16"]
    checks = compared(tmp_path, [*files, *words], CORONA)
    assert checks["pair sums"]["verdict"] == "not testable"
    assert checks["registration"]["verdict"] == "sound"
