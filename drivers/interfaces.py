"""Interfaces of rotation stage, camera and monitor, and the records that they return.

Real and simulated devices keep the same promises, which ``tests/contracts`` checks.
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
    """A finished move.

    Attributes
    ----------
    target_deg : float
        The requested angle.
    position : StagePosition
        The readback after the move, which is the true position, unlike the target.
    tries : int
        Number of commands until the readback was within tolerance.
    duration_s : float
        From the first command to the accepted readback.
    remarks : tuple of str
        Other messages of the device meanwhile, such as a pressed button of its handset.
    """

    target_deg: float
    position: StagePosition
    tries: int
    duration_s: float
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class StageStatus:
    """State of a stage.

    Attributes
    ----------
    moving : bool
        True while it turns.
    homed : bool
        True if it is known to have found its reference mark since power-up.
    code : int or str
        The device's own status: a number, status bits, or flags; 0 or "--" for none.
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
        """Return the identity that the device reports."""

    def home(self) -> StagePosition:
        """Search the reference mark; return the readback."""

    def move_to(self, angle_deg: float, *, way: Way = "short") -> Move:
        """Go to a mechanical angle (any real number, taken modulo 360), and return once it is there.

        If the first try ends outside the tolerance, the correction goes the short way. If the target is already within
        the tolerance, the stage does not move.

        Raises
        ------
        DeviceFaultError
            The device reports a fault, such as a stall.
        DeviceTimeoutError
            The device is silent or slower than its deadline.
        LimitError
            The readback stays further from the target than the tolerance, the angle is not finite, or the stage has not
            found its reference mark: `home` it first.
        """

    def position(self) -> StagePosition:
        """Read the encoder."""

    def status(self) -> StageStatus:
        """Return the state; a stored fault is part of it and raises nothing."""

    def stop(self) -> None:
        """Stop any motion that the device can stop."""

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
"""Source of an exposure's start: the camera's time stamp, by PTP or compared with the host's clock; between trigger and
first packet; before the first packet; the video driver's time stamp; a file's change; the simulation."""


@dataclass(frozen=True, kw_only=True)
class Frame:
    """One picture with its metadata.

    Attributes
    ----------
    counts : (H, W) array of uint16
        Samples as the camera gave them [DN]; the first row is the top of the scene.
    settings : CameraSettings
        The camera's settings during this picture.
    sequence : int
        The camera's own frame counter.
    start_utc_ns, end_utc_ns : int
        Start and end of the exposure, in nanoseconds since 1970 (UTC).
    start_monotonic_ns : int
        Start of the exposure on the host's monotonic clock.
    start_uncertainty_s : float or None
        Largest error of `start_utc_ns` if the host's clock is right (or the PTP master's, if the source is "ptp"); None
        if unknown [s].
    start_source : StartSource or None
        Source of the start.
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
    """A camera that takes a picture on request. A context manager: leaving it stops the camera."""

    def __enter__(self) -> "Camera": ...

    def __exit__(self, *exc_info: object) -> None: ...

    def identify(self) -> DeviceIdentity:
        """Return the identity that the device reports."""

    def configure(self, *, exposure_s: float, gain_db: float) -> CameraSettings:
        """Set exposure and gain; return the settings read back.

        Raises
        ------
        LimitError
            The camera does not allow a value.
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
        Pictures that were returned.
    damaged : int
        Pictures that were incomplete or marked as damaged.
    too_old : int
        Pictures whose exposure began before the request.
    never_came : int
        Requested pictures that did not come.
    reopened : int
        Number of times that the connection was lost and restored with all settings.
    packets : int
        Packets of pictures from a camera on a network; otherwise 0.
    packets_lost : int
        Lost packets; of each incomplete picture only the first is known.
    packets_resent : int
        Lost packets that came when requested again.
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
    """Facts about a camera's counts in addition to its settings.

    Attributes
    ----------
    sample_format : str
        Format of its samples, as in its own standard.
    justified : {"right", "left"}
        End of its bytes at which a sample is sent. The counts of a `Frame` are always right-justified.
    linear : bool or None
        True: all nonlinear processing (gamma, look-up table, sharpening, noise reduction) was read back as off. None:
        the camera reports none, so it is unknown. False: some is on.
    triggered : bool
        It takes pictures only on request, by software or a line: then a gap in the numbers of its frames is a lost
        picture.
    mosaic_deg : tuple of four floats or None
        Polarizer angles of the cell of 2 x 2 pixels, row by row, counter-clockwise from horizontal in the picture, from
        the camera; None if it reports none [deg].
    """

    sample_format: str
    justified: Literal["right", "left"]
    linear: bool | None
    triggered: bool = False
    mosaic_deg: MosaicDeg | None = None


@runtime_checkable
class CameraWithFacts(Protocol):
    """A camera that describes its counts."""

    def facts(self) -> CameraFacts:
        """Return the facts about its counts."""


@runtime_checkable
class ReportingCamera(Protocol):
    """A camera that reports its pictures and settings, as our own do; optional for plug-ins."""

    def tally(self) -> FrameTally:
        """Return the fate of the pictures so far, even of a lost camera."""

    def facts(self) -> CameraFacts:
        """Return the facts about its counts."""

    def features(self) -> dict[str, str]:
        """Return settings, controls left unchanged, and own measurements, under the camera's names.

        Raises
        ------
        DeviceError
            The camera does not answer.
        """


MonitorOptions = Mapping[str, bool | int | float | str | list[str]]


class Monitor(Protocol):
    """A sensor that gives a number for each frame: temperature, humidity, irradiance, ...

    An optional `close` without arguments is called at the end.
    """

    @property
    def name(self) -> str:
        """Name of the sensor, as it reports it."""

    @property
    def unit(self) -> str:
        """Unit of its number, such as "deg C" or "W m-2"."""

    def read(self, deadline_s: float) -> float:
        """Return the present value, within the deadline.

        Raises
        ------
        DeviceError
            It does not answer in time, or gives no number.
        """
