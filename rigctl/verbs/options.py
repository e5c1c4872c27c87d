"""Types and options that several verbs share. Imports nothing heavy: `--help` reads it.

A verb is a plain function. Its signature, annotations and docstring are the command, the Python call and the reference
page. Options that many verbs have stand in a `TypedDict` here and reach a verb as ``**frames: Unpack[FrameOptions]``:
flat keywords in Python, flat options on the command line, one declaration.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from inspect import cleandoc
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, TypedDict, cast

from cyclopts import Parameter, Token, convert
from cyclopts.validators import Number

from rigctl.errors import ConfigError
from rigctl.files.choices import EffectRule, Engine, LightPart, ScaleKind, SnrKind

if TYPE_CHECKING:
    from rigctl import mapped
    from rigctl.calibrations.made_for import CalibrationKind
    from rigctl.files.regions import Region
    from rigctl.files.scene_file import SceneFile
    from rigctl.measure.calibrations import CalibrationPaths

# Python takes texts and what it has read already; the command line makes a path of every text.
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
    """Return a scene file, read unless it was read already.

    Raises
    ------
    ConfigError
        The file is wrong.
    """
    from rigctl.files.scene_file import scene_file

    return scene_file(Path(scene) if isinstance(scene, str) else scene)


def regions_of(regions: RegionsPath | None) -> "list[Region]":
    """Return the regions of a file or of a program; none where none are given.

    Raises
    ------
    ConfigError
        The file is wrong.
    """
    from rigctl.files.regions import load_regions

    return load_regions(Path(regions)) if isinstance(regions, str | Path) else list(regions or ())


@dataclass(frozen=True, kw_only=True)
class Writes:
    """Annotation of a parameter that names a destination, which is tried before the verb begins."""

    kind: Literal["file", "folder", "new", "edited", "run", "absent"] = "file"  #: as in `storage.destination`
    names: tuple[str, ...] = ()  #: files of a folder; ``*`` stands for any text
    is_argument: bool = False  #: has no dashes on the command line
    edits: str | None = None  #: parameter whose file may be the same one: it is edited then, its old content kept


#: Annotation of a path whose content does not identify the results, such as an archive that grows.
NOT_AN_INPUT = "not an input"


def _words(kind: type, tokens: Sequence[Token]) -> Any:
    texts = [word.strip() for token in tokens for word in token.value.split(",")]
    return convert(kind, [tokens[0].evolve(value=word) for word in texts])


#: Several words in one option, with commas between them.
COMMA_SEPARATED = Parameter(converter=_words, n_tokens=1, allow_leading_hyphen=True)

#: Largest picture that is read [MB of samples].
MaxFrameMb: TypeAlias = Annotated[int, Parameter(validator=Number(gte=1, lte=100_000))]

#: For how many days a calibration holds; the kind says how long where it is not given.
ValidDays: TypeAlias = Annotated[float | None, Parameter(validator=Number(gte=0.0))]


# Below the word that begins the parameters of a docstring.
_PARAMETERS = "-" * len("Parameters")


def extend_help(group: type, *extended: type) -> None:
    """Add to the docstring of a group of options the parameters of the groups that it extends."""
    own, *others = (cleandoc(str(one.__doc__)) for one in (group, *extended))
    if _PARAMETERS not in own:
        own += f"\n\nParameters\n{_PARAMETERS}"
    group.__doc__ = "\n".join([own, *(other.partition(_PARAMETERS)[2].strip() for other in others), ""])


class RunOptions(TypedDict, total=False):
    """Which frames of a run are read.

    Parameters
    ----------
    ignore_exclusions : bool
        Take frames too that people have excluded.
    """

    ignore_exclusions: bool


class FrameOptions(RunOptions, total=False):
    """Calibrations that frames of a run are processed with; one that is not named is picked from the store.

    Parameters
    ----------
    noise : path or "none"
        Noise calibration: texture, noise and dark level. none: pick none.
    polarizer : path or "none"
        Polarizer calibration: divide by each angle's throughput. none: pick none.
    flat : path or "none"
        Flat fields: divide frames by them. none: pick none.
    register : path or "none"
        Registration: move frames to lie on one another. none: pick none.
    force_registration : bool
        Move frames even where edges lie no better for it.
    calibrations : path or "none"
        Store to pick calibrations from; the folder ``calibrations`` beside the rig file unless given. none: pick none.
    correct : sequence of {"throughput", "dark-level", "shift"}
        Correct the faults of these names as the run itself shows them.
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
    """Which effects act in a prediction.

    Parameters
    ----------
    effects : {"safe", "all"}
        Leave effects out by their bounds within the tolerance (safe, the default), or leave none out (all).
    switched_on : sequence of str
        Let the effect of this name act, whatever its bound; rigctl effects lists the names. Repeatable.
    left_out : sequence of str
        Leave the effect of this name out, whatever its bound. Repeatable.
    """

    effects: EffectRule | None
    switched_on: Annotated[Sequence[str], Parameter(name="--with")]
    left_out: Annotated[Sequence[str], Parameter(name="--without")]


class ScaledOptions(FrameOptions, EffectOptions, total=False):
    """How a run and a scene are brought together.

    Parameters
    ----------
    scale : {"absolute", "panel", "free"}
        What the counts are scaled by: the scene file (absolute, the default), a radiometric calibration (panel), or a
        factor that is fitted to the run (free).
    radiometric : path or "none"
        Radiometric calibration, for scale panel.
    """

    scale: ScaleKind
    radiometric: FilePath | None


extend_help(ScaledOptions, FrameOptions, EffectOptions)


class CompareOptions(ScaledOptions, total=False):
    """How runs are compared with the model.

    Parameters
    ----------
    alpha : float
        Chance of any false disagreement, 0 to 1; 0.001 unless given.
    """

    alpha: float


extend_help(CompareOptions, ScaledOptions)


class EngineOptions(TypedDict, total=False):
    """Where thousands of items are worked on.

    Parameters
    ----------
    scheduler : str
        Address of a scheduler of dask, tcp://HOST:8786; this machine unless given.
    workers : int
        Processes on this machine; one for each core unless given.
    """

    scheduler: str | None
    workers: Annotated[int | None, Parameter(validator=Number(gte=1))]


def engine_of(options: EngineOptions) -> "mapped.Engine":
    """Return where the work is done.

    Raises
    ------
    ConfigError
        A scheduler and a number of workers are given.
    """
    from rigctl import mapped

    scheduler, workers = options.get("scheduler"), options.get("workers")
    if scheduler is not None and workers is not None:
        raise ConfigError("--workers: is of this machine; a scheduler has its own")
    return mapped.Engine(scheduler=scheduler, workers=workers or os.cpu_count() or 1)


def calibrations_of(frames: FrameOptions | ScaledOptions) -> "CalibrationPaths":
    """Return the calibration files that the options name, and the store that the others are picked from.

    Raises
    ------
    ConfigError
        The store that is named is no folder.
    """
    from rigctl.measure.calibrations import calibration_paths

    named: dict[CalibrationKind, FilePath | None] = {
        "noise": frames.get("noise"),
        "polarizer": frames.get("polarizer"),
        "flat": frames.get("flat"),
        "registration": frames.get("register"),
        "radiometric": cast(ScaledOptions, frames).get("radiometric"),
    }
    store = frames.get("calibrations")
    return calibration_paths(
        {kind: None if path is None else Path(path) for kind, path in named.items()},
        store=None if store is None else Path(store),
        force_registration=frames.get("force_registration", False),
    )


class PredictOptions(EffectOptions, total=False):
    """How a scene is predicted.

    Parameters
    ----------
    changes : mapping, or sequence of "KEY=VALUE"
        Numbers in place of those of the file and of the calibrations, by keys such as sun.zenith_deg. Repeatable.
    noise : path or "none"
        Noise calibration in place of the assumed noise; picked from the store unless named. none: pick none.
    radiometric : path
        Radiometric calibration, in place of optics and efficiency.
    calibrations : path or "none"
        Store to pick calibrations from; the folder ``calibrations`` beside the scene file unless given. none: pick
        none.
    light : {"total", "reflected", "reflected_sun", "reflected_sky", "path"}
        Predict as if only this part of the light of materials came.
    engine : {"own", "sasktran2"}
        Solver of the light of the air: own, or sasktran2 as an independent check.
    tolerance : float
        Largest numerical error, 1e-6 to 0.1: absolute in DoLP, s1, s2 and P_D, relative in radiance, counts, deviations
        and SNR. Settings are chosen and errors estimated; numbers that cannot keep it are listed (docs/accuracy.md).
    estimated_only : bool
        With a tolerance: aerosol = spheres too, whose errors are estimated and not promised.
    roc : "TARGET,BACKGROUND"
        Whole ROC curves of a pair of regions, on Stokes parameters and on intensity.
    snr : {"exact", "first-order", "both"}
        DoLP SNR that is shown: of the exact law, to first order ([MK14]), or both.
    """

    changes: Annotated[Changes, Parameter(name="--set")]
    noise: FilePath | None
    radiometric: FilePath | None
    calibrations: FilePath | None
    light: LightPart
    engine: Engine
    tolerance: float | None
    estimated_only: bool
    roc: str | None
    snr: SnrKind


extend_help(PredictOptions, EffectOptions)


def changes_of(changes: Changes) -> dict[str, float]:
    """Return the numbers that are changed, by their keys.

    Raises
    ------
    ConfigError
        A text cannot be read, or a number is given twice.
    """
    from rigctl.scene.scene import parse_changes

    return dict(changes) if isinstance(changes, Mapping) else parse_changes(changes)
