"""Values of calibration files: each finite and inside its range, or the file is refused with its key."""

from dataclasses import dataclass
from typing import Annotated, Generic, TypeVar

from pydantic import AfterValidator, Field

from rigctl.numbers.utc_time import is_utc_text

# No quantity of a camera or a stage is larger, in any unit that a file has it in, and the square of it is finite.
_LARGEST = 1e12

Bounded = Annotated[float, Field(ge=-_LARGEST, le=_LARGEST)]
NotNegative = Annotated[float, Field(ge=0, le=_LARGEST)]
Positive = Annotated[float, Field(gt=0, le=_LARGEST)]

_Number = TypeVar("_Number", bound=float)
_Item = TypeVar("_Item")


@dataclass(frozen=True, kw_only=True)
class Measured(Generic[_Number]):
    """A number with the standard deviation of its error, in the unit that its name ends in."""

    value: _Number
    std_error: NotNegative


@dataclass(frozen=True, kw_only=True)
class MeasuredOverFrames(Generic[_Number]):
    """As `Measured`, and from how many frames it was made."""

    value: _Number
    std_error: NotNegative
    n: Annotated[int, Field(ge=1)]


def at_least(count: int) -> AfterValidator:
    """Return what refuses a list that has fewer items, once all that it has are right."""

    def checked(items: tuple[_Item, ...]) -> tuple[_Item, ...]:
        if len(items) < count:
            raise ValueError(f"has {len(items)} items, must have at least {count}")
        return items

    return AfterValidator(checked)


def _checked_utc(text: str) -> str:
    if not is_utc_text(text):
        raise ValueError(f"is {text!r}, must be a time such as 2026-05-04T10:00:00Z")
    return text


UtcText = Annotated[str, AfterValidator(_checked_utc)]
