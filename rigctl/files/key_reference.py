"""Every key of the files that people write, as a page: made from the models that check them.

``python -m rigctl.files.key_reference > docs/file-keys.md`` writes the page; a test holds it against the models.
"""

import ast
import inspect
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise
from textwrap import dedent
from types import NoneType
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from rigctl.files.materials import MaterialFile, SurfaceFitFile
from rigctl.files.regions import RegionsFile
from rigctl.files.rig_file import RigFile
from rigctl.files.scene_file import SceneFile
from rigctl.files.session_file import SessionFile
from rigctl.files.study_file import StudyFile
from rigctl.files.toml import Allowed, Uncertain

_FILES: tuple[tuple[str, type[BaseModel]], ...] = (
    ("Rig file", RigFile),
    ("Session file", SessionFile),
    ("Scene file", SceneFile),
    ("Regions file", RegionsFile),
    ("Material file", MaterialFile),
    ("Fit file", SurfaceFitFile),
    ("Study file", StudyFile),
)
_HEAD = """# Keys of the files that one writes

Made from the models that check the files (`python -m rigctl.files.key_reference`). A number marked "uncertain" can be
`1.2`, `{ value = 1.2, std = 0.1 }` or `{ range = [1.0, 1.4] }`. `[[name]]` is a table that may come several times; its
keys follow it. What the numbers of a scene are called in sweeps and reports is in [parameters](parameters.md).
"""
_COLUMNS = "\n| key | is | example | type | unit | allowed | default |\n|---|---|---|---|---|---|---|\n"
# Units by the ends of names, the longer before the shorter.
_UNITS = {
    "_dn_per_e": "DN/e",
    "_e_per_s": "e/s",
    "_per_frame": "1/frame",
    "_per_s": "1/s",
    "_std_deg": "deg",
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


@dataclass(frozen=True, kw_only=True)
class Key:
    """A key of a file: its row of the page."""

    shown: str  #: With the tables that it stands in; of a table in brackets.
    field: FieldInfo  #: Of the model that checks it.
    is_table: bool  #: Its keys follow it.
    meaning: str  #: One line; empty where the model says nothing of it.
    example: str  #: A value as TOML has it; a table has none, as its keys have them.

    @property
    def cells(self) -> tuple[str, ...]:
        """The cells of its row."""
        uncertain = ", uncertain" if not self.is_table and Uncertain in _models(self.field.annotation) else ""
        many = "tables" if self.shown.startswith("[[") else "table"
        kind = many if self.is_table else _kind(self.field.annotation) + uncertain
        unit = next((unit for end, unit in _UNITS.items() if self.shown.endswith(end)), "")
        example = f"`{self.example}`" if self.example else ""
        return (f"`{self.shown}`", self.meaning, example, kind, unit, _limits(self.field), _default(self.field))


def reference_page() -> str:
    """Return the page: a table of keys for each file."""
    parts = [_HEAD]
    for title, keys in file_keys():
        parts.append(f"\n## {title}\n{_COLUMNS}")
        parts += [f"| {' | '.join(key.cells)} |\n" for key in keys]
    return "".join(parts)


def file_keys() -> Iterator[tuple[str, tuple[Key, ...]]]:
    """Yield each kind of file with all its keys."""
    for title, model in _FILES:
        yield title, tuple(_keys(model, ""))


def _keys(model: type[BaseModel], place: str) -> Iterator[Key]:
    told = _told(model)
    for name, field in model.model_fields.items():
        key = place + (field.alias or name)
        meaning, example = told.get(name, ("", ""))
        inner = [one for one in _models(field.annotation) if one is not Uncertain]
        if not inner:
            yield Key(shown=key, field=field, is_table=False, meaning=meaning, example=example)
            continue
        shown = f"[[{key}]]" if "list" in _kind(field.annotation) else f"[{key}]"
        yield Key(shown=shown, field=field, is_table=True, meaning=meaning, example=example)
        for one in dict.fromkeys(inner):
            yield from _keys(one, f"{key}.")


def _told(model: type[BaseModel]) -> dict[str, tuple[str, str]]:
    """Return meaning and example of each key of a model: the texts under its fields."""
    found: dict[str, tuple[str, str]] = {}
    for one in reversed(model.__mro__):
        if not issubclass(one, BaseModel) or one is BaseModel:
            continue
        body = ast.parse(dedent(inspect.getsource(one))).body[0]
        statements = body.body if isinstance(body, ast.ClassDef) else []
        for field, text in pairwise(statements):
            if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant):
                match = _EXAMPLE.fullmatch(str(text.value.value))
                if match is not None:
                    found[ast.unparse(field.target)] = match[1].removesuffix("."), match[2] or ""
    return found


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in get_args(annotation):
        yield from _models(inner)


def _kind(annotation: Any) -> str:
    """Return the type of a value in words."""
    if get_origin(annotation) is Literal:
        return " or ".join(f"`{word}`" for word in get_args(annotation))
    if isinstance(annotation, type) and issubclass(annotation, StrEnum):
        return " or ".join(f"`{word}`" for word in annotation)
    inner = [one for one in get_args(annotation) if one is not NoneType and one is not Ellipsis]
    origin = get_origin(annotation)
    if origin in (list, tuple):
        return f"list of {_kind(inner[0])}"
    if origin is dict:
        return "table"
    if hasattr(annotation, "__metadata__"):
        return _kind(inner[0])
    if inner:
        return " or ".join(dict.fromkeys(_kind(one) for one in inner))
    names = {float: "number", int: "whole number", str: "text", bool: "true or false", Uncertain: "number"}
    name = getattr(annotation, "__name__", str(annotation)).lower()
    return names.get(annotation, "time with its zone" if name in ("awaredatetime", "datetime") else name)


def _limits(field: FieldInfo) -> str:
    """Return the range in words; of a list, how many it needs and the range of each."""
    signs = {"ge": "from", "gt": "above", "le": "to", "lt": "below", "min_length": "at least"}
    words: list[str] = []
    for one in (*field.metadata, *_marks(field.annotation)):
        if isinstance(one, Allowed):
            words.append(one.words)
        found = [(sign, getattr(one, name, None)) for name, sign in signs.items()]
        words += [f"{sign} {limit:.12g}" for sign, limit in found if isinstance(limit, int | float)]
    return ", ".join(dict.fromkeys(words))


def _marks(annotation: Any) -> Iterator[Any]:
    """Yield what is annotated of the values within, of a list or beside none."""
    for one in getattr(annotation, "__metadata__", ()):
        yield from one.metadata if isinstance(one, FieldInfo) else (one,)
    if not isinstance(annotation, type) and get_origin(annotation) is not Literal:
        for inner in get_args(annotation):
            yield from _marks(inner)


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    if field.default is None or field.default is PydanticUndefined or isinstance(field.default, BaseModel):
        value = getattr(field.default, "value", None)
        return f"`{value:g}`" if isinstance(value, int | float) else ""
    if isinstance(field.default, bool):
        return f"`{str(field.default).lower()}`"
    if isinstance(field.default, tuple):
        return f"`{list(field.default)}`".replace("'", '"')
    return f"`{field.default}`"


if __name__ == "__main__":
    sys.stdout.write(reference_page())
