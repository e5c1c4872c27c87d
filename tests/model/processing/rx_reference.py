"""The stored reference cases of the RX detector."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_STORED = json.loads((Path(__file__).parents[1] / "reference" / "rx.json").read_text())
CASES: dict[str, dict[str, Any]] = {case["id"]: case for case in _STORED["cases"]}
HOTELLING: list[dict[str, Any]] = _STORED["hotelling"]


def moments(case: dict[str, Any]) -> tuple[NDArray[np.float64], ...]:
    """Target mean and covariance, background mean and covariance."""
    return tuple(np.array(case[key]) for key in ("mu_t", "cov_t", "m_b", "cov_b"))


def column(case: dict[str, Any], name: str) -> NDArray[np.float64]:
    """One column of the ROC of a case; what is below the double range becomes 0."""
    return np.array([float(row[name]) for row in case["roc"]])
