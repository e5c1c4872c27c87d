"""Place of a camera and options for its use, in one text: ``PLACE?key=value&key=value``."""

from collections.abc import Callable, Mapping
from typing import Any

from drivers.errors import LimitError


def split_place(text: str, readers: Mapping[str, Callable[[str], Any]]) -> tuple[str, dict[str, Any]]:
    """Return the place and the values behind it.

    Parameters
    ----------
    text : str
        Such as ``192.168.0.5?pixel_format=Mono12Packed&width=640``.
    readers : mapping
        What turns the text of each allowed key into its value; it raises ValueError where it cannot.

    Raises
    ------
    LimitError
        The place is empty, or keys are unknown or their values unfit: all of them are named.
    """
    place, _, tail = text.partition("?")
    values: dict[str, Any] = {}
    problems = [] if place else ["there is nothing before the '?'"]
    for item in filter(None, tail.split("&")):
        key, _, value = item.partition("=")
        if key not in readers:
            problems.append(f"{key!r} is no known key; known are {', '.join(sorted(readers))}")
            continue
        try:
            values[key] = readers[key](value)
        except ValueError as error:
            problems.append(f"{key}={value!r}: {error}")
    if problems:
        raise LimitError(f"camera address {text!r}: {'; '.join(problems)}")
    return place, values


def one_of(*allowed: str) -> Callable[[str], str]:
    """Return a reader of a text that has to be one of these."""

    def read(value: str) -> str:
        if value not in allowed:
            raise ValueError(f"allowed are {', '.join(allowed)}")
        return value

    return read


def whole(least: int, most: int) -> Callable[[str], int]:
    """Return a reader of a whole number within these limits."""

    def read(value: str) -> int:
        number = int(value)
        if not least <= number <= most:
            raise ValueError(f"must lie between {least} and {most}")
        return number

    return read


def positive(value: str) -> float:
    """Return a number above 0."""
    number = float(value)
    if not 0.0 < number < float("inf"):
        raise ValueError("must be a number above 0")
    return number


def yes_or_no(value: str) -> bool:
    """Return whether the text is 1; it has to be 0 or 1."""
    if value not in ("0", "1"):
        raise ValueError("allowed are 0 and 1")
    return value == "1"
