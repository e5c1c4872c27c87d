"""Calibrations that are picked from the store for a run: which, why, and why not the others."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rigctl.calibrations.flat.flat_file import read_fitting_flats
from rigctl.calibrations.made_for import made_for
from rigctl.calibrations.noise.noise_file import read_fitting_noise
from rigctl.calibrations.picking import Choice, Pick, choice_lines, choices_json, choose
from rigctl.calibrations.polarizer.polarizer_file import read_fitting_polarizer
from rigctl.calibrations.radiometric_file import read_fitting_radiometric
from rigctl.calibrations.registration.registration_file import read_fitting_registration
from rigctl.calibrations.rig_picks import NONE, RigPicks
from rigctl.calibrations.store import STORE_FOLDER, CalibrationKind, UnreadFile, read_store
from rigctl.console.json_text import Json
from rigctl.console.terminal import note, warn
from rigctl.errors import ConfigError
from rigctl.measurement.flat_division import flat_division
from rigctl.measurement.frame_grid import FrameGrid, arrange
from rigctl.measurement.image_registration import frame_shifts
from rigctl.measurement.run_calibrations import CalibrationPaths
from rigctl.measurement.throughput_division import throughput_of
from rigctl.runs.run_folder import Run
from rigctl.storage.bounded_file import sha256_of

# As many folders above a run are looked into for its rig file.
_ABOVE = 3


@dataclass(frozen=True, kw_only=True)
class PickedCalibrations:
    """Calibrations of a run: those that were named, and those that were picked.

    Attributes
    ----------
    paths : CalibrationPaths
        All of them.
    store : Path or None
        Where was looked; None where there is no store, and nothing is picked.
    choices : tuple of Choice
        What was picked, kind by kind, and what was not.
    damaged : tuple of UnreadFile
        Files of the store that may be calibrations, and cannot be read.
    """

    paths: CalibrationPaths
    store: Path | None = None
    choices: tuple[Choice, ...] = ()
    damaged: tuple[UnreadFile, ...] = ()

    @property
    def lines(self) -> tuple[str, ...]:
        """What was picked and why, a line for each kind of which the store has any."""
        return choice_lines(self.choices, self.damaged)

    def report(self) -> None:
        """Report what was picked; warn where there are calibrations of a kind and none fits."""
        for choice in self.choices:
            (warn if choice.pick is None and choice.others else note)(choice.line)
        for line in choice_lines((), self.damaged):
            note(line)

    def as_json(self) -> dict[str, Json]:
        """Return what results say of it; nothing where there is no store."""
        return {} if self.store is None else choices_json(self.choices, self.damaged)


def calibration_paths(
    named: Mapping[CalibrationKind, Path | None], *, store: Path | None, force_registration: bool = False
) -> CalibrationPaths:
    """Return the calibrations that a command line names; ``none`` is to have none, the others are picked.

    Raises
    ------
    ConfigError
        The store that is named is no folder.
    """
    if store is not None and store != NONE and not store.is_dir():
        raise ConfigError(f"--calibrations: {store}: there is no such folder")
    paths = CalibrationPaths(
        force_registration=force_registration,
        picks=store != NONE,
        store=None if store == NONE else store,
        without=tuple(kind for kind, path in named.items() if path == NONE),
    )
    return paths.with_files({kind: path for kind, path in named.items() if path is not None and path != NONE})


def calibrations_json(picked: "PickedCalibrations | RigPicks | None") -> dict[str, Json]:
    """Return the calibrations that were used, by kind: file, sha256, why, age_days; empty where there is no store."""
    picks = () if picked is None or picked.store is None else (one.pick for one in picked.choices)
    return {one.kind: one.as_json() for one in picks if one is not None}


def named_calibrations(picked: "PickedCalibrations | RigPicks | None") -> str:
    """Return the calibrations that were used as the end of a sentence."""
    picks = () if picked is None else (one.pick for one in picked.choices)
    files = [f"{one.kind} {one.file.name}" for one in picks if one is not None]
    return f", with {', '.join(files)}" if files else ""


def picked_for_run(paths: CalibrationPaths, run: Run, kinds: Sequence[CalibrationKind]) -> PickedCalibrations:
    """Return the calibrations of a run, those that are not named picked from the store.

    Parameters
    ----------
    paths : CalibrationPaths
        What is named, and whether anything is picked.
    run : Run
        The run.
    kinds : sequence of str
        What can be used.

    Raises
    ------
    ConfigError, DataError
        The store cannot be read, or the run has no frames to calibrate.
    """
    folder = (paths.store or store_of_run(run)) if paths.picks else None
    if folder is None:
        return PickedCalibrations(paths=paths)
    store, grid = read_store(folder), arrange(run)
    used = made_for(run, grid.frames)
    wanted = [kind for kind in kinds if kind not in paths.without]
    choices = tuple(
        _named(kind, paths.files[kind])
        if kind in paths.files
        else choose(store, kind, used, require_usable=_usable(kind, run, grid))
        for kind in wanted
    )
    picked = {choice.kind: choice.pick.file for choice in choices if choice.pick is not None}
    return PickedCalibrations(paths=paths.with_files(picked), store=folder, choices=choices, damaged=store.damaged)


def store_of_run(run: Run) -> Path | None:
    """Return the store beside the rig file that a run was taken with; None where there is none.

    Notes
    -----
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
    pick = Pick(kind=kind, file=path, sha256=sha256_of(path), why="named on the command line", age_days=None)
    return Choice(kind=kind, pick=pick, others=())


def _usable(kind: CalibrationKind, run: Run, grid: FrameGrid) -> Callable[[Path], object]:
    """Return what tries a file on the frames of a run, as measuring will."""
    tries: dict[CalibrationKind, Callable[[Path], object]] = {
        "noise": lambda path: read_fitting_noise(path, run),
        "polarizer": lambda path: throughput_of(grid, read_fitting_polarizer(path, run)[0]),
        "flat": lambda path: flat_division(grid, read_fitting_flats(path, run)[0]),
        "radiometric": lambda path: read_fitting_radiometric(path, run),
        "registration": lambda path: frame_shifts(run, grid, read_fitting_registration(path, run)[0]),
    }
    return tries[kind]
