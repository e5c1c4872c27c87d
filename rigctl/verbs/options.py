"""Types and options that several verbs share. Imports nothing heavy: `--help` reads it.

A verb is a plain function. Its signature, annotations and docstring are the command, the Python call and the reference
page. Options that many verbs have stand in a `TypedDict` here and reach a verb as ``**frames: Unpack[FrameOptions]``:
flat keywords in Python, flat options on the command line, one declaration.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, TypedDict

from cyclopts import Parameter, Token, convert
from cyclopts.validators import Number

if TYPE_CHECKING:
    from rigctl.calibrations.store import CalibrationKind
    from rigctl.files.regions import Region
    from rigctl.files.scene_file import SceneFile
    from rigctl.interface.run import Run
    from rigctl.measurement.run_calibrations import CalibrationPaths

# Python takes texts and what it has read already; the command line makes a path of every text.
if TYPE_CHECKING:
    FilePath: TypeAlias = Path | str
    RunPath: TypeAlias = Path | str | Run
    RegionsPath: TypeAlias = Path | str | Sequence[Region]
    ScenePath: TypeAlias = Path | str | SceneFile
else:
    FilePath = RunPath = RegionsPath = ScenePath = Path


def path_of(run: RunPath) -> Path:
    """Return the folder of a run."""
    return Path(run) if isinstance(run, str | Path) else run.path


def scene_file_of(scene: ScenePath) -> "SceneFile":
    """Return a scene file, read unless it was read already.

    Raises
    ------
    ConfigError
        The file is wrong.
    """
    from rigctl.files.scene_file import scene_file

    return scene_file(Path(scene) if isinstance(scene, str) else scene)


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


class FrameOptions(TypedDict, total=False):
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
    ignore_exclusions : bool
        Take frames too that people have excluded.
    """

    noise: Annotated[FilePath | None, Parameter(show_default=False)]
    polarizer: FilePath | None
    flat: FilePath | None
    register: FilePath | None
    force_registration: bool
    calibrations: FilePath | None
    correct: Annotated[Sequence[Literal["throughput", "dark-level", "shift"]], COMMA_SEPARATED]
    ignore_exclusions: bool


def calibrations_of(frames: FrameOptions) -> "CalibrationPaths":
    """Return the calibration files that the options name, and the store that the others are picked from.

    Raises
    ------
    ConfigError
        The store that is named is no folder.
    """
    from rigctl.measurement.picked_calibrations import calibration_paths

    named: dict[CalibrationKind, FilePath | None] = {
        "noise": frames.get("noise"),
        "polarizer": frames.get("polarizer"),
        "flat": frames.get("flat"),
        "registration": frames.get("register"),
    }
    store = frames.get("calibrations")
    return calibration_paths(
        {kind: None if path is None else Path(path) for kind, path in named.items()},
        store=None if store is None else Path(store),
        force_registration=frames.get("force_registration", False),
    )
