"""An interlock that is not satisfied."""

from dataclasses import dataclass
from typing import Literal

Name = Literal[
    "angle",
    "black",
    "button",
    "clock",
    "counter",
    "disk",
    "drift",
    "fault",
    "gone",
    "homed",
    "identical",
    "low_signal",
    "queue",
    "saturated",
    "settings",
    "sum_rule",
    "synchronised",
    "temperature",
]


@dataclass(frozen=True, kw_only=True)
class InterlockViolation:
    """An interlock that is not satisfied.

    Attributes
    ----------
    name : str
        Which; its action stands under this name in the session file.
    message : str
        What was found, and what to try.
    """

    name: Name
    message: str
