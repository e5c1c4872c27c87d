"""Dark and flat frames for a noise calibration, out of a run folder or an EMVA 1288 data set."""

import hashlib
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from calibration.results import Flag
from calibration.sensor.curves import StatedExposures
from calibration.sensor.levels import LevelKind
from model.processing.mosaic import mosaic
from rigctl.calibrations.made_for import MadeFor, made_for
from rigctl.calibrations.noise.emva_descriptor import read_emva_descriptor
from rigctl.calibrations.noise.run_checks import record_flags
from rigctl.errors import DataError
from rigctl.files.choices import SECONDS_PER_UNIT, ExposureUnit
from rigctl.images.image_file import read_image
from rigctl.runs.frame_record import FrameRecord
from rigctl.runs.run_folder import MANIFEST_FILE, Run
from rigctl.runs.wholeness import used_run
from rigctl.storage.bounded_file import MOST_FRAME_BYTES, sha256_of

Shot = tuple[FrameRecord, ...]
Loader = Callable[[], NDArray[np.uint16]]


@dataclass(frozen=True, kw_only=True)
class FrameGroup:
    """Frames that differ by noise only.

    Attributes
    ----------
    kind : {"dark", "flat"}
        Without light, or with even light.
    exposure_s : float or None
        Exposure time [s].
    photons : float or None
        Mean photons a pixel, where somebody measured them.
    loaders : tuple of callables
        Each reads one frame, in the order in which they were taken.
    """

    kind: LevelKind
    exposure_s: float | None
    loaders: tuple[Loader, ...]
    photons: float | None = None


@dataclass(frozen=True, kw_only=True)
class CameraSetting:
    """A camera and its settings; None where one is not known."""

    model: str | None
    serial: str | None
    gain_db: float | None
    bit_depth: int


@dataclass(frozen=True, kw_only=True)
class FrameSource:
    """Origin of frames.

    Attributes
    ----------
    kind : {"run", "emva", "folder", "table"}
        A run folder, an EMVA 1288 data set, a folder of images, or a table of them.
    path : str
        Folder, descriptor or table.
    sha256 : str
        Of the run's manifest, of the descriptor or table, or of the names of the images.
    frames_sha256 : str
        Over the SHA-256 of every frame's file, in the order of use.
    """

    kind: Literal["run", "emva", "folder", "table"]
    path: str
    sha256: str
    frames_sha256: str


@dataclass(frozen=True, kw_only=True)
class FrameSet:
    """All frames of a calibration, where their exposures are stated, and what was odd about how they were taken."""

    groups: tuple[FrameGroup, ...]
    camera: CameraSetting
    made_for: MadeFor
    source: FrameSource
    flags: tuple[Flag, ...] = ()
    stated: StatedExposures = field(default_factory=StatedExposures)


def run_frames(path: Path, *, ignore_exclusions: bool = False) -> FrameSet:
    """Return the dark and flat frames of a run, by kind, exposure and polarizer angle.

    Parameters
    ----------
    path : Path
        Run folder.
    ignore_exclusions : bool
        Take excluded frames, too.

    Raises
    ------
    RunFolderError
        It is none, or is damaged.
    DataError
        It has no dark and flat frames, or they were not all taken with one setting of one camera.
    """
    run = used_run(path, ignore_exclusions=ignore_exclusions)
    _refuse_interpolated(run)
    groups: dict[tuple[LevelKind, float | None, float | None], list[Shot]] = defaultdict(list)
    for shot in _shots(run.frames):
        if shot[0].kind != "scene":
            groups[shot[0].kind, _alike(shot[0].exposure_s), _light(shot[0])].append(shot)
    records = [record for group in groups.values() for shot in group for record in shot]
    if not records:
        raise DataError(f"{path}: has no dark and no flat frames; `rigctl acquire` and `rigctl import` make them")
    return FrameSet(
        groups=tuple(
            FrameGroup(kind=kind, exposure_s=exposure_s, loaders=tuple(partial(_picture, run, shot) for shot in group))
            for (kind, exposure_s, _), group in groups.items()
        ),
        camera=_common_setting(path, records),
        made_for=made_for(run, records),
        source=FrameSource(
            kind="run",
            path=str(path),
            sha256=sha256_of(path / MANIFEST_FILE),
            frames_sha256=_digest(record.checksum.removeprefix("sha256:") for record in records),
        ),
        flags=record_flags(sorted(records, key=lambda record: record.sequence)),
        stated=StatedExposures(where="the record of the run", unit="s", has_option=False),
    )


def _shots(frames: Sequence[FrameRecord]) -> list[Shot]:
    """Return frames by exposure: each by itself, or the parts behind a cell of polarizers together."""
    shots: dict[tuple[str, int], list[FrameRecord]] = defaultdict(list)
    for record in frames:
        key = ("frame", record.sequence) if record.exposure_id is None else ("cell", record.exposure_id)
        shots[key].append(record)
    return [tuple(shot) for shot in shots.values()]


def _picture(run: Run, shot: Shot) -> NDArray[np.uint16]:
    """Return the picture of an exposure, its parts back in their places: each pixel is one of the sensor."""
    if len(shot) == 1:
        return run.counts(shot[0])
    return mosaic([run.counts(record) for record in shot])


def _refuse_interpolated(run: Run) -> None:
    if run.session.interpolation != "none":
        raise DataError(
            f"{run.path}: its frames were interpolated ({run.session.interpolation}), so that neighbours share their "
            'noise: take frames for a calibration with interpolation = "none"'
        )


def _light(record: FrameRecord) -> float | None:
    """Return the polarizer angle that a flat was taken at: another angle may be another brightness."""
    if record.kind == "dark":
        return None
    target_deg = record.polarizer_angle_target_deg
    return target_deg if target_deg is not None else _alike(record.polarizer_angle_deg)


def _alike(number: float | None) -> float | None:
    """Return a number to six digits: a readback differs from frame to frame in the last ones."""
    return None if number is None else float(f"{number:.6g}")


def _common_setting(path: Path, records: Sequence[FrameRecord]) -> CameraSetting:
    """Return the setting that all frames share; refuse them if they share none."""
    facts: dict[str, set[Any]] = {
        "camera_model": {record.camera_model for record in records},
        "camera_serial": {record.camera_serial for record in records},
        "gain_db": {record.gain_db for record in records},
        "bit_depth": {record.bit_depth for record in records},
        "size": {(record.height, record.width) for record in records},
    }
    mixed = [f"{name}: {', '.join(sorted(map(str, values)))}" for name, values in facts.items() if len(values) > 1]
    if mixed:
        raise DataError(
            f"{path}: dark and flat frames differ in what has to be the same for a calibration; make one run a "
            f"setting\n  " + "\n  ".join(mixed)
        )
    first = records[0]
    return CameraSetting(
        model=first.camera_model, serial=first.camera_serial, gain_db=first.gain_db, bit_depth=first.bit_depth
    )


def emva_frames(
    path: Path, *, exposure_unit: ExposureUnit | None = None, most_bytes: int = MOST_FRAME_BYTES
) -> FrameSet:
    """Return the frames of an EMVA 1288 data set.

    Parameters
    ----------
    path : Path
        Its descriptor file.
    exposure_unit : str or None
        Unit of its exposures; None is nanoseconds, as the format wants.
    most_bytes : int
        A picture of more bytes of samples is refused.

    Raises
    ------
    ConfigError
        The descriptor is wrong.
    """
    descriptor = read_emva_descriptor(path)
    factor = SECONDS_PER_UNIT[exposure_unit or "ns"] / SECONDS_PER_UNIT["ns"]
    shape = (descriptor.height, descriptor.width)
    return FrameSet(
        groups=tuple(
            FrameGroup(
                kind=group.kind,
                exposure_s=float(f"{group.exposure_s * factor:.9g}"),
                loaders=tuple(partial(_read_emva_image, file, shape, most_bytes) for file in group.files),
                photons=group.photons or None,
            )
            for group in descriptor.groups
        ),
        camera=CameraSetting(model=None, serial=None, gain_db=None, bit_depth=descriptor.bit_depth),
        made_for=MadeFor(bit_depth=descriptor.bit_depth),
        source=FrameSource(
            kind="emva",
            path=str(path),
            sha256=sha256_of(path),
            frames_sha256=files_digest([file for group in descriptor.groups for file in group.files]),
        ),
        stated=StatedExposures(where="the descriptor", unit=exposure_unit or "ns"),
    )


def _read_emva_image(file: Path, shape: tuple[int, int], most_bytes: int) -> NDArray[np.uint16]:
    try:
        counts = read_image(file, most_bytes=most_bytes).counts
    except DataError as error:
        raise DataError(f"{file}: {error}") from error
    if counts.shape != shape:
        raise DataError(f"{file}: has {counts.shape} rows and columns; the descriptor says {shape}")
    return counts


def files_digest(files: Sequence[Path]) -> str:
    """Return the SHA-256 over the SHA-256 of each file."""
    with ThreadPoolExecutor() as pool:
        return _digest(pool.map(sha256_of, files))


def _digest(sha256s: Iterable[str]) -> str:
    return hashlib.sha256("".join(sha256s).encode("ascii")).hexdigest()
