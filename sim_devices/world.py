"""World before a simulated camera: a scene, a polarizer on a stage, or something held in front of both."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sim_devices.scene_truth import refuse_unphysical

FloatArray = NDArray[np.float64]
Subject = Literal["scene", "dark", "flat"]


@dataclass(frozen=True, kw_only=True)
class Polarizer:
    """The polarizer as it really is, and how it sits on its stage.

    Parameters
    ----------
    transmittance_along, transmittance_across
        Share of the power that passes, of light polarised along and across the axis;
        0 <= across <= along <= 1, and along > 0.
    offset_deg
        Where the axis points with the stage at 0, counter-clockwise from horizontal as the camera sees it.
    sense
        +1 if a growing stage angle turns the axis counter-clockwise as the camera sees it, or -1.

    Raises
    ------
    ValueError
        If a value is outside of its range.
    """

    transmittance_along: float
    transmittance_across: float
    offset_deg: float
    sense: int

    def __post_init__(self) -> None:
        along, across = self.transmittance_along, self.transmittance_across
        if not (0.0 <= across <= along <= 1.0 and along > 0.0):
            raise ValueError(
                f"transmittance_along is {along} and transmittance_across {across}; "
                "needed is 0 <= across <= along <= 1 with along > 0"
            )
        if self.sense not in (1, -1):
            raise ValueError(f"sense is {self.sense}; it has to be 1 or -1")
        if not np.isfinite(self.offset_deg):
            raise ValueError(f"offset_deg is {self.offset_deg}; it has to be finite")

    def axis_deg(self, *, stage_angle_deg: float) -> float:
        """Return the direction of the transmission axis for a mechanical angle of the stage [deg]."""
        return self.sense * stage_angle_deg + self.offset_deg


class World:
    """Everything in front of the camera's lens. Stage and camera of one rig share one world.

    Parameters
    ----------
    radiance
        Stokes radiance of the scene, shape (3, H, W) [W m^-2 sr^-1, in band], every pixel with S0 > 0 and
        DoLP <= 1. Conventions are those of `sim_devices.scene_truth`.
    polarizer
        The truth about the polarizer. It stays mounted whatever is presented.
    stage_angle_deg
        Gives the true mechanical angle of the stage at the moment of the call [deg].
    pixel_axes_deg
        Axes of polarizers on the camera's pixels, shape (H, W) [deg]: what a stage would turn is not there then.
    flat_radiance
        Unpolarised radiance that "flat" presents in every pixel [W m^-2 sr^-1], > 0.

    Raises
    ------
    ValueError
        If a radiance is not physical or has another shape.

    Notes
    -----
    Light of a pixel is kept as an unpolarised part and the amplitude of a linearly polarised part. A perfect
    polarizer passes half of the former and the squared projection of the latter (Malus), so that no rounding
    makes a radiance negative.
    """

    def __init__(
        self,
        *,
        radiance: FloatArray,
        polarizer: Polarizer,
        stage_angle_deg: Callable[[], float],
        flat_radiance: float,
        pixel_axes_deg: FloatArray | None = None,
    ) -> None:
        if not 0.0 < flat_radiance < np.inf:
            raise ValueError(f"flat_radiance is {flat_radiance} W m^-2 sr^-1; it has to be finite and above 0")
        self._polarizer = polarizer
        self._stage_angle_deg = stage_angle_deg
        self._pixel_axes_rad = None if pixel_axes_deg is None else np.deg2rad(pixel_axes_deg)
        self._flat_radiance = flat_radiance
        self._subject: Subject = "scene"
        self.show(radiance)

    def show(self, radiance: FloatArray) -> None:
        """Let the scene have another light from now on.

        Parameters
        ----------
        radiance
            As at the making.

        Raises
        ------
        ValueError
            If it is not physical or has another shape.
        """
        if radiance.ndim != 3:
            raise ValueError(f"radiance has shape {radiance.shape}; it has to be (3, H, W)")
        refuse_unphysical(radiance, name="radiance")
        self._unpolarised, self._amplitude_x, self._amplitude_y = _split(radiance)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the scene in pixels."""
        height, width = self._unpolarised.shape
        return height, width

    @property
    def subject(self) -> Subject:
        """Subject in front of the camera."""
        return self._subject

    def axis_deg(self) -> float:
        """Return where the polarizer's axis truly points now, over whole turns: a wedge is no axis [deg]."""
        return self._polarizer.axis_deg(stage_angle_deg=self._stage_angle_deg())

    def polarizer_angle_deg(self) -> float:
        """Return where the transmission axis truly points now, in [0, 180) [deg]."""
        return self.axis_deg() % 180.0

    def present(self, subject: Subject) -> None:
        """Put something in front of the camera until the next call.

        Parameters
        ----------
        subject
            "scene"; "dark": the lens is covered; "flat": the port of an integrating sphere fills the view, in
            front of the polarizer.
        """
        if subject not in ("scene", "dark", "flat"):
            raise ValueError(f"subject is {subject!r}; it has to be 'scene', 'dark' or 'flat'")
        self._subject = subject

    def radiance_behind_polarizer(self) -> FloatArray:
        """Return the radiance that enters the lens now, shape (H, W) [W m^-2 sr^-1]."""
        if self._subject == "dark":
            return np.zeros(self.shape)
        if self._subject == "flat":
            return np.full(self.shape, self._share_of_unpolarised() * self._flat_radiance)
        if self._pixel_axes_rad is not None:
            return self._passed(axis_rad=self._pixel_axes_rad)
        return self._passed(axis_rad=np.float64(np.deg2rad(self.axis_deg())))

    def _share_of_unpolarised(self) -> float:
        return (self._polarizer.transmittance_along + self._polarizer.transmittance_across) / 2.0

    def _passed(self, *, axis_rad: FloatArray | np.float64) -> FloatArray:
        """Return what the polarizer lets through of the scene."""
        cosine, sine = np.cos(axis_rad), np.sin(axis_rad)
        along = cosine * self._amplitude_x + sine * self._amplitude_y
        passed = self._share_of_unpolarised() * self._unpolarised
        passed += self._polarizer.transmittance_along * along**2
        if self._polarizer.transmittance_across > 0.0:
            across = cosine * self._amplitude_y - sine * self._amplitude_x
            passed += self._polarizer.transmittance_across * across**2
        return passed


def _split(radiance: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the unpolarised radiance, and the polarised amplitudes to the right and up, each (H, W)."""
    s0, s1, s2 = radiance
    polarised = np.hypot(s1, s2)
    direction_rad = np.arctan2(s2, s1) / 2.0
    amplitude = np.sqrt(polarised)
    # At DoLP = 1 the difference is zero but for rounding; `refuse_unphysical` has seen to the rest.
    unpolarised = np.maximum(s0 - polarised, 0.0)
    return unpolarised, amplitude * np.cos(direction_rad), amplitude * np.sin(direction_rad)
