"""Numbers, angles and times as text: allowed range, known digits, one form of UTC."""

from collections.abc import Iterator, Mapping
from datetime import UTC, date, datetime, timedelta
from math import floor, isfinite, log10
from typing import TYPE_CHECKING, TypeVar

from rigctl.errors import ConfigError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

AngleT = TypeVar("AngleT", float, "NDArray[np.float64]")
FiniteT = TypeVar("FiniteT")


def wrapped(angle: AngleT, *, turn: float) -> AngleT:
    """Return an angle modulo a turn in [-turn / 2, turn / 2)."""
    half = turn / 2.0
    return (angle + half) % turn - half


# Correlations below this are rounding.
_NO_CORRELATION = 1e-12


def covariance_rows(cov: "NDArray[np.float64]") -> list[list[float]]:
    """Return a covariance as lists for files, with rounding set to 0."""
    std = abs(cov.diagonal()) ** 0.5
    rows: list[list[float]] = (cov * (abs(cov) > _NO_CORRELATION * std[:, None] * std) + 0.0).tolist()  # no -0
    return rows


# Above every quantity of a camera, stage, scene or session in any unit; products of a dozen such numbers are finite.
LARGEST = 1e12
# Smaller numbers are misspelt zeros; quotients stay finite.
SMALLEST = 1e-30
# Years of times in files and options: within the range for the sun and for nanoseconds in 64 bits.
FIRST_YEAR, LAST_YEAR = 1900, 2200


def range_problem(value: float) -> str | None:
    """Return the problem of a number outside the range for arithmetic; None for a good one."""
    if isinstance(value, float) and not isfinite(value):
        return f"must be finite, between -{LARGEST:g} and {LARGEST:g}"
    # Integers of any length can be compared, but not converted to float.
    if abs(value) > LARGEST:
        return f"must lie between -{LARGEST:g} and {LARGEST:g}"
    if 0 < abs(value) < SMALLEST:
        return f"must be 0, or at least {SMALLEST:g} away from it"
    return None


def wild_numbers(content: object, key: str = "") -> Iterator[tuple[str, str]]:
    """Yield key and problem of every number of a nested table that is out of range."""
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
    """Return a value for a message, with very long integers and texts shortened."""
    try:
        text = repr(value)
    except ValueError:  # whole numbers of more than 4300 digits have no text
        return "a number of thousands of digits"
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}... ({len(text)} characters)"


_SHOWN = 200


def finite(value: FiniteT) -> FiniteT | None:
    """Return a value for JSON; null if it is infinite (an ideal polarizer) or missing."""
    return None if isinstance(value, float) and not isfinite(value) else value


# For a missing number.
NOTHING = "–"
NO_NUMBER = "does not exist"

# No number is known well enough to distinguish smaller values from 0.
_ROUNDING = 1e-12
# Smaller probabilities depend on unknown tails.
_LEAST_CHANCE = 1e-6


def to_digits(value: float, error: float) -> str:
    """Return a number to two digits of its error, or to four digits without one."""
    if not isfinite(value):
        return NO_NUMBER
    if error == 0.0 or not isfinite(error):
        return f"{value:.4g}"
    exponent = int(f"{error:.1e}".partition("e")[2])
    return f"{value:.{max(0, 1 - exponent)}f}"


def plus_minus(value: float, error: float) -> str:
    """Return a number with its standard error, both to two digits of the error."""
    return f"{to_digits(value, error)} ± {to_digits(error, error)}"


def signed(score: float | None) -> str:
    """Return a standard score."""
    return NOTHING if score is None else f"{score:+.2f}"


def size(value: float) -> str:
    """Return an error or a limit by its power of ten; 0 for rounding."""
    if not isfinite(value):
        return NOTHING
    return "0" if abs(value) < _ROUNDING else f"{value:.1e}"


# Smaller changes are rounding of a solution.
_LEAST_CHANGE = 1e-10


def change_text(value: float) -> str:
    """Return the size of a change: 0, two digits, or "any" without a limit."""
    if not isfinite(value):
        return "any"
    return "0" if value < _LEAST_CHANGE else f"{value:.2g}"


def chance(probability: float) -> str:
    """Return a probability to two digits, or an upper limit if it is very small."""
    if not isfinite(probability):
        return NO_NUMBER
    return f"{probability:.2g}" if probability >= _LEAST_CHANCE else "< 1e-6"


def p_value(probability: float) -> str:
    """Return a probability after its name, as in "p = 0.03"."""
    found = chance(probability)
    return f"p {found}" if found.startswith("<") else f"p = {found}"


def percent(share: float, *, digits: int = 2, sign: bool = False) -> str:
    """Return a share in per cent to some digits, without a power of ten: "100 %", "0.013 %"."""
    if not isfinite(share):
        return NO_NUMBER
    value = 100.0 * share
    if abs(value) < _ROUNDING:
        return "0 %"
    decimals = min(max(0, digits - 1 - floor(log10(abs(value)))), 6)
    return f"{value:{'+' if sign else ''}.{decimals}f} %"


NS_PER_S = 1_000_000_000
_EPOCH = datetime.fromisoformat("1970-01-01T00:00:00Z")


def utc_text(unix_ns: int) -> str:
    """Return a point in time as ISO 8601 text in UTC, with all nine digits of its nanoseconds.

    The text ends in ``Z`` and sorts as the times do: ``2026-05-04T10:00:00.250000000Z``.
    """
    seconds, nanoseconds = divmod(unix_ns, NS_PER_S)
    moment = datetime.fromtimestamp(seconds, tz=UTC)
    return f"{moment:%Y-%m-%dT%H:%M:%S}.{nanoseconds:09d}Z"


def unix_ns(time: datetime) -> int:
    """Return a time with a zone in nanoseconds since 1970 (UTC)."""
    return (time - _EPOCH) // timedelta(microseconds=1) * 1000


def utc_moment(text: str) -> datetime:
    """Return the time that a UTC text says, to the second."""
    # The standard library cannot read nanoseconds.
    return datetime.fromisoformat(text[:19] + "+00:00")


def is_utc_text(text: str) -> bool:
    """Return whether a text is a time, since header keywords of others vary."""
    try:
        utc_moment(text)
    except ValueError:
        return False
    return True


def time_option(name: str, text: str | None) -> int | None:
    """Return the time that an option states [ns since 1970 UTC]; ConfigError unless it is a time with a zone."""
    if text is None:
        return None
    try:
        moment = datetime.fromisoformat(text)
    except ValueError as error:
        raise ConfigError(f"{name}: {text!r} is not a time; write it like 2026-05-04T10:00Z") from error
    if moment.tzinfo is None:
        raise ConfigError(f"{name}: {text!r} has no zone; write {text}Z for UTC, or {text}+02:00")
    if not FIRST_YEAR <= moment.year <= LAST_YEAR:
        raise ConfigError(f"{name}: {text!r}: the year must lie between {FIRST_YEAR} and {LAST_YEAR}")
    return unix_ns(moment.astimezone(UTC))
