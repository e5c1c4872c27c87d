"""Light of a sun position in a band, computed once for all that ask for it."""

from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from model.atmosphere.lighting.compute_lighting import Solver, compute_lighting
from model.atmosphere.lighting.lighting import Lighting
from model.atmosphere.lighting.tiers import Tier
from model.atmosphere.profile import AtmosphereState
from model.atmosphere.solver import solve
from model.atmosphere.sun import SolarBand
from model.atmosphere.transfer.phase import AerosolKind
from model.illumination import Illumination, illuminate, require_sun_zenith
from model.sampled_sky import Sky, sample_sky
from rigctl.errors import ConfigError
from rigctl.skies.sky_table import read_sky_table
from rigctl.skies.solar_band import response_band

# A sky is asked for again by the next region, the next geometry, or not at all.
_KEPT = 8


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
    """

    sun_zenith_rad: float
    distance_factor: float
    response: tuple[tuple[float, float], ...]
    tier: Tier
    aerosol: AerosolKind
    state: AtmosphereState | None
    ground_albedo: float
    wavelengths: int
    dolp_max: float
    table: Path | None

    @property
    def band(self) -> SolarBand:
        """The sun's spectrum with the sensor's response."""
        nm, response = np.array(self.response).T
        return response_band(wavelength_nm=nm, response=response, distance_factor=self.distance_factor)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Lit:
    lighting: Lighting
    sky: Sky
    sky_error: float


class Skies:
    """Makes illuminations, and keeps the last few skies."""

    def __init__(self, *, solver: Solver = solve) -> None:
        self._solver = solver
        self._kept: OrderedDict[SkyRequest, _Lit] = OrderedDict()

    def illumination(self, request: SkyRequest, *, sun_azimuth_rad: float) -> Illumination:
        """Return sun, sky and air for a request.

        Raises
        ------
        ValueError
            A number is outside its range, such as a sun below 85 deg from the zenith.
        ConfigError
            The table cannot be read, or is of another sun.
        """
        require_sun_zenith(request.sun_zenith_rad)
        lit = self._lit(request)
        return illuminate(
            lit.lighting,
            sun_zenith_rad=request.sun_zenith_rad,
            sun_azimuth_rad=sun_azimuth_rad,
            ground_albedo=request.ground_albedo,
            sky=lit.sky,
            sky_error=lit.sky_error,
        )

    def _lit(self, request: SkyRequest) -> _Lit:
        if request not in self._kept:
            self._kept[request] = self._made(request)
            if len(self._kept) > _KEPT:
                self._kept.popitem(last=False)
        self._kept.move_to_end(request)
        return self._kept[request]

    def _made(self, request: SkyRequest) -> _Lit:
        if request.tier is Tier.TABLE:
            lighting = _table(request)
            return _Lit(lighting=lighting, sky=lighting.sky, sky_error=0.0)
        if request.state is None:
            raise ConfigError("atmosphere: visibility_km or aerosol_optical_depth is needed")
        computed = compute_lighting(
            request.state,
            tier=request.tier,
            band=request.band,
            mu0=float(np.cos(request.sun_zenith_rad)),
            albedo=request.ground_albedo,
            aerosol=request.aerosol,
            wavelengths=request.wavelengths,
            dolp_max=request.dolp_max,
            solver=self._solver,
        )
        sampled = sample_sky(computed.sky, sun_zenith_rad=request.sun_zenith_rad)
        return _Lit(lighting=computed, sky=sampled, sky_error=sampled.relative_error)


def _table(request: SkyRequest) -> Lighting:
    if request.table is None:
        raise ConfigError("atmosphere: tier 'table' needs table = \"FILE.npz\"")
    return read_sky_table(request.table, sun_zenith_rad=request.sun_zenith_rad)
