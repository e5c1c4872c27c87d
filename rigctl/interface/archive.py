"""A whole archive in Python: the frames of all its runs as one array that is read bit by bit."""

import json
import warnings
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.archive.index import matching_runs
from rigctl.errors import ConfigError, DataError
from rigctl.files.choices import FrameKind
from rigctl.runs.folder import annotated, read_frame, read_run
from rigctl.runs.records import FrameRecord
from rigctl.verbs.options import FilePath

Shape = tuple[int, int]
# A frame with the name and the folder of its run.
_Placed = tuple[str, Path, FrameRecord]


def open_archive(
    root: FilePath,
    *,
    where: str | None = None,
    kind: FrameKind | None = None,
    shape: Shape | None = None,
    ignore_exclusions: bool = False,
) -> Any:
    """Return the frames of all runs below a folder as one `xarray.Dataset`, of which no frame is read yet.

    Parameters
    ----------
    root : path
        Folder with runs at any depth below it.
    where : str or None
        Expression as of `rigctl archive find`, such as ``"sun_zenith < 40 and state = 'whole'"``; the index is brought
        up to date. None is every run.
    kind : {"scene", "dark", "flat"} or None
        None: frames of all kinds.
    shape : (int, int) or None
        Rows and columns of the frames that are taken; it has to be said where there are several.
    ignore_exclusions : bool
        Take frames too that people have excluded.

    Returns
    -------
    xarray.Dataset
        `counts` over frame, y and x [DN], one chunk of dask a frame, with the coordinates `run`, `sequence`, `kind`,
        `time`, `polarizer_angle_deg` and `exposure_s` along frame: runs in the order of their names, frames in that in
        which they were taken. Runs that cannot be read stand in the attribute `left_out`, as JSON, with the reason.

    Raises
    ------
    ConfigError
        There is no such folder, no frame, or frames of several sizes and no `shape`.
    ImportError
        dask or xarray is not installed.
    RunFolderError
        Later, as it is read: a frame is damaged.

    Warns
    -----
    UserWarning
        Runs are left out.

    Examples
    --------
    >>> frames = rigctl.open_archive("runs", where="state = 'whole'", kind="scene")  # doctest: +SKIP
    >>> frames.counts.mean(("y", "x")).compute()  # doctest: +SKIP
    """
    try:
        import xarray as xr
        from dask import array
    except ImportError as error:
        raise ImportError(f"{error.name} is not installed; install it with: pip install 'rigctl[cluster]'") from error
    placed, left_out = _frames(Path(root), where, kind, ignore_exclusions=ignore_exclusions)
    height, width = _one_shape(Path(root), placed, shape)
    placed = [one for one in placed if (one[2].height, one[2].width) == (height, width)]
    if left_out:
        warnings.warn(f"{len(left_out)} runs are left out; why stands in the attribute left_out", stacklevel=2)
    # One task a frame, named by nothing but its place: thousands of `delayed` would take seconds.
    name = f"frames-{array.core.tokenize([(run, one.checksum) for run, _, one in placed])}"
    graph = {(name, k, 0, 0): (_read, folder, record) for k, (_, folder, record) in enumerate(placed)}
    chunks = ((1,) * len(placed), (height,), (width,))
    counts = array.Array(graph, name, chunks, dtype=np.uint16)
    return xr.Dataset(
        {"counts": (("frame", "y", "x"), counts, {"units": "DN"})},
        coords=_coordinates(placed),
        attrs={"root": str(root), "left_out": json.dumps(left_out)},
    )


def _read(folder: Path, record: FrameRecord) -> NDArray[np.uint16]:
    """Return a frame as a picture of a stack, once its checksum was found right."""
    return read_frame(folder, record).counts[None]


def _frames(
    root: Path, where: str | None, kind: FrameKind | None, *, ignore_exclusions: bool
) -> tuple[list[_Placed], dict[str, str]]:
    placed: list[_Placed] = []
    left_out = {}
    for name in matching_runs(root, where):
        try:
            run = annotated(read_run(root / name), ignore_exclusions=ignore_exclusions)
        except DataError as error:
            left_out[name] = " ".join(str(error).split())
            continue
        placed += [(name, run.path, record) for record in run.frames if kind in (None, record.kind)]
    return placed, left_out


def _one_shape(root: Path, placed: Sequence[_Placed], shape: Shape | None) -> Shape:
    found = Counter((record.height, record.width) for _, _, record in placed)
    if not found:
        raise ConfigError(f"{root}: no run that matches has such a frame")
    if shape is None and len(found) > 1:
        told = ", ".join(f"{frames} of shape={one}" for one, frames in found.most_common())
        raise ConfigError(f"{root}: frames of {len(found)} sizes do not make one array; choose: {told}")
    chosen = shape or next(iter(found))
    if chosen not in found:
        raise ConfigError(f"{root}: no frame has shape={chosen}; there are {', '.join(map(str, found))}")
    return chosen


def _coordinates(placed: Sequence[_Placed]) -> dict[str, Any]:
    records = [record for _, _, record in placed]

    def numbers(name: str) -> NDArray[np.float64]:
        known = (getattr(record, name) for record in records)
        return np.array([np.nan if value is None else value for value in known], dtype=np.float64)

    times = [np.datetime64((record.start_utc or "NaT").removesuffix("Z"), "ns") for record in records]
    return {
        "run": ("frame", np.array([name for name, _, _ in placed])),
        "sequence": ("frame", np.array([record.sequence for record in records])),
        "kind": ("frame", np.array([str(record.kind) for record in records])),
        "time": ("frame", np.array(times), {"long_name": "start, UTC"}),
        "polarizer_angle_deg": ("frame", numbers("polarizer_angle_deg"), {"units": "deg"}),
        "exposure_s": ("frame", numbers("exposure_s"), {"units": "s"}),
    }
