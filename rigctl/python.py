"""Runs in Python: `open_run` opens one, `open_archive` gives the frames of many as one lazy array.

The other names of the Python interface are the verbs themselves (docs/python.md).
"""

import json
import os
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from rigctl.archive.index import matching_runs
from rigctl.errors import ConfigError, DataError
from rigctl.files.choices import FrameKind
from rigctl.files.regions import Region
from rigctl.files.scene_file import load_scene
from rigctl.report.document import Backend, optional
from rigctl.runs.check import run_with_remarks, wholeness
from rigctl.runs.folder import Run as RunRecord
from rigctl.runs.folder import annotated, read_contents, read_frame, read_run, writing_process
from rigctl.runs.records import FrameRecord, read_events
from rigctl.session.status import session_state
from rigctl.verbs.options import FilePath, FrameOptions, RegionsPath
from rigctl.verbs.stokes import StokesResult, stokes

Shape = tuple[int, int]
_Placed = tuple[str, Path, FrameRecord]  # a frame with the name and the folder of its run


def open_run(path: FilePath, *, ignore_exclusions: bool = False) -> "Run":
    """Return a run folder, opened: its frames, Stokes parameters and regions.

    Parameters
    ----------
    path : path
        Run folder, of `rigctl acquire` or `rigctl import`.
    ignore_exclusions : bool
        Include frames that people have excluded.

    Raises
    ------
    RunFolderError
        The folder is not a run, or is damaged.

    Warns
    -----
    UserWarning
        Its session has not finished, files other than its frames are damaged, or frames are excluded.

    Examples
    --------
    >>> run = rigctl.open_run("runs/panels")  # doctest: +SKIP
    >>> run.frames(kind="scene").counts.mean(axis=(1, 2))  # doctest: +SKIP
    """
    record, remarks = run_with_remarks(Path(path), ignore_exclusions=ignore_exclusions)
    for remark in remarks:
        warnings.warn(remark, stacklevel=2)
    return Run(path=Path(path), record=record, ignore_exclusions=ignore_exclusions)


def open_archive(
    root: FilePath,
    *,
    where: str | None = None,
    kind: FrameKind | None = None,
    shape: Shape | None = None,
    ignore_exclusions: bool = False,
) -> Any:
    """Return the frames of all runs below a folder as one lazy `xarray.Dataset`.

    Parameters
    ----------
    root : path
        Folder with runs at any depth below it.
    where : str or None
        Expression as of `rigctl archive find`, such as ``"sun_zenith < 40 and state = 'whole'"``; the index is updated.
        None is every run.
    kind : {"scene", "dark", "flat"} or None
        None: frames of all kinds.
    shape : (int, int) or None
        Rows and columns of the frames to use; required if there are several sizes.
    ignore_exclusions : bool
        Include frames that people have excluded.

    Returns
    -------
    xarray.Dataset
        `counts` over frame, y and x [DN], one chunk of dask a frame, with the coordinates `run`, `sequence`, `kind`,
        `time`, `polarizer_angle_deg` and `exposure_s` along frame: runs in the order of their names, frames in order of
        time. The attribute `left_out` has the unreadable runs with the reason, as JSON.

    Raises
    ------
    ConfigError
        There is no such folder, no frame, or frames of several sizes and no `shape`.
    ImportError
        dask or xarray is not installed.
    RunFolderError
        Later, on reading: a frame is damaged.

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
        warnings.warn(f"{len(left_out)} runs are left out; the attribute left_out has the reasons", stacklevel=2)
    # One task per frame, named by its place: thousands of `delayed` would take seconds.
    name = f"frames-{array.core.tokenize([(run, one.checksum) for run, _, one in placed])}"
    graph = {(name, k, 0, 0): (_read, folder, record) for k, (_, folder, record) in enumerate(placed)}
    chunks = ((1,) * len(placed), (height,), (width,))
    is_real = any(record.real_counts for _, _, record in placed)
    counts = array.Array(graph, name, chunks, dtype=np.float32 if is_real else np.uint16)
    return xr.Dataset(
        {"counts": (("frame", "y", "x"), counts, {"units": "DN"})},
        coords=_coordinates(placed),
        attrs={"root": str(root), "left_out": json.dumps(left_out)},
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Frames:
    """Frames of one kind, in the order in which they were taken.

    Attributes
    ----------
    records : tuple of FrameRecord
        Records of the frames.
    counts : (N, H, W) array of uint16, or float32 for imported sums and means with fractions
        Samples [DN]; the first row is the top of the picture.
    """

    records: tuple[FrameRecord, ...]
    counts: NDArray[Any]

    def __len__(self) -> int:
        return len(self.records)

    def __iter__(self) -> Iterator[NDArray[Any]]:
        return iter(self.counts)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.array(self.counts, dtype=dtype, copy=copy)

    def __repr__(self) -> str:
        return f"<{len(self)} frames, {' x '.join(map(str, self.counts.shape[1:]))} pixels [DN]>"

    @property
    def polarizer_angle_deg(self) -> NDArray[np.float64]:
        """Transmission axis of each frame by the stage's readback [deg]; nan if unknown."""
        return self._numbers("polarizer_angle_deg")

    @property
    def exposure_s(self) -> NDArray[np.float64]:
        """Integration time of each frame [s]; nan if unknown."""
        return self._numbers("exposure_s")

    def to_xarray(self) -> Any:
        """Return the counts as an `xarray.DataArray` over frame, y and x, with the records of the frames.

        Raises
        ------
        ImportError
            xarray is not installed.
        """
        known = {name: ("frame", self._numbers(name)) for name in ("polarizer_angle_deg", "exposure_s", "cycle")}
        coordinates = {
            "frame": [record.sequence for record in self.records],
            "kind": ("frame", [record.kind for record in self.records]),
            **known,
        }
        return optional("xarray").DataArray(
            self.counts, dims=("frame", "y", "x"), coords=coordinates, name="counts", attrs={"units": "DN"}
        )

    def _numbers(self, name: str) -> NDArray[np.float64]:
        found = [getattr(record, name) for record in self.records]
        return np.array([np.nan if number is None else number for number in found], dtype=np.float64)


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """A run folder, opened.

    Attributes
    ----------
    path : Path
        The folder.
    record : rigctl.runs.folder.Run
        Its table of contents.
    ignore_exclusions : bool
        True to include frames that people have excluded.
    """

    path: Path
    record: RunRecord
    ignore_exclusions: bool = False

    def __fspath__(self) -> str:
        """Return the folder, so that every verb accepts an opened run."""
        return os.fspath(self.path)

    def __repr__(self) -> str:
        return f"<run {self.path}: {self._summary}>"

    def _repr_html_(self) -> str:
        return f"<p><b>{escape(str(self.path))}</b>: {escape(self._summary)}</p>"

    @property
    def state(self) -> str:
        """The state of its session: "finished", "stopped", "interrupted", "running", "holding" or "waiting"."""
        return session_state(writing_process(self.path), read_events(self.path))

    @property
    def wholeness(self) -> str:
        """The result of `rigctl verify` without reading the frames: "whole", "unfinished" or "damaged"."""
        return wholeness(self.path, read_contents(self.path))[0]

    @property
    def calibrations(self) -> Mapping[str, Any]:
        """Calibrations chosen by its session, by kind: file, sha256, why, age_days; empty without any."""
        selected = self.record.session_json.get("calibrations")
        return dict(selected) if isinstance(selected, dict) else {}

    @cached_property
    def _summary(self) -> str:
        kinds = [record.kind for record in self.record.frames]
        counted = ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds))
        not_whole = "" if self.wholeness == "whole" else f"{self.wholeness}: "
        return f"{not_whole}{len(kinds)} frames ({counted}), made {self.record.created_utc} by {self.record.created_by}"

    def frames(self, kind: FrameKind | None = None) -> Frames:
        """Return the frames of a kind as one array, after checking every checksum.

        Parameters
        ----------
        kind : {"scene", "dark", "flat"} or None
            None: all of them.

        Raises
        ------
        ConfigError
            The run has no frame of this kind, or frames of several sizes.
        RunFolderError
            A frame is damaged.
        """
        chosen = tuple(record for record in self.record.frames if kind in (None, record.kind))
        there = ", ".join(dict.fromkeys(record.kind for record in self.record.frames)) or "none"
        if not chosen:
            raise ConfigError(f"{self.path}: has no frames of kind {kind!r}; there are {there}")
        sizes = {(record.height, record.width) for record in chosen}
        if len(sizes) > 1:
            raise ConfigError(f"{self.path}: frames of {len(sizes)} sizes do not make one array; ask for one kind")
        return Frames(records=chosen, counts=np.stack([self.record.counts(record) for record in chosen]))

    def stokes(
        self, *, regions: RegionsPath | None = None, out: FilePath | None = None, **frames: Unpack[FrameOptions]
    ) -> StokesResult:
        """Return Stokes parameters, DoLP and AoLP of the run, and the numbers of its regions, as `rigctl.stokes`."""
        frames.setdefault("ignore_exclusions", self.ignore_exclusions)
        return stokes(self.path, regions=regions, out=out, **frames)

    def to_xarray(self) -> Any:
        """Return the run as an `xarray.Dataset`: the frames' counts with their angles, and the Stokes pictures.

        Raises
        ------
        ImportError
            xarray is not installed.
        """
        counts = self.frames("scene").to_xarray()
        return self.stokes().to_xarray().assign({"counts": counts})

    def regions(
        self, regions: FilePath | None = None, *, noise: FilePath | None = None, backend: Backend = "pandas"
    ) -> Any:
        """Return the numbers of the regions: region, quantity, statistic, value, std_error.

        Parameters
        ----------
        regions : path or None
            Regions file. None: the regions of the simulated scene of the run.
        noise : path or None
            Noise calibration.
        backend : {"pandas", "polars"}
            Whose data frame.

        Raises
        ------
        ConfigError
            No regions are given, and the run has no simulated scene.
        ImportError
            The backend is not installed.
        """
        return self.stokes(regions=self._simulated_regions() if regions is None else regions, noise=noise).table(
            backend=backend
        )

    def _simulated_regions(self) -> list[Region]:
        scene = self.record.session.simulated_scene
        if scene is None or not scene.is_file():
            raise ConfigError(
                f"{self.path}: say which regions: regions=FILE; `rigctl regions draw {self.path} --out regions.toml` "
                "makes such a file"
            )
        return list(load_scene(scene).regions)


def _read(folder: Path, record: FrameRecord) -> NDArray[Any]:
    """Return a frame as a picture of a stack, after checking its checksum."""
    return read_frame(folder, record)[None]


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
        raise ConfigError(f"{root}: no matching run has such a frame")
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
