"""The calibrations of a run: named by options or selected from the store, read, and found to be of its devices.

`selected_for_run` says which files, and why not others; `calibrations_of_run` reads them too, with doubts in words.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from rigctl.base.durable import sha256_of
from rigctl.calibrations.made_for import KINDS, CalibrationKind, made_for, record_of
from rigctl.calibrations.store import (
    NONE,
    STORE_FOLDER,
    Choice,
    Selection,
    choose,
    read_store,
)
from rigctl.files.rig_file import PLACEHOLDER
from rigctl.measure.frames import (
    CalibrationPaths,
    FrameGrid,
    RunCalibrations,
    SelectedCalibrations,
    arrange,
    flat_division,
    frame_shifts,
    throughput_of,
)
from rigctl.runs.folder import Run


def calibrations_of_run(paths: CalibrationPaths, run: Run, kinds: Sequence[CalibrationKind]) -> RunCalibrations:
    """Return the calibrations of a run; of some kinds, those that are not named are selected from the store."""
    selected = selected_for_run(paths, run, kinds)
    files = selected.paths.files
    doubts = [f"{run.path}: {PLACEHOLDER}"] if run.session.polarizer.placeholder and "polarizer" not in files else []
    found: dict[str, Any] = {}
    for kind in KINDS:
        if kind in files:
            found[kind], more = record_of(kind).read_fitting(files[kind], run)
            doubts.extend(more)
    return RunCalibrations(selected=selected, doubts=tuple(doubts), **found)


# As many folders above a run are looked into for its rig file.
_ABOVE = 3


def selected_for_run(paths: CalibrationPaths, run: Run, kinds: Sequence[CalibrationKind]) -> SelectedCalibrations:
    """Return the calibrations of a run, those that are not named selected from the store."""
    folder = (paths.store or store_of_run(run)) if paths.uses_store else None
    if folder is None:
        return SelectedCalibrations(paths=paths)
    store, grid = read_store(folder), arrange(run)
    used = made_for(run, grid.frames)
    choices = tuple(
        _named(kind, paths.named[kind])
        if kind in paths.named
        else choose(store, kind, used, require_usable=_usable(kind, run, grid))
        for kind in kinds
        if paths.named.get(kind) != NONE
    )
    selected = {choice.kind: choice.selection.file for choice in choices if choice.selection is not None}
    chosen = replace(paths, named=dict(paths.named) | selected)
    return SelectedCalibrations(paths=chosen, store=folder, choices=choices, damaged=store.damaged)


def store_of_run(run: Run) -> Path | None:
    """Return the store beside the rig file that a run was taken with; None where there is none.

    The rig file is sought where it was, then by its name in the folders above the run and in the current one, as runs
    are moved to other machines.
    """
    files = run.session_json.get("files")
    rig = files.get("rig") if isinstance(files, dict) else None
    if not isinstance(rig, dict) or not isinstance(rig.get("name"), str):
        return None
    stated = run.session_json.get("host_folder")
    folders = [Path(stated)] if isinstance(stated, str) else []
    folders += [*run.path.absolute().parents][:_ABOVE]
    for folder in (*folders, Path.cwd()):
        if (folder / str(rig["name"])).is_file() and (folder / STORE_FOLDER).is_dir():
            return folder / STORE_FOLDER
    return None


def _named(kind: CalibrationKind, path: Path) -> Choice:
    return Choice(kind=kind, selection=Selection(file=path, sha256=sha256_of(path), why="named on the command line"))


def _usable(kind: CalibrationKind, run: Run, grid: FrameGrid) -> Callable[[Path], object]:
    """Return what tries a file on the frames of a run, as measuring will."""
    also: dict[str, Callable[[Any], object]] = {
        "polarizer": partial(throughput_of, grid),
        "flat": partial(flat_division, grid),
        "registration": partial(frame_shifts, run, grid),
    }

    def try_file(path: Path) -> None:
        found, _ = record_of(kind).read_fitting(path, run)
        if kind in also:
            also[kind](found)

    return try_file
