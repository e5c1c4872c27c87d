"""Range that every number of a file, an option or an address keeps to, so that arithmetic with it stays finite."""

from collections.abc import Callable, Iterator, Mapping
from datetime import date
from functools import wraps
from math import isfinite
from typing import Any

# No quantity of a camera, a stage, a scene or a session is larger in any unit that people write it in; products of a
# dozen such numbers are finite.
LARGEST = 1e12
# Closer to 0 than this is 0 misspelt: what is divided by it stays finite too.
SMALLEST = 1e-30
# Of a time that a file or an option says: the sun is computed well within, and nanoseconds fit into 64 bits.
FIRST_YEAR, LAST_YEAR = 1900, 2200


def range_problem(value: float) -> str | None:
    """Return in words what is wrong with a number that no arithmetic may be done with; None for a good one."""
    if isinstance(value, float) and not isfinite(value):
        return f"must be finite, between -{LARGEST:g} and {LARGEST:g}"
    # Whole numbers of any length can be compared, but not made a float.
    if abs(value) > LARGEST:
        return f"must lie between -{LARGEST:g} and {LARGEST:g}"
    if 0 < abs(value) < SMALLEST:
        return f"must be 0, or at least {SMALLEST:g} away from it"
    return None


def wild_numbers(content: object, key: str = "") -> Iterator[tuple[str, str]]:
    """Yield key and problem of every number of a nested table that is out of range.

    Parameters
    ----------
    content : object
        Tables, lists and values, times among them, as a TOML or JSON file gives them.
    key : str
        Where it stands.
    """
    if isinstance(content, Mapping):
        for name, value in content.items():
            yield from wild_numbers(value, f"{key}.{name}" if key else str(name))
    elif isinstance(content, list | tuple):
        for place, value in enumerate(content):
            yield from wild_numbers(value, f"{key}.{place}" if key else str(place))
    elif isinstance(content, date) and not FIRST_YEAR <= content.year <= LAST_YEAR:
        yield key, f"the year must lie between {FIRST_YEAR} and {LAST_YEAR} (found {content.isoformat()})"
    elif isinstance(content, int | float):
        problem = range_problem(content)
        if problem is not None:
            yield key, f"{problem} (found {shown(content)})"


def shown(value: object) -> str:
    """Return a value as a message shows it: whole numbers of a hundred digits and long texts cut."""
    try:
        text = repr(value)
    except ValueError:  # whole numbers of more than 4300 digits have no text
        return "a number of thousands of digits"
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}... ({len(text)} characters)"


_SHOWN = 200


def with_options_in_range(command: Callable[..., Any], refuse: Callable[[str], Exception]) -> Callable[..., Any]:
    """Return a command that refuses options whose numbers are out of range, before it does anything.

    Parameters
    ----------
    command : callable
        Called with the options by their names.
    refuse : callable
        Makes the error out of a message.
    """

    @wraps(command)
    def checked(*arguments: Any, **options: Any) -> Any:
        problems = [f"--{name.partition('.')[0].replace('_', '-')}: {text}" for name, text in wild_numbers(options)]
        if problems:
            raise refuse("\n  ".join(problems))
        return command(*arguments, **options)

    return checked
