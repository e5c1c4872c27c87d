"""TOML files to checked records, with all problems and suggestions at once."""

import ast
import inspect
import re
import tomllib
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from difflib import get_close_matches
from functools import cache
from itertools import pairwise
from math import inf
from pathlib import Path
from textwrap import dedent
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler, ValidationError, model_validator
from pydantic_core import CoreSchema
from pydantic_core.core_schema import no_info_after_validator_function

from model.moments import rectangular_std
from rigctl.base.durable import MOST_TEXT_BYTES, read_bounded
from rigctl.base.numbers import shown, wild_numbers
from rigctl.errors import ConfigError
from rigctl.version import VERSION

Key = tuple[int | str, ...]

_ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth")
# Demands on a value by pydantic's type of error; names in braces are its details.
_TIME = "a time with its zone, such as 2026-05-04T12:00:00Z or 2026-05-04T14:00:00+02:00"
_DEMANDS = {
    "greater_than": "above {gt:g}",
    "greater_than_equal": "at least {ge:g}",
    "less_than": "below {lt:g}",
    "less_than_equal": "at most {le:g}",
    "multiple_of": "a multiple of {multiple_of:g}",
    "float_type": "a number",
    "float_parsing": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "string_type": "text, in quotes",
    "path_type": "a path, in quotes",
    "list_type": "a list",
    "tuple_type": "a list",
    "too_short": "of {min_length} or more, and has {actual_length}",
    "too_long": "of {max_length} at most, and has {actual_length}",
    "string_too_short": "text of {min_length} characters or more",
    "string_too_long": "text of {max_length} characters at most",
    "missing_argument": "there",
    "timezone_aware": _TIME,
    "datetime_type": _TIME,
    "datetime_parsing": _TIME,
    "datetime_from_date_parsing": _TIME,
    "literal_error": "{expected}",
    "enum": "{expected}",
    "dict_type": "a table",
    "dataclass_type": "a table",
}
# Text for tables that may be written in one line.
_TABLES = {
    "Uncertain": "a number, {{ value = 1.2, std = 0.1 }} or {{ range = [1.0, 1.4] }}",
    "Rectangle": "{{ x = 70, y = 190, width = 150, height = 130 }}, in pixels",
}
# The most keys of a table that are all listed if none is similar.
_FEW = 12
# Kinds of files by tables that only they have; the first match.
_KINDS: tuple[tuple[str, str, frozenset[str]], ...] = (
    ("RigFile", "a rig file", frozenset({"stage", "camera"})),
    ("StudyFile", "a study file", frozenset({"cases"})),
    ("SessionFile", "a session file", frozenset({"take"})),
    ("SceneFile", "a scene file", frozenset({"sensor", "acquisition"})),
    ("MaterialFile", "a material file", frozenset({"n"})),
    ("RegionsFile", "a regions file", frozenset({"regions"})),
)
_IN_MANY = frozenset({"regions", "schema_version"})


def other_kind(table: Mapping[str, Any], model: type[BaseModel]) -> str | None:
    """Return a message if a file is of another kind than expected; None if not."""
    own = next(((words, keys) for name, words, keys in _KINDS if name == model.__name__), None)
    if own is None or (own[1] <= set(table) and not own[1] <= _IN_MANY):
        return None
    found = next((words for _, words, keys in _KINDS if _is_of_kind(table, keys) and words != own[0]), None)
    return None if found is None else f"this is {found}; give {own[0]}"


def _is_of_kind(table: Mapping[str, Any], keys: frozenset[str]) -> bool:
    """Return whether a file has the tables of its kind only; for a kind without own tables, no others."""
    return keys <= set(table) and (not keys <= _IN_MANY or set(table) <= _IN_MANY)


def demands(details: Sequence[Any]) -> str:
    """Return the demand on a value from pydantic's errors: "must be a number, or 'auto'"."""
    wanted = list(dict.fromkeys(_demand(detail) for detail in details))
    if all(text.startswith("must be ") for text in wanted):
        return ", or ".join([wanted[0], *(text.removeprefix("must be ") for text in wanted[1:])])
    return ", or ".join(wanted)


def _demand(detail: Any) -> str:
    kind, facts = detail["type"], detail.get("ctx", {})
    if kind == "json_invalid":
        return f"is no JSON: {facts['error']}"
    if kind in ("model_type", "model_attributes_type"):
        return f"must be {_TABLES.get(facts['class_name'], 'a table')}".replace("{{", "{").replace("}}", "}")
    if kind in _DEMANDS:
        return f"must be {_DEMANDS[kind].format(**facts)}{_alike(detail['input'], facts.get('expected', ''))}"
    text = str(detail["msg"]).removeprefix("Value error, ").removeprefix("Input should be ")
    return text[:1].lower() + text[1:]


def _alike(given: object, expected: str) -> str:
    """Return a similar expected word as a suggestion; empty without one."""
    words = re.findall(r"'([^']*)'", expected)
    close = get_close_matches(str(given), words, n=1, cutoff=0.7) if isinstance(given, str) else []
    return f"; did you mean {close[0]!r}?" if close else ""


def place_text(key: Key, *, is_table: bool = False) -> str:
    """Return the place of a value in words: "second [[take]], exposure_ms" for take.1.exposure_ms."""
    texts: list[str] = []
    names: list[str] = []
    for k, part in enumerate(key):
        is_last = k + 1 == len(key)
        if isinstance(part, int) and names and (_is_array_of_tables(key, k) or (is_last and is_table)):
            texts.append(f"{_ordinal(part)} [[{'.'.join(names)}]]")
            names = []
        elif isinstance(part, int) and names and is_last:
            return ", ".join([*texts, f"{_ordinal(part)} of {'.'.join(names)}"])
        else:
            names.append(str(part))
    return ", ".join([*texts, ".".join(names)] if names else texts)


def _is_array_of_tables(key: Key, k: int) -> bool:
    """Return whether an index counts tables, with a name after it."""
    return k + 1 < len(key) and isinstance(key[k + 1], str)


def _ordinal(k: int) -> str:
    return _ORDINALS[k] if k < len(_ORDINALS) else f"{k + 1}th"


def meant(key: Key, model: type[BaseModel] | None) -> str:
    """Return a suggestion for an unknown key; empty without one."""
    if model is None or not key:
        return ""
    here = sorted({name for one in _models_at(model, key[:-1]) for name in one.model_fields})
    close = get_close_matches(str(key[-1]), here, n=2, cutoff=0.6)
    if close:
        return f"; did you mean {' or '.join(close)}?"
    elsewhere = _elsewhere(str(key[-1]), model)
    if elsewhere:
        return f"; did you mean {elsewhere}?"
    return f"; there are {', '.join(here)}" if 0 < len(here) <= _FEW else ""


def needed(key: Key, model: type[BaseModel] | None) -> str:
    """Return the required keys of a missing table; empty for a plain value."""
    if model is None or not key:
        return ""
    fields = [one.model_fields[str(key[-1])] for one in _models_at(model, key[:-1]) if str(key[-1]) in one.model_fields]
    tables = [inner for field in fields for inner in _models_of(field.annotation)]
    keys = [name for one in tables[:1] for name, field in one.model_fields.items() if field.is_required()]
    return f"; it has {', '.join(keys)}" if keys and tables[0].__name__ not in _TABLES else ""


def _elsewhere(name: str, model: type[BaseModel]) -> str:
    """Return the place of a key of this name in another table of the file."""
    for table, field in model.model_fields.items():
        if any(name in one.model_fields for one in _models_of(field.annotation)):
            return f"{table}.{name}"
    return ""


def _models_at(model: type[BaseModel], place: Sequence[int | str]) -> list[type[BaseModel]]:
    models = [model]
    for part in place:
        if isinstance(part, str):
            fields = [one.model_fields[part] for one in models if part in one.model_fields]
            models = [inner for field in fields for inner in _models_of(field.annotation)]
    return models


def _models_of(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the possible tables of a value, through lists, unions and annotations."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in get_args(annotation):
        yield from _models_of(inner)


def _make_numbers_strict(schema: Any) -> None:
    if isinstance(schema, dict):
        if schema.get("type") in ("float", "int"):
            schema["strict"] = True
        for part in schema.values():
            _make_numbers_strict(part)
    elif isinstance(schema, list | tuple):
        for part in schema:
            _make_numbers_strict(part)


class Section(BaseModel):
    """A table of a file: unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Return the schema of the table with numbers taken strictly: one in quotes is text."""
        schema = handler(source)
        _make_numbers_strict(schema)
        return schema


class Uncertain(Section):
    """A number with its standard uncertainty.

    In a file: a plain number, ``{value = 1.2, std = 0.1}``, or ``{range = [1.0, 1.4]}`` with all values between two
    limits equally likely.
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


@dataclass(frozen=True, kw_only=True)
class Within:
    """Annotation of a number with an uncertainty: the range of its value, in pydantic's terms."""

    gt: float | None = None
    ge: float | None = None
    lt: float | None = None
    le: float | None = None

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return no_info_after_validator_function(self._check, handler(source))

    @property
    def least(self) -> float:
        """Lower end of the range."""
        return max(-inf if end is None else end for end in (self.gt, self.ge))

    @property
    def most(self) -> float:
        """Upper end of the range."""
        return min(inf if end is None else end for end in (self.lt, self.le))

    def _check(self, given: Any) -> Any:
        values = given.value if isinstance(given.value, list) else [given.value]
        for value in values:
            if not self._has(value):
                raise ValueError(f"is {value:g}, must {self._words()}")
        return given

    def _has(self, value: float) -> bool:
        is_above = value > self.least or (value == self.least and self.gt is None)
        return is_above and (value < self.most or (value == self.most and self.lt is None))

    def _words(self) -> str:
        if self.most < inf:
            first, last = "[" if self.gt is None else "(", "]" if self.lt is None else ")"
            return f"lie in {first}{self.least:g}, {self.most:g}{last}"
        return f"{'not be below' if self.gt is None else 'be above'} {self.least:g}"


# Units by the ends of keys, longest first.
_UNITS = {
    "_dn_per_e": "DN/e",
    "_e_per_s": "e/s",
    "_per_frame": "1/frame",
    "_per_s": "1/s",
    "_deg": "deg",
    "_ms": "ms",
    "_us": "us",
    "_s": "s",
    "_min": "min",
    "_h": "h",
    "_um": "um",
    "_mm": "mm",
    "_nm": "nm",
    "_km": "km",
    "_m": "m",
    "_px": "pixels",
    "_db": "dB",
    "_e": "e",
    "_dn": "DN",
    "_mb": "MB",
    "_c": "deg C",
    "_du": "DU",
    "_hpa": "hPa",
    "radiance": "W m-2 sr-1",
}
_EXAMPLE = re.compile(r"(.*?)(?: Example: `(.*)`\.)?", re.DOTALL)


def unit_of(key: str) -> str:
    """Return the unit of a number by the end of its key; empty for a pure number."""
    return next((unit for end, unit in _UNITS.items() if key.endswith(end)), "")


@cache
def key_texts(section: type[BaseModel]) -> dict[str, tuple[str, str]]:
    """Return the meaning of each key of a table and an example of its value, from the text below the field."""
    found: dict[str, tuple[str, str]] = {}
    for model in reversed(section.__mro__):
        if not issubclass(model, BaseModel) or model is BaseModel:
            continue
        (definition,) = ast.parse(dedent(inspect.getsource(model))).body
        for field, text in pairwise(definition.body if isinstance(definition, ast.ClassDef) else []):
            if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant):
                match = _EXAMPLE.fullmatch(str(text.value.value))
                if match is not None:
                    found[ast.unparse(field.target)] = match[1].removesuffix("."), match[2] or ""
    return found


def with_std_apart(given: object, *names: str) -> object:
    """Return a table in which some numbers are plain, with separate keys for their standard uncertainties.

    ``latitude_deg = {value = 43.0, std = 0.1}`` becomes ``latitude_deg = 43.0`` and ``latitude_std_deg = 0.1``. For
    numbers that most of the program uses as exact.
    """
    if not isinstance(given, dict):
        return given
    apart = dict(given)
    for name in names:
        if isinstance(given.get(name), dict):
            number, (quantity, _, unit) = Uncertain.model_validate(given[name]), name.rpartition("_")
            apart |= {name: number.value, f"{quantity}_std_{unit}": number.std}
    return apart


Positive = Annotated[Uncertain, Within(gt=0)]
NotNegative = Annotated[Uncertain, Within(ge=0)]
Fraction = Annotated[Uncertain, Within(gt=0, le=1)]
Share = Annotated[Uncertain, Within(ge=0, le=1)]

FileModel = TypeVar("FileModel", bound=BaseModel)

# Pydantic's entries in a place for each type that it tried.
_KIND_TRIED = re.compile(r"constrained-\w+|float|int|str|bool|(literal|list|tuple|dict)\[.*\]")


def load(path: Path, model: type[FileModel]) -> FileModel:
    """Return the checked content of a TOML file."""
    table = _table(path)
    other = other_kind(table, model)
    if other is not None:
        raise ConfigError(f"{path}: {other}")
    wild = [f"{key}: {problem}" for key, problem in wild_numbers(table)]
    if wild:
        raise ConfigError(_listed(path, wild))
    try:
        return model.model_validate(table)
    except ValidationError as error:
        later = other_schema(table, model)
        raise ConfigError(f"{path}: {later}" if later else describe(path, error, model)) from error


def other_schema(content: object, model: type[object]) -> str | None:
    """Return a message if a file has another schema version than a record reads; None if not."""
    found = content if isinstance(content, dict) else {}
    version, read = found.get("schema_version"), _schema_of(model)
    if not isinstance(version, int) or isinstance(version, bool) or read is None or version == read:
        return None
    by = found.get("created_by")
    known = isinstance(by, str) and re.fullmatch(r"rigctl [\w.+-]{1,40}", by)
    later = version > read
    if known:
        advice = f"{by} wrote it: use that{', or a later one' if later else ''}"
    else:
        advice = f"{'a later' if later else 'an earlier'} rigctl reads it: use that which wrote it"
    return f"schema_version is {version}, and rigctl {VERSION} reads {read}; {advice}"


def _schema_of(model: type[object]) -> int | None:
    kind = get_type_hints(model, include_extras=True).get("schema_version")
    if get_origin(kind) is Literal:
        return int(max(get_args(kind)))
    limits = (one for field in getattr(kind, "__metadata__", ()) for one in getattr(field, "metadata", ()))
    newest: int | None = next((limit.le for limit in limits if hasattr(limit, "le")), None)
    return newest


def has_any_key(path: Path, *keys: str) -> bool:
    """Return whether a TOML file has any of some keys, which identify its kind."""
    return not _table(path).keys().isdisjoint(keys)


def _table(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(read_bounded(path, MOST_TEXT_BYTES).decode("utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: is not a text file (UTF-8): {error.reason}") from error
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: {_toml_problem(path, error)}") from error
    except (RecursionError, ValueError) as error:  # brackets within brackets, a number of thousands of digits
        raise ConfigError(f"{path}: is not valid TOML: {_first_line(error)}") from error


# Error of the TOML reader, and the remedy.
_TOML_ADVICE = (
    ("end of a table declaration", "write the name of a table in brackets, such as [stage]"),
    ("end of an array declaration", "write the name of a list of tables in double brackets, such as [[take]]"),
    ("Expected '=' after", "write = and the value after a key"),
    ("Unclosed array", "a list is not closed by a bracket"),
    ("Unclosed inline table", "a table between braces is not closed"),
    ("Illegal character", "end text with the quote that begins it, on the same line"),
    ("Cannot overwrite", "a key occurs twice in its table"),
    ("Cannot declare", "a table occurs twice; a list of tables has double brackets, such as [[take]]"),
    ("Expected newline", "there is something after the value; write text in quotes, and begin a comment with #"),
    ("Invalid statement", "a line is KEY = VALUE, [TABLE], or a comment that begins with #"),
)


def _toml_problem(path: Path, error: tomllib.TOMLDecodeError) -> str:
    """Return where a file is not valid TOML, and the remedy."""
    said = str(error)
    place = re.search(r"at line (\d+)", said)
    line = read_bounded(path, MOST_TEXT_BYTES).decode("utf-8").splitlines()[int(place[1]) - 1].strip() if place else ""
    advice = next((advice for words, advice in _TOML_ADVICE if words in said), said)
    value = line.partition("=")[2].strip()
    if re.match(r"-?\d+,\d", value):
        advice = "write numbers with a point, such as 2.5"
    elif "Invalid value" in said:
        is_word = value.lower() in ("true", "false", "yes", "no", "on", "off")
        advice = "write true and false in small letters" if is_word else f'write text in quotes: "{value}"'
        advice = advice if value else "the value is missing"
    where = f"line {place[1]} is not valid TOML: {shown(line)}" if place else "is no TOML at its end"
    return f"{where}: {advice}"


def describe(path: Path, error: ValidationError, model: type[BaseModel] | None = None) -> str:
    """Return every problem of a file as text, one a line: key, what is wrong, what was found, what was meant."""
    problems = _problems(error.errors(include_url=False), model, dotted=path.suffix == ".json")
    return _listed(path, problems)


def _first_line(error: Exception) -> str:
    return str(error).partition("\n")[0]


def _listed(path: Path, problems: Sequence[str]) -> str:
    count = "1 problem" if len(problems) == 1 else f"{len(problems)} problems"
    return "\n".join([f"{path}: {count}", *(f"  {line}" for line in problems)])


def _problems(details: Sequence[Any], model: type[BaseModel] | None, *, dotted: bool = False) -> list[str]:
    """Return a line for each key that is wrong; what a value of several allowed kinds is not, in one line."""
    by_key: dict[Key, list[Any]] = defaultdict(list)
    for detail in details:
        by_key[_key(detail["loc"])].append(detail)
    # Of a list, its items say more than that it is no number.
    inner = {key[:size] for key in by_key for size in range(len(key))}
    told = {key: found for key, found in by_key.items() if key not in inner or not _is_of_items(found)}
    # Tables are counted as in TOML; JSON, which programs wrote, has its keys with dots.
    texts = {key: ".".join(map(str, key)) if dotted else place_text(key, is_table=_is_table(told[key])) for key in told}
    return [_problem(key, texts[key], found, model) for key, found in told.items()]


def _is_of_items(found: Sequence[Any]) -> bool:
    """Return whether a list is only wrong since its items are: several kinds were tried, or all were left out."""
    return len(found) > 1 or found[0]["type"] == "too_short"


def _key(place: Sequence[int | str]) -> Key:
    """Return the place of a value in its file, without the kinds of value that were tried there."""
    return tuple(part for part in place if not (isinstance(part, str) and _KIND_TRIED.fullmatch(part)))


def _problem(key: Key, place: str, details: Sequence[Any], model: type[BaseModel] | None) -> str:
    name, first = place or "(whole file)", details[0]
    if first["type"] == "extra_forbidden":
        return f"{name}: is no known key{_found(first['input'])}{meant(key, model)}"
    if first["type"] == "missing":
        return f"{name}: is missing{needed(key, model)}"
    is_said = first["type"] in ("value_error", "json_invalid")
    found = "" if is_said else _found(first["input"])
    text, question, alike = demands(details).partition("; did you mean ")
    return f"{name}: {text}{found}{question}{alike}"


def _is_table(details: Sequence[Any]) -> bool:
    return isinstance(details[0]["input"], dict)


def _found(given: object) -> str:
    """Return what stands in the file; a whole table is not repeated."""
    is_table = isinstance(given, dict) or (isinstance(given, list) and any(isinstance(one, dict) for one in given))
    if isinstance(given, date | bool):
        return f" (found {given.isoformat() if isinstance(given, date) else str(given).lower()})"
    return " (found a table)" if is_table else f" (found {shown(given)})"
