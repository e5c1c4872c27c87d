"""The sky sampled for a scene, and the light that falls on a panel.

`sample_sky` keeps a computed sky on a grid of directions, so that reading it again costs next to nothing. The bright
ring around the sun (the aureole) and the brightening of thin air toward the horizon are divided out first, because no
polynomial follows them. `illuminate` puts sun, sky and ground together, `hemisphere_nodes` are directions for sums over
the hemisphere of a panel.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.polynomial.chebyshev import chebvander
from numpy.typing import ArrayLike, NDArray

from model import stokes as geometry
from model.atmosphere.sky import Lighting
from model.numerics import ClampedSpline, fit_above_zero, gauss_legendre
from model.surface.pbrdf import Tilt

FloatArray = NDArray[np.float64]


class Sky(Protocol):
    """Function from a direction to the Stokes radiance of the sky, such as `model.atmosphere.sky.Lighting.sky`."""

    def __call__(self, *, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> FloatArray:
        """Return S0, S1, S2 in the frame of each direction's own azimuth, shape (..., 3) [W m-2 sr-1]."""
        ...


# The bright ring around the sun, as a function of the angle from it


# Asymmetries of the Henyey-Greenstein functions whose sum describes an aureole.
_ASYMMETRIES = np.array([0.0, 0.3, 0.5, 0.6, 0.7, 0.8, 0.87, 0.92, 0.95, 0.97, 0.98, 0.99, 0.995, 0.998])
_AUREOLE_SAMPLES = 60
_AUREOLE_EDGE_RAD = float(np.radians(60.0))
# With a higher sun the ring of the sun's own zenith angle is too small to sample the aureole.
_HIGH_SUN_RAD = float(np.radians(15.0))


@dataclass(frozen=True, kw_only=True, eq=False)
class Aureole:
    """Radiance as a function of the angle from the sun alone: a sum of Henyey-Greenstein functions and a correction."""

    sun_zenith_rad: float
    asymmetries: FloatArray
    weights: FloatArray
    correction: ClampedSpline | None = None

    def __call__(self, *, zenith_rad: FloatArray, phi_rad: FloatArray) -> FloatArray:
        """Return the radiance of the sum in directions [W m-2 sr-1]."""
        across = np.sin(zenith_rad) * np.sin(self.sun_zenith_rad) * (1.0 - np.cos(phi_rad))
        cosine = np.cos(zenith_rad - self.sun_zenith_rad) - across
        smooth = np.asarray(_henyey_greenstein(self.asymmetries, cosine) @ self.weights)
        if self.correction is None:
            return smooth
        root = np.sqrt(np.arccos(np.clip(cosine, -1.0, 1.0)))
        return np.asarray(smooth * np.exp(self.correction(np.minimum(root, self.correction.x[-1]))))


# The same in all directions.
NO_AUREOLE = Aureole(sun_zenith_rad=0.0, asymmetries=np.zeros(1), weights=np.ones(1))


def aureole_of(sky: Sky, sun_zenith_rad: float) -> Aureole:
    """Return the sum of functions that is closest to a sky around the sun, in relative terms.

    `NO_AUREOLE` where the sky is black somewhere.

    Definition: least squares with weights of 0 or more.
    """
    share = (np.arange(_AUREOLE_SAMPLES) / (_AUREOLE_SAMPLES - 1)) ** 2
    if sun_zenith_rad > _HIGH_SUN_RAD:
        from_sun = min(2.0 * sun_zenith_rad, _AUREOLE_EDGE_RAD) * share
        # Two directions of one zenith angle: sin(from_sun / 2) = sin(zenith) sin(phi / 2).
        phi = 2.0 * np.arcsin(np.minimum(np.sin(0.5 * from_sun) / np.sin(sun_zenith_rad), 1.0))
        radiance = sky(zenith_rad=sun_zenith_rad, phi_rad=phi)[:, 0]
    else:
        from_sun = 0.5 * _AUREOLE_EDGE_RAD * share
        zenith = sun_zenith_rad - from_sun
        radiance = sky(zenith_rad=np.abs(zenith), phi_rad=np.where(zenith < 0.0, np.pi, 0.0))[:, 0]
    if not np.all(radiance > 0.0):
        return NO_AUREOLE
    columns = _henyey_greenstein(_ASYMMETRIES, np.cos(from_sun)) / radiance[:, np.newaxis]
    scale = np.max(columns, axis=0)
    weights = fit_above_zero(columns / scale, np.ones(_AUREOLE_SAMPLES)) / scale
    used = weights > 0.0
    left = np.log(radiance / (_henyey_greenstein(_ASYMMETRIES[used], np.cos(from_sun)) @ weights[used]))
    return Aureole(
        sun_zenith_rad=sun_zenith_rad,
        asymmetries=_ASYMMETRIES[used],
        weights=weights[used],
        correction=ClampedSpline(np.sqrt(from_sun), left * _faded(from_sun / from_sun[-1])),
    )


def _faded(share: FloatArray) -> FloatArray:
    """Weight that falls smoothly from 1 at the middle of the aureole to 0 at its edge."""
    step = np.clip(2.0 * share - 1.0, 0.0, 1.0)
    return np.asarray(1.0 - step**2 * (3.0 - 2.0 * step))


def _henyey_greenstein(asymmetries: FloatArray, cosine: FloatArray) -> FloatArray:
    """Henyey-Greenstein functions of mean 1, shape (..., K)."""
    squares = asymmetries**2
    return np.asarray((1.0 - squares) / (1.0 + squares - 2.0 * asymmetries * cosine[..., np.newaxis]) ** 1.5)


# The sky on a grid of directions


# Directions between those of the grid at which it is compared with the sky: steps of the grid in azimuth, and zenith
# angles around the sun's and down to the horizon.
_PROBED_STEPS = (0.05, 0.5, 1.5, 4.5)
_PROBED_BESIDE_SUN_RAD = np.radians([-9.0, -2.5, 0.0, 0.7, 2.5, 9.0])
_PROBED_ZENITH_RAD = np.radians([6.0, 33.0, 71.0, 83.0, 88.0])
# Optical depths of air that are tried for the brightening toward the horizon.
_DEPTHS = (0.01, 0.02, 0.04, 0.06, 0.09, 0.14, 0.2, 0.3, 0.45, 0.7, 1.2)
# Cosine of the zenith angle at the horizon: below that of any angle that a double can hold.
_LEVEL = 1e-18


@dataclass(frozen=True, kw_only=True, eq=False)
class MixedSky:
    """Two skies mixed linearly."""

    first: Sky
    second: Sky
    share: float

    def __call__(self, *, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> FloatArray:
        """Return the Stokes radiance of the mixture; arguments as those of its skies."""
        first, second = (sky(zenith_rad=zenith_rad, phi_rad=phi_rad) for sky in (self.first, self.second))
        return (1.0 - self.share) * first + self.share * second


@dataclass(frozen=True, kw_only=True, eq=False)
class SampledSky:
    """A sky on a grid; takes the same arguments as the sky that was sampled."""

    series: FloatArray
    aureole: Aureole
    depth: float
    relative_error: float

    def __call__(self, *, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> FloatArray:
        """Return the Stokes radiance of the sky.

        Trefethen, Approximation Theory and Approximation Practice (SIAM, 2013), doi:10.1137/1.9781611975949, ch. 3.
        """
        zenith, phi = np.broadcast_arrays(np.asarray(zenith_rad, dtype=float), np.asarray(phi_rad, dtype=float))
        if not np.all((zenith >= 0.0) & (zenith <= 0.5 * np.pi)):
            raise ValueError("zenith_rad must be 0 to pi/2 rad: there is no sky below the horizon")
        upward, around = (degrees - 1 for degrees in self.series.shape[1:])
        at_phi = self.series @ chebvander(np.cos(phi.ravel()), around).T
        even: FloatArray = np.einsum("kzr,zr->rk", at_phi, _upward(zenith.ravel(), upward).T)
        even *= _brightening(zenith.ravel(), self.depth)[:, np.newaxis]
        even[:, 0] *= self.aureole(zenith_rad=zenith.ravel(), phi_rad=phi.ravel())
        even[:, 2] *= np.sin(phi.ravel())
        return even.reshape(*zenith.shape, 3)


def sample_sky(sky: Sky, *, sun_zenith_rad: float, zeniths: int = 24, azimuths: int = 20) -> SampledSky:
    """Return a sky sampled over the hemisphere, with an estimate of what the samples miss.

    Zenith angle and azimuth are coordinates in which a sky is smooth, also at the zenith, where its frame turns: the
    series converge geometrically, as fast as the phase function of the aerosol lets them. A bright aureole is divided
    out first, as sampled on the ring of the sun's own zenith angle, and so is the brightening of thin air toward the
    horizon. A polynomial fits neither, and would leave ripples that a rule of few nodes does not integrate.
    """
    nodes_rad, phi_rad = _grid(zeniths, azimuths)
    samples = sky(zenith_rad=nodes_rad[:, np.newaxis], phi_rad=phi_rad)
    beside = np.clip(sun_zenith_rad + _PROBED_BESIDE_SUN_RAD, 0.0, 0.5 * np.pi)
    steps_rad = np.pi / azimuths * np.array(_PROBED_STEPS)
    zenith, phi = (one.ravel() for one in np.meshgrid(np.concatenate([beside, _PROBED_ZENITH_RAD]), steps_rad))
    exact = sky(zenith_rad=zenith, phi_rad=phi)
    lit = exact[:, 0] > 0.0
    # From values at the nodes of a meridian to those at the probed zenith angles.
    along = _upward(zenith, zeniths) @ _cosines(np.eye(zeniths + 1), axis=0)

    def errors(aureole: Aureole, depths: Sequence[float]) -> list[float]:
        """Return the largest error of the series at the probed directions for each depth, relative to S0."""
        at_phi = _around(_without(aureole, samples, nodes_rad, phi_rad)) @ chebvander(np.cos(phi), azimuths).T
        at_nodes, probed = (np.stack([_brightening(rad, depth) for depth in depths]) for rad in (nodes_rad, zenith))
        found = np.einsum("pz,dz,kzp->dpk", along, 1.0 / at_nodes, at_phi) * probed[..., np.newaxis]
        found[..., 0] *= aureole(zenith_rad=zenith, phi_rad=phi)
        found[..., 2] *= np.sin(phi)
        apart = np.max(np.abs(found - exact), axis=-1)[:, lit] / exact[lit, 0]
        return np.max(apart, axis=-1, initial=0.0).tolist()  # type: ignore[no-any-return]

    # Without an aureole, or without brightening, division by it may make the sky less smooth: try all four ways.
    depths, aureole = (0.0, *_thin_depth(nodes_rad, samples), *_DEPTHS), aureole_of(sky, sun_zenith_rad)
    of_depths = errors(aureole, depths)
    depth = depths[int(np.argmin(of_depths))]
    tried = [(aureole, depth), (aureole, 0.0), (NO_AUREOLE, depth), (NO_AUREOLE, 0.0)]
    found = [min(of_depths), of_depths[0], *errors(NO_AUREOLE, (depth, 0.0))]
    best = int(np.argmin(found))
    chosen, depth = tried[best]
    smooth = _around(_without(chosen, samples, nodes_rad, phi_rad)) / _brightening(nodes_rad, depth)[:, np.newaxis]
    return SampledSky(series=_cosines(smooth, axis=1), aureole=chosen, depth=depth, relative_error=found[best])


def _without(aureole: Aureole, samples: FloatArray, nodes_rad: FloatArray, phi_rad: FloatArray) -> FloatArray:
    """Return samples, shape (Z, A, 3), with the radiance divided by an aureole."""
    smooth = samples.copy()
    smooth[..., 0] /= aureole(zenith_rad=nodes_rad[:, np.newaxis], phi_rad=phi_rad)
    return smooth


def _thin_depth(nodes_rad: FloatArray, samples: FloatArray) -> tuple[float, ...]:
    """Optical depth of very thin air, from the radiance at the horizon and at the node above it; empty for other air.

    The radiance of such a sky differs by orders of magnitude between the two. Only division by the brightening of its
    own depth leaves a smooth function.
    """
    above, level = np.mean(samples[-2:, :, 0], axis=1).tolist()
    if not 0.0 < above < level:
        return ()
    depth = -float(np.cos(nodes_rad[-2]) * np.log1p(-above / level))
    return (depth,) if depth < _DEPTHS[0] else ()


def _brightening(zenith_rad: FloatArray, depth: float) -> FloatArray:
    """Light scattered once by a uniform layer, relative to that at the horizon; 1 everywhere for depth 0."""
    if depth == 0.0:
        return np.ones(zenith_rad.shape)
    return np.asarray(-np.expm1(-depth / np.maximum(np.cos(zenith_rad), _LEVEL)))


def sample_smooth(sky: Sky, *, zeniths: int, azimuths: int) -> SampledSky:
    """Return a sky without an aureole sampled over the hemisphere, such as the difference of two skies."""
    nodes_rad, phi_rad = _grid(zeniths, azimuths)
    around = _around(sky(zenith_rad=nodes_rad[:, np.newaxis], phi_rad=phi_rad))
    return SampledSky(series=_cosines(around, axis=1), aureole=NO_AUREOLE, depth=0.0, relative_error=0.0)


def _grid(zeniths: int, azimuths: int) -> tuple[FloatArray, FloatArray]:
    """Zenith angles, Chebyshev points, and azimuths."""
    for name, steps in (("zeniths", zeniths), ("azimuths", azimuths)):
        if steps < 4:
            raise ValueError(f"sample_sky: {name} = {steps}, allowed is 4 or more")
    nodes_rad = 0.25 * np.pi * (1.0 - np.cos(np.pi * np.arange(zeniths + 1) / zeniths))
    return nodes_rad, np.pi * np.arange(azimuths + 1) / azimuths


def _upward(zenith_rad: FloatArray, degree: int) -> FloatArray:
    """Chebyshev polynomials of zenith angles, shape (R, degree + 1)."""
    return np.asarray(chebvander(1.0 - 4.0 / np.pi * zenith_rad, degree))


def _around(samples: FloatArray) -> FloatArray:
    """Coefficients over azimuth of samples (Z, A, 3) on the grid, shape (3, Z, A), as `SampledSky` has them."""
    steps = samples.shape[1] - 1
    odd = np.concatenate([samples[..., 2], -samples[:, -2:0:-1, 2]], axis=1)
    odd[:, [0, steps]] = 0.0
    sines = -np.fft.rfft(odd, axis=1).imag[:, 1:-1] / steps
    # sin(m phi) over sin(phi) is twice the sum of cos(j phi) for the j below m that are odd where m is even.
    degree = np.arange(steps + 1)[:, np.newaxis]
    mode = np.arange(1, steps)
    below = np.where((degree < mode) & ((mode - degree) % 2 == 1), np.where(degree == 0, 1.0, 2.0), 0.0)
    return np.stack([*np.moveaxis(_cosines(samples[..., :2], axis=1), -1, 0), sines @ below.T])


def _cosines(samples: FloatArray, *, axis: int) -> FloatArray:
    """Coefficients of cos(m t), t from 0 to pi, of samples along an axis, both ends among them."""
    first = np.moveaxis(samples, axis, 0)
    modes = np.fft.rfft(np.concatenate([first, first[-2:0:-1]]), axis=0).real / (len(first) - 1)
    modes[[0, -1]] *= 0.5
    return np.moveaxis(modes, 0, axis)


# Diffuse radiance on a panel, without the beam, and quadrature over the directions from which it comes


# A direction that rounding put this far below the horizon is on it.
_HORIZON = 1e-12
# A panel whose normal is closer than this to the zenith has no uphill.
_LEVEL_DIFFUSE_RADIANCE = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class Nodes:
    """Directions of the world that a panel faces."""

    zenith_rad: FloatArray
    azimuth_rad: FloatArray
    weight: FloatArray

    def at(self, chosen: NDArray[np.intp]) -> "Nodes":
        """Return some of the nodes, in an order of their own."""
        return Nodes(
            zenith_rad=self.zenith_rad[chosen], azimuth_rad=self.azimuth_rad[chosen], weight=self.weight[chosen]
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class DiffuseRadiance:
    """Downwelling diffuse radiance of the sky above the horizon, and that of a Lambertian ground below it."""

    sky: Sky
    sun_azimuth_rad: float
    ground_radiance: float = 0.0
    relative_error: float = 0.0
    # By tilt and order: shared by all views of all panels of the same tilt.
    _on_nodes: dict[tuple[Tilt, int], FloatArray] = field(default_factory=dict, init=False, repr=False)

    def stokes(self, *, zenith_rad: FloatArray, azimuth_rad: FloatArray) -> FloatArray:
        """Return the light from directions (R,) in each one's own frame, shape (R, 3) [W m-2 sr-1]."""
        found = np.zeros((zenith_rad.size, 3))
        above = np.cos(zenith_rad) >= -_HORIZON
        zenith = np.minimum(zenith_rad[above], 0.5 * np.pi)
        found[above] = self.sky(zenith_rad=zenith, phi_rad=self.sun_azimuth_rad - azimuth_rad[above])
        found[~above, 0] = self.ground_radiance
        return found

    def on_nodes(self, tilt: Tilt, order: int) -> FloatArray:
        """Return the light on the nodes of a panel's hemisphere, shape (R, 3) [W m-2 sr-1]; not to be written to."""
        if (tilt, order) not in self._on_nodes:
            nodes = hemisphere_nodes(tilt, order)
            self._on_nodes[tilt, order] = self.stokes(zenith_rad=nodes.zenith_rad, azimuth_rad=nodes.azimuth_rad)
        return self._on_nodes[tilt, order]


def nodes_toward(direction: FloatArray, *, solid_angle: FloatArray, cosine: FloatArray) -> Nodes:
    """Return nodes of directions that a panel faces."""
    east, north, up = direction.T
    return Nodes(
        zenith_rad=np.arctan2(np.hypot(east, north), up),
        azimuth_rad=np.arctan2(east, north),
        weight=solid_angle * cosine,
    )


@lru_cache(maxsize=64)
def hemisphere_nodes(tilt: Tilt, order: int) -> Nodes:
    """Return directions over the hemisphere that a panel faces.

    Each half turn about the normal, uphill and downhill, has its own nodes, and each meridian is cut at the horizon,
    so that no rule reaches across an edge of the light.

    Definition: Gauss-Legendre rules.
    """
    node, weight = gauss_legendre(order)
    around = np.concatenate([np.pi * (node - 0.5), np.pi * (node + 0.5)])
    share = np.pi * np.tile(weight, 2)
    # Where cos(theta) cos(tilt) + sin(theta) sin(tilt) cos(around) = 0.
    rise, run = float(np.cos(tilt.tilt_rad)), float(np.sin(tilt.tilt_rad)) * np.cos(around)
    horizon = np.arctan2(abs(rise), np.where(run * rise < 0.0, np.abs(run), 0.0))
    parts = [(np.zeros_like(horizon), horizon), (horizon, np.full_like(horizon, 0.5 * np.pi))]
    theta = np.concatenate([low[:, np.newaxis] + (high - low)[:, np.newaxis] * node for low, high in parts])
    ring = np.concatenate([(share * (high - low))[:, np.newaxis] * weight for low, high in parts])
    solid_angle = ring * np.sin(theta)
    uphill = np.array([0.0, 0.0, 1.0]) - rise * tilt.normal
    level = geometry.direction(zenith_rad=0.5 * np.pi, azimuth_rad=tilt.azimuth_rad)
    length = float(np.linalg.norm(uphill))
    along = uphill / length if length > _LEVEL_DIFFUSE_RADIANCE else level
    flat = geometry.direction(zenith_rad=theta, azimuth_rad=np.tile(around, 2)[:, np.newaxis])
    axes = np.stack([np.cross(along, tilt.normal), along, tilt.normal])
    kept = solid_angle > 0.0
    return nodes_toward(flat[kept] @ axes, solid_angle=solid_angle[kept], cosine=np.cos(theta[kept]))


# Sun, sky and air of a scene together

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
    diffuse_radiance
        Diffuse light on a panel: sky and ground.
    sky_irradiance
        Of the sky on level ground [W m-2].
    sun_zenith_rad, sun_azimuth_rad
        Position of the sun, azimuth clockwise from north [rad].
    """

    lighting: Lighting
    diffuse_radiance: DiffuseRadiance
    sky_irradiance: float
    sun_zenith_rad: float
    sun_azimuth_rad: float

    @property
    def direct_horizontal_irradiance(self) -> float:
        """Irradiance of the beam on level ground [W m-2]."""
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
    """Return the illumination of a scene."""
    require_sun_zenith(sun_zenith_rad)
    if not 0.0 <= ground_albedo <= 1.0:
        raise ValueError(f"ground_albedo = {ground_albedo!r}, allowed is 0 to 1")
    seen = lighting.sky if sky is None else sky
    from_sky = _sky_irradiance(seen)
    received = from_sky + lighting.direct_irradiance * float(np.cos(sun_zenith_rad))
    diffuse_radiance = DiffuseRadiance(
        sky=seen,
        sun_azimuth_rad=sun_azimuth_rad,
        ground_radiance=ground_albedo / np.pi * received,
        relative_error=sky_error,
    )
    return Illumination(
        lighting=lighting,
        diffuse_radiance=diffuse_radiance,
        sky_irradiance=from_sky,
        sun_zenith_rad=sun_zenith_rad,
        sun_azimuth_rad=sun_azimuth_rad,
    )


def require_sun_zenith(sun_zenith_rad: float) -> None:
    """Raise ValueError for a sun too low for a plane-parallel atmosphere."""
    if not 0.0 <= sun_zenith_rad <= LARGEST_SUN_ZENITH_RAD + 1e-12:
        raise ValueError(
            f"solar zenith = {np.degrees(sun_zenith_rad):.2f} deg, allowed is 0 to 85 deg: a plane-parallel atmosphere "
            "is wrong for a lower sun, and there is no beam below the horizon. Take another time"
        )


def _sky_irradiance(sky: Sky) -> float:
    """Irradiance of a sky on level ground, by Gauss nodes in zenith angle and even azimuths."""
    node, weight = gauss_legendre(_IRRADIANCE_NODES)
    zenith = 0.5 * np.pi * node
    azimuth = 2.0 * np.pi * (np.arange(_IRRADIANCE_NODES) + 0.5) / _IRRADIANCE_NODES
    s0 = sky(zenith_rad=zenith[:, np.newaxis], phi_rad=azimuth)[..., 0]
    # cos sin = sin(2 zenith) / 2, and half a right angle for the interval of the nodes.
    return float(0.5 * np.pi**2 * weight @ (np.mean(s0, axis=1) * np.sin(2.0 * zenith)))
