"""What the sky of a scene depends on, as hashable numbers, and the record that the model takes."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from model.atmosphere.lighting.fidelity import Fidelity
from model.atmosphere.lighting.lighting import Lighting
from model.atmosphere.profile import AtmosphereState
from model.atmosphere.sun import SolarBand
from model.atmosphere.transfer.phase import AerosolKind
from model.scene.lit_scene import Air
from rigctl.errors import ConfigError
from rigctl.scene.skies.alternative_air import AlternativeAir
from rigctl.scene.skies.sky_table import read_sky_table
from rigctl.scene.skies.solar_band import response_band


@dataclass(frozen=True, kw_only=True)
class SkyRequest:
    """All that a sky depends on, but for the azimuth of the sun.

    Attributes
    ----------
    sun_zenith_rad, distance_factor : float
        The sun.
    response : tuple of (float, float)
        Wavelength [nm] and relative response of the sensor.
    tier, aerosol, state, ground_albedo, wavelengths, dolp_max
        As `model.atmosphere.lighting.compute_lighting.compute_lighting` takes them; `state` is None for a table.
    table : Path or None
        File of a table.
    alternative : AlternativeAir or None
        Another aerosol that it might as well be.
    """

    sun_zenith_rad: float
    distance_factor: float
    response: tuple[tuple[float, float], ...]
    tier: Fidelity
    aerosol: AerosolKind
    state: AtmosphereState | None
    ground_albedo: float
    wavelengths: int
    dolp_max: float
    table: Path | None
    alternative: AlternativeAir | None = None

    @property
    def band(self) -> SolarBand:
        """The sun's spectrum with the sensor's response."""
        nm, response = np.array(self.response).T
        return response_band(wavelength_nm=nm, response=response, distance_factor=self.distance_factor)


def air_of(request: SkyRequest) -> Air:
    """Return what the model computes the light from.

    Raises
    ------
    ConfigError
        The table cannot be read, or is of another sun.
    """
    air = Air(
        sun_zenith_rad=request.sun_zenith_rad,
        band=request.band,
        fidelity=request.tier,
        aerosol=request.aerosol,
        state=request.state,
        ground_albedo=request.ground_albedo,
        dolp_max=request.dolp_max,
        table=_table(request) if request.tier is Fidelity.TABLE else None,
    )
    other = request.alternative
    if other is None:
        return air
    return replace(air, alternative=replace(air, aerosol=other.aerosol, state=other.state), share=other.share)


def _table(request: SkyRequest) -> Lighting:
    if request.table is None:
        raise ConfigError("atmosphere: tier 'table' needs table = \"FILE.npz\"")
    return read_sky_table(request.table, sun_zenith_rad=request.sun_zenith_rad)
