"""JSON that every reader takes: a number that does not exist is null, with its reason beside it."""

import json
import math
from collections.abc import Mapping, Sequence
from typing import TypeAlias

# What JSON holds, as it is written; NaN and infinite numbers become null.
Json: TypeAlias = "Mapping[str, Json] | Sequence[Json] | str | int | float | bool | None"

REASON_SUFFIX = "_reason"
_NO_NUMBER = "no number follows from these inputs"
_NO_BOUND = "grows beyond every number with these inputs"


def json_text(content: Mapping[str, Json] | Sequence[Mapping[str, Json]], *, indent: int | None = 2) -> str:
    """Return the content of a JSON file or answer.

    Parameters
    ----------
    content : mapping, or a list of them
        Where a value is NaN or infinite it becomes null, and ``KEY_reason`` says why, unless the content has a
        reason of its own; of a list, the reason names the places.
    indent : int or None
        As `json.dumps` takes it.
    """
    return json.dumps(_existing(content), indent=indent, allow_nan=False) + "\n"


def _existing(content: Json) -> Json:
    if isinstance(content, Mapping):
        return _existing_table(content)
    if isinstance(content, list | tuple):
        return [_existing(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


def _existing_table(content: Mapping[str, Json]) -> dict[str, Json]:
    told: dict[str, Json] = {}
    for key, value in content.items():
        told[key] = _existing(value)
        reason = _reason(value)
        if reason is not None and content.get(f"{key}{REASON_SUFFIX}") is None:
            told[f"{key}{REASON_SUFFIX}"] = reason
    # A reason that the content has itself, at its own place, is the better one.
    return told | {key: value for key, value in content.items() if key.endswith(REASON_SUFFIX) and value is not None}


def _reason(value: object) -> str | None:
    """Return in words why a number, or numbers of a list, are null; None where all of them are there."""
    if isinstance(value, float) and not math.isfinite(value):
        return _NO_NUMBER if math.isnan(value) else _NO_BOUND
    if isinstance(value, list | tuple):
        gone = [(place, reason) for place, one in enumerate(value) if (reason := _reason(one)) is not None]
        return "; ".join(f"item {place}: {reason}" for place, reason in gone[:3]) or None
    return None
