"""What verbs share: types and options of their parameters, and `Result`, the base of what they return.

Imports nothing heavy: `--help` reads it.

A verb is a plain function. Its signature, annotations and docstring are the command, the Python call and the reference
page. Options that many verbs have stand in a `TypedDict` here and reach a verb as ``**frames: Unpack[FrameOptions]``:
flat keywords in Python, flat options on the command line, one declaration.
"""

import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from inspect import cleandoc
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias, TypedDict, cast

from cyclopts import Parameter
from cyclopts.validators import Number

from rigctl.console import Json, anonymized_content, json_text, results
from rigctl.errors import ConfigError
from rigctl.files.choices import COMMA_SEPARATED, EffectRule, Engine, LightPart, ScaleKind, SnrKind

if TYPE_CHECKING:
    from rigctl import mapped
    from rigctl.calibrations.kinds import CalibrationKind
    from rigctl.files.regions import Region
    from rigctl.files.scene_file import SceneFile
    from rigctl.measure.frames import CalibrationPaths
    from rigctl.report.document import AnyTable
    from rigctl.report.files import Content

# Python accepts text and objects that were read already; the command line makes paths of texts.
if TYPE_CHECKING:
    FilePath: TypeAlias = Path | str
    RunPath: TypeAlias = Path | str | os.PathLike[str]
    RegionsPath: TypeAlias = Path | str | Sequence[Region]
    ScenePath: TypeAlias = Path | str | SceneFile
    Changes: TypeAlias = Mapping[str, float] | Sequence[str]
else:
    Changes = Sequence[str]
    FilePath = RunPath = RegionsPath = ScenePath = Path


def scene_file_of(scene: ScenePath) -> "SceneFile":
    """Return a scene file, reading it if necessary."""
    from rigctl.files.scene_file import scene_file

    return scene_file(Path(scene) if isinstance(scene, str) else scene)


def regions_of(regions: RegionsPath | None) -> "list[Region]":
    """Return the given regions, reading their file if necessary; empty if none are given."""
    from rigctl.files.regions import load_regions

    return load_regions(Path(regions)) if isinstance(regions, str | Path) else list(regions or ())


@dataclass(frozen=True, kw_only=True)
class Writes:
    """Annotation of a parameter with a destination, which is checked before the verb begins."""

    kind: Literal["file", "folder", "new", "edited", "run", "absent"] = "file"  #: as in `storage.destination`
    names: tuple[str, ...] = ()  #: files of a folder; ``*`` stands for any text
    is_argument: bool = False  #: positional on the command line
    edits: str | None = None  #: parameter whose file may be the same; then it is edited, and its old content is kept


#: Annotation of a path whose content does not identify the results, such as an archive that grows.
NOT_AN_INPUT = "not an input"


#: Validity of a calibration [days]; the default depends on the kind.
ValidDays: TypeAlias = Annotated[float | None, Parameter(validator=Number(gte=0.0))]


# Line below the word "Parameters" in a docstring.
_PARAMETERS = "-" * len("Parameters")


def extend_help(group: type, *extended: type) -> None:
    """Add the parameters of extended groups of options to the docstring of a group."""
    own, *others = (cleandoc(str(one.__doc__)) for one in (group, *extended))
    if _PARAMETERS not in own:
        own += f"\n\nParameters\n{_PARAMETERS}"
    group.__doc__ = "\n".join([own, *(other.partition(_PARAMETERS)[2].strip() for other in others), ""])


class RunOptions(TypedDict, total=False):
    """Frames of a run to be read.

    Parameters
    ----------
    ignore_exclusions : bool
        Also use frames that were excluded by a note.
    """

    ignore_exclusions: bool


class FrameOptions(RunOptions, total=False):
    """Calibrations that frames of a run are processed with; the store supplies those that are not given.

    Parameters
    ----------
    noise : path or "none"
        Noise calibration file: noise, pattern and dark level of the camera. "none" uses none.
    polarizer : path or "none"
        Polarizer calibration file: divide by the throughput at each angle. "none" uses none.
    flat : path or "none"
        Flat-field file: divide frames by the flat fields. "none" uses none.
    register : path or "none"
        Registration file: undo the shift of the picture at each angle. "none" uses none.
    force_registration : bool
        Undo the shift even if edges do not match better afterwards.
    calibrations : path or "none"
        Folder from which calibrations that are not given are selected; default: the folder ``calibrations``
        next to the rig file. "none" selects none.
    correct : sequence of {"throughput", "dark-level", "shift"}
        Correct these faults by what the run itself shows.
    """

    noise: Annotated[FilePath | None, Parameter(show_default=False)]
    polarizer: FilePath | None
    flat: FilePath | None
    register: FilePath | None
    force_registration: bool
    calibrations: FilePath | None
    correct: Annotated[Sequence[Literal["throughput", "dark-level", "shift"]], COMMA_SEPARATED]


extend_help(FrameOptions, RunOptions)


class EffectOptions(TypedDict, total=False):
    """Effects that act in a prediction.

    Parameters
    ----------
    effects : {"safe", "all"}
        Leave out effects whose bounds stay within the tolerance (safe, the default), or leave out none (all).
    switched_on : sequence of str
        Effect that must act; rigctl effects lists the names. Repeatable.
    left_out : sequence of str
        Effect to leave out. Repeatable.
    """

    effects: EffectRule | None
    switched_on: Annotated[Sequence[str], Parameter(name="--with")]
    left_out: Annotated[Sequence[str], Parameter(name="--without")]


class ScaledOptions(FrameOptions, EffectOptions, total=False):
    """How the scale of a run and a scene are matched.

    Parameters
    ----------
    scale : {"absolute", "panel", "free"}
        Source of the scale of the counts: the scene file (absolute, the default), a radiometric calibration (panel),
        or a factor fitted to the run (free).
    radiometric : path or "none"
        Radiometric calibration file, for --scale panel.
    """

    scale: ScaleKind
    radiometric: FilePath | None


extend_help(ScaledOptions, FrameOptions, EffectOptions)


class CompareOptions(ScaledOptions, total=False):
    """How runs are compared with the model.

    Parameters
    ----------
    alpha : float
        Probability of any false disagreement, between 0 and 1; default 0.001.
    """

    alpha: float


extend_help(CompareOptions, ScaledOptions)


class EngineOptions(TypedDict, total=False):
    """Machines on which many items are processed.

    Parameters
    ----------
    scheduler : str
        Address of a dask scheduler, such as tcp://HOST:8786; default: this machine.
    workers : int
        Processes on this machine; default: one per core.
    """

    scheduler: str | None
    workers: Annotated[int | None, Parameter(validator=Number(gte=1))]


def engine_of(options: EngineOptions) -> "mapped.Engine":
    """Return the engine for the work."""
    from rigctl import mapped

    scheduler, workers = options.get("scheduler"), options.get("workers")
    if scheduler is not None and workers is not None:
        raise ConfigError("--workers: is for this machine and cannot be combined with --scheduler; give one of them")
    return mapped.Engine(scheduler=scheduler, workers=workers or os.cpu_count() or 1)


def calibrations_of(frames: FrameOptions | ScaledOptions) -> "CalibrationPaths":
    """Return the given calibration files, and the store for the others."""
    from rigctl.calibrations.store import NONE
    from rigctl.measure.frames import CalibrationPaths

    given: dict[CalibrationKind, FilePath | None] = {
        "noise": frames.get("noise"),
        "polarizer": frames.get("polarizer"),
        "flat": frames.get("flat"),
        "registration": frames.get("register"),
        "radiometric": cast(ScaledOptions, frames).get("radiometric"),
    }
    store = None if frames.get("calibrations") is None else Path(str(frames.get("calibrations")))
    if store is not None and store != NONE and not store.is_dir():
        raise ConfigError(f"--calibrations: {store}: there is no such folder")
    return CalibrationPaths(
        named={kind: Path(path) for kind, path in given.items() if path is not None},
        uses_store=store != NONE,
        store=None if store == NONE else store,
        force_registration=frames.get("force_registration", False),
    )


class PredictOptions(EffectOptions, total=False):
    """How a scene is predicted.

    Parameters
    ----------
    changes : mapping, or sequence of "KEY=VALUE"
        KEY=VALUE, such as sun.zenith_deg=40: replaces a number of the scene file or of a calibration. Repeatable.
    noise : path or "none"
        Noise calibration file, in place of the assumed noise; default: selected from the store. "none" uses none.
    radiometric : path
        Radiometric calibration file, in place of optics and efficiency of the scene file.
    calibrations : path or "none"
        Folder from which calibrations that are not given are selected; default: the folder ``calibrations``
        next to the scene file. "none" selects none.
    light : {"total", "reflected", "reflected_sun", "reflected_sky", "path"}
        Part of the light of materials to be predicted alone.
    engine : {"own", "sasktran2"}
        Radiative transfer solver: own, or sasktran2 as an independent check.
    tolerance : float
        Largest allowed numerical error, 1e-6 to 0.1: absolute in DoLP, s1, s2 and P_D, relative in radiance, counts,
        deviations and SNR. The program chooses its settings for it and lists numbers that cannot keep it.
    estimated_only : bool
        With --tolerance: also allow aerosol = "spheres", whose errors are estimated and not guaranteed.
    roc : "TARGET,BACKGROUND"
        Two regions: ROC curves for telling them apart by Stokes parameters and by intensity.
    snr : {"exact", "first-order", "both"}
        Formula of the DoLP SNR: the exact law, first order as in the paper, or both.
    """

    changes: Annotated[Changes, Parameter(name="--set")]
    noise: FilePath | None
    radiometric: FilePath | None
    calibrations: FilePath | None
    light: LightPart
    engine: Engine
    tolerance: Annotated[float | None, Parameter(validator=Number(gte=1e-6, lte=0.1))]
    estimated_only: bool
    roc: str | None
    snr: SnrKind


extend_help(PredictOptions, EffectOptions)


def changes_of(changes: Changes) -> dict[str, float]:
    """Return the changed numbers by key."""
    from rigctl.scene.scene import parse_changes

    return dict(changes) if isinstance(changes, Mapping) else parse_changes(changes)


# A sentence, a table, or a function that draws a picture as PNG, which a terminal leaves out.
Part: TypeAlias = "str | AnyTable | Callable[[], bytes]"
# Files of a result by name.
Files: TypeAlias = "Mapping[str, Content]"


class Result:
    """Base of the results of verbs: text and tables for people, JSON for programs, and an exit code."""

    def content(self) -> Iterable[Part]:
        """Return text and tables, the answer first."""
        return ()

    def as_json(self) -> Mapping[str, Json] | Sequence[Mapping[str, Json]]:
        """Return the content for JSON."""
        return {}

    @property
    def notes(self) -> Sequence[str]:
        """Return notes, which a notebook shows below the content and the command line has printed before."""
        return ()

    @property
    def exit_code(self) -> int:
        """Exit code of the command: 0, or a code of docs/codes.md."""
        return 0

    def output_files(self) -> Files:
        """Return the files of this result: their names and what they hold."""
        return {}

    def write(self, folder: Path) -> tuple[str, ...]:
        """Write the files of this result into a folder, which is created if needed; return their names."""
        from rigctl.report.files import write_folder

        return write_folder(folder, self.output_files())

    def show(self) -> None:
        """Print the content on standard output."""
        for part in self.content():
            if not callable(part):
                results().print(part, markup=False)

    def show_json(self) -> None:
        """Print the JSON on standard output."""
        sys.stdout.write(json_text(anonymized_content(self.as_json())))

    def follow(self) -> None:
        """Continue after the content was shown: a page answers until Ctrl-C."""

    def _repr_html_(self) -> str:
        from rigctl.report.files import notebook_html

        return notebook_html((*self.content(), *self.notes))
