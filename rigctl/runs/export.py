"""A run in the formats of other programs: FITS, TIFF, HDF5 and Zarr."""

import json
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.errors import ConfigError, RunFolderError
from rigctl.runs.folder import Run
from rigctl.runs.records import FrameRecord

Column = list[Any]
# Attribute with the names of an array's dimensions for xarray.
_DIMENSIONS = "_ARRAY_DIMENSIONS"
# The longest ending first: "_e_per_dn" is not a count.
_UNITS = {
    "_e_per_dn": "e-/DN",
    "_deg": "deg",
    "_dn": "DN",
    "_db": "dB",
    "_ns": "ns",
    "_s": "s",
    "_c": "deg C",
    "_m": "m",
}


def columns_of(run: Run) -> dict[str, Column]:
    """Return the known fields of the frames, one value per frame; None for an unknown value."""
    return {field.name: [getattr(record, field.name) for record in run.frames] for field in fields(FrameRecord)}


def unit_of(field: str) -> str:
    """Return the unit at the end of a field's name; empty without one."""
    return next((unit for ending, unit in _UNITS.items() if field.endswith(ending)), "")


def common_shape(run: Run) -> tuple[int, int]:
    """Return rows and columns of all frames."""
    if not run.frames:
        raise RunFolderError(f"{run.path}: has no frames")
    shapes = {(record.height, record.width) for record in run.frames}
    if len(shapes) != 1:
        raise RunFolderError(f"{run.path}: has frames of {len(shapes)} sizes; one file holds frames of one size")
    return next(iter(shapes))


def sample_type(run: Run) -> np.dtype[Any]:
    """Return the type that holds the counts of all frames."""
    return np.dtype(np.float32 if any(record.real_counts for record in run.frames) else np.uint16)


def export_fits(run: Run, out: Path) -> None:
    """Write a run into one FITS file: counts (N, H, W), and a table FRAMES with a column a field of their records.

    Unknown numbers are NaN, unknown texts empty; characters beyond ASCII are escaped. The column `record` has each
    complete record as JSON.
    """
    from astropy.io import fits

    is_real = sample_type(run) == np.float32
    height, width = common_shape(run)
    header = fits.Header(
        [
            ("SIMPLE", True),
            ("BITPIX", -32 if is_real else 16),
            ("NAXIS", 3),
            ("NAXIS1", width),
            ("NAXIS2", height),
            ("NAXIS3", len(run.frames), "frames"),
            ("EXTEND", True),
            *(() if is_real else (("BZERO", 32768, "samples are unsigned"), ("BSCALE", 1))),
            ("BUNIT", "DN"),
            ("ROWORDER", "TOP-DOWN", "the first row is the top of the picture"),
            ("SWVER", run.created_by),
        ]
    )
    stream = fits.StreamingHDU(str(out), header)
    try:
        for record in run.frames:
            counts = run.counts(record)
            stream.write(counts.astype(">f4") if is_real else (counts.astype(np.int32) - 32768).astype(">i2"))
    finally:
        stream.close()
    columns = [_fits_column(name, _dataset(column), unit_of(name)) for name, column in columns_of(run).items()]
    columns.append(_fits_column("record", [json.dumps(asdict(record)) for record in run.frames], ""))
    with fits.open(out, mode="append") as file:
        file.append(fits.BinTableHDU.from_columns(columns, name="FRAMES"))


def _fits_column(name: str, values: Any, unit: str) -> Any:
    from astropy.io import fits

    if isinstance(values, list):
        texts = [value.encode("ascii", "backslashreplace") for value in values]
        return fits.Column(name=name, format=f"{max(1, *map(len, texts))}A", array=np.array(texts))
    return fits.Column(name=name, format="K" if values.dtype == np.int64 else "D", unit=unit or None, array=values)


def export_tiff(run: Run, out: Path) -> None:
    """Write a run into a folder of 16 bit TIFF files with the record of each frame as JSON in its description."""
    try:
        import tifffile
    except ImportError as error:
        raise ConfigError("--to tiff needs tifffile: pip install 'rigctl[export]'") from error
    out.mkdir(parents=True)
    for record in run.frames:
        name = Path(record.file).with_suffix(".tif").name
        # ASCII, as the format requires: JSON escapes other characters. One description: the tags of a file stand in
        # order, each once.
        description = json.dumps(asdict(record))
        tifffile.imwrite(
            out / name, run.counts(record), photometric="minisblack", description=description, metadata=None
        )
    (out / "session.json").write_text(json.dumps(run.session_json, indent=2), encoding="ascii")


def export_hdf5(run: Run, out: Path) -> None:
    """Write a run into an HDF5 file: `counts` (N, H, W), a dataset a field under `frames`, and `records`.

    Under `frames` unknown numbers are NaN, unknown texts empty; several remarks are lines of one text. `records` has
    each frame's complete record as JSON, as in the manifest. The attribute `session` has the session as JSON.
    """
    try:
        import h5py
    except ImportError as error:
        raise ConfigError("--to hdf5 needs h5py: pip install 'rigctl[export]'") from error
    height, width = common_shape(run)
    with h5py.File(out, "x") as file:
        counts = file.create_dataset(
            "counts",
            (len(run.frames), height, width),
            dtype=sample_type(run),
            chunks=(1, height, width),
            fletcher32=True,
        )
        counts.attrs["unit"] = "DN"
        for place, record in enumerate(run.frames):
            counts[place] = run.counts(record)
        for name, column in columns_of(run).items():
            dataset = file.create_dataset(f"frames/{name}", data=_dataset(column))
            dataset.attrs["unit"] = unit_of(name)
        file.create_dataset("records", data=[json.dumps(asdict(record)) for record in run.frames])
        file.attrs["session"] = json.dumps(run.session_json)
        file.attrs["created_by"] = run.created_by


def _dataset(column: Column) -> Any:
    if any(isinstance(value, (str, tuple)) for value in column):
        return [_text(value) for value in column]
    if all(isinstance(value, int) for value in column):
        return np.array(column, dtype=np.int64)
    return np.array([np.nan if value is None else value for value in column], dtype=np.float64)


def _text(value: str | tuple[str, ...] | None) -> str:
    if value is None:
        return ""
    return value if isinstance(value, str) else "\n".join(value)


def export_zarr(run: Run, out: Path) -> None:
    """Write a run into a Zarr folder: an array `counts` (N, H, W), one chunk a frame, coordinates and attributes.

    xarray opens it lazily, with the coordinates `kind`, `polarizer_angle_deg`, `exposure_s` and, where every frame has
    one, `time` along `frame`. The group's attribute `frames` has every field of the frames' records by its name, one
    value a frame; `session` the content of the session file.
    """
    try:
        import zarr
    except ImportError as error:
        raise ConfigError("--to zarr needs zarr: pip install 'rigctl[export]'") from error
    height, width = common_shape(run)
    # Version 2, for its single file of metadata, which the standard of version 3 lacks.
    group = zarr.open_group(str(out), mode="w-", zarr_format=2)
    # xarray would read a fill value as missing.
    counts = group.create_array(
        "counts",
        shape=(len(run.frames), height, width),
        chunks=(1, height, width),
        dtype=sample_type(run),
        fill_value=None,
    )
    for place, record in enumerate(run.frames):
        counts[place] = run.counts(record)
    coordinates = _coordinates(run)
    counts.attrs.update(
        {"unit": "DN", "units": "DN", _DIMENSIONS: ["frame", "y", "x"], "coordinates": " ".join(coordinates)}
    )
    for name, (values, facts) in coordinates.items():
        group.create_array(name, data=values, fill_value=None, attributes={_DIMENSIONS: ["frame"], **facts})
    group.attrs.update({"frames": columns_of(run), "session": run.session_json, "created_by": run.created_by})
    zarr.consolidate_metadata(str(out))


def _coordinates(run: Run) -> dict[str, tuple[np.ndarray[Any, Any], dict[str, str]]]:
    """Values along the frames with attributes for other programs, after the CF conventions."""
    records = run.frames
    numbers = {"polarizer_angle_deg": "deg", "exposure_s": "s"}
    found: dict[str, tuple[np.ndarray[Any, Any], dict[str, str]]] = {
        name: (np.array([_known(getattr(record, name)) for record in records]), {"units": unit})
        for name, unit in numbers.items()
    }
    found["kind"] = (np.array([record.kind for record in records]), {})
    starts = [record.start_utc for record in records if record.start_utc is not None]
    if len(starts) == len(records):
        utc_ns = np.array([np.datetime64(text.removesuffix("Z"), "ns").astype(np.int64) for text in starts])
        facts = {"units": "nanoseconds since 1970-01-01", "calendar": "proleptic_gregorian", "long_name": "start, UTC"}
        found["time"] = (utc_ns, facts)
    return found


def _known(value: float | None) -> float:
    return np.nan if value is None else value
