"""Sun, sky and light of regions of scenes, computed once for all that ask for them."""

from collections import OrderedDict, defaultdict
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar, Unpack, cast

import numpy as np

from model.accuracy.evaluation.light_requests import LightRequest, lights_of, passes, scatters, sky_key
from model.accuracy.evaluation.settings import Settings
from model.atmosphere.lighting.compute_lighting import compute_lighting
from model.atmosphere.lighting.diffuse_light import DiffuseLight
from model.atmosphere.lighting.lighting import Lighting
from model.atmosphere.lighting.mixed_lighting import MixedLighting
from model.atmosphere.lighting.solve_column import HowToSolve, LightSolver
from model.atmosphere.lighting.unlit import unlit_solution
from model.atmosphere.solver import solve
from model.atmosphere.transfer.layers import Layer
from model.scene.field_light import FieldLight
from model.scene.hemisphere import Rules
from model.scene.illumination import Illumination, illuminate
from model.scene.lit_scene import ALL_LIGHT, Air, LightParts, LitRegion
from model.scene.sampled_sky import MixedSky, sample_sky
from model.scene.sky import Sky
from model.scene.view import View

# Of one wavelength, with many streams and layers ten megabytes.
_KEPT = 48


class KeptSolutions:
    """Calls a solver, and keeps the last solutions."""

    def __init__(self, solver: LightSolver) -> None:
        """Set the solver."""
        self._solver = solver
        self._kept: OrderedDict[Hashable, tuple[tuple[Layer, ...], DiffuseLight]] = OrderedDict()

    def __call__(self, layers: tuple[Layer, ...], **how: Unpack[HowToSolve]) -> DiffuseLight:
        """Return the solution of one wavelength; arguments as `model.atmosphere.solver.solve`."""
        key = (tuple(map(_facts, layers)), *sorted(how.items()))
        if key not in self._kept:
            solution = self._solver(layers, **how)
            # The layers stay with it: a scattering matrix is known by its identity.
            self._kept[key] = (layers, solution)
            if len(self._kept) > _KEPT:
                self._kept.popitem(last=False)
        self._kept.move_to_end(key)
        return self._kept[key][1]


def _facts(layer: Layer) -> Hashable:
    matrix = None if layer.matrix is None else id(layer.matrix)
    scattering = (layer.ssa_aerosol, layer.g_aerosol, layer.delta, layer.forward_share)
    return (layer.tau_rayleigh, layer.tau_aerosol, *scattering, matrix)


# A sky is asked for again by the next region, the next geometry, or not at all; lights by a sweep or a derivative.
_SKIES, _LIGHTS = 16, 512

# Light that varies by less over a field is the same throughout, whatever parts of it count.
_NEVER = 1e-9

Made = TypeVar("Made")


@dataclass(frozen=True, kw_only=True, eq=False)
class _Lit:
    air: Air  # a table is known by its identity, which holds while it is kept
    lighting: Lighting
    sky: Sky
    sky_error: float


class LightStore:
    """Computes the light of scenes, and keeps the last of what it computed."""

    def __init__(self, *, solver: LightSolver = solve) -> None:
        """Set what solves a wavelength, such as a store of solutions."""
        self._solver = KeptSolutions(solver)
        self._skies: OrderedDict[object, _Lit] = OrderedDict()
        self._lights: OrderedDict[object, FieldLight] = OrderedDict()
        self._others: OrderedDict[object, object] = OrderedDict()

    @property
    def solver(self) -> LightSolver:
        """Solver of a wavelength, which keeps the last solutions."""
        return self._solver

    def once(self, key: object, make: Callable[[], Made]) -> Made:
        """Return what was made under a key of the caller's own, made where it is not kept.

        Parameters
        ----------
        key
            All that it depends on, and what it is.
        make
            Makes it.
        """
        # What is kept is of many kinds; the key says of which.
        return cast("Made", _kept(self._others, key, _SKIES, make))

    def illumination(
        self, air: Air, settings: Settings, *, sun_azimuth_rad: float, parts: LightParts = ALL_LIGHT
    ) -> Illumination:
        """Return sun, sky and air for given settings.

        Parameters
        ----------
        air
            What it depends on.
        settings
            Of solver, wavelengths and sky grid.
        sun_azimuth_rad
            Clockwise from north [rad].
        parts
            Without skylight the sky is black; without path radiance too, no light is scattered and nothing is solved.

        Raises
        ------
        ValueError
            A number is outside its range, such as a sun below 85 deg from the zenith.
        """
        lit = self._kept_sky(air, settings, parts)
        return illuminate(
            lit.lighting,
            sun_zenith_rad=air.sun_zenith_rad,
            sun_azimuth_rad=sun_azimuth_rad,
            ground_albedo=air.ground_albedo,
            sky=lit.sky,
            sky_error=lit.sky_error,
        )

    def region(
        self,
        region: LitRegion,
        settings: Settings,
        *,
        air: Air,
        view: View,
        sun_azimuth_rad: float,
        parts: LightParts = ALL_LIGHT,
        rules: Rules | None = None,
    ) -> FieldLight:
        """Return the light of a region that is given by its material.

        Parameters
        ----------
        region
            What is looked at.
        settings
            Of the sky, the integral over the hemisphere, and the tiles.
        air, view, sun_azimuth_rad
            Of the scene.
        parts
            Of the light, that are computed.
        rules
            Of the hemisphere integral, where they are known from a neighbouring scene; None to find them.

        Raises
        ------
        ValueError
            The region's radiance is given, or a number is outside its range.
        """
        request = LightRequest(
            region=region,
            settings=settings,
            air=air,
            view=view,
            sun_azimuth_rad=sun_azimuth_rad,
            parts=parts,
            rules=rules,
        )
        if (whole := self._whole(request)) is not None:
            # What is left out of light that is known needs no computing.
            return whole.with_parts(skylight=parts.skylight, path=parts.path_radiance)
        return _kept(self._lights, request.key(parts), _LIGHTS, lambda: self._made((request,))[0])

    def _whole(self, request: LightRequest) -> FieldLight | None:
        """Return light of which only some parts are asked for, where it is kept with all of them."""
        whole = replace(request.parts, skylight=True, path_radiance=True)
        if request.parts == whole or request.settings.negligible_spread > _NEVER:
            return None
        return self._lights.get(request.key(whole))

    def keep_together(self, requests: Iterable[LightRequest]) -> None:
        """Compute lights in few array passes, those that differ in the view alone in one, and keep them.

        Parameters
        ----------
        requests
            Together no more than are kept. Those without known rules have some that suffice for all in one pass.

        Raises
        ------
        ValueError
            A number is outside its range.
        """
        groups: dict[object, dict[object, LightRequest]] = defaultdict(dict)
        for one in requests:
            if one.key(one.parts) not in self._lights and self._whole(one) is None:
                groups[one.alike][one.key(one.parts)] = one
        for group in groups.values():
            for keys in passes(group):
                for key, light in zip(keys, self._made([group[key] for key in keys]), strict=True):
                    self._lights[key] = light
        while len(self._lights) > _LIGHTS:
            self._lights.popitem(last=False)

    def _made(self, requests: Sequence[LightRequest]) -> tuple[FieldLight, ...]:
        """Lights that differ in the view alone."""
        one = requests[0]
        illumination = self.illumination(one.air, one.settings, sun_azimuth_rad=one.sun_azimuth_rad, parts=one.parts)
        try:
            return lights_of(illumination, requests)
        except ValueError as error:
            raise ValueError(f"region {one.region.name}: {error}") from error

    def _kept_sky(self, air: Air, settings: Settings, parts: LightParts) -> _Lit:
        key = sky_key(air, settings, parts)
        return _kept(self._skies, key, _SKIES, lambda: self._lit(air, settings, parts))

    def _lit(self, air: Air, settings: Settings, parts: LightParts) -> _Lit:
        if air.alternative is not None:
            alone = self._kept_sky(replace(air, alternative=None, share=0.0), settings, parts)
            return _mixed(air, alone, self._kept_sky(air.alternative, settings, parts))
        lighting = self._lighting(air, settings, parts)
        if not parts.skylight:
            return _Lit(air=air, lighting=lighting, sky=_black, sky_error=0.0)
        if air.table is not None or settings.sky_zeniths == 0:
            return _Lit(air=air, lighting=lighting, sky=lighting.sky, sky_error=0.0)
        sampled = sample_sky(
            lighting.sky,
            sun_zenith_rad=air.sun_zenith_rad,
            zeniths=settings.sky_zeniths,
            azimuths=settings.sky_azimuths,
        )
        return _Lit(air=air, lighting=lighting, sky=sampled, sky_error=sampled.relative_error)

    def _lighting(self, air: Air, settings: Settings, parts: LightParts) -> Lighting:
        if air.table is not None:
            return air.table
        if air.state is None:
            raise ValueError("atmosphere: visibility or optical depth of the aerosol is needed, or a table")
        return compute_lighting(
            air.state,
            fidelity=air.fidelity,
            band=air.band,
            mu0=float(np.cos(air.sun_zenith_rad)),
            albedo=air.ground_albedo,
            aerosol=air.aerosol,
            wavelengths=settings.wavelengths,
            split_at_kinks=settings.split_at_kinks,
            dolp_max=air.dolp_max,
            solver=self._solver if scatters(parts) else unlit_solution,
            settings=settings.solver,
        )


def _mixed(air: Air, one: _Lit, other: _Lit) -> _Lit:
    return _Lit(
        air=air,
        lighting=MixedLighting(first=one.lighting, second=other.lighting, share=air.share),
        sky=MixedSky(first=one.sky, second=other.sky, share=air.share),
        sky_error=max(one.sky_error, other.sky_error),
    )


def _black(*, zenith_rad: object, phi_rad: object) -> np.ndarray:
    """Sky without light."""
    shape = np.broadcast_shapes(np.shape(np.asarray(zenith_rad)), np.shape(np.asarray(phi_rad)))
    return np.zeros((*shape, 3))


def _kept(kept: OrderedDict[object, Made], key: object, limit: int, make: Callable[[], Made]) -> Made:
    """Return what is kept under a key, made where it is not; the oldest by use goes first."""
    if key not in kept:
        kept[key] = make()
        if len(kept) > limit:
            kept.popitem(last=False)
    kept.move_to_end(key)
    return kept[key]
