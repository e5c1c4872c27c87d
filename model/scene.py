"""Radiance at the aperture: reflected sun, reflected sky and path, kept apart."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.lighting import Lighting
from model.hemisphere import TOLERANCE, Rules, reflected_by_rules, reflected_skylight
from model.panel_light import PanelLight, Skylight
from model.quadrature import gauss_legendre
from model.sampled_sky import Sky
from model.stokes import rotate_frame
from model.surface.pbrdf import Surface
from model.surface.tilt import Tilt
from model.view import View

FloatArray = NDArray[np.float64]

# Largest zenith angle of the sun for which a plane-parallel atmosphere holds [rad].
LARGEST_SUN_ZENITH_RAD = float(np.radians(85.0))
_IRRADIANCE_NODES = 32


@dataclass(frozen=True, kw_only=True, eq=False)
class Illumination:
    """Sun, sky and air of a scene.

    Attributes
    ----------
    lighting
        Beam, transmittance and path.
    skylight
        What shines on a panel but the beam.
    sky_irradiance
        Of the sky on level ground [W m-2].
    sun_zenith_rad, sun_azimuth_rad
        Where the sun is, azimuth clockwise from north [rad].
    """

    lighting: Lighting
    skylight: Skylight
    sky_irradiance: float
    sun_zenith_rad: float
    sun_azimuth_rad: float

    @property
    def beam_irradiance(self) -> float:
        """Of the beam on level ground [W m-2]."""
        return self.lighting.direct_irradiance * float(np.cos(self.sun_zenith_rad))


def illuminate(
    lighting: Lighting,
    *,
    sun_zenith_rad: float,
    sun_azimuth_rad: float,
    ground_albedo: float,
    sky: Sky | None = None,
    sky_error: float = 0.0,
) -> Illumination:
    """Return the illumination of a scene.

    Parameters
    ----------
    lighting
        Light of this sun position in the sensor's band.
    sun_zenith_rad
        0 to 85 deg [rad].
    sun_azimuth_rad
        Clockwise from north [rad].
    ground_albedo
        Of the ground around, which a tilted panel sees, 0 to 1.
    sky
        What stands for the lighting's sky, such as a `model.sampled_sky.SampledSky` of it; None for the sky itself.
    sky_error
        Relative error of that stand-in.

    Raises
    ------
    ValueError
        The sun is too low, or the albedo outside its range.

    References
    ----------
    Definition.
    """
    require_sun_zenith(sun_zenith_rad)
    if not 0.0 <= ground_albedo <= 1.0:
        raise ValueError(f"ground_albedo = {ground_albedo!r}, allowed is 0 to 1")
    seen = lighting.sky if sky is None else sky
    from_sky = _sky_irradiance(seen)
    received = from_sky + lighting.direct_irradiance * float(np.cos(sun_zenith_rad))
    skylight = Skylight(
        sky=seen,
        sun_azimuth_rad=sun_azimuth_rad,
        ground_radiance=ground_albedo / np.pi * received,
        relative_error=sky_error,
    )
    return Illumination(
        lighting=lighting,
        skylight=skylight,
        sky_irradiance=from_sky,
        sun_zenith_rad=sun_zenith_rad,
        sun_azimuth_rad=sun_azimuth_rad,
    )


def require_sun_zenith(sun_zenith_rad: float) -> None:
    """Refuse a sun for which no atmosphere of this model holds.

    Parameters
    ----------
    sun_zenith_rad
        Zenith angle of the sun [rad].

    Raises
    ------
    ValueError
        It is not 0 to 85 deg.
    """
    if not 0.0 <= sun_zenith_rad <= LARGEST_SUN_ZENITH_RAD + 1e-12:
        raise ValueError(
            f"solar zenith = {np.degrees(sun_zenith_rad):.2f} deg, allowed is 0 to 85 deg: a plane-parallel atmosphere "
            "is wrong for a lower sun, and there is no beam below the horizon. Take another time"
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class ApertureLight:
    """Stokes radiance that reaches the aperture from one panel, by where it comes from [W m-2 sr-1].

    Attributes
    ----------
    reflected_sun, reflected_sky
        Off the panel and through the air to the camera, shape (3,).
    path
        Scattered into the line of sight, shape (3,).
    transmittance
        From the panel to the camera.
    error
        Estimated error of each component, of the hemisphere integral; the atmosphere has its own.
    rules
        That suffice for that integral.
    """

    reflected_sun: FloatArray
    reflected_sky: FloatArray
    path: FloatArray
    transmittance: float
    error: float
    rules: Rules

    @property
    def reflected(self) -> FloatArray:
        """Reflected sun and sky together, [MK14] eq. (31)."""
        return self.reflected_sun + self.reflected_sky

    @property
    def total(self) -> FloatArray:
        """All of it, [MK14] eq. (6)."""
        return self.reflected + self.path


def aperture_light(
    illumination: Illumination, *, surface: Surface, tilt: Tilt, view: View, tolerance: float = TOLERANCE
) -> ApertureLight:
    """Return the Stokes radiance that reaches the aperture from a panel, in the camera's own frame.

    Parameters
    ----------
    illumination
        Sun, sky and air.
    surface, tilt
        The panel; it must face the camera.
    view
        The camera.
    tolerance
        Of the hemisphere integral, share of its S0.

    Raises
    ------
    ValueError
        The panel turns its back to the camera.

    Notes
    -----
    Shadows of other things, light from other panels and the sun's width are left out. The surface is that of one
    wavelength, the light that of the band.

    References
    ----------
    [MK14] eq. (1)-(7).
    """
    return aperture_lights(illumination, surface=surface, tilt=tilt, views=(view,), tolerance=tolerance)[0]


def aperture_lights(
    illumination: Illumination,
    *,
    surface: Surface,
    tilt: Tilt,
    views: Sequence[View],
    tolerance: float = TOLERANCE,
    rules: Rules | None = None,
) -> tuple[ApertureLight, ...]:
    """Return what `aperture_light` does for several views from one height, faster than one by one.

    Parameters
    ----------
    illumination, surface, tilt, tolerance
        As in `aperture_light`.
    views
        One or more, of one height.
    rules
        Of the hemisphere integral, where they are known from a similar view; its error is then not estimated anew and
        counts as the tolerance and the sky's.

    Raises
    ------
    ValueError
        The panel turns its back to a camera, or heights differ.

    References
    ----------
    [MK14] eq. (1)-(7).
    """
    heights_m = {view.height_m for view in views}
    if len(heights_m) != 1:
        raise ValueError(f"aperture_lights: views from heights {sorted(heights_m)} m, allowed is one height")
    zenith = np.array([view.zenith_rad for view in views])
    phi = illumination.sun_azimuth_rad - np.array([view.azimuth_rad for view in views])
    (height_m,) = heights_m
    through = illumination.lighting.transmittance(height_m=height_m, zenith_rad=zenith)
    paths = illumination.lighting.path(height_m=height_m, zenith_rad=zenith, phi_rad=phi)
    return tuple(
        _one_light(illumination, PanelLight(surface=surface, tilt=tilt, view=view), float(part), path, tolerance, rules)
        for view, part, path in zip(views, through, paths, strict=True)
    )


def _one_light(
    illumination: Illumination,
    panel: PanelLight,
    through: float,
    path: FloatArray,
    tolerance: float,
    rules: Rules | None,
) -> ApertureLight:
    """Light of one view, its path being known."""
    sun = panel.sun(
        zenith_rad=illumination.sun_zenith_rad,
        azimuth_rad=illumination.sun_azimuth_rad,
        irradiance=illumination.lighting.direct_irradiance,
    )
    sky, error, used = _sky_part(panel, illumination.skylight, tolerance, rules)
    roll_rad = panel.view.roll_rad
    return ApertureLight(
        reflected_sun=rotate_frame(through * sun, roll_rad),
        reflected_sky=rotate_frame(through * sky, roll_rad),
        path=rotate_frame(path, roll_rad),
        transmittance=through,
        error=through * error,
        rules=used,
    )


def _sky_part(
    panel: PanelLight, light: Skylight, tolerance: float, rules: Rules | None
) -> tuple[FloatArray, float, Rules]:
    """Reflected skylight, its error and its rules."""
    if rules is not None:
        stokes = reflected_by_rules(panel, light, rules)
        return stokes, (tolerance + light.relative_error) * float(stokes[0]), rules
    found = reflected_skylight(panel, light, tolerance=tolerance)
    return found.stokes, found.error, found.rules


def _sky_irradiance(sky: Sky) -> float:
    """Irradiance of a sky on level ground, by Gauss nodes in zenith angle and even azimuths."""
    node, weight = gauss_legendre(_IRRADIANCE_NODES)
    zenith = 0.5 * np.pi * node
    azimuth = 2.0 * np.pi * (np.arange(_IRRADIANCE_NODES) + 0.5) / _IRRADIANCE_NODES
    s0 = sky(zenith_rad=zenith[:, np.newaxis], phi_rad=azimuth)[..., 0]
    # cos sin = sin(2 zenith) / 2, and half a right angle for the interval of the nodes.
    return float(0.5 * np.pi**2 * weight @ (np.mean(s0, axis=1) * np.sin(2.0 * zenith)))
