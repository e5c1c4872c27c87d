"""A case of a study and the scene it is of, each known by the hash of what its numbers follow from."""

import hashlib
import json
from dataclasses import dataclass, field
from pathlib import Path

from rigctl.cluster import on_dask
from rigctl.files.scene_file import SceneFile, load_scene

# What a number hangs on, beside the inputs.
PACKAGES = ("model", "rigctl.files", "rigctl.scene", "rigctl.prediction", "rigctl.study")


@dataclass(frozen=True, kw_only=True)
class StudyScene:
    """A scene of a study; two are one where their digests are.

    Attributes
    ----------
    digest : str
        SHA-256 of the file and of the files that it names.
    name : str
        The file's name without ending: what cases are told by.
    file : SceneFile
        Its content. Files that it names are read where a case is computed, under the same paths.
    """

    digest: str
    name: str = field(compare=False)
    file: SceneFile = field(compare=False, repr=False)


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """What is computed of every case.

    Attributes
    ----------
    columns : tuple of (str, str)
        Quantity and statistic of each region.
    detection : bool
        Whether every ordered pair's probability of detection and area under the curve is wanted.
    roc : str or None
        Pair whose whole curves are wanted.
    tolerance : float or None
        Largest numerical error; None: the settings of the scene file.
    """

    columns: tuple[tuple[str, str], ...]
    detection: bool
    roc: str | None
    tolerance: float | None


@dataclass(frozen=True, kw_only=True)
class Case:
    """One case: its place in the study, that of its scene among the scenes, and numbers in the place of the file's."""

    number: int
    scene: int
    values: tuple[tuple[str, float], ...]


def case_hash(case: Case, scene: StudyScene, wanted: Wanted) -> str:
    """Return what a case is known by: the hash of its inputs, of what is wanted, and of the code."""
    said = [scene.digest, sorted(case.values), wanted.columns, wanted.detection, wanted.roc, wanted.tolerance]
    return hashlib.sha256(json.dumps([code_version(), *said]).encode()).hexdigest()


def study_scene(path: Path) -> StudyScene:
    """Return a scene with its digest.

    Raises
    ------
    ConfigError
        The file cannot be read or has problems.
    """
    file = load_scene(path)
    return StudyScene(digest=scene_digest(file), name=path.stem, file=file)


def scene_digest(file: SceneFile) -> str:
    """Return the hash of a scene's content and of the files that it names, as they are here and now."""
    digest = hashlib.sha256(file.model_dump_json().encode())
    table = None if file.atmosphere is None else file.atmosphere.table
    materials = (Path(region.material) for region in file.regions if region.material is not None)
    for named in (*materials, *(() if table is None else (table,))):
        if named.is_file():  # others are names of the library
            digest.update(named.read_bytes())
    return digest.hexdigest()


def code_version() -> str:
    """Return the program's version with a hash of the code that numbers follow from."""
    return on_dask.code_version(PACKAGES)
