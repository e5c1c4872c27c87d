"""The sky of a scene in numbers: Stokes radiance over the hemisphere, and what is to be known of it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.scene.illumination import Illumination
from model.stokes import dolp
from rigctl.choices import Engine
from rigctl.errors import ConfigError
from rigctl.files.scene_file import SceneFile
from rigctl.scene.scene_light import SceneLight
from rigctl.scene.scene_reading import scene_of_file
from rigctl.scene.skies.engine import require_engine

FloatArray = NDArray[np.float64]

SCHEMA_VERSION = 1
_ZENITH_DEG = np.arange(0.0, 90.1, 2.0)
_AZIMUTH_DEG = np.arange(0.0, 360.1, 4.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class SkySheet:
    """A sky.

    Attributes
    ----------
    name : str
        Of the scene.
    zenith_deg, azimuth_deg : (Z,), (A,) arrays
        Directions; azimuth clockwise from north.
    stokes : (Z, A, 3) array
        S0, S1, S2 in the frame of each direction [W m-2 sr-1 in band].
    sun_zenith_deg, sun_azimuth_deg : float
        Where the sun is.
    direct_irradiance, sky_irradiance : float
        Of the beam on a plane normal to it, and of the sky on level ground [W m-2 in band].
    relative_error : float
        Of the sampled sky, over its mean radiance; the atmosphere has its own.
    remarks : tuple of str
        Tier, accuracy, optical depth, kind of aerosol.
    """

    name: str
    zenith_deg: FloatArray
    azimuth_deg: FloatArray
    stokes: FloatArray
    sun_zenith_deg: float
    sun_azimuth_deg: float
    direct_irradiance: float
    sky_irradiance: float
    relative_error: float
    remarks: tuple[str, ...]

    @property
    def dolp(self) -> FloatArray:
        """Degree of linear polarization, shape (Z, A)."""
        return dolp(self.stokes)

    @property
    def largest_dolp(self) -> tuple[float, float, float]:
        """Largest degree of polarization, and its zenith angle and azimuth [deg]."""
        place = np.unravel_index(int(np.argmax(self.dolp)), self.dolp.shape)
        return float(self.dolp[place]), float(self.zenith_deg[place[0]]), float(self.azimuth_deg[place[1]])

    @property
    def lines(self) -> tuple[str, ...]:
        """What is to be known of this sky, in words."""
        degree, zenith_deg, azimuth_deg = self.largest_dolp
        return (
            f"sun: zenith {self.sun_zenith_deg:.2f} deg, azimuth {self.sun_azimuth_deg:.2f} deg",
            (
                f"irradiance in band: beam {self.direct_irradiance:.4g} W m-2 on a plane normal to it, sky "
                f"{self.sky_irradiance:.4g} W m-2 on level ground"
            ),
            f"largest DoLP {degree:.3f} at zenith {zenith_deg:.0f} deg, azimuth {azimuth_deg:.0f} deg",
            *self.remarks,
        )

    @property
    def title_lines(self) -> tuple[str, ...]:
        """Heading of a figure."""
        return (f"{self.name}: north at the top, azimuth clockwise, horizon outside", self.lines[0], *self.remarks[:1])

    def as_json(self) -> dict[str, Any]:
        """Return the sky as JSON holds it."""
        degree, zenith_deg, azimuth_deg = self.largest_dolp
        return {
            "schema_version": SCHEMA_VERSION,
            "scene": self.name,
            "sun": {"zenith_deg": self.sun_zenith_deg, "azimuth_deg": self.sun_azimuth_deg},
            "direct_irradiance": self.direct_irradiance,
            "sky_irradiance": self.sky_irradiance,
            "largest_dolp": {"dolp": degree, "zenith_deg": zenith_deg, "azimuth_deg": azimuth_deg},
            "relative_error": self.relative_error,
            "zenith_deg": self.zenith_deg.tolist(),
            "azimuth_deg": self.azimuth_deg.tolist(),
            "stokes": self.stokes.tolist(),
            "remarks": list(self.remarks),
        }


def sky_sheet(scene: SceneFile, *, engine: Engine = "own") -> SkySheet:
    """Return the sky of a scene file.

    Parameters
    ----------
    scene : SceneFile
        With sun, atmosphere and the sensor's band.
    engine : str
        What solves it.

    Raises
    ------
    ConfigError
        The file says nothing of sun and atmosphere, or of a sun too low; or the engine is not installed.
    """
    missing = [f"[{name}]" for name in ("sun", "atmosphere") if getattr(scene, name) is None]
    if not scene.sensor.has_band:
        missing.append("a band of the sensor (band_nm or response)")
    if missing:
        raise ConfigError(f"scene {scene.name}: a sky also needs {', '.join(missing)}")
    require_engine(engine, tier=None if scene.atmosphere is None else scene.atmosphere.tier)
    light = SceneLight(engine=engine)
    record = scene_of_file(scene)
    return _sheet(scene.name, light.illumination(record), remarks=light.remarks(record))


def _sheet(name: str, illumination: Illumination, *, remarks: tuple[str, ...]) -> SkySheet:
    phi_rad = illumination.sun_azimuth_rad - np.deg2rad(_AZIMUTH_DEG)
    return SkySheet(
        name=name,
        zenith_deg=_ZENITH_DEG,
        azimuth_deg=_AZIMUTH_DEG,
        stokes=illumination.diffuse_radiance.sky(zenith_rad=np.deg2rad(_ZENITH_DEG)[:, np.newaxis], phi_rad=phi_rad),
        sun_zenith_deg=float(np.degrees(illumination.sun_zenith_rad)),
        sun_azimuth_deg=float(np.degrees(illumination.sun_azimuth_rad)) % 360.0,
        direct_irradiance=illumination.lighting.direct_irradiance,
        sky_irradiance=illumination.sky_irradiance,
        relative_error=illumination.diffuse_radiance.relative_error,
        remarks=remarks,
    )
