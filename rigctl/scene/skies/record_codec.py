"""Records of numbers and arrays as bytes and back: for results that are kept, never for what people write."""

import hashlib
import io
import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

_CONTENT = "content"


class NotStorableError(Exception):
    """A record holds something that this codec does not know."""


def fingerprint(value: object) -> str:
    """Return a hash of a record: the same for records of the same numbers, put together the same way.

    Raises
    ------
    NotStorableError
        It holds something that this codec does not know.
    """
    writer = _Writer()
    root = writer.tree(value)
    digest = hashlib.sha256(json.dumps([root, writer.records]).encode())
    for array in writer.arrays:
        digest.update(f"{array.dtype.str}{array.shape}".encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def encode(value: object) -> bytes:
    """Return a record as bytes; what is one object in it is written once.

    Raises
    ------
    NotStorableError
        It holds something that cannot be kept.
    """
    writer = _Writer()
    content = json.dumps({"root": writer.tree(value), "records": writer.records}).encode()
    buffer = io.BytesIO()
    arrays = {f"a{k}": array for k, array in enumerate(writer.arrays)}
    np.savez(buffer, allow_pickle=False, **{_CONTENT: np.frombuffer(content, dtype=np.uint8)}, **arrays)
    return buffer.getvalue()


def decode(data: bytes, kinds: Mapping[str, type]) -> Any:
    """Return the record that the bytes hold.

    Parameters
    ----------
    data : bytes
        Of `encode`.
    kinds : mapping
        Name to class, for every class of record that may occur.

    Raises
    ------
    KeyError, IndexError, TypeError, ValueError, OSError
        The bytes hold no such record.
    """
    with np.load(io.BytesIO(data), allow_pickle=False) as archive:
        content = json.loads(archive[_CONTENT].tobytes())
        arrays = {name: archive[name] for name in archive.files if name != _CONTENT}
    made: list[Any] = []
    for kind, parts in content["records"]:
        made.append(kinds[kind](**{name: _value(part, made, arrays) for name, part in parts.items()}))
    return _value(content["root"], made, arrays)


class _Writer:
    """Walks a record; a record or an array that is met again is referred to."""

    def __init__(self) -> None:
        self.records: list[Any] = []
        self.arrays: list[NDArray[Any]] = []
        self._known: dict[int, Any] = {}
        self._alive: list[object] = []

    def tree(self, value: object) -> Any:
        """Return a value as JSON holds it."""
        if isinstance(value, Enum):
            return self.tree(value.value)
        if isinstance(value, np.generic):
            return self.tree(value.item())
        if isinstance(value, bool | int | float | str) or value is None:
            return value
        if isinstance(value, tuple | list):
            return {"tuple": [self.tree(item) for item in value]}
        if isinstance(value, dict):
            return {"mapping": {str(name): self.tree(item) for name, item in sorted(value.items())}}
        if isinstance(value, range):
            return {"range": [value.start, value.stop, value.step]}
        return self._referred(value)

    def _referred(self, value: object) -> Any:
        if id(value) in self._known:
            return self._known[id(value)]
        if isinstance(value, np.ndarray):
            reference: dict[str, Any] = {"array": f"a{len(self.arrays)}"}
            self.arrays.append(value)
        elif is_dataclass(value) and not isinstance(value, type):
            parts = {field.name: self.tree(getattr(value, field.name)) for field in fields(value) if field.init}
            reference = {"record": len(self.records)}
            self.records.append([type(value).__name__, parts])
        else:
            raise NotStorableError(type(value).__name__)
        self._alive.append(value)  # an id is good as long as its object lives
        self._known[id(value)] = reference
        return reference


def _value(tree: Any, made: list[Any], arrays: Mapping[str, NDArray[Any]]) -> Any:
    if not isinstance(tree, dict):
        return tree
    ((kind, content),) = tree.items()
    if kind == "tuple":
        return tuple(_value(item, made, arrays) for item in content)
    if kind == "mapping":
        return {name: _value(item, made, arrays) for name, item in content.items()}
    if kind == "range":
        return range(*content)
    return arrays[content] if kind == "array" else made[content]
