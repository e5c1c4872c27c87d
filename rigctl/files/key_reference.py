"""Every key of the files that people write, as a page: made from the models that check them.

``python -m rigctl.files.key_reference > docs/file-keys.md`` writes the page; a test holds it against the models.
"""

import sys
from collections.abc import Iterator
from types import NoneType
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from rigctl.files.config import Uncertain
from rigctl.files.material_file import MaterialFile
from rigctl.files.regions import RegionsFile
from rigctl.files.rig_file import RigFile
from rigctl.files.scene_file import SceneFile
from rigctl.files.session_file import SessionFile
from rigctl.files.surface_fit_file import SurfaceFitFile

_FILES: tuple[tuple[str, type[BaseModel]], ...] = (
    ("Rig file", RigFile),
    ("Session file", SessionFile),
    ("Scene file", SceneFile),
    ("Regions file", RegionsFile),
    ("Material file", MaterialFile),
    ("Fit file", SurfaceFitFile),
)
_HEAD = """# Keys of the files that one writes

Made from the models that check the files (`python -m rigctl.files.key_reference`). A number in the column "may be
uncertain" can be `1.2`, `{ value = 1.2, std = 0.1 }` or `{ range = [1.0, 1.4] }`. `[[name]]` is a table that may come
several times. Units are in the names; what the numbers of a scene mean is in [parameters](parameters.md).
"""


def reference_page() -> str:
    """Return the page: a table of keys for each file."""
    parts = [_HEAD]
    for title, model in _FILES:
        parts.append(f"\n## {title}\n\n| key | type | allowed | default | may be uncertain |\n|---|---|---|---|---|\n")
        parts += [f"| `{key}` | {' | '.join(cells)} |\n" for key, *cells in _rows(model, "")]
    return "".join(parts)


def _rows(model: type[BaseModel], place: str) -> Iterator[tuple[str, ...]]:
    for name, field in model.model_fields.items():
        key = place + name
        inner = [one for one in _models(field.annotation) if one is not Uncertain]
        is_list = "list" in _kind(field.annotation)
        if not inner:
            uncertain = "yes" if any(one is Uncertain for one in _models(field.annotation)) else ""
            yield key, _kind(field.annotation), _limits(field), _default(field), uncertain
            continue
        shown = f"[[{key}]]" if is_list else f"[{key}]"
        yield shown, "tables" if is_list else "table", _limits(field), _default(field), ""
        for one in inner:
            yield from _rows(one, f"{key}.")


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in get_args(annotation):
        yield from _models(inner)


def _kind(annotation: Any) -> str:
    """Return the type of a value in words."""
    if get_origin(annotation) is Literal:
        return " or ".join(f"`{word}`" for word in get_args(annotation))
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
    signs = {"ge": "from", "gt": "above", "le": "to", "lt": "below", "min_length": "at least", "pattern": "pattern"}
    found = [(name, getattr(one, name)) for one in field.metadata for name in signs if hasattr(one, name)]
    return ", ".join(f"{signs[name]} {limit:g}" for name, limit in found if isinstance(limit, int | float))


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    if field.default is None or field.default is PydanticUndefined or isinstance(field.default, BaseModel):
        value = getattr(field.default, "value", None)
        return f"`{value:g}`" if isinstance(value, int | float) else ""
    return f"`{field.default}`"


if __name__ == "__main__":
    sys.stdout.write(reference_page())
