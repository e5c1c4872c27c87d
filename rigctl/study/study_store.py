"""The files of a study as others read them: one Zarr store for xarray, tables in Parquet."""

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from model.quantities import is_counts
from rigctl.files.choices import ROC_KINDS
from rigctl.prediction.performance import SWEPT_RATES
from rigctl.prediction.roc_curves import ROC_RATES
from rigctl.storage.durable_file import flush_folder
from rigctl.study.study_arrays import StudyArrays
from rigctl.study.study_case import Case

ZARR, REGIONS_TABLE, DETECTION_TABLE = "study.zarr", "study.parquet", "detection.parquet"
_STOKES = ("s0", "s1", "s2")
# How signs are meant, in words for whoever opens the store.
CONVENTIONS = (
    "S1 = horizontal - vertical, S2 = (+45) - (-45), angles counter-clockwise from horizontal as the camera sees the "
    "scene, AoLP in [0, 180) deg; azimuths clockwise from north; counts and Stokes parameters in DN"
)


@dataclass(frozen=True, kw_only=True)
class Axis:
    """A number that is varied: its key, unit and meaning; on a grid its values too."""

    key: str
    unit: str
    meaning: str
    values: tuple[float, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class StudyTable:
    """A study as its files hold it.

    Attributes
    ----------
    scenes : tuple of str
        Names.
    axes : tuple of Axis
        What is varied; each with its values where all combinations are there, else with none.
    columns : tuple of (str, str)
        Quantity and statistic.
    cases : tuple of Case
        N of them.
    arrays : StudyArrays
        Their numbers.
    said : mapping
        Attributes of the store: version, inputs, conventions.
    """

    scenes: tuple[str, ...]
    axes: tuple[Axis, ...]
    columns: tuple[tuple[str, str], ...]
    cases: tuple[Case, ...]
    arrays: StudyArrays
    said: Mapping[str, str]

    @property
    def is_grid(self) -> bool:
        """Whether every combination of the axes is there."""
        return all(axis.values for axis in self.axes)


def column_name(column: tuple[str, str]) -> str:
    """Return the name of a number in stores and tables, "dolp_mean"."""
    return "_".join(column)


def write_zarr(out: Path, table: StudyTable) -> None:
    """Write the store; one that is there is replaced once the new one is whole.

    Raises
    ------
    OSError
        It cannot be written.
    """
    part, store = out / f"{ZARR}.part", out / ZARR
    shutil.rmtree(part, ignore_errors=True)
    dataset(table).to_zarr(part, mode="w", zarr_format=2, consolidated=True)
    if store.exists():
        store.rename(out / f"{ZARR}.old")
    part.rename(store)
    shutil.rmtree(out / f"{ZARR}.old", ignore_errors=True)
    flush_folder(out)


def dataset(table: StudyTable) -> Any:
    """Return the numbers as an `xarray.Dataset`: over scene and axes of a grid, else over cases.

    Parameters
    ----------
    table : StudyTable
        The study.
    """
    import xarray as xr

    arrays = table.arrays
    dims, lengths, coords = _dimensions(table)
    coords |= {"region": ("region", _texts(arrays.regions))}

    def shaped(values: Any, *inner: str) -> tuple[tuple[str, ...], Any]:
        return (*dims, *inner), values.reshape(*lengths, *values.shape[1:])

    variables: dict[str, Any] = {
        column_name(column): (*shaped(arrays.values[..., k], "region"), {"units": _unit(column[0])})
        for k, column in enumerate(table.columns)
    }
    variables["seconds"] = (*shaped(arrays.seconds), {"units": "s", "long_name": "time of computation"})
    variables["reason"] = (*shaped(_texts(arrays.reasons)), {"long_name": "why a case has no numbers"})
    if arrays.pairs:
        coords |= {"pair": ("pair", _texts(arrays.pairs)), "p_false_alarm": ("p_false_alarm", list(SWEPT_RATES))}
        variables["p_detection"] = (*shaped(arrays.p_detection, "pair", "p_false_alarm"), {"units": "1"})
        variables["auc"] = (*shaped(arrays.auc, "pair"), {"units": "1"})
    if arrays.roc is not None:
        coords |= {"kind": ("kind", _texts(ROC_KINDS)), "roc_p_false_alarm": ("roc_p_false_alarm", ROC_RATES)}
        variables["roc_p_detection"] = (*shaped(arrays.roc, "kind", "roc_p_false_alarm"), {"units": "1"})
    return xr.Dataset(variables, coords=coords, attrs=dict(table.said))


def _dimensions(table: StudyTable) -> tuple[tuple[str, ...], tuple[int, ...], dict[str, Any]]:
    """Dimensions of the cases, their lengths, and the coordinates that say what each case is."""
    scenes = _texts(table.scenes)
    facts = {axis.key: {"units": axis.unit or "1", "long_name": axis.meaning} for axis in table.axes}
    if table.is_grid:
        coords: dict[str, Any] = {axis.key: (axis.key, list(axis.values), facts[axis.key]) for axis in table.axes}
        lengths = (len(scenes), *(len(axis.values) for axis in table.axes))
        return ("scene", *(axis.key for axis in table.axes)), lengths, {"scene": ("scene", scenes)} | coords
    columns = np.array([[value for _, value in case.values] for case in table.cases])
    coords = {axis.key: ("case", columns[:, k], facts[axis.key]) for k, axis in enumerate(table.axes)}
    coords |= {"case": ("case", np.arange(len(table.cases)))}
    coords |= {"scene": ("case", scenes[[case.scene for case in table.cases]])}
    return ("case",), (len(table.cases),), coords


def _unit(quantity: str) -> str:
    if quantity.endswith("_deg"):
        return "deg"
    return "DN" if is_counts(quantity) or quantity in _STOKES else "1"


def _texts(words: Sequence[str]) -> Any:
    return np.array(words, dtype=f"U{max(map(len, words), default=1) or 1}")


def write_parquet(out: Path, table: StudyTable) -> None:
    """Write a row for each case and region and, where it is wanted, one for each case, pair and rate.

    Raises
    ------
    OSError
        It cannot be written.
    """
    import pyarrow as pa
    from pyarrow import parquet

    arrays, n = table.arrays, len(table.cases)
    said = {key: value.encode() for key, value in table.said.items()}
    of_case = {"case": np.arange(n), "scene": np.array(table.scenes)[[case.scene for case in table.cases]]}
    of_case |= {axis.key: np.array([case.values[k][1] for case in table.cases]) for k, axis in enumerate(table.axes)}

    def write(name: str, inner: Mapping[str, Any], values: Mapping[str, Any], repeats: int) -> None:
        columns = {key: np.repeat(value, repeats) for key, value in of_case.items()}
        columns |= {key: np.tile(value, n) for key, value in inner.items()}
        made = pa.table(columns | {key: np.ravel(value) for key, value in values.items()})
        part = out / f"{name}.part"
        parquet.write_table(made.replace_schema_metadata(said), part)
        part.replace(out / name)

    per_region = len(arrays.regions)
    numbers = {column_name(column): arrays.values[..., k] for k, column in enumerate(table.columns)}
    numbers |= {
        "seconds": np.repeat(arrays.seconds, per_region),
        "reason": np.repeat(_texts(arrays.reasons), per_region),
    }
    write(REGIONS_TABLE, {"region": _texts(arrays.regions)}, numbers, per_region)
    if arrays.pairs:
        rates = len(SWEPT_RATES)
        inner = {
            "pair": np.repeat(_texts(arrays.pairs), rates),
            "p_false_alarm": np.tile(SWEPT_RATES, len(arrays.pairs)),
        }
        auc = np.repeat(arrays.auc, rates, axis=-1)
        write(DETECTION_TABLE, inner, {"p_detection": arrays.p_detection, "auc": auc}, len(arrays.pairs) * rates)
