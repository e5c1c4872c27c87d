"""Records of a scene: `LitScene` is regions under a sky before a camera, `Scenario` the light that they send to it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.air import AtmosphereState
from model.atmosphere.layers import AerosolKind
from model.atmosphere.sky import Fidelity, Lighting, SolarBand
from model.moments import Moments
from model.scene.field import FieldPart, Source
from model.scene.panel import View
from model.scene.sky_light import require_sun_zenith
from model.sensor import PERFECT, Imperfections, Sensor
from model.surface.pbrdf import Surface, Tilt

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class RegionLight:
    """The Stokes radiance that comes from a region to the aperture, and how it differs from pixel to pixel.

    Parameters
    ----------
    name
        Of the region.
    stokes_radiance
        Mean (S0, S1, S2), shape (3,) [W m-2 sr-1, in band].
    texture_rms
        Relative rms of a factor common to the whole Stokes vector of a pixel, >= 0.
    texture_cov
        Covariance of the pixels' Stokes radiance beyond that factor, shape (3, 3) [(W m-2 sr-1)^2].
    field_cov
        Covariance from what varies smoothly over the region, shape (3, 3) [(W m-2 sr-1)^2]; None for none.
    falloff_mean, falloff_var
        Mean and variance, over the region's pixels, of what the lens lets through off its axis; independent of the
        light.

    Notes
    -----
    A common factor has the rank-one covariance texture_rms^2 S S'; it moves DoLP by nothing at first order,
    where a diagonal covariance does.

    References
    ----------
    [MK14] eq. (7), (10).
    """

    name: str
    stokes_radiance: FloatArray
    texture_rms: float
    texture_cov: FloatArray
    field_cov: FloatArray | None = None
    falloff_mean: float = 1.0
    falloff_var: float = 0.0

    def aperture_moments(self) -> Moments:
        """Return mean and covariance of the Stokes radiance over the region's pixels, [MK14] eq. (10)."""
        squared = np.outer(self.stokes_radiance, self.stokes_radiance)
        texture = self.texture_rms**2 * squared + self.texture_cov
        square_mean = self.falloff_mean**2 + self.falloff_var
        return Moments(mean=self.falloff_mean * self.stokes_radiance, cov=square_mean * texture + self.smooth_cov())

    def smooth_cov(self) -> FloatArray:
        """Return the part of that covariance which varies smoothly over the region, shape (3, 3)."""
        squared = np.outer(self.stokes_radiance, self.stokes_radiance)
        over_field = np.zeros((3, 3)) if self.field_cov is None else self.field_cov
        return np.asarray(self.falloff_var * squared + (self.falloff_mean**2 + self.falloff_var) * over_field)


@dataclass(frozen=True, kw_only=True)
class Readout:
    """Readout: angles, cycles and processing of the frames.

    Parameters
    ----------
    angles_rad
        Angles of the polarizer's axis, one per frame of a cycle, shape (N,) [rad]; in a comparison those that the
        stage read back.
    channel_names
        A name for each of them, as it stands in a report: "dn_45".
    cycles
        Number of times that all angles are measured, >= 1.
    extinction_ratio
        Of the polarizer, as the processing assumes it; infinite for ideal.
    noise_factor
        Factor of each frame by which the processing changes the variance of temporal noise first, for instance by
        interpolation between pixels; or None.
    flat_error
        Relative standard deviation of the error of each frame's flat field over the pixels, one a frame; None where
        frames are not divided by a flat field, and show the response of each pixel.
    """

    angles_rad: FloatArray
    channel_names: tuple[str, ...]
    cycles: int
    extinction_ratio: float
    noise_factor: FloatArray | None = None
    flat_error: FloatArray | None = None


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """Light, sensor and readout of a prediction; `imperfections` are the session's."""

    regions: tuple[RegionLight, ...]
    sensor: Sensor
    readout: Readout
    imperfections: Imperfections = PERFECT


# False alarm probabilities at which detection is predicted.
P_FALSE_ALARM = (1e-4, 1e-3, 1e-2, 1e-1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Air:
    """Air and sun: all that their light depends on except the sun's azimuth and numerical settings.

    Attributes
    ----------
    sun_zenith_rad
        0 to 85 deg [rad].
    band
        Spectrum of the sun at its actual distance, with the sensor's response.
    fidelity
        ANALYTIC, SINGLE and TABLE are models of their own. FAST and STANDARD are the same model; the numerical settings
        decide its accuracy.
    aerosol
        Effect of the aerosol's scattering on polarization.
    state
        The atmosphere; None for a table.
    ground_albedo
        Of the ground around, 0 to 1.
    dolp_max
        Largest degree of polarization of the sky; fidelity ANALYTIC alone uses it.
    table
        The light of a table; None for all other fidelity levels.
    alternative, share
        Another air that is possible, and the share of its light (`model.atmosphere.sky.MixedLighting`); or None.

    Raises
    ------
    ValueError
        The sun is lower than a plane-parallel atmosphere is made for.
    """

    sun_zenith_rad: float
    band: SolarBand
    fidelity: Fidelity
    aerosol: AerosolKind
    state: AtmosphereState | None
    ground_albedo: float
    dolp_max: float = 0.2
    table: Lighting | None = None
    alternative: "Air | None" = None
    share: float = 0.0

    def __post_init__(self) -> None:
        require_sun_zenith(self.sun_zenith_rad)

    @property
    def is_solved(self) -> bool:
        """True if light scattered more than once is computed."""
        return self.fidelity in (Fidelity.FAST, Fidelity.STANDARD)

    @cached_property
    def key(self) -> tuple[object, ...]:
        """Equal for two airs of the same light; hashable."""
        band = (self.band.wavelength_m, self.band.irradiance_w_per_m3, self.band.response)
        model = "solved" if self.is_solved else self.fidelity
        same = (self.sun_zenith_rad, model, self.aerosol, self.state, self.ground_albedo, self.dolp_max)
        other = None if self.alternative is None else (self.alternative.key, self.share)
        return (*same, *(array.tobytes() for array in band), None if self.table is None else id(self.table), other)


@dataclass(frozen=True, kw_only=True, eq=False)
class LitRegion:
    """One region of the picture: a material under the light of the scene, or a radiance as given.

    Attributes
    ----------
    name
        Of the region.
    surface, tilt, part
        Material, tilt, and the part of the field that it fills (None for a point on the axis); surface and tilt are
        None where the radiance is given.
    radiance
        Mean Stokes radiance at the aperture, shape (3,) [W m-2 sr-1, in band]; None for a material.
    texture_rms, texture_diagonal, texture_cov
        As in `model.scene.field.FieldLight.moments`.

    Raises
    ------
    ValueError
        Neither a surface with its tilt, nor a radiance; or both.
    """

    name: str
    surface: Surface | None = None
    tilt: Tilt | None = None
    part: FieldPart | None = None
    radiance: FloatArray | None = None
    texture_rms: float = 0.0
    texture_diagonal: tuple[float, float, float] = (0.0, 0.0, 0.0)
    texture_cov: FloatArray

    def __post_init__(self) -> None:
        is_material = self.surface is not None and self.tilt is not None
        if is_material == (self.radiance is not None):
            raise ValueError(f"region {self.name}: needs either surface and tilt, or radiance")


@dataclass(frozen=True, kw_only=True)
class LightParts:
    """Parts of the light before the lens that are computed.

    Attributes
    ----------
    field_of_view
        Over a region's part of the field; without it, in the middle of that alone.
    skylight
        Reflected by the regions.
    path_radiance
        Scattered by the air into the line of sight; without it and skylight no atmosphere is solved.
    wavelengths
        At several wavelengths of the band; without it, at their mean.
    """

    field_of_view: bool = True
    skylight: bool = True
    path_radiance: bool = True
    wavelengths: bool = True


ALL_LIGHT = LightParts()


@dataclass(frozen=True, kw_only=True, eq=False)
class LitScene:
    """Record of a scene.

    Attributes
    ----------
    air, view, sun_azimuth_rad
        Light and camera; None, None and any number where every region's radiance is given.
    regions
        One or more, in the order of the file.
    sensor, readout
        What the light falls on, and how it is read out.
    source
        Which light of materials counts.
    pairs
        Target and background by their names, for detection.
    p_false_alarm
        At which detection is predicted, each in (0, 1).
    imperfections
        Of the session.
    parts
        Of the light, that are computed.

    Raises
    ------
    ValueError
        A material without air or view, or a name that no region has.
    """

    air: Air | None = None
    view: View | None = None
    sun_azimuth_rad: float = 0.0
    regions: tuple[LitRegion, ...]
    sensor: Sensor
    readout: Readout
    source: Source = "total"
    pairs: tuple[tuple[str, str], ...] = ()
    p_false_alarm: tuple[float, ...] = P_FALSE_ALARM
    imperfections: Imperfections = PERFECT
    parts: LightParts = ALL_LIGHT

    def __post_init__(self) -> None:
        names = [region.name for region in self.regions]
        unlit = [region.name for region in self.regions if region.surface is not None]
        if unlit and (self.air is None or self.view is None):
            raise ValueError(f"regions {', '.join(unlit)} are given by material: the scene needs air and view")
        unknown = sorted({name for pair in self.pairs for name in pair} - set(names))
        if unknown:
            raise ValueError(f"pairs name {', '.join(unknown)}; the regions are {', '.join(names)}")

    @property
    def sensor_height_m(self) -> float:
        """Height over the ground [m]; 0 if the light of the air is not computed."""
        return 0.0 if self.view is None else self.view.height_m
