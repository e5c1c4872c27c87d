"""Measuring a rotation stage by itself: a rig file in; readback errors, backlash and settling out."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rigctl.devices.characterisation_file import CharacterisationFile, as_text, characterisation_file
from rigctl.devices.characterise import SIDES, Characterisation, characterise
from rigctl.devices.stages import open_stage
from rigctl.errors import ConfigError
from rigctl.files.rig_file import RigFile, load_rig
from rigctl.files.session_file import DEFAULT_ANGLES_DEG, load_session
from rigctl.storage.durable_file import write_durably

# So wide that a landing is measured as it is: a correction would come from the other side.
_TOLERANCE_DEG = 1.0


@dataclass(frozen=True, kw_only=True)
class CharacteriseRequest:
    """A measurement of a stage.

    Attributes
    ----------
    rig : Path
        Rig file; only its stage is opened.
    session : Path or None
        Session file whose angles are visited; None: the usual ones.
    out, plot : Path or None
        Files to write: numbers, and a picture.
    repeats : int
        Visits of each angle from each side, at least 2.
    band_deg : float
        What counts as rest [deg].
    watch_s : float
        How long each visit is watched [s].
    """

    rig: Path
    session: Path | None = None
    out: Path | None = None
    plot: Path | None = None
    repeats: int = 3
    band_deg: float = 0.01
    watch_s: float = 1.0


@dataclass(frozen=True, kw_only=True)
class CharacterisedStage:
    """A measured stage, and its file."""

    result: Characterisation
    file: CharacterisationFile


# Told after each visit how many there will be in all.
Progress = Callable[[int], None]
Warn = Callable[[str], None]


def characterise_stage(request: CharacteriseRequest, *, progress: Progress, warn: Warn) -> CharacterisedStage:
    """Return what a stage's own readings say of it; write what was asked for.

    Raises
    ------
    ConfigError, DeviceError
        A file is wrong, or the stage fails.
    """
    _require_folders(request.out, request.plot)
    rig_file = load_rig(request.rig)
    result = _measured(rig_file, _stage_angles_deg(rig_file, request.session), request, progress, warn)
    file = characterisation_file(result)
    if request.out is not None:
        write_durably(request.out, as_text(file))
    if request.plot is not None:
        from rigctl.reports.figures.rig_figures import (
            characterisation_png,  # half a second, for a plot only
        )

        write_durably(request.plot, characterisation_png(result))
    return CharacterisedStage(result=result, file=file)


def _require_folders(*files: Path | None) -> None:
    for file in files:
        if file is not None and not file.parent.is_dir():
            raise ConfigError(f"{file}: there is no folder {file.parent}")


def _stage_angles_deg(rig: RigFile, session: Path | None) -> tuple[float, ...]:
    """Return the stage angles of a session's polarizer angles, each once."""
    if session is None:
        polarizer_deg: tuple[float | None, ...] = DEFAULT_ANGLES_DEG
    else:
        polarizer_deg = tuple(angle for take in load_session(session).take for angle in take.polarizer_angles_deg)
    turned = (rig.polarizer.sense * (angle - rig.polarizer.offset_deg) for angle in polarizer_deg if angle is not None)
    angles_deg = tuple(dict.fromkeys(angle % 360.0 for angle in turned))
    if not angles_deg:
        raise ConfigError(f"{session}: names no angle")
    return angles_deg


def _measured(
    rig: RigFile,
    angles_deg: tuple[float, ...],
    request: CharacteriseRequest,
    progress: Progress,
    warn: Warn,
) -> Characterisation:
    if rig.stage is None:
        raise ConfigError(f"rig {rig.name}: has no [stage] to characterise")
    section = rig.stage.model_copy(update={"characterisation": None, "tolerance_deg": _TOLERANCE_DEG})
    visits = len(angles_deg) * request.repeats * len(SIDES)
    with open_stage(section, warn=warn) as opened:
        return characterise(
            opened,
            angles_deg,
            repeats=request.repeats,
            band_deg=request.band_deg,
            watch_s=request.watch_s,
            progress=lambda _: progress(visits),
        )
