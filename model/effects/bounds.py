"""Bounds of what leaving out an effect of the light changes of a prediction, before anything is solved.

A bound is made in three steps. `light_limits` gives the limits of each region's radiance: that of the beam is known,
and what air scatters is bounded by its optical depth and the conservation of energy. From them follow limits of the
mean counts of a region and of their covariance (`radiance_bounds`). For each effect a function then states by how much
the mean and the covariance can change (`Disturbance`), and `bound_of` and `_detection_bound` translate that into the
numbers of a prediction: radiance, ratios, deviations and probabilities of detection.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.air import Column, column
from model.atmosphere.sky import Fidelity, Lighting, SolarBand, SolverSettings, compute_lighting, unlit_solution
from model.effects.effect import EVERYTHING, LIGHT, Bound, Effect
from model.numerics import chdtri, erfc, expn
from model.processing.detection import CONDITION_LIMIT
from model.processing.reconstruction import design
from model.scene.field import BACKSCATTER
from model.scene.panel import View, aperture_lights
from model.scene.scene import Air, LitRegion, LitScene
from model.scene.sky_light import illuminate
from model.sensor import electrons_per_radiance, temporal_variance_dn2
from model.stokes import analyzer_row, angle_between_rad, direction
from model.surface.pbrdf import Surface, Tilt, mueller

FloatArray = NDArray[np.float64]


class Light(NamedTuple):
    """Upper limits of light that is added to the beam's: all of it, and what of it is polarized [W m-2 sr-1]."""

    s0: float
    polarised: float


_DARK, _ANY_LIGHT = Light(0.0, 0.0), Light(np.inf, np.inf)


@dataclass(frozen=True, kw_only=True, eq=False)
class LightLimits:
    """Limits of a region's radiance [W m-2 sr-1], and what the bounds need to know of the air before it."""

    beam: FloatArray  #: Stokes vector of the beam's light, (3,)
    parts: Mapping[Effect, Light] = field(default_factory=dict)  #: most that each effect of `LIGHT_PARTS` adds
    again: Light = _ANY_LIGHT  #: most that the sky adds by light that air scattered at least twice
    depth: float = np.inf  #: optical depth of all air, and of the air below the camera
    depth_below: float = np.inf

    @property
    def polarised(self) -> float:
        """The polarised part of the beam's light."""
        return float(np.hypot(self.beam[1], self.beam[2]))

    @cached_property
    def added(self) -> float:
        """Upper limit of all that comes beside the beam: the one place that every bound takes the other light from."""
        return sum(part.s0 for part in self.parts.values())

    def but_for(self, *effects: Effect) -> LightLimits:
        """Return the limits of what is left without some effects."""
        return replace(self, parts={one: part for one, part in self.parts.items() if one not in effects})


@dataclass(frozen=True, kw_only=True)
class Disturbance:
    """Largest change of the mean and of the covariance of one region where an effect is left out."""

    s0: float = 0.0  #: of the mean S0, over S0
    polarised: float = 0.0  #: of the mean (S1, S2), over S0
    share: float = 0.0  #: of the covariance, over itself, along any direction
    share_of_dolp: float | None = None  #: the same as far as the DoLP of the pixels depends on it; None: as `share`

    @property
    def is_nothing(self) -> bool:
        """True if the effect is not there at all."""
        return not (self.s0 or self.polarised or self.share)


def light_limits(scene: LitScene) -> dict[str, LightLimits]:
    """Return the limits of each region's light on the axis, without solving anything; of materials under thin air."""
    if scene.air is None:
        raise ValueError("light_limits: the scene has no air")
    thin, lighting = _ThinAir.of(scene.air), _beam_lighting(scene.air)
    return {one.name: _sun_light(scene, one, lighting, thin) for one in scene.regions}


def effect_bounds(
    scene: LitScene, limits: Mapping[str, LightLimits], effects: frozenset[Effect] = LIGHT
) -> dict[Effect, Bound]:
    """Return for each of some effects of the light how much leaving it out can change; for regions without extent."""
    regions = {one.name: radiance_bounds(scene, one, limits[one.name]) for one in scene.regions}
    found: dict[Effect, Bound] = {}
    for effect in (one for one in Effect if one in effects & _BOUNDS.keys()):
        of_region = _BOUNDS[effect]
        changes = {name: of_region(scene, region, limits[name]) for name, region in regions.items()}
        found[effect] = _worst(scene, regions, changes)
    return found


def _worst(scene: LitScene, regions: Mapping[str, RegionBounds], found: Mapping[str, Disturbance]) -> Bound:
    """Worst bound of all regions, and of detection between them."""
    worst = Bound()
    for name, region in regions.items():
        worst = worst.worse(bound_of(region, found[name]))
    # The area under the curve is a mean over thresholds: that of its mean distance is covered too.
    eta = max(3.0, float(chdtri(3, min(scene.p_false_alarm)))) if scene.p_false_alarm else 3.0
    for target, background in scene.pairs:
        detection = _detection_bound(regions[target], found[target], regions[background], found[background], eta=eta)
        worst = worst.worse(Bound(detection=detection))
    return worst


# What the largest pBRDF on a grid is taken times for what its steps miss.
_MISSED = 1.5
# Under air as thick as this the sky sends so much that no bound is of use.
_THIN = 0.05
# Under air thinner than this a computed sky is bright at the horizon alone and has few digits there, if any: its grid
# may be off by more than all of it, and polarised by more than 1.
NEXT_TO_NONE, _FEW_DIGITS = 1e-4, 10.0
# The beam sees the depth of all layers and no more.
_FEWEST_LAYERS = SolverSettings(fine_layers=False, nodes=4, element_depth=0.1, tolerance=1e-3)
_WITH_BEAM = ("total", "reflected", "reflected_sun")

# Optical depth falls at most as this power of the wavelength: molecules have 4.1, no aerosol more.
_POWER = 4.2


def is_bounded(scene: LitScene) -> bool:
    """Return whether bounds are looked for: of materials without an extent under air that is thin and well known.

    In thick air the sky alone may add a tenth of the beam's light, and no bound is of use beside it. Over a field the
    light is not known without computing it.
    """
    air = scene.air
    if air is None or air.alternative is not None or air.state is None or air.fidelity is Fidelity.ANALYTIC:
        return False
    is_simple = all(one.surface is not None and one.part is None for one in scene.regions)
    return is_simple and _ThinAir.of(air).depth < _THIN


_NOTHING = Disturbance()
_UNKNOWN = Disturbance(s0=np.inf, polarised=np.inf)


def _added_by(effect: Effect) -> Callable[[LitScene, RegionBounds, LightLimits], Disturbance]:
    """Return what gives the disturbance by an effect that adds light."""
    return lambda scene, region, light: added(scene, region, light.parts.get(effect, _DARK))


def _wavelengths(scene: LitScene, region: RegionBounds, light: LightLimits) -> Disturbance:
    """Return what one wavelength, the mean of the band, misses of sky, path and transmittance.

    Light L of a depth tau ~ lambda^-4.2 changes by at most K per relative wavelength, K = 4.2 (1 + 2 tau / mu0 +
    2 tau / mu_v), and its curvature is at most K (K + 5). At the mean of the band the slope drops out
    (`model.atmosphere.sky`): with the variance v of the relative wavelength over the band K (K + 5) v / 2 of
    all that the air scatters, but of no more than there may be of it. The transmittance T of the air below the camera,
    of slant depth x, changes by 4.2 x per relative wavelength and its curvature is at most 4.2 x (4.2 x + 5); weighted
    by the beam, whose own slope is at most K, it misses 4.2 x (4.2 x + 5 + 2 K) v / 2 of what is reflected.
    """
    if scene.air is None or scene.view is None:
        return _UNKNOWN
    air = scene.air
    slant = 1.0 / np.cos(scene.view.zenith_rad)
    steepness = _steepness(air, light.depth, slant)
    way = _POWER * light.depth_below * slant
    variance = _relative_variance(air)
    scattered = min(region.counts_per_radiance * light.added / region.s0_low, 1.0) if region.is_known else 1.0
    missed = 0.5 * variance * steepness * (steepness + 5.0) * scattered
    missed += 0.5 * variance * way * (way + 5.0 + 2.0 * steepness)
    return _moved(scene, region, missed, missed) if missed < 1.0 and region.is_known else _UNKNOWN


def added(scene: LitScene, region: RegionBounds, light: Light) -> Disturbance:
    """Return what light that is added changes."""
    if light.s0 == 0.0:
        return _NOTHING
    if not (region.is_known and np.isfinite(light.s0)):
        return _UNKNOWN
    share = region.counts_per_radiance / region.s0_low
    return _moved(scene, region, share * light.s0, share * light.polarised) if share * light.s0 < 1.0 else _UNKNOWN


def _moved(scene: LitScene, region: RegionBounds, s0: float, polarised: float) -> Disturbance:
    """Return a shift of the mean, with what it does to the shot noise and to the texture."""
    noise = scene.sensor.noise
    s0, polarised = s0 + region.crosstalk * max(s0, polarised), polarised + region.crosstalk * max(s0, polarised)
    counts = 0.5 * (s0 + polarised) * region.s0_high * 2.0
    variance = noise.noise_factor**2 * noise.gain_dn_per_e * counts
    share = _times(variance, region.share_of_noise) if noise.shot_noise else 0.0
    texture = _of_texture(scene, region, float(np.hypot(s0, polarised)))
    return Disturbance(
        s0=s0,
        polarised=polarised,
        share=share + texture + texture**2,
        share_of_dolp=share + texture / np.sqrt(region.cycles) + texture**2 / region.cycles,
    )


def _of_texture(scene: LitScene, region: RegionBounds, shift: float) -> float:
    """Amplitude b of what texture and pattern, which go with the light, change.

    A part v v' of a covariance C = N + v v' + ... that becomes (v + d) (v + d)' changes x'Cx by 2 (xv) (xd) + (xd)^2.
    With b the largest of |xd| over the root of x'Nx, and since 2 |xv| times that root is at most x'Cx, it is b + b^2 of
    x'Cx at most. N is the noise of a mean over cycles: of one cycle b is smaller by the root of their number.
    """
    one, noise = region.region, scene.sensor.noise
    relative = noise.prnu + (1.0 + noise.prnu) * (one.texture_rms + max(one.texture_diagonal))
    return _times(relative * shift * region.s0_high, float(np.sqrt(region.share_of_light))) if relative > 0.0 else 0.0


def _times(size: float, share: float) -> float:
    """Return so many times the share of a unit: none of nothing, and no limit where the size has none."""
    if size == 0.0:
        return 0.0
    return size * share if np.isfinite(size) else np.inf


def _steepness(air: Air, depth: float, slant: float) -> float:
    """Most by which light that the air scatters changes per relative wavelength, over itself."""
    return float(_POWER * (1.0 + 2.0 * depth * (1.0 / np.cos(air.sun_zenith_rad) + slant)))


def _relative_variance(air: Air) -> float:
    """Variance over the band of the wavelength over its mean, by its inverse, as at the shortest wavelength."""
    shares, inverse = air.band.shares, 1.0 / air.band.wavelength_m
    mean = float(shares @ inverse / np.sum(shares))
    variance = float(shares @ (inverse / mean - 1.0) ** 2 / np.sum(shares))
    return variance * float((mean / np.min(inverse[shares > 0.0])) ** 2)


def _beam_lighting(air: Air) -> Lighting:
    """Return the light of the beam alone; nothing is solved."""
    if air.state is None:
        raise ValueError("atmosphere: visibility or optical depth of the aerosol is needed for limits of its light")
    return compute_lighting(
        air.state,
        fidelity=air.fidelity,
        band=air.band,
        mu0=float(np.cos(air.sun_zenith_rad)),
        albedo=air.ground_albedo,
        aerosol=air.aerosol,
        wavelengths=2 if is_narrow(air.band) else 4,
        dolp_max=air.dolp_max,
        solver=unlit_solution,
        settings=_FEWEST_LAYERS,
    )


def _sun_light(scene: LitScene, region: LitRegion, lighting: Lighting, thin: _ThinAir) -> LightLimits:
    """Return the limits of a region's radiance before sky and path are known."""
    panel, air = _panel(scene, region)
    is_counted = scene.source in _WITH_BEAM
    return LightLimits(
        beam=_beam(panel, air, lighting, scene.sun_azimuth_rad) if is_counted else np.zeros(3),
        parts={effect: most(scene, panel, thin) for effect, most in LIGHT_PARTS.items()},
        again=_reflected(scene, panel, thin, thin.sky_again),
        depth=thin.depth,
        depth_below=thin.depth_below(panel.view.height_m),
    )


class _Panel(NamedTuple):
    """A region of a material, and the view on it."""

    surface: Surface
    tilt: Tilt
    view: View


def _panel(scene: LitScene, region: LitRegion) -> tuple[_Panel, Air]:
    if scene.air is None or scene.view is None or region.surface is None or region.tilt is None:
        raise ValueError(f"region {region.name}: needs air, view, surface and tilt")
    return _Panel(surface=region.surface, tilt=region.tilt, view=scene.view), scene.air


def _slant(panel: _Panel) -> float:
    """Way through air to the camera over that upward."""
    return 1.0 / float(np.cos(panel.view.zenith_rad))


def _beam(panel: _Panel, air: Air, lighting: Lighting, sun_azimuth_rad: float) -> FloatArray:
    """Stokes radiance that the beam sends to the view of a panel, (3,)."""
    illumination = illuminate(
        lighting,
        sun_zenith_rad=air.sun_zenith_rad,
        sun_azimuth_rad=sun_azimuth_rad,
        ground_albedo=air.ground_albedo,
        sky=_black_sky,
    )
    (light,) = aperture_lights(
        illumination, surface=panel.surface, tilt=panel.tilt, views=(panel.view,), skylight=False, path=False
    )
    return light.reflected_sun


def _black_sky(*, zenith_rad: object, phi_rad: object) -> FloatArray:
    """Return no light from any direction."""
    shape = np.broadcast_shapes(np.shape(np.asarray(zenith_rad)), np.shape(np.asarray(phi_rad)))
    return np.zeros((*shape, 3))


# What each effect may add to the light of the beam. An effect that is entered here is in the total of all others


def _skylight(scene: LitScene, panel: _Panel, thin: _ThinAir) -> Light:
    """Return the most that the sky adds, ten times that where a computed sky has few digits."""
    if scene.source not in ("total", "reflected", "reflected_sky"):
        return _DARK
    found = _reflected(scene, panel, thin, thin.sky)
    if thin.depth >= NEXT_TO_NONE:
        return Light(found.s0, min(found.polarised, found.s0))
    return Light(_FEW_DIGITS * found.s0, _FEW_DIGITS * found.s0)


def _path_radiance(scene: LitScene, panel: _Panel, thin: _ThinAir) -> Light:
    """Return the most that the air adds between region and camera."""
    if scene.air is None or scene.source not in ("total", "path"):
        return _DARK
    sun = direction(zenith_rad=scene.air.sun_zenith_rad, azimuth_rad=scene.sun_azimuth_rad)
    toward = direction(zenith_rad=panel.view.zenith_rad, azimuth_rad=panel.view.azimuth_rad)
    found = thin.path(panel, scattering_rad=angle_between_rad(-sun, toward))
    return Light(found, found)


def _adjacency(scene: LitScene, panel: _Panel, thin: _ThinAir) -> Light:
    """Return the most that the surroundings add: their radiance beyond that of the mean ground, as far as it arrives.

    The radiance is |A' - A| G / pi with G the irradiance of the ground, and of it T^b - T arrive, unpolarised.
    """
    around = scene.imperfections.surround_albedo
    if around is None or scene.source not in ("total", "path"):
        return _DARK
    beyond = abs(around - thin.ground_albedo) / np.pi * thin.received
    return Light(beyond * thin.mixed_in(height_m=panel.view.height_m, slant=_slant(panel)), 0.0)


LIGHT_PARTS: dict[Effect, Callable[[LitScene, _Panel, _ThinAir], Light]] = {
    Effect.SKYLIGHT: _skylight,
    Effect.PATH_RADIANCE: _path_radiance,
    Effect.ADJACENCY: _adjacency,
}

# Radiance of the sky by zenith angle and angle from the sun, both of one shape [W m-2 sr-1].
RadianceOfSky = Callable[[FloatArray, FloatArray], FloatArray]

# Steps over the hemisphere in the search of the largest pBRDF.
_ZENITHS, _AZIMUTHS = 46, 31
# Digits of the view on that grid [rad].
_DIGITS = 2


def _reflected(scene: LitScene, panel: _Panel, thin: _ThinAir, sky: RadianceOfSky) -> Light:
    """Return the most that a level panel reflects of a sky to its view; no limit is known of a tilted one.

    Of light of any polarization a surface reflects at most f0 = F00 + |(F01, F02)|, and as polarised light at most fp =
    |(F10, F20)| + the norm of the rest of F, which an unpolarized diffuse term has not. Summed over a grid of
    directions with the mirror direction in it, times 1.5.

    [MK14] eq. (2), (3).
    """
    if panel.tilt.tilt_rad != 0.0:
        return _ANY_LIGHT
    sun_zenith_rad, view = float(np.arccos(thin.mu)), panel.view
    angle, off_rad = (round(one, _DIGITS) for one in (view.zenith_rad, scene.sun_azimuth_rad - view.azimuth_rad))
    near = panel.surface.slope_rms * np.linspace(-3.0, 3.0, 13)
    grid = [np.linspace(0.0, 0.5 * np.pi - 1e-3, _ZENITHS), angle + near]
    zenith = np.unique(np.clip(np.concatenate(grid), 0.0, 0.5 * np.pi - 1e-6))[:, np.newaxis]
    azimuth = np.concatenate([np.linspace(0.0, np.pi, _AZIMUTHS), np.pi - np.abs(near)])
    azimuth = np.unique(np.clip(azimuth, 0.0, np.pi))
    reflectance = _most_reflected(mueller(zenith, angle, azimuth, surface=panel.surface)) * np.cos(zenith)
    both_sides = np.zeros(())
    for side in (azimuth, -azimuth):
        toward = np.cos(zenith) * thin.mu + np.sin(zenith) * np.sin(sun_zenith_rad) * np.cos(side - off_rad)
        scattering = np.arccos(np.clip(toward, -1.0, 1.0))
        both_sides = both_sides + sky(np.broadcast_to(zenith, scattering.shape), scattering)
    rows = _sum(reflectance * both_sides, azimuth)
    return Light(*(_MISSED * _sum(rows * np.sin(zenith[:, 0]), zenith[:, 0])).tolist())


def _most_reflected(mueller: FloatArray) -> FloatArray:
    """Most of S0 and of polarised light that matrices make of light of any polarization, shape (2, ...)."""
    rest = mueller[..., 1:, 1:]
    squares = np.sum(rest**2, axis=(-2, -1))
    determinant = rest[..., 0, 0] * rest[..., 1, 1] - rest[..., 0, 1] * rest[..., 1, 0]
    norm = np.sqrt(0.5 * (squares + np.sqrt(np.maximum(squares**2 - 4.0 * determinant**2, 0.0))))
    total = mueller[..., 0, 0] + np.hypot(mueller[..., 0, 1], mueller[..., 0, 2])
    return np.stack([total, np.hypot(mueller[..., 1, 0], mueller[..., 2, 0]) + norm])


def _sum(values: FloatArray, at: FloatArray) -> FloatArray:
    """Integral over the last axis by the trapezoidal rule."""
    return np.asarray(0.5 * np.sum((values[..., 1:] + values[..., :-1]) * np.diff(at), axis=-1))


# Of what is scattered more than once, directions are known to nobody: its phase function is taken as this, and a beam
# that was scattered once before as turned by up to that angle.
_SPREAD_PHASE = 2.0
_TURNED_RAD = np.radians(30.0)
# Room for interpolation over wavelengths and for the phase functions of spheres, which are no Henyey-Greenstein ones.
_ROOM = 1.5
# Parts of a band, each as thick as at its thicker end: a wide one has so many, a narrow one is one.
_SLICES, _NARROW = 4, 1.05
# Molecules turn light by any angle with a phase function of 1.5 or less; a little more for their depolarization.
_MOLECULES = 1.01
# The largest difference of transmittances T^b - T is at this slant depth.
_MOST_MIXED = -np.log(BACKSCATTER) / (1.0 - BACKSCATTER)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Slice:
    """Part of a band: its irradiance outside the atmosphere [W m-2], and the air where it is thickest and thinnest."""

    outside: float
    thick: Column
    thin: Column

    @cached_property
    def depth(self) -> float:
        """Largest optical depth."""
        return self.thick.depth

    @cached_property
    def asymmetries(self) -> tuple[float, ...]:
        """Of its aerosols."""
        return tuple({one.g for column in (self.thick, self.thin) for one in (column.lower, column.upper)})

    def scattered_once(self, scattering_rad: FloatArray) -> FloatArray:
        """Return the largest phase function of molecules times their depth, and that of all air times the rest's."""
        molecules, rest = (
            max(getattr(column, name) for column in (self.thick, self.thin)) for name in ("tau_rayleigh", "tau_aerosol")
        )
        return np.asarray(molecules * _phase((), scattering_rad) + rest * _phase(self.asymmetries, scattering_rad))


# All regions of a scene ask for the same: records are known by their identity.
@lru_cache(maxsize=32)
def _above_and_below(part: _Slice, height_m: float) -> tuple[float, float]:
    """Least optical depth above a height and largest below it."""
    thick, thin = (float(one.tau_above(height_m)) for one in (part.thick, part.thin))
    return min(thick, thin), part.depth - thick


@dataclass(frozen=True, kw_only=True, eq=False)
class _ThinAir:
    """Upper bounds of light, all in band.

    With irradiance E outside the atmosphere, mu its cosine, depth tau (the largest in a part of the band), ground
    albedo A: the ground receives G <= E mu / (1 - A s), s = 1 - 2 E3(tau), since what returns to it has been scattered.
    The actinic flux anywhere is at most (E + 2 A G) / E2(tau / 2): in an isotropically scattering slab at least the
    share E2(tau / 2) of a source leaves without another scattering.

    Definition; conservation of energy. E_n are the exponential integrals.
    """

    slices: tuple[_Slice, ...]
    mu: float
    ground_albedo: float

    @classmethod
    def of(cls, air: Air) -> _ThinAir:
        """Return the bounds of air whose state is known."""
        return cls(slices=_slices(air), mu=float(np.cos(air.sun_zenith_rad)), ground_albedo=air.ground_albedo)

    @property
    def received(self) -> float:
        """Irradiance of the ground by sun and sky [W m-2]."""
        return sum(map(self.received_of, self.slices))

    @property
    def depth(self) -> float:
        """Largest optical depth in the band."""
        return max(one.depth for one in self.slices)

    def depth_below(self, height_m: float) -> float:
        """Return the largest optical depth in the band between the ground and a height [m]."""
        return max(_above_and_below(one, height_m)[1] for one in self.slices)

    def sky(self, zenith_rad: FloatArray, scattering_rad: FloatArray) -> FloatArray:
        """Return upper bounds of the radiance of the sky by direction [W m-2 sr-1].

        Of the beam no more is scattered than the share 1 - exp(-tau / mu) by the larger of the phase functions of
        molecules and aerosol, nor more than tau / mu of each by its own.
        """
        slant, found = 1.0 / np.maximum(np.cos(zenith_rad), 1e-12), np.zeros(np.shape(scattering_rad))
        for part in self.slices:
            scattered = -np.expm1(-part.depth * slant)
            once = np.minimum(
                _phase(part.asymmetries, scattering_rad) * scattered, part.scattered_once(scattering_rad) * slant
            )
            found = found + part.outside * once + self.rest_of(part, scattering_rad) * scattered
        return _ROOM / (4.0 * np.pi) * found

    def sky_again(self, zenith_rad: FloatArray, scattering_rad: FloatArray) -> FloatArray:
        """Return upper bounds of the sky's radiance by light that air scattered at least twice [W m-2 sr-1].

        Light of the beam that came off the ground, and was scattered once then, is not in it.
        """
        slant, found = 1.0 / np.maximum(np.cos(zenith_rad), 1e-12), np.zeros(np.shape(scattering_rad))
        for part in self.slices:
            beam = part.outside * self.mu * np.exp(-part.depth / self.mu)
            again = self.rest_of(part, scattering_rad) - 2.0 * _SPREAD_PHASE * self.ground_albedo * beam
            found = found + again * -np.expm1(-part.depth * slant)
        return _ROOM / (4.0 * np.pi) * found

    def path(self, panel: _Panel, *, scattering_rad: FloatArray) -> float:
        """Return an upper bound of the radiance that air adds between the ground and a camera [W m-2 sr-1].

        The radiance is at most the largest source times 1 - exp(-tau_below / mu_v). The source is, over 4 pi: the beam
        as it reaches the camera's height, times the larger phase function of molecules and aerosol; what was
        scattered out of the beam, times that function within 30 deg; and 2 times the actinic flux of all other light.
        """
        height_m, slant, found = panel.view.height_m, _slant(panel), np.zeros(())
        for part in self.slices if height_m > 0.0 else ():
            above, below = _above_and_below(part, height_m)
            beam = part.outside * np.exp(-above / self.mu) * _phase(part.asymmetries, scattering_rad)
            found = found + (beam + self.rest_of(part, scattering_rad)) * -np.expm1(-below * slant)
        return float(_ROOM / (4.0 * np.pi) * found)

    def mixed_in(self, *, height_m: float, slant: float) -> float:
        """Return the largest share of the light of wide surroundings that air scatters into a line of sight, 0 to 1."""
        if height_m == 0.0:
            return 0.0
        way = min(self.depth_below(height_m) * slant, _MOST_MIXED)
        return float(np.exp(-BACKSCATTER * way) - np.exp(-way))

    def rest_of(self, part: _Slice, scattering_rad: FloatArray) -> FloatArray:
        """Return the most that is scattered of all but the beam, over the depth and 1 / (4 pi) [W m-2]."""
        nearest = np.maximum(scattering_rad - _TURNED_RAD, 0.0)
        turned = part.outside * -np.expm1(-part.depth / self.mu) * _phase(part.asymmetries, nearest, turned=True)
        received, lost = self.received_of(part), float(expn(2, 0.5 * part.depth))
        actinic = (part.outside + 2.0 * self.ground_albedo * received) / lost
        diffuse = (1.0 - lost) * actinic + 2.0 * self.ground_albedo * received
        return np.asarray(turned + _SPREAD_PHASE * diffuse)

    def received_of(self, part: _Slice) -> float:
        """Return what a part of the band brings to the ground [W m-2]."""
        returned = self.ground_albedo * (1.0 - 2.0 * float(expn(3, part.depth)))
        return float(part.outside * self.mu / (1.0 - returned))


def is_narrow(band: SolarBand) -> bool:
    """Return whether a band is one in which the air is all but the same."""
    shortest, longest = band.limits_m
    return bool(longest <= _NARROW * shortest)


def _slices(air: Air) -> tuple[_Slice, ...]:
    if air.state is None:
        raise ValueError("air without a state has no optical depth")
    shortest, longest = air.band.limits_m
    edges = np.linspace(shortest, longest, 2 if is_narrow(air.band) else _SLICES + 1)
    columns = [column(air.state, wavelength_m=float(edge)) for edge in edges]
    place = np.clip(np.searchsorted(edges, air.band.wavelength_m, side="right") - 1, 0, edges.size - 2)
    outside = np.bincount(place, weights=air.band.shares, minlength=edges.size - 1)
    return tuple(
        _Slice(
            outside=float(sent),
            thick=max(ends, key=lambda one: one.depth),
            thin=min(ends, key=lambda one: one.depth),
        )
        for sent, ends in zip(outside, pairwise(columns), strict=True)
    )


def _phase(asymmetries: tuple[float, ...], scattering_rad: FloatArray, *, turned: bool = False) -> FloatArray:
    """Largest phase function of molecules and of aerosols (Henyey-Greenstein); of molecules 1.5 for turned light."""
    cosine = np.cos(scattering_rad)
    largest = np.asarray(1.5 if turned else _MOLECULES * 0.75 * (1.0 + cosine**2))
    for g in asymmetries:
        largest = np.maximum(largest, (1.0 - g**2) / (1.0 + g**2 - 2.0 * g * cosine) ** 1.5)
    return largest


@dataclass(frozen=True, kw_only=True, eq=False)
class RegionBounds:
    """Limits of one region, in counts [DN]; equal where its radiance is given."""

    region: LitRegion
    s0_low: float
    s0_high: float
    polarised_low: float
    polarised_high: float
    signal_low: FloatArray  #: least mean of each channel, (N,), and the least temporal variance there
    variance_low: FloatArray
    inverse: FloatArray  #: from channels to Stokes parameters, (3, N)
    counts_per_radiance: float
    noise_low: FloatArray  #: least temporal covariance of the Stokes parameters of one cycle, (3, 3)
    cov_high: FloatArray  #: largest covariance over pixels, and that without a factor common to a pixel's Stokes vector
    own_high: FloatArray
    cycles: int
    crosstalk: float  #: share of S0 that drift mixes into S1 and S2, and the other way

    @property
    def is_known(self) -> bool:
        """True if there is light for certain, and not without limit."""
        return self.s0_low > 0.0 and bool(np.isfinite(self.s0_high))

    def to_channels(self, cov: FloatArray) -> FloatArray:
        """Return a covariance of Stokes parameters as one of channels, shape (N, N)."""
        system = np.linalg.pinv(self.inverse)
        return np.asarray(system @ cov @ system.T)

    @cached_property
    def share_of_noise(self) -> float:
        """Share of a temporal variance of 1 DN^2 of every channel, in any direction and channel."""
        ones, least = np.ones_like(self.variance_low), float(np.min(self.variance_low))
        if not np.all(np.isfinite(self.variance_low)) or least <= 0.0:
            return np.inf
        # Of channels that vary apart the largest ratio is that of one of them.
        return max(_share_of(_of_channels(self.inverse, ones), self.noise_low), 1.0 / least)

    @cached_property
    def share_of_light(self) -> float:
        """Ratio of a variance of 1 DN^2 of every Stokes parameter to the least noise of a mean over the cycles."""
        cov = self.to_channels(np.eye(3))
        in_stokes = _share_of(self.inverse @ cov @ self.inverse.T, self.noise_low / self.cycles)
        return max(in_stokes, _share_of(cov, np.diag(self.variance_low) / self.cycles))


# One plan asks for the bounds of effects in several groups: records are known by their identity.
@lru_cache(maxsize=32)
def radiance_bounds(scene: LitScene, region: LitRegion, light: LightLimits) -> RegionBounds:
    """Return the limits of a region.

    Light of sky and path adds to every channel, so that what the beam alone gives is a lower limit; noise grows with
    the light. Drift and scatter of angles widen the limits. Drift by d mixes Stokes parameters by W diag(f) M
    - 1, at most d / 2 times the condition of M.
    """
    sensor, readout, session = scene.sensor, scene.readout, scene.imperfections
    scale = sensor.noise.gain_dn_per_e * electrons_per_radiance(sensor) * sensor.tau_parallel
    least, most = (scale * (1.0 + sign * 0.5 * abs(session.drift)) for sign in (-1.0, 1.0))
    low, high = _signals(scene, light, least, most)
    plan = design(readout.angles_rad, readout.extinction_ratio)
    variance_low, variance_high = (
        temporal_variance_dn2(one, noise=sensor.noise, exposure_s=sensor.exposure_s) for one in (low, high)
    )
    noise_low, noise_high = (_of_channels(plan.inverse, one) for one in (variance_low, variance_high))
    s0, s0_high = float(light.beam[0]), most * (float(light.beam[0]) + light.added)
    texture = _texture_high(region, s0_high=s0_high, scale=scale)
    turned = noise_high + _scatter_high(scene, texture, plan.inverse, s0_high)
    apart = _apart_high(region, light, texture, s0_high=s0_high, scale=scale)
    return RegionBounds(
        region=region,
        s0_low=least * s0,
        s0_high=s0_high,
        polarised_low=least * session.kept_polarization * max(light.polarised - light.added, 0.0),
        polarised_high=min(most * (light.polarised + light.added), s0_high),
        signal_low=low,
        variance_low=variance_low,
        inverse=plan.inverse,
        counts_per_radiance=scale,
        noise_low=noise_low,
        cov_high=turned + _with_light(scene, texture, plan.inverse, high, s0_high),
        own_high=turned + _with_light(scene, apart, plan.inverse, np.zeros_like(high), s0_high),
        cycles=readout.cycles,
        crosstalk=np.sqrt(2.0) * 0.5 * abs(session.drift) * plan.condition,
    )


def _signals(scene: LitScene, light: LightLimits, least: float, most: float) -> tuple[FloatArray, FloatArray]:
    """Least and largest mean of each channel, (N,) each, of so many counts per radiance."""
    sensor, kept = scene.sensor, scene.imperfections.kept_polarization
    rows = analyzer_row(scene.readout.angles_rad, 1.0, sensor.tau_perpendicular / sensor.tau_parallel)
    weakened = rows * np.array([1.0, kept, kept])
    beams = np.stack([rows @ light.beam, weakened @ light.beam])
    return least * np.maximum(beams.min(axis=0), 0.0), most * (beams.max(axis=0) + light.added)


def _of_channels(inverse: FloatArray, variances: FloatArray) -> FloatArray:
    """Covariance of the Stokes parameters of channels that vary apart; infinite where no limit of one is known."""
    if not np.all(np.isfinite(variances)):
        return np.full((3, 3), np.inf)
    return np.asarray(inverse @ np.diag(variances) @ inverse.T)


def _share_of(part: FloatArray, whole: FloatArray) -> float:
    """Return the largest ratio of two quadratic forms along any direction; infinite where the whole has none of it.

    Definition; the largest eigenvalue of L^-1 P L^-T, L being the Cholesky factor of the whole.
    """
    if not np.any(part):
        return 0.0
    if not np.all(np.isfinite(part)) or not np.all(np.isfinite(whole)):
        return np.inf
    try:
        root = np.linalg.cholesky(whole)
    except np.linalg.LinAlgError:
        return np.inf
    relative = np.linalg.solve(root, np.linalg.solve(root, part).T)
    return float(max(np.linalg.eigvalsh(relative)[-1], 0.0))


def _texture_high(region: LitRegion, *, s0_high: float, scale: float) -> FloatArray:
    """Upper bound of the texture's covariance, as the light allows.

    A factor common to a vector R has the covariance t^2 R R', at most t^2 |R|^2 <= 2 t^2 S0^2 along any direction.
    """
    if not np.isfinite(s0_high):
        is_there = region.texture_rms > 0.0 or any(region.texture_diagonal) or bool(np.any(region.texture_cov))
        return np.full((3, 3), np.inf) if is_there else np.zeros((3, 3))
    common = 2.0 * (region.texture_rms * s0_high) ** 2 * np.eye(3)
    own = np.diag(np.square(region.texture_diagonal)) * s0_high**2
    return np.asarray(common + own + scale**2 * region.texture_cov)


def _apart_high(
    region: LitRegion, light: LightLimits, texture: FloatArray, *, s0_high: float, scale: float
) -> FloatArray:
    """Upper bound of the part of the texture that is no factor common to a pixel's Stokes vector.

    What path and surroundings add has no texture: the factor of the rest is off the whole by no more than is added.
    """
    if not np.isfinite(s0_high):
        return texture
    untextured = 2.0 * (region.texture_rms * scale * light.added) ** 2 * np.eye(3)
    return _texture_high(replace(region, texture_rms=0.0), s0_high=s0_high, scale=scale) + untextured


def _scatter_high(scene: LitScene, texture: FloatArray, inverse: FloatArray, s0_high: float) -> FloatArray:
    """Upper bound of the covariance from offsets of pixels, shifts and scatter of angles."""
    noise, session = scene.sensor.noise, scene.imperfections
    if not np.isfinite(s0_high):
        return np.full((3, 3), np.inf)
    frames = inverse.shape[1]
    turned = (2.0 * session.polarizer_angle_std_rad * s0_high) ** 2
    shifted = 0.0 if session.misregistration_pixels == 0.0 else float(np.trace(texture))
    offsets = (noise.gain_dn_per_e * noise.dsnu_e) ** 2 * np.ones((frames, frames))
    return np.asarray(inverse @ (offsets + (turned + shifted) * np.eye(frames)) @ inverse.T)


def _with_light(
    scene: LitScene, texture: FloatArray, inverse: FloatArray, high: FloatArray, s0_high: float
) -> FloatArray:
    """Upper bound of the covariance from texture and from what pixels differ by in their response."""
    if not np.isfinite(s0_high):
        return np.full((3, 3), np.inf)
    prnu, drifted = scene.sensor.noise.prnu, (1.0 + 2.0 * abs(scene.imperfections.drift)) ** 2
    return np.asarray(drifted * (1.0 + prnu**2) * texture + inverse @ (prnu**2 * np.outer(high, high)) @ inverse.T)


_ANYTHING = replace(EVERYTHING, detection=0.0)
# S0 falls this many deviations below its mean in one pixel of three million. Where that is nearer to zero than a
# quarter of the mean nothing is guaranteed: the pixels' DoLP then has hardly any moments.
_TAIL = 5.0
_LARGEST_TAIL = 0.75
# Polarised light so many deviations above its noise is as good as normal.
_CLEAR = 8.0
# Largest share of a covariance for which the bounds below are taken: beyond, they are of no use.
_LARGEST_SHARE = 0.3
# Largest density of the distance of a normal vector from a point, times the least of its deviations. It is the Gaussian
# surface of a ball: 0.59 about the mean, less elsewhere; a slab, the extreme of convex bodies known, has 0.80.
_SURFACE = 1.0
# Statistic of a background that is above in one pixel of 1e12.
_HARDLY, _PASSED = 60.0, 1e-12
# Means that are computed in two ways differ by rounding, a share of S0 of this size.
_ROUNDING = 1e-14


def bound_of(bounds: RegionBounds, found: Disturbance) -> Bound:
    """Return what a disturbance does to the numbers of one region at most; detection is left at 0.

    Covariance: where the eigenvalues of the one covariance over the other lie within 1 - x and 1 + x, the likelihood
    ratio L of the two normal distributions has var L <= (1 - x^2)^(-3/2) - 1 =: c^2 (chi-square divergence), and by
    Cauchy and Schwarz the mean of the pixels' DoLP changes by at most c times its deviation, its variance by at most 2
    c + c^2 of itself (kurtosis up to 5). Deviations of what is linear change by at most x.

    A factor 1 + e common to a pixel's Stokes vector leaves its DoLP as it is with the rest of its fluctuation over 1 +
    e: a mixture of distributions, whose divergence is at most the mean of theirs, 6 <e^2>, as of a share of 2 rms(e).

    Mean: with |dS0| <= a S0 and |d(S1, S2)| <= b S0 ratios change by at most (b + a P) / (1 - a): of a factor 1 + a of
    all of the mean only the noise beside it tells, which is 1 + a times as large in proportion. The deviation of DoLP
    changes as its gradient does: by no more than (1.42 b / P + 2 a) / (1 - a - b / P) times the largest deviation of a
    Stokes parameter over the least, both without a factor common to each pixel; and where polarised light is not clear
    of its noise by no more than the change over the deviation, and the noise beside the factor.

    Definition; Cauchy-Schwarz with the chi-square divergence of two normal distributions.
    """
    if found.is_nothing:
        return Bound()
    share = found.share if found.share_of_dolp is None else found.share_of_dolp
    tail = _TAIL * np.sqrt(bounds.cov_high[0, 0]) / bounds.s0_low if bounds.is_known else np.inf
    if not (
        tail < _LARGEST_TAIL
        and found.s0 < 0.5
        and found.polarised < 0.5
        and share < _LARGEST_SHARE
        and found.share < 1.0
    ):
        return _ANYTHING
    shift = (found.s0 + found.polarised) / (1.0 - found.s0)
    turned = _turned(bounds, found)
    divergence = _divergence(share)
    low, high = _deviation_limits(bounds)
    dolp_low = bounds.polarised_low / bounds.s0_high
    spread = _of_variance(divergence, share)
    if not spread < 0.5:
        return _ANYTHING
    spread += _of_gradient(bounds, found, turned=turned, low=low, dolp_low=dolp_low, tail=tail)
    if not spread < 0.5:
        return _ANYTHING
    snr = _of_mean(found, divergence, high=high, dolp_low=dolp_low, tail=tail)
    return Bound(
        radiance=_of_counts(bounds, shift),
        ratios=min(shift / (1.0 - tail) + divergence * high, _of_ratios(found, turned, share, high=high, tail=tail)),
        # An SNR to first order knows no common factor: it grows as the deviation falls.
        deviations=max((spread + snr) / (1.0 - spread), (1.0 - found.share) ** -0.5 - 1.0, found.share),
    )


def _detection_bound(
    target: RegionBounds, of_target: Disturbance, background: RegionBounds, of_background: Disturbance, *, eta: float
) -> float:
    """Return what disturbances of target and background do to a probability of detection at most.

    Target: two distributions whose covariances differ by x have a total variation of at most c / 2, two whose means
    differ by h deviations at most 0.4 h. Background: another mean is a shift of the target; another covariance moves
    the ellipsoid of detection by at most x sqrt(eta) of its deviations, and a normal vector lies within such a shell
    with at most its width times the Gaussian surface of a ball over the least deviation of the target along it. Where
    the two differ in S0 by many deviations a target is missed so rarely, with and without, that nothing more changes,
    if the background keeps so much of its covariance that there is such a probability.

    [MK14] eq. (30); definition of total variation; Ball, Discrete Comput. Geom. 10 (1993) 411 for the surface.
    """
    if of_target.is_nothing and of_background.is_nothing:
        return 0.0
    if not (target.is_known and background.is_known):
        return np.inf
    missed = _missed(target, of_target, background, of_background, eta=eta)
    if max(of_target.share, of_background.share) >= _LARGEST_SHARE:
        return missed if missed < 1.0 and _lasts(background, of_background.share) else np.inf
    moved = _shift_in_deviations(of_target, target, target) + _shift_in_deviations(of_background, background, target)
    ratio = _share_of(background.cov_high, target.noise_low) if of_background.share > 0.0 else 0.0
    shell = _SURFACE * np.sqrt(eta) * of_background.share * np.sqrt(ratio) if of_background.share > 0.0 else 0.0
    return float(min(0.4 * moved + 0.5 * _divergence(of_target.share) + shell, missed, 1.0))


def _deviation_limits(bounds: RegionBounds) -> tuple[float, float]:
    """Return a lower and an upper limit of the deviation of a pixel's DoLP.

    Definition; least and largest eigenvalue of the covariance, with S0 up to five deviations below its mean.
    """
    least = np.sqrt(max(float(np.linalg.eigvalsh(bounds.noise_low)[0]), 0.0)) / bounds.s0_high
    if not np.all(np.isfinite(bounds.cov_high)):
        return least, np.inf
    tail = _TAIL * np.sqrt(bounds.cov_high[0, 0]) / bounds.s0_low
    most = np.sqrt(2.0 * float(np.linalg.eigvalsh(bounds.own_high)[-1])) / bounds.s0_low / (1.0 - tail)
    return least, most


def _missed(
    target: RegionBounds, of_target: Disturbance, background: RegionBounds, of_background: Disturbance, *, eta: float
) -> float:
    """Largest chance of a miss with or without an effect, by S0 alone; of thresholds that background hardly passes."""
    shifts = [region.s0_high * found.s0 for region, found in ((target, of_target), (background, of_background))]
    apart = max(target.s0_low - background.s0_high, background.s0_low - target.s0_high) - sum(shifts)
    of_background_s0, of_target_s0 = (
        np.sqrt(region.cov_high[0, 0] * (1.0 + found.share)) if np.isfinite(found.share) else np.inf
        for region, found in ((background, of_background), (target, of_target))
    )
    clear = apart - np.sqrt(max(eta, _HARDLY)) * of_background_s0
    if not (np.isfinite(clear) and clear > 0.0):
        return 1.0
    return float(erfc(clear / (np.sqrt(2.0) * of_target_s0))) + _PASSED if of_target_s0 > 0.0 else _PASSED


def _lasts(background: RegionBounds, share: float) -> bool:
    """Return whether a covariance that loses this share along any direction is still one that targets are told from."""
    if not (share < 1.0 and np.all(np.isfinite(background.cov_high))):
        return False
    least, most = np.linalg.eigvalsh(background.noise_low)[0], np.linalg.eigvalsh(background.cov_high)[-1]
    return bool((1.0 - share) * least * CONDITION_LIMIT > most)


def _turned(bounds: RegionBounds, found: Disturbance) -> float:
    """Most that DoLP, S1/S0 and S2/S0 change: what is left of a change of the mean beside a factor common to it."""
    dolp_high = min(bounds.polarised_high / bounds.s0_low, 1.0)
    return (found.polarised + found.s0 * dolp_high) / (1.0 - found.s0)


def _of_ratios(found: Disturbance, turned: float, share: float, *, high: float, tail: float) -> float:
    """Change of the ratios of the mean, and of the mean of the pixels' DoLP."""
    # A factor common to the mean is one of the noise beside it.
    beside = share + (1.0 + found.s0) ** 2 - 1.0
    return turned / (1.0 - tail) + _divergence(beside) * high if beside < 1.0 else np.inf


def _of_variance(divergence: float, share: float) -> float:
    """Relative change of a deviation, half of what its variance changes by; infinite where that is too much."""
    variance = 2.0 * divergence + divergence**2 + share
    return 0.5 * variance / (1.0 - variance) if variance < 0.5 else np.inf


def _of_gradient(
    bounds: RegionBounds, found: Disturbance, *, turned: float, low: float, dolp_low: float, tail: float
) -> float:
    """Relative change of the deviations of DoLP, S1/S0 and S2/S0 by another mean."""
    if found.s0 == 0.0 and found.polarised == 0.0:
        return 0.0
    if low == 0.0 or dolp_low == 0.0:
        return np.inf
    # A factor common to a pixel's Stokes vector goes with the mean, and no gradient of a ratio sees it.
    most = np.sqrt(float(np.linalg.eigvalsh(bounds.own_high)[-1]))
    # The gradient (-P, u) / S, u a unit vector, turns by the change of polarised light over itself; P changes as much.
    of_direction = found.polarised / dolp_low
    if not of_direction + found.s0 < 1.0:
        return np.inf
    of_gradient = (np.sqrt(2.0) * of_direction + 2.0 * found.s0) / (1.0 - of_direction - found.s0)
    by_gradient = most / (low * bounds.s0_high) * of_gradient
    if (1.0 - tail) * bounds.polarised_low > _CLEAR * most:
        return float(by_gradient)
    scaled = (1.0 + found.s0) ** 2 - 1.0
    by_scale = _of_variance(_divergence(scaled), scaled) if scaled < _LARGEST_SHARE else np.inf
    return float(max(by_gradient, 1.5 * turned / low + by_scale))


def _of_mean(found: Disturbance, divergence: float, *, high: float, dolp_low: float, tail: float) -> float:
    """Relative change of the mean of the pixels' DoLP: by another distribution, and about another mean.

    The first is the divergence times the deviation over the mean, which is below 1 of any DoLP.
    """
    spread = min(divergence, divergence * high / (dolp_low * (1.0 - tail)) if dolp_low > 0.0 else np.inf)
    if found.s0 + found.polarised == 0.0:
        return spread
    if dolp_low == 0.0:
        return np.inf
    moved = found.s0 + (found.polarised + _ROUNDING) / dolp_low
    return float(moved / ((1.0 - found.s0) * (1.0 - tail)) + spread)


def _of_counts(bounds: RegionBounds, shift: float) -> float:
    """Change of the Stokes parameters over S0, and of counts each over itself."""
    if shift == 0.0:
        return 0.0
    darkest = float(np.min(bounds.signal_low))
    return shift * max(1.0, bounds.s0_high / darkest if darkest > 0.0 else np.inf)


def _shift_in_deviations(found: Disturbance, moved: RegionBounds, seen: RegionBounds) -> float:
    """Shift of a mean in deviations of the target."""
    length = np.hypot(found.s0, found.polarised) * moved.s0_high
    if length == 0.0:
        return 0.0
    least = float(np.linalg.eigvalsh(seen.noise_low)[0])
    return float(length / np.sqrt(least)) if least > 0.0 else np.inf


def _divergence(share: float) -> float:
    """Root of the chi-square divergence of normal distributions of three components; 0 gives 0 without rounding."""
    return float(np.sqrt(np.expm1(-1.5 * np.log1p(-(share**2)))))


_BOUNDS: Mapping[Effect, Callable[[LitScene, RegionBounds, LightLimits], Disturbance]] = {
    **{effect: _added_by(effect) for effect in LIGHT_PARTS},
    Effect.WAVELENGTHS: _wavelengths,
}
