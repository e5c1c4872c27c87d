"""Reference cases of the law of DoLP."""

import json
from pathlib import Path
from typing import Any

_FILE = Path(__file__).parent.parent / "reference" / "dolp.json"


def dolp_cases(*, with_moments: bool | None = None) -> list[dict[str, Any]]:
    """Return the cases, all or only those with (without) moments."""
    cases: list[dict[str, Any]] = json.loads(_FILE.read_text())["cases"]
    return [case for case in cases if with_moments is None or (case["mean"] is not None) == with_moments]


def case_id(case: dict[str, Any]) -> str:
    """Return a name for a parametrised test."""
    return f"{case['id']}-{case['kind']}-snr{case['snr0']:g}-p{case['p']:g}"
