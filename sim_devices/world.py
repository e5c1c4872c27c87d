"""The world of a simulated camera: a scene, a polarizer on a stage, or a cover in front of both.

One Stokes vector per pixel is drawn once; mean and spread of each region may change with time.

Pictures: the first row is the top, x runs right, y down. Stokes vectors (S0, S1, S2) are radiances in band [W m^-2
sr^-1] with S1 = horizontal - vertical and S2 = (+45) - (-45), angles counter-clockwise from horizontal in the picture
as displayed.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

# A fully polarised vector in decimals misses DoLP = 1 by some eps.
_ROUNDING = 1e-12


@dataclass(frozen=True, kw_only=True, eq=False)
class Surface:
    """Light from a kind of surface, and its variation from pixel to pixel.

    Parameters
    ----------
    mean_stokes
        Mean of (S0, S1, S2) [W m^-2 sr^-1]; S0 > 0 and DoLP <= 1.
    texture_rms
        Relative rms of a normal factor common to the whole Stokes vector of a pixel, as of albedo; >= 0.
    extra_covariance
        Covariance, shape (3, 3) [(W m^-2 sr^-1)^2], of a normal vector added to each pixel independently of the
        texture; None for none. It may be singular.

    Raises
    ------
    ValueError
        If the mean or a spread is not physical.
    """

    mean_stokes: tuple[float, float, float]
    texture_rms: float = 0.0
    extra_covariance: FloatArray | None = None

    def __post_init__(self) -> None:
        refuse_unphysical(np.array(self.mean_stokes, dtype=np.float64).reshape(-1), name="mean_stokes")
        if not 0.0 <= self.texture_rms < np.inf:
            raise ValueError(f"texture_rms is {self.texture_rms}; allowed is 0 and above")
        if self.extra_covariance is not None:
            refuse_no_covariance(self.extra_covariance)


def paint_scene(
    *,
    width: int,
    height: int,
    background: Surface,
    regions: Sequence[tuple[Surface, NDArray[np.bool_]]],
    generator: np.random.Generator,
) -> FloatArray:
    """Return the Stokes radiance of every pixel, drawn once.

    Parameters
    ----------
    width, height
        Size of the picture in pixels.
    background
        Surface outside the regions.
    regions
        Surfaces with masks of shape (H, W) that are True on them, painted in this order: a later one covers an earlier
        one.
    generator
        Source of the texture. The same state gives the same scene.

    Returns
    -------
    array of float64, shape (3, height, width)
        (S0, S1, S2) [W m^-2 sr^-1], read-only.

    Raises
    ------
    ValueError
        If a mask has another shape, or a drawn pixel has S0 <= 0 or DoLP > 1: texture or covariance is too wide for the
        mean. Values are not clipped, since that would change the moments.
    """
    radiance = np.empty((3, height, width))
    radiance[...] = _drawn(background, count=width * height, generator=generator).reshape(radiance.shape)
    for surface, mask in regions:
        if mask.shape != (height, width):
            raise ValueError(f"a mask has shape {mask.shape}; the picture has {(height, width)}")
        radiance[:, mask] = _drawn(surface, count=int(mask.sum()), generator=generator)
    refuse_unphysical(radiance, name="a drawn pixel (make texture_rms or extra_covariance smaller)")
    radiance.flags.writeable = False
    return radiance


def refuse_unphysical(stokes: FloatArray, *, name: str) -> None:
    """Raise ValueError unless every Stokes vector (first axis) is finite with S0 > 0 and DoLP <= 1."""
    if stokes.shape[0] != 3:
        raise ValueError(f"{name}: the first axis has length {stokes.shape[0]}; it has to be 3 (S0, S1, S2)")
    s0, s1, s2 = stokes
    physical = (s0 > 0.0) & np.isfinite(s0) & (np.hypot(s1, s2) <= s0 * (1.0 + _ROUNDING))
    if not np.all(physical):
        bad = stokes.reshape(3, -1)[:, int(np.argmin(physical))]
        raise ValueError(
            f"{name}: (S0, S1, S2) = ({bad[0]:g}, {bad[1]:g}, {bad[2]:g}) W m^-2 sr^-1 is no light; "
            "S0 has to be finite and above 0, and the root of S1^2 + S2^2 at most S0"
        )


def refuse_no_covariance(covariance: FloatArray) -> None:
    """Raise ValueError unless a matrix is a covariance of a Stokes vector; it may be singular."""
    if covariance.shape != (3, 3) or not np.array_equal(covariance, covariance.T):
        raise ValueError("extra_covariance has to be symmetric with shape (3, 3)")
    if not np.all(np.isfinite(covariance)):
        raise ValueError("extra_covariance has to be finite")
    smallest = np.linalg.eigvalsh(covariance)[0]
    if smallest < -_ROUNDING * np.trace(covariance):
        raise ValueError(f"extra_covariance has an eigenvalue of {smallest:g}; none may be negative")


def _drawn(surface: Surface, *, count: int, generator: np.random.Generator) -> FloatArray:
    """Return `count` Stokes vectors of a surface, shape (3, count)."""
    stokes = np.repeat(np.array(surface.mean_stokes, dtype=np.float64)[:, np.newaxis], count, axis=1)
    if surface.texture_rms > 0.0:
        stokes *= 1.0 + surface.texture_rms * generator.standard_normal(count)
    if surface.extra_covariance is not None:
        variances, axes = np.linalg.eigh(surface.extra_covariance)
        # A singular covariance has eigenvalues of zero to rounding.
        spreads = np.sqrt(np.maximum(variances, 0.0))
        stokes += (axes * spreads) @ generator.standard_normal((3, count))
    return stokes


@dataclass(frozen=True, kw_only=True, eq=False)
class RegionLight:
    """Light of a region's pixels at one moment.

    Attributes
    ----------
    mean
        Mean of (S0, S1, S2), shape (3,) [W m^-2 sr^-1 in band].
    cov
        Covariance over its pixels, shape (3, 3); it may be singular.
    """

    mean: FloatArray
    cov: FloatArray


class TexturedScene:
    """Regions before a background; the texture of each pixel stays while the light changes.

    Parameters
    ----------
    masks
        Boolean masks of shape (H, W) by region; a later one covers an earlier one.
    background_radiance
        Unpolarised radiance outside the regions [W m^-2 sr^-1], > 0.
    shape
        Height and width in pixels.
    generator
        Source of the texture. The same state gives the same scene.
    """

    def __init__(
        self,
        *,
        masks: Mapping[str, NDArray[np.bool_]],
        background_radiance: float,
        shape: tuple[int, int],
        generator: np.random.Generator,
    ) -> None:
        self._background = np.zeros((3, *shape))
        self._background[0] = background_radiance
        self._masks = dict(masks)
        self._normals = {name: generator.standard_normal((3, int(mask.sum()))) for name, mask in self._masks.items()}

    @property
    def names(self) -> Sequence[str]:
        """Names of the regions, in the order in which they are painted."""
        return tuple(self._masks)

    def painted(self, lights: Mapping[str, RegionLight], *, background_share: float = 1.0) -> FloatArray:
        """Return the Stokes radiance of every pixel, shape (3, H, W) [W m^-2 sr^-1].

        Parameters
        ----------
        lights
            Of each region.
        background_share
            Factor of the background, > 0.

        Raises
        ------
        ValueError
            A region has no light, a covariance is invalid, or a pixel has S0 <= 0 or DoLP > 1 because its texture is
            too wide.

        Notes
        -----
        Pixels are normal numbers times the symmetric root of the covariance, which is unique and continuous: a slow
        change of the light changes every pixel slowly, and light of constant proportions keeps those of the pixels.
        """
        missing = sorted(set(self._masks).difference(lights))
        if missing:
            raise ValueError(f"no light is given for {', '.join(missing)}")
        radiance = background_share * self._background
        for name, mask in self._masks.items():
            light = lights[name]
            refuse_no_covariance(light.cov)
            radiance[:, mask] = light.mean[:, np.newaxis] + _symmetric_root(light.cov) @ self._normals[name]
        refuse_unphysical(radiance, name="a drawn pixel (make its texture smaller)")
        radiance.flags.writeable = False
        return radiance


def _symmetric_root(cov: FloatArray) -> FloatArray:
    variances, axes = np.linalg.eigh(cov)
    return np.asarray((axes * np.sqrt(np.maximum(variances, 0.0))) @ axes.T)


Subject = Literal["scene", "dark", "flat"]


@dataclass(frozen=True, kw_only=True)
class Polarizer:
    """The true polarizer and its mounting on the stage.

    Parameters
    ----------
    transmittance_along, transmittance_across
        Transmitted share of the power polarised along and across the axis; 0 <= across <= along <= 1, and along > 0.
    offset_deg
        Direction of the axis with the stage at 0, counter-clockwise from horizontal as the camera sees it.
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
                f"transmittance_along is {along} and transmittance_across {across}; allowed is 0 <= across <= along <= "
                "1 with along > 0"
            )
        if self.sense not in (1, -1):
            raise ValueError(f"sense is {self.sense}; allowed is 1 or -1")
        if not np.isfinite(self.offset_deg):
            raise ValueError(f"offset_deg is {self.offset_deg}; it must be finite")

    def axis_deg(self, *, stage_angle_deg: float) -> float:
        """Return the direction of the transmission axis for a mechanical angle of the stage [deg]."""
        return self.sense * stage_angle_deg + self.offset_deg


class World:
    """Everything in front of the camera's lens. Stage and camera of one rig share one world.

    Parameters
    ----------
    radiance
        Stokes radiance of the scene, shape (3, H, W) [W m^-2 sr^-1, in band], every pixel with S0 > 0 and
        DoLP <= 1. Conventions are those of `sim_devices.world`.
    polarizer
        The true polarizer, always mounted.
    stage_angle_deg
        Returns the present true mechanical angle of the stage [deg].
    pixel_axes_deg
        Axes of polarizers on the camera's pixels, shape (H, W) [deg], in place of one on a stage.
    flat_radiance
        Unpolarised radiance of "flat" in every pixel [W m^-2 sr^-1], > 0.

    Raises
    ------
    ValueError
        If a radiance is not physical or has another shape.

    Notes
    -----
    Light of a pixel is stored as an unpolarised part and the amplitude of a linearly polarised part. A perfect
    polarizer passes half of the former and the squared projection of the latter (Malus), so rounding cannot make a
    radiance negative.
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
            raise ValueError(f"flat_radiance is {flat_radiance} W m^-2 sr^-1; it must be finite and above 0")
        self._polarizer = polarizer
        self._stage_angle_deg = stage_angle_deg
        self._pixel_axes_rad = None if pixel_axes_deg is None else np.deg2rad(pixel_axes_deg)
        self._flat_radiance = flat_radiance
        self._subject: Subject = "scene"
        self.show(radiance)

    def show(self, radiance: FloatArray) -> None:
        """Change the light of the scene.

        Parameters
        ----------
        radiance
            As in the constructor.

        Raises
        ------
        ValueError
            If it is not physical or has another shape.
        """
        if radiance.ndim != 3:
            raise ValueError(f"radiance has shape {radiance.shape}; it must be (3, H, W)")
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
        """Return the true direction of the polarizer's axis over whole turns, as needed for a wedge [deg]."""
        return self._polarizer.axis_deg(stage_angle_deg=self._stage_angle_deg())

    def polarizer_angle_deg(self) -> float:
        """Return the true direction of the transmission axis, in [0, 180) [deg]."""
        return self.axis_deg() % 180.0

    def present(self, subject: Subject) -> None:
        """Change the subject in front of the camera.

        Parameters
        ----------
        subject
            "scene"; "dark": the lens is covered; "flat": the port of an integrating sphere fills the view, in
            front of the polarizer.
        """
        if subject not in ("scene", "dark", "flat"):
            raise ValueError(f"subject is {subject!r}; allowed is 'scene', 'dark' or 'flat'")
        self._subject = subject

    def radiance_behind_polarizer(self) -> FloatArray:
        """Return the radiance at the lens, shape (H, W) [W m^-2 sr^-1]."""
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
        """Return the light of the scene behind the polarizer."""
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
    # At DoLP = 1 the difference is zero to rounding; `refuse_unphysical` excludes the rest.
    unpolarised = np.maximum(s0 - polarised, 0.0)
    return unpolarised, amplitude * np.cos(direction_rad), amplitude * np.sin(direction_rad)
