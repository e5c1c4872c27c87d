"""Interfaces of a rotation stage and of a camera, and the records that they hand back.

Real and simulated devices keep the same promises; the suites in ``tests/contracts`` hold them to these.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, kw_only=True)
class DeviceIdentity:
    """Identity of a device. It goes into every frame; a configured serial number is checked against it."""

    model: str
    serial_number: str
    firmware: str


@dataclass(frozen=True, kw_only=True)
class StagePosition:
    """Position of a stage by its own encoder: the mechanical angle, and the counts it was computed from."""

    angle_deg: float
    counts: int


@dataclass(frozen=True, kw_only=True)
class Move:
    """A finished move, as it went.

    Attributes
    ----------
    target_deg : float
        The angle that was asked for.
    position : StagePosition
        The readback after the move: this, and not the target, is where the stage stands.
    tries : int
        How many times the move was commanded until the readback was within tolerance.
    duration_s : float
        From the first command to the readback that was accepted.
    remarks : tuple of str
        What else the device said meanwhile, such as a button of its handset being pressed.
    """

    target_deg: float
    position: StagePosition
    tries: int
    duration_s: float
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class StageStatus:
    """State of a stage, in its own words.

    Attributes
    ----------
    moving : bool
        Whether it turns.
    homed : bool
        Whether it is known to have found its reference mark since its power-up.
    code : int or str
        The device's own status: a number, its status bits, or its flags; 0 or "--" for nothing to tell.
    meaning : str
        What the device's manual says that the code means.
    """

    moving: bool
    homed: bool
    code: int | str
    meaning: str


MosaicDeg = tuple[float, float, float, float]

Way = Literal["short", "forward", "backward"]
"""Way round: the shorter one, or always towards larger or smaller angles (to take up backlash)."""


class RotationStage(Protocol):
    """A stage that turns the polarizer. A context manager: leaving it closes the port."""

    def __enter__(self) -> "RotationStage": ...

    def __exit__(self, *exc_info: object) -> None: ...

    def identify(self) -> DeviceIdentity:
        """Return what the device says of itself."""

    def home(self) -> StagePosition:
        """Search the reference mark; return the readback."""

    def move_to(self, angle_deg: float, *, way: Way = "short") -> Move:
        """Go to a mechanical angle (any real number, taken modulo 360), and return once it is there.

        Where a first try lands outside of the tolerance, the correction goes the short way. A target that is
        within the tolerance already is not gone round to.

        Raises
        ------
        DeviceFaultError
            The device reports a fault, such as a stall.
        DeviceTimeoutError
            The device is silent or slower than its deadline.
        LimitError
            The readback stays further from the target than the tolerance, the angle is not finite, or the
            stage is not known to have found its reference mark: `home` it first.
        """

    def position(self) -> StagePosition:
        """Read the encoder."""

    def status(self) -> StageStatus:
        """Ask the device what it is doing; a fault that it remembers is told here and raises nothing."""

    def stop(self) -> None:
        """Stop any motion that the device is able to stop."""

    def close(self) -> None:
        """Release the port. May be called twice."""


@dataclass(frozen=True, kw_only=True)
class CameraSettings:
    """Settings of a camera, as read back from it.

    Attributes
    ----------
    exposure_s : float
        Integration time.
    gain_db : float
        The camera's own gain setting; it is not a calibrated gain in DN per electron.
    width, height : int
        Size of a frame in pixels.
    bit_depth : int
        Bits per sample; the largest possible count is ``2**bit_depth - 1``, right-justified.
    """

    exposure_s: float
    gain_db: float
    width: int
    height: int
    bit_depth: int


StartSource = Literal["ptp", "camera clock", "trigger", "arrival", "driver", "file", "simulation"]
"""Source of an exposure's start: the camera's time stamp, by PTP or by its clock held against the host's; between
trigger and first packet; before the first packet; the video driver's time stamp; a file's change; the simulation."""


@dataclass(frozen=True, kw_only=True)
class Frame:
    """One picture, with what is needed to interpret it.

    Attributes
    ----------
    counts : (H, W) array of uint16
        Samples in DN as the camera gave them; the first row is the top of the scene.
    settings : CameraSettings
        What the camera was set to while it took this picture.
    sequence : int
        The camera's own frame counter.
    start_utc_ns, end_utc_ns : int
        Start and end of the exposure, in nanoseconds since 1970 (UTC).
    start_monotonic_ns : int
        Start of the exposure on the host's monotonic clock.
    start_uncertainty_s : float or None
        By how much `start_utc_ns` may be off at most, the host's own clock taken for right (for that of the PTP master
        where the source is "ptp"); None where nobody knows [s].
    start_source : StartSource or None
        What the start was found by.
    """

    counts: NDArray[np.uint16]
    settings: CameraSettings
    sequence: int
    start_utc_ns: int
    end_utc_ns: int
    start_monotonic_ns: int
    start_uncertainty_s: float | None = None
    start_source: StartSource | None = None


class Camera(Protocol):
    """A camera that takes a picture when asked. A context manager: leaving it stops the camera."""

    def __enter__(self) -> "Camera": ...

    def __exit__(self, *exc_info: object) -> None: ...

    def identify(self) -> DeviceIdentity:
        """Return what the device says of itself."""

    def configure(self, *, exposure_s: float, gain_db: float) -> CameraSettings:
        """Set exposure and gain; return what the camera says that it took.

        Raises
        ------
        LimitError
            A value is outside of what the camera allows.
        """

    def take_frame(self, *, timeout_s: float) -> Frame:
        """Return a picture whose exposure began after this call.

        Raises
        ------
        DeviceTimeoutError
            No picture came in time.
        """

    def close(self) -> None:
        """Release the camera. May be called twice."""


@dataclass(frozen=True, kw_only=True)
class FrameTally:
    """Fate of the pictures that a camera sent, counted since it was opened.

    Attributes
    ----------
    accepted : int
        Pictures that were handed on.
    damaged : int
        Pictures that came in incomplete, or marked as damaged.
    too_old : int
        Pictures whose exposure began before they were asked for.
    never_came : int
        Pictures that were asked for and did not come.
    reopened : int
        How often the connection was lost, made again, and all settings restored.
    packets : int
        Packets of pictures, where the camera is on a network and they are counted; 0 where not.
    packets_lost : int
        Those that were lost on their way, as far as a picture was looked at: behind the first one that stays away,
        what else is missing is not told.
    packets_resent : int
        Those of them that came when they were asked for again.
    """

    accepted: int = 0
    damaged: int = 0
    too_old: int = 0
    never_came: int = 0
    reopened: int = 0
    packets: int = 0
    packets_lost: int = 0
    packets_resent: int = 0

    def __add__(self, other: "FrameTally") -> "FrameTally":
        return FrameTally(**{name: count + getattr(other, name) for name, count in vars(self).items()})


@dataclass(frozen=True, kw_only=True)
class CameraFacts:
    """Facts on how a camera's counts come about, beside its settings.

    Attributes
    ----------
    sample_format : str
        How its samples come, in the words of its own standard.
    justified : {"right", "left"}
        At which end of its bytes a sample comes. The counts of a `Frame` are right-justified in any case.
    linear : bool or None
        True: what the camera has to bend its counts (gamma, look-up table, sharpening, noise reduction) was read back
        as switched off. None: it tells of nothing of that kind, so nothing is known. False: it bends them.
    triggered : bool
        It takes a picture only when it is asked for one, by software or by a line: then the numbers of its frames
        follow each other, and a gap is a picture that was lost.
    mosaic_deg : tuple of four floats or None
        Polarizer angles of the cell of 2 x 2 pixels, row by row, counter-clockwise from horizontal in the picture, as
        the camera tells them; None where it tells none [deg].
    """

    sample_format: str
    justified: Literal["right", "left"]
    linear: bool | None
    triggered: bool = False
    mosaic_deg: MosaicDeg | None = None


@runtime_checkable
class CameraWithFacts(Protocol):
    """A camera that tells how its counts come about."""

    def facts(self) -> CameraFacts:
        """Return what is known of them."""


@runtime_checkable
class ReportingCamera(Protocol):
    """A camera that tells more than pictures, as our own do. A plug-in's need not: then a run has nothing of it."""

    def tally(self) -> FrameTally:
        """Return what became of the pictures so far; of a camera that is gone too."""

    def facts(self) -> CameraFacts:
        """Return how its counts come about."""

    def features(self) -> dict[str, str]:
        """Return what was set, what was found and left, and what it measures: values by its own names.

        Raises
        ------
        DeviceError
            The camera does not answer.
        """


MonitorOptions = Mapping[str, bool | int | float | str | list[str]]


class Monitor(Protocol):
    """A sensor that tells a number beside the frames: temperature, humidity, irradiance, ...

    A `close` without arguments, where there is one, is called at the end.
    """

    @property
    def name(self) -> str:
        """What it is, in its own words."""

    @property
    def unit(self) -> str:
        """Unit of its number, such as "deg C" or "W m-2"."""

    def read(self, deadline_s: float) -> float:
        """Return the number as it is now, within the deadline.

        Raises
        ------
        DeviceError
            It does not answer in time, or says no number.
        """
