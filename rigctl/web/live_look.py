"""Devices at work for a page: which are open, what they shall do, and what they see."""

from dataclasses import dataclass
from typing import Literal

from drivers.interfaces import Camera, RotationStage
from rigctl.files.choices import Interpolation

TaskKind = Literal["rest", "preview", "polarimetry"]


@dataclass(frozen=True, kw_only=True)
class Cell:
    """Axes of a cell of polarizers, row by row [deg], and what is made of its pictures."""

    axes_deg: tuple[float, ...]
    interpolation: Interpolation


@dataclass(frozen=True, kw_only=True, eq=False)
class OpenDevices:
    """Devices that are open; no stage where there is none, a cell where the camera has polarizers on its pixels."""

    camera: Camera
    stage: RotationStage | None
    cell: Cell | None = None


@dataclass(frozen=True, kw_only=True)
class Task:
    """What the devices shall do.

    Attributes
    ----------
    kind : str
        "rest" closes the devices; "preview" takes picture after picture; "polarimetry" turns through the angles.
    exposure_s : float
        Integration time, above 0 [s].
    gain_db : float
        The camera's gain setting [dB].
    angles_deg : tuple of float
        Of the polarizer, for "polarimetry" [deg].
    zoom : int
        The middle is shown and judged, so many times larger; at least 1.
    """

    kind: TaskKind = "rest"
    exposure_s: float = 0.01
    gain_db: float = 0.0
    angles_deg: tuple[float, ...] = (0.0, 45.0, 90.0, 135.0)
    zoom: int = 1


@dataclass(frozen=True, kw_only=True)
class LiveLook:
    """What the devices do and see now.

    Attributes
    ----------
    task : str
        As in `Task`.
    exposure_ms, gain_db : float
        As set [ms], [dB].
    sequence, maps_sequence : int
        Number of the newest picture, and of the newest maps; 0 where there is none.
    angle_deg : float or None
        Of the polarizer at the newest picture, by readback [deg].
    sharpness, best_sharpness : float
        Of the newest picture and the largest since the task began; to be compared with itself only.
    brightest, clipped : float
        The 99.5 % quantile as a share of the range, and the share of saturated pixels.
    proposed_ms : float or None
        Exposure at which the brightest parts come to 70 % of the range [ms]; None where that cannot be told.
    cycles_per_min : float or None
        How fast the polarizer goes round.
    dark_dn : float or None
        Level without light that the maps subtract [DN]; None where none was taken at this exposure: DoLP reads too low.
    zoom : int
        As in `Task`.
    left, top, width, height : int
        The part of the camera's picture that is shown: its first column and row, and its size [pixel].
    problem : str
        What stopped the task; empty where nothing did.
    """

    task: TaskKind = "rest"
    exposure_ms: float = 10.0
    gain_db: float = 0.0
    sequence: int = 0
    maps_sequence: int = 0
    angle_deg: float | None = None
    sharpness: float = 0.0
    best_sharpness: float = 0.0
    brightest: float = 0.0
    clipped: float = 0.0
    proposed_ms: float | None = None
    cycles_per_min: float | None = None
    dark_dn: float | None = None
    zoom: int = 1
    left: int = 0
    top: int = 0
    width: int = 0
    height: int = 0
    problem: str = ""
