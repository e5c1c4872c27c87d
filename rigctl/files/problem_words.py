"""Words for what is wrong with a file that people write: which table, which key was meant, which file this is."""

import re
from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from typing import Any, get_args

from pydantic import BaseModel

Key = tuple[int | str, ...]

_ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth")
# What a value must be, by what pydantic calls the fault; names in braces are its own facts.
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
# Of tables that may be written in one line, what one writes.
_TABLES = {
    "Uncertain": "a number, {{ value = 1.2, std = 0.1 }} or {{ range = [1.0, 1.4] }}",
    "Rectangle": "{{ x = 70, y = 190, width = 150, height = 130 }}, in pixels",
}
# A table of few keys is told whole, where none of them is alike.
_FEW = 12
# Files by the tables that only they have; the first that fits.
_KINDS: tuple[tuple[str, str, frozenset[str]], ...] = (
    ("RigFile", "a rig file", frozenset({"stage", "camera"})),
    ("SurfaceFitFile", "a fit file", frozenset({"observation"})),
    ("StudyFile", "a study file", frozenset({"cases"})),
    ("SessionFile", "a session file", frozenset({"take"})),
    ("SceneFile", "a scene file", frozenset({"sensor", "acquisition"})),
    ("MaterialFile", "a material file", frozenset({"n"})),
    ("RegionsFile", "a regions file", frozenset({"regions"})),
)
_IN_MANY = frozenset({"regions", "schema_version"})


def other_kind(table: Mapping[str, Any], model: type[BaseModel]) -> str | None:
    """Return in words that a file is of another kind than the one that is wanted; None where it may be the one."""
    own = next(((words, keys) for name, words, keys in _KINDS if name == model.__name__), None)
    if own is None or (own[1] <= set(table) and not own[1] <= _IN_MANY):
        return None
    found = next((words for _, words, keys in _KINDS if _is_of_kind(table, keys) and words != own[0]), None)
    return None if found is None else f"this is {found}, {own[0]} is wanted"


def _is_of_kind(table: Mapping[str, Any], keys: frozenset[str]) -> bool:
    """Return whether a file has what only its kind has; of a kind that has nothing of its own, nothing else."""
    return keys <= set(table) and (not keys <= _IN_MANY or set(table) <= _IN_MANY)


def demands(details: Sequence[Any]) -> str:
    """Return in words what a value must be, from all that pydantic says of it: "must be a number, or 'auto'".

    Parameters
    ----------
    details : sequence of ErrorDetails
        One for each kind that the value was held against.
    """
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
    """Return which of the words that are expected was meant; empty where none is alike."""
    words = re.findall(r"'([^']*)'", expected)
    close = get_close_matches(str(given), words, n=1, cutoff=0.7) if isinstance(given, str) else []
    return f"; did you mean {close[0]!r}?" if close else ""


def place_text(key: Key, *, is_table: bool = False) -> str:
    """Return the place of a value as people count: "second [[take]], exposure_ms" for take.1.exposure_ms.

    Parameters
    ----------
    key : tuple of int or str
        Names, and places within lists, from 0.
    is_table : bool
        Whether a table stands there: then a number at the end counts tables and not values.
    """
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
    """Return whether an index counts tables: a name stands after it."""
    return k + 1 < len(key) and isinstance(key[k + 1], str)


def _ordinal(k: int) -> str:
    return _ORDINALS[k] if k < len(_ORDINALS) else f"{k + 1}th"


def meant(key: Key, model: type[BaseModel] | None) -> str:
    """Return which key may have been meant, for a key that is not known; empty where nothing can be said."""
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
    """Return what a table that is missing has to have, so that one reads it all at once; empty for a plain value."""
    if model is None or not key:
        return ""
    fields = [one.model_fields[str(key[-1])] for one in _models_at(model, key[:-1]) if str(key[-1]) in one.model_fields]
    tables = [inner for field in fields for inner in _models_of(field.annotation)]
    keys = [name for one in tables[:1] for name, field in one.model_fields.items() if field.is_required()]
    return f"; it has {', '.join(keys)}" if keys and tables[0].__name__ not in _TABLES else ""


def _elsewhere(name: str, model: type[BaseModel]) -> str:
    """Return the place of a key of this very name in a table of the file."""
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
    """Yield the tables that a value may be, through lists, unions and what is annotated."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in get_args(annotation):
        yield from _models_of(inner)
