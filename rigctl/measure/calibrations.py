"""The calibrations of a run: named by options or picked from the store, read, and found to be of its devices.

`picked_for_run` says which files, and why not others; `read_calibrations` reads them, with doubts in words.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from rigctl.base.durable import sha256_of
from rigctl.calibrations.flat import FlatFields
from rigctl.calibrations.made_for import KINDS, CalibrationKind, made_for
from rigctl.calibrations.noise import NoiseParameters
from rigctl.calibrations.polarizer import PolarizerParameters
from rigctl.calibrations.radiometric import RadiometricResponse
from rigctl.calibrations.registration import ImageRegistration
from rigctl.calibrations.store import (
    NONE,
    STORE_FOLDER,
    Choice,
    Pick,
    RigPicks,
    choose,
    read_store,
)
from rigctl.console import Json
from rigctl.errors import ConfigError
from rigctl.files.regions import Region
from rigctl.files.rig_file import PLACEHOLDER
from rigctl.measure.frames import (
    FoundCorrections,
    FrameGrid,
    Throughput,
    arrange,
    flat_division,
    flat_remarks,
    frame_shifts,
    throughput_of,
)
from rigctl.measure.measure import Measurement, measure
from rigctl.runs.folder import Run

_MOVED = (
    "frames were moved to lie on one another, bilinearly: the prediction of temporal noise follows that; texture and "
    "fixed pattern of single pixels are smoothed too, and their prediction is not"
)

_Content = TypeVar("_Content")
_Read = Callable[[Path, Run], tuple[_Content, tuple[str, ...]]]


@dataclass(frozen=True, kw_only=True)
class CalibrationPaths:
    """Files of calibrations, None is not given; a registration that helps no edges is used only if that is forced."""

    noise: Path | None = None  #: Files that are named.
    radiometric: Path | None = None
    registration: Path | None = None
    flat: Path | None = None
    polarizer: Path | None = None
    force_registration: bool = False  #: Use a registration that helps no edges too.
    picks: bool = False  #: Pick what is not named from the store, where there is one.
    store: Path | None = None  #: The store; None is the one that stands beside the rig file.
    without: tuple[str, ...] = ()  #: Kinds that are not picked.

    @property
    def files(self) -> dict[CalibrationKind, Path]:
        """Files that are named, by their kind."""
        named = {kind: getattr(self, kind) for kind in KINDS}
        return {kind: path for kind, path in named.items() if isinstance(path, Path)}

    def with_files(self, files: Mapping[CalibrationKind, Path]) -> "CalibrationPaths":
        """Return them with more files."""
        together = self.files | dict(files)
        return replace(
            self,
            noise=together.get("noise"),
            radiometric=together.get("radiometric"),
            registration=together.get("registration"),
            flat=together.get("flat"),
            polarizer=together.get("polarizer"),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class RunCalibrations:
    """Contents of calibration files, as far as there are any, and doubts about using them for a run, in words."""

    noise: NoiseParameters | None
    radiometric: RadiometricResponse | None
    registration: ImageRegistration | None
    flats: FlatFields | None
    polarizer: PolarizerParameters | None
    doubts: tuple[str, ...]
    force_registration: bool = False

    def measure(self, run: Run, regions: list[Region], found: FoundCorrections | None = None) -> Measurement:
        """Return what a run measured, processed with them, and corrected by what it shows of itself."""
        return measure(
            run,
            regions=regions,
            noise=self.noise,
            registration=self.registration,
            flats=self.flats,
            polarizer=self.polarizer,
            found=found,
            may_measure_none=True,
        )


def read_calibrations(paths: CalibrationPaths, run: Run) -> RunCalibrations:
    """Return the calibrations of a run."""
    doubts = [f"{run.path}: {PLACEHOLDER}"] if run.session.polarizer.placeholder and paths.polarizer is None else []

    def read(path: Path | None, reader: _Read[_Content]) -> _Content | None:
        if path is None:
            return None
        content, more = reader(path, run)
        doubts.extend(more)
        return content

    return RunCalibrations(
        noise=read(paths.noise, NoiseParameters.read_fitting),
        radiometric=read(paths.radiometric, RadiometricResponse.read_fitting),
        registration=read(paths.registration, ImageRegistration.read_fitting),
        flats=read(paths.flat, FlatFields.read_fitting),
        polarizer=read(paths.polarizer, PolarizerParameters.read_fitting),
        doubts=tuple(doubts),
        force_registration=paths.force_registration,
    )


def correction_remarks(measurement: Measurement, regions: list[Region]) -> tuple[str, ...]:
    """Return what was done to frames by calibrations and to regions by their repeats, in words."""
    done = measurement.corrections
    return (
        *_of_repeats(measurement),
        *(() if done.throughput is None else (_of_throughput(done.throughput),)),
        *(() if done.flat is None else flat_remarks(done.flat, regions)),
        *(() if done.shifts is None else (_MOVED,)),
    )


# Less drift than this share of the light from cycle to cycle is not worth a word.
_SMALL_DRIFT = 1e-3


def _of_repeats(measurement: Measurement) -> Iterable[str]:
    """Return which pixels the repeats of a run show to be hit, and what light that drifts was divided by."""
    for name, region in measurement.regions.items():
        if region.hit and measurement.grid.cycles > 1:
            yield (
                f"{name}: {region.hit} of {region.hit + region.pixels} pixels were hit in single frames, as by cosmic "
                "rays or pixels that jump; they are left out"
            )
        drift = region.repeatability.drift
        if abs(drift) > _SMALL_DRIFT:
            yield f"{name}: the light drifts by {drift:+.2%} a cycle; that is divided out"


def _of_throughput(throughput: Throughput) -> str:
    values = throughput.value.tolist()
    return (
        f"frames were divided by the throughput of their angle, {min(values):.4f} to {max(values):.4f}, known to "
        f"{throughput.error.max():.2%}"
    )


# As many folders above a run are looked into for its rig file.
_ABOVE = 3


@dataclass(frozen=True, kw_only=True)
class PickedCalibrations(RigPicks):
    """Calibrations of a run: those that were named, and those that were picked from the store."""

    paths: CalibrationPaths  #: all of them


def calibration_paths(
    named: Mapping[CalibrationKind, Path | None], *, store: Path | None, force_registration: bool = False
) -> CalibrationPaths:
    """Return the calibrations that a command line names; ``none`` is to have none, the others are picked."""
    if store is not None and store != NONE and not store.is_dir():
        raise ConfigError(f"--calibrations: {store}: there is no such folder")
    paths = CalibrationPaths(
        force_registration=force_registration,
        picks=store != NONE,
        store=None if store == NONE else store,
        without=tuple(kind for kind, path in named.items() if path == NONE),
    )
    return paths.with_files({kind: path for kind, path in named.items() if path is not None and path != NONE})


def calibrations_json(picked: RigPicks | None) -> dict[str, Json]:
    """Return the calibrations that were used, by kind: file, sha256, why, age_days; empty where there is no store."""
    choices = () if picked is None or picked.store is None else picked.choices
    return {one.kind: one.pick.as_json() for one in choices if one.pick is not None}


def named_calibrations(picked: RigPicks | None) -> str:
    """Return the calibrations that were used as the end of a sentence."""
    choices = () if picked is None else picked.choices
    files = [f"{one.kind} {one.pick.file.name}" for one in choices if one.pick is not None]
    return f", with {', '.join(files)}" if files else ""


def picked_for_run(paths: CalibrationPaths, run: Run, kinds: Sequence[CalibrationKind]) -> PickedCalibrations:
    """Return the calibrations of a run, those that are not named picked from the store."""
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
    return Choice(kind=kind, pick=Pick(file=path, sha256=sha256_of(path), why="named on the command line"))


def _usable(kind: CalibrationKind, run: Run, grid: FrameGrid) -> Callable[[Path], object]:
    """Return what tries a file on the frames of a run, as measuring will."""
    tries: dict[CalibrationKind, Callable[[Path], object]] = {
        "noise": lambda path: NoiseParameters.read_fitting(path, run),
        "polarizer": lambda path: throughput_of(grid, PolarizerParameters.read_fitting(path, run)[0]),
        "flat": lambda path: flat_division(grid, FlatFields.read_fitting(path, run)[0]),
        "radiometric": lambda path: RadiometricResponse.read_fitting(path, run),
        "registration": lambda path: frame_shifts(run, grid, ImageRegistration.read_fitting(path, run)[0]),
    }
    return tries[kind]
