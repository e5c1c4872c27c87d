"""Files that people write: TOML in, checked records out, every problem of a file named at once."""

import hashlib
import tomllib
from pathlib import Path
from typing import Annotated, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from model.rectangular import rectangular_std
from rigctl.errors import ConfigError


class Section(BaseModel):
    """A table of a file: keys that it does not know are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Uncertain(Section):
    """A number with its standard uncertainty.

    In a file: a plain number, ``{value = 1.2, std = 0.1}``, or ``{range = [1.0, 1.4]}`` where any value between two
    limits is as likely as any other.
    """

    value: float
    std: Annotated[float, Field(ge=0)] = 0.0

    @model_validator(mode="before")
    @classmethod
    def _plain_number(cls, given: object) -> object:
        if isinstance(given, int | float):
            return {"value": given}
        if isinstance(given, dict) and set(given) == {"range"}:
            return _of_range(given["range"])
        return given


def _of_range(limits: object) -> dict[str, float]:
    """Return middle and standard deviation of a rectangular law (JCGM 100:2008, 4.3.7)."""
    if not isinstance(limits, list | tuple) or len(limits) != 2 or not all(isinstance(x, int | float) for x in limits):
        raise ValueError(f"range is {limits!r}; it needs two numbers, for instance [1.0, 1.4]")
    low, high = limits
    if not low < high:
        raise ValueError(f"range is {limits!r}; the first number must be below the second")
    return {"value": 0.5 * (low + high), "std": rectangular_std(low, high)}


def _positive(number: Uncertain) -> Uncertain:
    if number.value <= 0:
        raise ValueError(f"is {number.value:g}, must be above 0")
    return number


def _not_negative(number: Uncertain) -> Uncertain:
    if number.value < 0:
        raise ValueError(f"is {number.value:g}, must not be below 0")
    return number


def _fraction(number: Uncertain) -> Uncertain:
    if not 0 < number.value <= 1:
        raise ValueError(f"is {number.value:g}, must lie in (0, 1]")
    return number


Positive = Annotated[Uncertain, AfterValidator(_positive)]
NotNegative = Annotated[Uncertain, AfterValidator(_not_negative)]
Fraction = Annotated[Uncertain, AfterValidator(_fraction)]

FileModel = TypeVar("FileModel", bound=BaseModel)


def load(path: Path, model: type[FileModel]) -> FileModel:
    """Return the checked content of a TOML file.

    Raises
    ------
    ConfigError
        The file cannot be read, is no TOML, or has problems: all of them, each with its key.
    """
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: is no text file (UTF-8): {error.reason}") from error
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: is no TOML: {error}") from error
    try:
        return model.model_validate(table)
    except ValidationError as error:
        raise ConfigError(describe(path, error)) from error


def describe(path: Path, error: ValidationError) -> str:
    """Return every problem of a file as text, one a line: key, what is wrong, what was found."""
    problems = [_problem(detail) for detail in error.errors(include_url=False)]
    count = "1 problem" if len(problems) == 1 else f"{len(problems)} problems"
    return "\n".join([f"{path}: {count}", *(f"  {line}" for line in problems)])


def _problem(detail: object) -> str:
    if not isinstance(detail, dict):
        return str(detail)
    key = ".".join(str(part) for part in detail["loc"]) or "(whole file)"
    kind, message, found = detail["type"], detail["msg"], detail["input"]
    if kind == "extra_forbidden":
        return f"{key}: is no known key (found {found!r})"
    if kind == "missing":
        return f"{key}: is missing"
    text = message.removeprefix("Value error, ")
    return f"{key}: {text[0].lower() + text[1:]}" + ("" if kind == "value_error" else f" (found {found!r})")


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal: it goes into whatever is made from that file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
