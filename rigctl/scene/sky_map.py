"""The sky of a scene: Stokes radiance over the hemisphere, for its own aerosol or for several kinds."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.aerosols import AerosolType
from model.atmosphere.layers import AerosolKind
from model.atmosphere.sky import Fidelity
from model.scene.sky_light import Illumination
from model.stokes import dolp
from rigctl.errors import ConfigError
from rigctl.files.choices import Engine
from rigctl.files.scene_file import AtmosphereSection
from rigctl.scene.light import SceneLight, require_engine
from rigctl.scene.scene import Scene

FloatArray = NDArray[np.float64]

_ZENITH_DEG = np.arange(0.0, 90.1, 2.0)
_AZIMUTH_DEG = np.arange(0.0, 360.1, 4.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class SkyMap:
    """A sky."""

    name: str  #: Of the scene.
    zenith_deg: FloatArray  #: Directions; azimuth clockwise from north.
    azimuth_deg: FloatArray
    stokes: FloatArray  #: S0, S1, S2 in the frame of each direction [W m-2 sr-1 in band].
    sun_zenith_deg: float  #: Where the sun is.
    sun_azimuth_deg: float
    direct_irradiance: float  #: Of the beam on a plane normal to it, and of the sky on level ground [W m-2 in band].
    sky_irradiance: float
    relative_error: float  #: Of the sampled sky, over its mean radiance, without that of the atmosphere.
    remarks: tuple[str, ...]  #: Tier, accuracy, optical depth, kind of aerosol.

    @property
    def dolp(self) -> FloatArray:
        """Degree of linear polarization, shape (Z, A)."""
        return dolp(self.stokes)

    @property
    def largest_dolp(self) -> tuple[float, float, float]:
        """Largest degree of polarization, and its zenith angle and azimuth [deg]."""
        place = np.unravel_index(int(np.argmax(self.dolp)), self.dolp.shape)
        return float(self.dolp[place]), float(self.zenith_deg[place[0]]), float(self.azimuth_deg[place[1]])


def sky_map(scene: Scene, *, engine: Engine = "own", tell: Callable[[float], None] | None = None) -> SkyMap:
    """Return the sky of a scene."""
    missing = [f"[{name}]" for name in ("sun", "atmosphere") if getattr(scene, name) is None]
    if not scene.sensor.has_band:
        missing.append("a band of the sensor (band_nm or response)")
    if missing:
        raise ConfigError(f"scene {scene.name}: a sky also needs {', '.join(missing)}")
    require_engine(engine, tier=None if scene.atmosphere is None else scene.atmosphere.tier)
    light = SceneLight(engine=engine, tell=tell)
    return _map(scene.name, light.illumination(scene), remarks=light.remarks(scene))


def _map(name: str, illumination: Illumination, *, remarks: tuple[str, ...]) -> SkyMap:
    phi_rad = illumination.sun_azimuth_rad - np.deg2rad(_AZIMUTH_DEG)
    return SkyMap(
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


def skies_of_kinds(scene: Scene, *, engine: Engine = "own") -> Iterator[tuple[str, SkyMap]]:
    """Yield each kind of aerosol in words with its sky at the file's depth at 550 nm, the file's kind first."""
    own = scene.atmosphere
    if own is None or own.tier is Fidelity.TABLE:
        raise ConfigError(f"--compare-aerosols: {scene.name} has no computed atmosphere; a table has a single sky")
    for label, air in _kinds(own):
        changed = replace(scene, atmosphere=air.model_copy(update={"alternative": None}))
        yield label, sky_map(changed, engine=engine)


def _kinds(own: AtmosphereSection) -> Iterable[tuple[str, AtmosphereSection]]:
    """Yield the file's aerosol, then its other kinds, then spheres of others below 2 km."""
    name = own.aerosol_type.value if own.own_aerosol is None else own.own_aerosol.name
    yield f"{own.aerosol}, {name}", own
    for kind in AerosolKind:
        if kind is not own.aerosol:
            yield f"{kind}, {name}", own.model_copy(update={"aerosol": kind})
    for other in AerosolType:
        if own.own_aerosol is not None or other is not own.aerosol_type:
            update = {"aerosol": AerosolKind.SPHERES, "aerosol_type": other, "own_aerosol": None}
            yield f"{AerosolKind.SPHERES}, {other.value}", own.model_copy(update=update)


def sky_difference(sky: SkyMap, reference: SkyMap) -> dict[str, float]:
    """Return the difference of two skies: relative rms of S0 over the solid angle, and largest of DoLP."""
    weight = np.sin(np.deg2rad(reference.zenith_deg))[:, np.newaxis] * np.ones(reference.azimuth_deg.size)
    ratio = sky.stokes[..., 0] / reference.stokes[..., 0] - 1.0
    return {
        "s0_rms": float(np.sqrt(np.average(ratio**2, weights=weight))),
        "largest_dolp": float(np.max(np.abs(sky.dolp - reference.dolp))),
    }
