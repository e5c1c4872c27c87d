"""Where the lens of a simulated camera is turned to: kept in its rig file, read at each frame, turned from outside."""

import re
import tomllib
from dataclasses import dataclass
from pathlib import Path

from rigctl.errors import ConfigError
from rigctl.files.rig_file import load_rig
from rigctl.files.simulation_sections import MOST_DEFOCUS_MM, SimulatedCamera, SimulationSection
from rigctl.storage.bounded_file import MOST_TEXT_BYTES, read_bounded
from rigctl.storage.durable_file import write_durably

_TABLE = re.compile(r"^\[simulation\.camera\][^\n]*\n(?:(?!\[)[^\n]*(?:\n|\Z))*", re.MULTILINE)
_LINE = re.compile(r"^(defocus_mm\s*=\s*)[^#\r\n]*?([ \t]*#[^\r\n]*)?(\r?)$", re.MULTILINE)
_UM_PER_MM = 1e3
_MM_PER_M = 1e3


class LensPosition:
    """Where a lens is turned to now.

    Parameters
    ----------
    simulation : SimulationSection
        Of the rig. Where it was read from a file, what that file says at each frame holds.
    """

    def __init__(self, simulation: SimulationSection) -> None:
        self._file = simulation.file
        self._defocus_mm = simulation.camera.defocus_mm
        self._seen = self._state()

    def defocus_m(self) -> float:
        """Return how far the detector is behind the focus [m]; of a file that cannot be read, what it said before."""
        state = self._state()
        if state != self._seen and self._file is not None:
            self._seen = state
            self._defocus_mm = _stated_mm(self._file, self._defocus_mm)
        return self._defocus_mm / _MM_PER_M

    def _state(self) -> tuple[int, int] | None:
        """Return by what a file that was written anew is told from what it was."""
        try:
            found = None if self._file is None else self._file.stat()
        except OSError:
            return None
        return None if found is None else (found.st_mtime_ns, found.st_ino)


def _stated_mm(file: Path, before_mm: float) -> float:
    try:
        content = tomllib.loads(read_bounded(file, MOST_TEXT_BYTES).decode("utf-8"))
        stated_mm = float(content["simulation"]["camera"].get("defocus_mm", 0.0))
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        return before_mm
    return stated_mm if abs(stated_mm) <= MOST_DEFOCUS_MM else before_mm


@dataclass(frozen=True, kw_only=True)
class TurnedLens:
    """A lens that was turned.

    Attributes
    ----------
    defocus_mm : float
        How far the detector is behind the focus now [mm].
    was_mm : float
        And before [mm].
    blur_px : float
        Diameter of the disk that a point becomes [pixels].
    """

    defocus_mm: float
    was_mm: float
    blur_px: float


def turn_lens(rig: Path, *, defocus_mm: float) -> TurnedLens:
    """Turn the lens of a simulated camera, also while it runs: the key in its rig file changes, the rest stays.

    Parameters
    ----------
    rig : Path
        Rig file with a table [simulation.camera].
    defocus_mm : float
        How far the detector shall be behind the focus, -5 to 5 [mm].

    Raises
    ------
    ConfigError
        The number is beyond that, or the file describes no simulated camera in a table of its own.
    """
    if not abs(defocus_mm) <= MOST_DEFOCUS_MM:
        raise ConfigError(f"--defocus-mm: is {defocus_mm:g}; must be from {-MOST_DEFOCUS_MM:g} to {MOST_DEFOCUS_MM:g}")
    camera = _simulated_camera(rig)
    # As bytes: the ends of lines stay what they are.
    text = rig.read_bytes().decode("utf-8")
    table = _TABLE.search(text)
    if table is None:
        raise ConfigError(f"{rig}: has no table [simulation.camera] of its own to write into")
    inside = _with_line(table[0], f"{defocus_mm:g}")
    try:
        write_durably(rig, (text[: table.start()] + inside + text[table.end() :]).encode("utf-8"))
    except OSError as error:
        raise ConfigError(f"{rig}: cannot be written: {error.strerror}") from error
    return TurnedLens(defocus_mm=defocus_mm, was_mm=camera.defocus_mm, blur_px=_blur_px(camera, defocus_mm))


def _simulated_camera(rig: Path) -> SimulatedCamera:
    simulation = load_rig(rig).simulation
    if simulation is None:
        raise ConfigError(f"{rig}: has no [simulation]: the lens of a real camera is turned by hand")
    return simulation.camera


def _with_line(table: str, number: str) -> str:
    was = _LINE.search(table)
    if was is None:
        end = "\r\n" if table.partition("\n")[0].endswith("\r") else "\n"
        return table.replace("\n", f"\ndefocus_mm = {number}{end}", 1)
    return f"{table[: was.start()]}{was[1]}{number}{was[2] or ''}{was[3]}{table[was.end() :]}"


def _blur_px(camera: SimulatedCamera, defocus_mm: float) -> float:
    cone = camera.aperture_diameter_mm / camera.focal_length_mm
    return cone * abs(defocus_mm) * _UM_PER_MM / camera.pixel_pitch_um
