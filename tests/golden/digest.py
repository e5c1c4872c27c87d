"""What is kept of a value or a file: numbers to 12 digits, long series as a few numbers, texts without what changes."""

import csv
import io
import json
import math
import re
import tomllib
import zipfile
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from astropy.io import fits

_DIGITS = 12
# Series that are longer are kept as n, mean, rms, and some samples; tables with more rows column by column.
_LONGEST_SERIES = 8
_LONGEST_TABLE = 6
_MOST_TEXTS = 12
# By the name of a key: times of the clock and of the machine, versions, hashes, places on this machine or in the code.
_MASKED_KEY = re.compile(
    r"(^|[_/])(utc|monotonic_ns|sha256|checksum|versions?|hostname|host|host_folder|machine|platform|python|pid|user|by"
    r"|created_by|program|expected_s|elapsed_s|wall_s|cpu_s|stage_s|time_s(\.\w+)?|share_of_estimates|seconds(_of_\w+)?"
    r"|settle_s|frame_s|cost_s|disk_free_mb|next|place)$"
    r"|^(DATE-.*|MONONS|SWVER|DATASUM|CHECKSUM|SETTLE)$"
)
_MASKED_TEXT = (
    (re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d+)?)?( ?(Z|UTC|[+-]\d\d:?\d\d))?"), "<time>"),
    (re.compile(r"\b\d\d:\d\d:\d\d(\.\d+)?Z?\b"), "<time>"),
    (re.compile(r"(sha256:)?\b[0-9a-f]{16,}\b"), "<hash>"),
    (re.compile(r"\brigctl \d+\.\d+[\w.+]*"), "rigctl <version>"),
)


def digest_value(value: Any, folder: Path, key: str = "") -> Any:
    """Return a JSON value as it is stored."""
    if _MASKED_KEY.search(key) and value is not None:
        return "<masked>"
    if key == "live":
        return shape(value)
    if isinstance(value, dict):
        if key == "error" and {"code", "kind", "message"} <= value.keys():  # its words are for people
            value = {name: one for name, one in value.items() if name not in ("message", "next")}
        return {mask(str(k), folder): digest_value(v, folder, str(k)) for k, v in value.items()}
    if isinstance(value, list | tuple):
        numbers = _numbers(value)
        if numbers is not None and numbers.size > _LONGEST_SERIES:
            return digest_array(numbers)
        if len(value) > _LONGEST_TABLE and all(isinstance(row, dict) for row in value):
            return digest_table([flat(row) for row in value], folder)
        return [digest_value(one, folder) for one in value]
    if isinstance(value, str):
        return mask(value, folder)
    if isinstance(value, np.generic):
        value = value.item()
    return rounded(value) if isinstance(value, float) else value


def shape(value: Any) -> Any:
    """Return the keys of a value only: which cycle a session looked at last depends on how busy this machine is."""
    return {name: shape(one) for name, one in value.items()} if isinstance(value, dict) else "<value>"


def digest_table(rows: list[dict[str, Any]], folder: Path) -> dict[str, Any]:
    """Return a table column by column: numbers as a series, texts as the different ones with their counts."""
    columns: dict[str, Any] = {"rows": len(rows)}
    for name in dict.fromkeys(chain.from_iterable(rows)):
        if _MASKED_KEY.search(name) or name == "id":
            continue
        values = [row[name] for row in rows if row.get(name) is not None and row[name] != ""]
        numbers = [v for v in values if isinstance(v, int | float) and not isinstance(v, bool)]
        texts = [mask(str(v), folder) for v in values if not isinstance(v, int | float) or isinstance(v, bool)]
        column: dict[str, Any] = digest_array(np.array(numbers, dtype=float)) if numbers else {}
        kinds = sorted(set(texts))
        if kinds:
            column["texts"] = (
                {kind: texts.count(kind) for kind in kinds}
                if len(kinds) <= _MOST_TEXTS
                else [kinds[0], kinds[-1], len(kinds)]
            )
        columns[mask(name, folder)] = column
    return columns


def digest_array(array: np.ndarray) -> dict[str, Any]:
    """Return size, mean, rms and samples of an array; of what is not finite the share."""
    array = np.asarray(array, dtype=float)
    finite = array[np.isfinite(array)]
    found: dict[str, Any] = {"n": list(array.shape) if array.ndim > 1 else array.size}
    if finite.size < array.size:
        found["not_finite"] = array.size - finite.size
    if finite.size == 0:
        return found
    scale = float(np.max(np.abs(finite))) or 1.0
    # A sum of squares would lose small numbers and overflow with large ones.
    found["mean"] = rounded(math.fsum(finite.ravel().tolist()) / finite.size)
    found["rms"] = rounded(scale * math.sqrt(math.fsum(((finite / scale) ** 2).ravel().tolist()) / finite.size))
    places = sorted({0, finite.size // 3, 2 * finite.size // 3, finite.size - 1})
    found["samples"] = [rounded(float(finite.flat[i])) for i in places]
    return found


def digest_file(path: Path, folder: Path) -> Any:
    """Return what is kept of a file: of pictures, pages, copies and parts of results only that they are there."""
    read = _READERS.get(path.suffix.lower())
    return "<file>" if read is None or path.parent.name in ("inputs", "parts") else read(path, folder)


def _digest_json(path: Path, folder: Path) -> Any:
    try:
        return digest_value(json.loads(path.read_text()), folder, "live" if path.name == "status.json" else "")
    except ValueError:
        return "<no JSON>"


def _digest_jsonl(path: Path, folder: Path) -> Any:
    rows = [flat(json.loads(line)) for line in path.read_text().splitlines() if line.strip()]
    # Whether frames wait for the disk depends on how busy this machine is.
    return digest_table([row for row in rows if row.get("facts.interlock") != "queue"], folder)


def _digest_toml(path: Path, folder: Path) -> Any:
    return digest_value(json.loads(json.dumps(tomllib.loads(path.read_text()), default=str)), folder)


def _digest_parquet(path: Path, folder: Path) -> Any:
    from pyarrow import parquet

    return digest_table([flat(row) for row in parquet.read_table(path).to_pylist()], folder)


def _digest_arrays(path: Path, folder: Path) -> Any:
    loaded = np.load(path, allow_pickle=False)
    arrays = {name: loaded[name] for name in loaded.files} if path.suffix == ".npz" else {"array": loaded}
    return {name: _digest_npy(array, folder) for name, array in arrays.items()}


def _digest_npy(array: np.ndarray, folder: Path) -> Any:
    is_bytes = array.dtype == np.uint8 and array.ndim == 1
    text = array.tobytes().decode("utf-8", "replace") if is_bytes else str(array.item()) if array.ndim == 0 else ""
    try:
        return digest_value(json.loads(text), folder)
    except ValueError:
        return digest_array(array) if array.dtype.kind in "biuf" else digest_value(array.tolist(), folder)


def _digest_csv(path: Path, folder: Path) -> Any:
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    rows = [{k or "": _number(v) for k, v in row.items()} for row in csv.DictReader(io.StringIO("\n".join(lines)))]
    return digest_table(rows, folder)


def _digest_fits(path: Path, folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = {}
    with fits.open(path) as parts:
        for number, part in enumerate(parts):
            if path.parent.name == "frames":  # their facts stand in the manifest
                found[f"header{number}"] = " ".join(part.header)
            else:
                header = {k: v for k, v in part.header.items() if k not in ("COMMENT", "HISTORY", "")}
                found[f"header{number}"] = digest_value(header, folder)
            if part.data is not None and part.data.dtype.names is None:
                found[f"data{number}"] = digest_array(part.data)
    return found


def _digest_hdf5(path: Path, folder: Path) -> dict[str, Any]:
    import h5py

    found: dict[str, Any] = {}

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and not _MASKED_KEY.search(name):
            is_numeric = item.dtype.kind in "iuf"
            found[name] = digest_array(item[()]) if is_numeric else {"shape": list(item.shape)}

    with h5py.File(path) as file:
        file.visititems(visit)
    return found


def mask(text: str, folder: Path) -> str:
    """Return a text without times, hashes, versions and places on this machine."""
    for place in (str(folder.resolve()), str(folder)):
        text = text.replace(f"{place}/", "").replace(place, "<folder>")
    text = re.sub(r"(/tmp|/var/tmp|/home|/work)/[^\s'\",;)]*", "<path>", text)
    for pattern, name in _MASKED_TEXT:
        text = pattern.sub(name, text)
    return text


def rounded(number: float) -> float | str:
    """Return a number to the digits that are kept; what is not finite as text."""
    number = float(number)
    return float(f"{number:.{_DIGITS}g}") if math.isfinite(number) else str(number)


def _numbers(values: Any) -> np.ndarray | None:
    """Return an array of nested lists of numbers; None of anything else."""
    if not values or not isinstance(values[0], int | float | list | type(None)) or isinstance(values[0], bool):
        return None
    try:
        array = np.array(values)
        return np.array(values, dtype=float) if array.dtype.kind in "iuf" or _has_gaps(array) else None
    except ValueError:
        return None


def _has_gaps(array: np.ndarray) -> bool:
    """Return whether an array holds numbers and None only."""
    return array.dtype.kind == "O" and all(
        one is None or (isinstance(one, int | float) and not isinstance(one, bool)) for one in array.flat
    )


def _number(text: str | None) -> Any:
    try:
        return float(text or "")
    except ValueError:
        return text


def flat(row: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return a record with its inner records' fields in it; lists as numbered fields."""
    found: dict[str, Any] = {}
    for key, value in row.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict):
            found |= flat(value, f"{name}.")
        elif isinstance(value, list):
            found |= flat({str(i): v for i, v in enumerate(value[:4])} | {"n": len(value)}, f"{name}.")
        else:
            found[name] = value
    return found


def _digest_zip(path: Path, folder: Path) -> Any:
    with zipfile.ZipFile(path) as packed:
        return {"names": sorted(packed.namelist())}


_READERS = {
    ".json": _digest_json,
    ".jsonl": _digest_jsonl,
    ".csv": _digest_csv,
    ".toml": _digest_toml,
    ".npy": _digest_arrays,
    ".npz": _digest_arrays,
    ".fits": _digest_fits,
    ".h5": _digest_hdf5,
    ".parquet": _digest_parquet,
    ".zip": _digest_zip,
}
