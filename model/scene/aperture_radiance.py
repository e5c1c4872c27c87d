"""Radiance at the aperture: reflected sun, reflected sky and path, kept apart."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model.scene.diffuse_radiance import DiffuseRadiance
from model.scene.hemisphere import TOLERANCE, ReflectedDiffuse, Rules, reflected_by_rules, reflected_diffuse
from model.scene.illumination import Illumination
from model.scene.panel_light import PanelLight
from model.scene.view import View
from model.stokes import rotate_frame
from model.surface.pbrdf import Surface
from model.surface.tilt import Tilt

FloatArray = NDArray[np.float64]

# Of a panel on which no skylight falls.
_NO_RULES = Rules(lobe=2, diffuse=2)


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
    finest
        By which it was found.
    view
        The line of sight.
    """

    reflected_sun: FloatArray
    reflected_sky: FloatArray
    path: FloatArray
    transmittance: float
    error: float
    rules: Rules
    finest: Rules
    view: View

    @property
    def reflected(self) -> FloatArray:
        """Reflected sun and sky together, [MK14] eq. (31)."""
        return self.reflected_sun + self.reflected_sky

    @property
    def total(self) -> FloatArray:
        """All of it, [MK14] eq. (6)."""
        return self.reflected + self.path

    def with_parts(self, *, skylight: bool, path: bool) -> "ApertureLight":
        """Return the same light without what the sky or the path sends."""
        found = self if path else replace(self, path=np.zeros(3))
        return (
            found
            if skylight
            else replace(found, reflected_sky=np.zeros(3), error=0.0, rules=_NO_RULES, finest=_NO_RULES)
        )


def aperture_lights(
    illumination: Illumination,
    *,
    surface: Surface,
    tilt: Tilt,
    views: Sequence[View],
    tolerance: float = TOLERANCE,
    rules: Rules | None = None,
    skylight: bool = True,
    path: bool = True,
) -> tuple[ApertureLight, ...]:
    """Return the Stokes radiance that reaches apertures from a panel, each in its camera's own frame.

    Parameters
    ----------
    illumination
        Sun, sky and air.
    surface, tilt
        The panel; it must face the cameras.
    views
        One or more, of one height; one set of rules suffices for all of them.
    tolerance
        Of the hemisphere integral, share of its S0.
    rules
        Of the hemisphere integral, where they are known from a similar view; its error is then not estimated anew, but
        theirs.
    skylight, path
        Whether these parts are computed; what is not is zero.

    Raises
    ------
    ValueError
        The panel turns its back to a camera, or heights differ.

    Notes
    -----
    Shadows of other things, light from other panels and the sun's width are left out. The surface is that of one
    wavelength, the light that of the band.

    References
    ----------
    [MK14] eq. (1)-(7).
    """
    height_m = _height_m(views)
    zenith = np.array([view.zenith_rad for view in views])
    phi = illumination.sun_azimuth_rad - np.array([view.azimuth_rad for view in views])
    through = illumination.lighting.transmittance(height_m=height_m, zenith_rad=zenith)
    paths = np.zeros((len(views), 3))
    if path:
        paths = illumination.lighting.path(height_m=height_m, zenith_rad=zenith, phi_rad=phi)
    panel = PanelLight(surface=surface, tilt=tilt, views=views)
    sun = panel.sun(
        zenith_rad=illumination.sun_zenith_rad,
        azimuth_rad=illumination.sun_azimuth_rad,
        irradiance=illumination.lighting.direct_irradiance,
    )
    sky = _sky_part(panel, illumination.diffuse_radiance, tolerance, rules) if skylight else _no_sky(len(views))
    turn = np.array([view.roll_rad for view in views])
    reflected_sun, reflected_sky, added = (
        rotate_frame(part, turn) for part in (through[:, np.newaxis] * sun, through[:, np.newaxis] * sky.stokes, paths)
    )
    return tuple(
        ApertureLight(
            reflected_sun=reflected_sun[k],
            reflected_sky=reflected_sky[k],
            path=added[k],
            transmittance=float(through[k]),
            error=float(through[k] * sky.error[k]),
            rules=sky.rules,
            finest=sky.finest,
            view=view,
        )
        for k, view in enumerate(views)
    )


def _height_m(views: Sequence[View]) -> float:
    heights_m = {view.height_m for view in views}
    if len(heights_m) != 1:
        raise ValueError(f"aperture_lights: views from heights {sorted(heights_m)} m, allowed is one height")
    return heights_m.pop()


def _no_sky(count: int) -> ReflectedDiffuse:
    none = np.zeros((count, 3))
    return ReflectedDiffuse(stokes=none, error=none[:, 0], rules=_NO_RULES, finest=_NO_RULES)


def _sky_part(panel: PanelLight, light: DiffuseRadiance, tolerance: float, rules: Rules | None) -> ReflectedDiffuse:
    """Reflected skylight by given rules, or refined to a tolerance."""
    if rules is None:
        return reflected_diffuse(panel, light, tolerance=tolerance)
    stokes = reflected_by_rules(panel, light, rules)
    return ReflectedDiffuse(stokes=stokes, error=rules.error * stokes[:, 0], rules=rules, finest=rules)
