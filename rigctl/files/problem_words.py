"""Words for what is wrong with a file that people write: which table, which key was meant, which file this is."""

from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from typing import Any, get_args

from pydantic import BaseModel

Key = tuple[int | str, ...]

_ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth")
# A table of few keys is told whole, where none of them is alike.
_FEW = 12
# Files by the tables that only they have; the first that fits.
_KINDS: tuple[tuple[str, str, frozenset[str]], ...] = (
    ("RigFile", "a rig file", frozenset({"stage", "camera"})),
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


def place_text(key: Key) -> str:
    """Return the place of a value as people count: "second [[take]], exposure_ms" for take.1.exposure_ms."""
    texts: list[str] = []
    names: list[str] = []
    for k, part in enumerate(key):
        if isinstance(part, int) and names and _is_array_of_tables(key, k):
            texts.append(f"{_ordinal(part)} [[{'.'.join(names)}]]")
            names = []
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
