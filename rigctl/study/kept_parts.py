"""What of a study is done: a durable file for each batch; a kill or a power cut takes what was in flight alone."""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rigctl.cluster.held_folder import PARTS_FOLDER
from rigctl.errors import DataError
from rigctl.storage.array_archive import read_arrays
from rigctl.storage.durable_file import write_durably
from rigctl.study.batch import BatchResult


@dataclass(frozen=True, kw_only=True)
class DoneCases:
    """Cases that are done: each hash with the part and the row where its numbers stand."""

    parts: tuple[BatchResult, ...]
    places: dict[str, tuple[int, int]]
    damaged: tuple[str, ...]


def write_part(out: Path, result: BatchResult, hashes: Sequence[str]) -> None:
    """Return once a batch is on the disk, under the hash of its first case.

    Raises
    ------
    OSError
        It cannot be written.
    """
    data = io.BytesIO()
    np.savez(
        data,
        hashes=np.array(hashes),
        numbers=np.array(result.numbers),
        regions=np.array(result.regions),
        pairs=np.array(result.pairs, dtype=str),
        values=result.values,
        p_detection=result.p_detection,
        auc=result.auc,
        roc=result.roc,
        seconds=result.seconds,
        is_new_sky=result.is_new_sky,
        reasons=np.array(result.reasons, dtype=str),
    )
    write_durably(out / PARTS_FOLDER / f"{hashes[0]}.npz", data.getvalue())


def read_parts(out: Path) -> DoneCases:
    """Return what is done; a part that is damaged is named, and its cases are not done."""
    parts: list[BatchResult] = []
    places: dict[str, tuple[int, int]] = {}
    damaged = []
    for file in sorted((out / PARTS_FOLDER).glob("*.npz")):
        try:
            hashes, result = _part(file)
        except DataError as error:
            damaged.append(str(error))
            continue
        places |= {one: (len(parts), row) for row, one in enumerate(hashes)}
        parts.append(result)
    return DoneCases(parts=tuple(parts), places=places, damaged=tuple(damaged))


def _part(file: Path) -> tuple[list[str], BatchResult]:
    arrays = read_arrays(file)
    try:
        hashes, texts = (
            arrays["hashes"].tolist(),
            {name: arrays[name].tolist() for name in ("regions", "pairs", "reasons")},
        )
        return hashes, BatchResult(
            numbers=tuple(arrays["numbers"].tolist()),
            regions=tuple(texts["regions"]),
            pairs=tuple(texts["pairs"]),
            reasons=tuple(texts["reasons"]),
            **{name: arrays[name] for name in ("values", "p_detection", "auc", "roc", "seconds", "is_new_sky")},
        )
    except KeyError as error:
        raise DataError(f"{file}: is no part of a study: {error} is missing") from error
