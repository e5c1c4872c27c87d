"""A computed sky kept on a grid of directions, so that reading it again costs next to nothing."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial.chebyshev import chebvander
from numpy.typing import ArrayLike, NDArray

from model.scene.aureole import NO_AUREOLE, Aureole, aureole_of
from model.scene.sky import Sky

FloatArray = NDArray[np.float64]

# Directions between the grid's at which it is set beside the sky itself: steps of the grid in azimuth, and zenith
# angles around the sun's and down to the horizon.
_PROBED_STEPS = (0.05, 0.5, 1.5, 4.5)
_PROBED_BESIDE_SUN_RAD = np.radians([-9.0, -2.5, 0.0, 0.7, 2.5, 9.0])
_PROBED_ZENITH_RAD = np.radians([6.0, 33.0, 71.0, 83.0, 88.0])
# Depths of air that are tried, by which a sky brightens toward the horizon.
_DEPTHS = (0.01, 0.02, 0.04, 0.06, 0.09, 0.14, 0.2, 0.3, 0.45, 0.7, 1.2)
# Cosine of the zenith angle at the horizon: below that of any angle that a double can hold.
_LEVEL = 1e-18


@dataclass(frozen=True, kw_only=True, eq=False)
class MixedSky:
    """Two skies mixed linearly.

    Attributes
    ----------
    first, second
        The skies, under the same sun.
    share
        Of the second.
    """

    first: Sky
    second: Sky
    share: float

    def __call__(self, *, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> FloatArray:
        """Return the Stokes radiance of the mixture; arguments as those of its skies."""
        first, second = (sky(zenith_rad=zenith_rad, phi_rad=phi_rad) for sky in (self.first, self.second))
        return (1.0 - self.share) * first + self.share * second


@dataclass(frozen=True, kw_only=True, eq=False)
class SampledSky:
    """A sky on a grid; call it like the sky it was made from.

    Attributes
    ----------
    series
        Coefficients of S0 over the aureole, of S1, and of S2 over sin(phi), all over the brightening, by the degrees of
        Chebyshev polynomials of 1 - 4 zenith / pi and of cos(phi), shape (3, Z, A).
    aureole
        What S0 was divided by.
    depth
        Of the air by which the sky brightens toward the horizon, as `_brightening`; 0 for none.
    relative_error
        Largest difference from the sky at directions between the grid's, over S0 there; down to 2 deg above the
        horizon. Below that it is up to four times as much.
    """

    series: FloatArray
    aureole: Aureole
    depth: float
    relative_error: float

    def __call__(self, *, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> FloatArray:
        """Return the Stokes radiance of the sky.

        Parameters
        ----------
        zenith_rad
            Zenith angle of the point, 0 to pi/2 [rad].
        phi_rad
            Azimuth of the sun minus that of the point [rad].

        Returns
        -------
        ndarray, shape (..., 3)
            S0, S1, S2 [W m-2 sr-1].

        Raises
        ------
        ValueError
            A point below the horizon.

        References
        ----------
        Trefethen, Approximation Theory and Approximation Practice (SIAM, 2013), doi:10.1137/1.9781611975949, ch. 3.
        """
        zenith, phi = np.broadcast_arrays(np.asarray(zenith_rad, dtype=float), np.asarray(phi_rad, dtype=float))
        if not np.all((zenith >= 0.0) & (zenith <= 0.5 * np.pi)):
            raise ValueError("zenith_rad must be 0 to pi/2 rad: there is no sky below the horizon")
        upward, around = (degrees - 1 for degrees in self.series.shape[1:])
        at_phi = self.series @ chebvander(np.cos(phi.ravel()), around).T
        even: FloatArray = np.einsum("kzr,zr->rk", at_phi, chebvander(1.0 - 4.0 / np.pi * zenith.ravel(), upward).T)
        even *= _brightening(zenith.ravel(), self.depth)[:, np.newaxis]
        even[:, 0] *= self.aureole(zenith_rad=zenith.ravel(), phi_rad=phi.ravel())
        even[:, 2] *= np.sin(phi.ravel())
        return even.reshape(*zenith.shape, 3)


def sample_sky(sky: Sky, *, sun_zenith_rad: float, zeniths: int = 24, azimuths: int = 20) -> SampledSky:
    """Return a sky sampled over the hemisphere, with an estimate of what the samples miss.

    Parameters
    ----------
    sky
        Symmetric about the principal plane, as every plane-parallel atmosphere makes it: S2(-phi) = -S2(phi).
    sun_zenith_rad
        Where the sky changes fastest [rad].
    zeniths, azimuths
        Steps of the grid from the zenith to the horizon, and from the sun's azimuth to the opposite one, 4 or more.

    Raises
    ------
    ValueError
        Too few steps.

    Notes
    -----
    Zenith angle and azimuth are coordinates in which a sky is smooth, also at the zenith, where its frame turns: the
    series converge geometrically, as fast as the phase function of the aerosol lets them. A bright aureole is divided
    out first, as it shows on the ring of the sun's own zenith angle, and how thin air brightens toward the horizon:
    a polynomial would follow neither, and leave ripples over all of the sky that no rule of few nodes integrates.
    """
    nodes_rad, phi_rad = _grid(zeniths, azimuths)
    samples = sky(zenith_rad=nodes_rad[:, np.newaxis], phi_rad=phi_rad)
    probes = _probes(sky, sun_zenith_rad=sun_zenith_rad, step_rad=np.pi / azimuths)

    def best(aureoles: Iterable[Aureole], depths: Iterable[float]) -> SampledSky:
        found = [_over(aureole, depth, nodes_rad, phi_rad, samples) for aureole in aureoles for depth in depths]
        every = (replace(one, relative_error=probes.largest(one)) for one in found)
        return min(every, key=lambda one: one.relative_error)

    # Without an aureole what is divided out may bend the sky more than the sky itself; so may the brightening.
    aureole = aureole_of(sky, sun_zenith_rad)
    depth = best((aureole,), (0.0, *_thin_depth(nodes_rad, samples), *_DEPTHS)).depth
    return best((aureole, NO_AUREOLE), (depth, 0.0))


def _over(
    aureole: Aureole, depth: float, nodes_rad: FloatArray, phi_rad: FloatArray, samples: FloatArray
) -> SampledSky:
    """Sky of samples, shape (Z, A, 3), whose light is divided by a brightening and its radiance by an aureole."""
    smooth = samples / _brightening(nodes_rad, depth)[:, np.newaxis, np.newaxis]
    smooth[..., 0] /= aureole(zenith_rad=nodes_rad[:, np.newaxis], phi_rad=phi_rad)
    return SampledSky(series=_series(smooth), aureole=aureole, depth=depth, relative_error=0.0)


def _thin_depth(nodes_rad: FloatArray, samples: FloatArray) -> tuple[float, ...]:
    """Depth of air that is thinner than those tried, from the horizon and the node above it; none for other air.

    Such a sky falls off by orders of magnitude between the two, and no polynomial follows another depth than its own.
    """
    above, level = np.mean(samples[-2:, :, 0], axis=1).tolist()
    if not 0.0 < above < level:
        return ()
    depth = -float(np.cos(nodes_rad[-2]) * np.log1p(-above / level))
    return (depth,) if depth < _DEPTHS[0] else ()


def _brightening(zenith_rad: FloatArray, depth: float) -> FloatArray:
    """Light that an even layer of some depth scatters once, over that at the horizon; 1 throughout for none."""
    if depth == 0.0:
        return np.ones(zenith_rad.shape)
    return np.asarray(-np.expm1(-depth / np.maximum(np.cos(zenith_rad), _LEVEL)))


def sample_smooth(sky: Sky, *, zeniths: int, azimuths: int) -> SampledSky:
    """Return a sky without an aureole sampled over the hemisphere, such as the difference of two skies.

    Parameters
    ----------
    sky, zeniths, azimuths
        As in `sample_sky`. What the samples miss is not estimated.

    Raises
    ------
    ValueError
        Too few steps.
    """
    nodes_rad, phi_rad = _grid(zeniths, azimuths)
    series = _series(sky(zenith_rad=nodes_rad[:, np.newaxis], phi_rad=phi_rad))
    return SampledSky(series=series, aureole=NO_AUREOLE, depth=0.0, relative_error=0.0)


def _grid(zeniths: int, azimuths: int) -> tuple[FloatArray, FloatArray]:
    """Zenith angles, Chebyshev points, and azimuths."""
    for name, steps in (("zeniths", zeniths), ("azimuths", azimuths)):
        if steps < 4:
            raise ValueError(f"sample_sky: {name} = {steps}, allowed is 4 or more")
    nodes_rad = 0.25 * np.pi * (1.0 - np.cos(np.pi * np.arange(zeniths + 1) / zeniths))
    return nodes_rad, np.pi * np.arange(azimuths + 1) / azimuths


def _series(samples: FloatArray) -> FloatArray:
    """Coefficients of samples (Z, A, 3) on the grid, as `SampledSky` has them."""
    steps = samples.shape[1] - 1
    from scipy.fft import dst  # wanted for a sky only

    sines = dst(samples[:, 1:-1, 2], type=1, axis=1) / steps
    # sin(m phi) over sin(phi) is twice the sum of cos(j phi) for the j below m that are odd where m is even.
    degree = np.arange(steps + 1)[:, np.newaxis]
    mode = np.arange(1, steps)
    below = np.where((degree < mode) & ((mode - degree) % 2 == 1), np.where(degree == 0, 1.0, 2.0), 0.0)
    around = [*np.moveaxis(_cosines(samples[..., :2], axis=1), -1, 0), sines @ below.T]
    return _cosines(np.stack(around), axis=1)


def _cosines(samples: FloatArray, *, axis: int) -> FloatArray:
    """Coefficients of cos(m t), t from 0 to pi, of samples along an axis, both ends among them."""
    from scipy.fft import dct  # wanted for a sky only

    modes = np.moveaxis(dct(samples, type=1, axis=axis), axis, 0) / (samples.shape[axis] - 1)
    modes[[0, -1]] *= 0.5
    return np.moveaxis(modes, 0, axis)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Probes:
    """A sky itself at directions between those of its grid."""

    zenith_rad: FloatArray
    phi_rad: FloatArray
    exact: FloatArray

    def largest(self, sampled: SampledSky) -> float:
        """Largest difference of the grid, over the sky's S0."""
        apart = sampled(zenith_rad=self.zenith_rad, phi_rad=self.phi_rad) - self.exact
        lit = self.exact[..., 0] > 0.0
        return float(np.max(np.max(np.abs(apart), axis=-1)[lit] / self.exact[lit, 0], initial=0.0))


def _probes(sky: Sky, *, sun_zenith_rad: float, step_rad: float) -> _Probes:
    beside = np.clip(sun_zenith_rad + _PROBED_BESIDE_SUN_RAD, 0.0, 0.5 * np.pi)
    zenith, phi = np.meshgrid(np.concatenate([beside, _PROBED_ZENITH_RAD]), step_rad * np.array(_PROBED_STEPS))
    return _Probes(zenith_rad=zenith, phi_rad=phi, exact=sky(zenith_rad=zenith, phi_rad=phi))
