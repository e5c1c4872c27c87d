"""Measured BRDF as a surface: a table of geometries, made reciprocal and mirror-symmetric, smoothed, with its error.

`MeasuredTable` holds the geometries as measured; its method `at` gives the `TabulatedBrdf` of a wavelength, which
evaluates Mueller matrices and their standard errors between the measured directions.

Elements over f00 are taken in the axes of the plane of scattering, in which they vary slowly. Each element is a
Gaussian process over the cosines of incidence, reflection and half the angle between the rays. Reciprocity and mirror
symmetry are in its variables, and a row counts for the reversed way too. Lengths of correlation and noise are those of
largest likelihood. The standard error is that of the smooth function: it holds the noise that is left after smoothing,
and grows where nothing was measured nearby.

Rasmussen and Williams, Gaussian Processes for Machine Learning (2006), chapters 2, 5 and 8.3.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from model.numerics import gauss_legendre
from model.surface.facets import HalfVectorGeometry, half_vector_geometry

FloatArray = NDArray[np.float64]

# Number of centres of the smooth function, and of rows from which the correlation lengths are estimated.
_CENTRES, _SAMPLE = 240, 700
# With fewer rows the shape of a BRDF is not determined.
LEAST_ROWS = 30
# Wavelengths that differ by less than this share are the same; angles this far beyond the largest count as it.
_SAME_WAVELENGTH, _ROOM_RAD = 1e-3, 1e-3
_PLACES = ((1, 0), (2, 0), (1, 1), (2, 2), (2, 1))


@dataclass(frozen=True, kw_only=True, eq=False)
class TabulatedBrdf:
    """A measured surface at one wavelength.

    Parameters
    ----------
    source
        Origin, in words.
    fits
        Smooth functions of one measured wavelength, or of the two around this one, each with its share.
    largest_rad
        The larger and the smaller of incidence and reflection, as far as they were measured [rad].
    """

    source: str
    fits: "tuple[tuple[float, _Fit], ...]"
    largest_rad: tuple[float, float]

    def matrix(
        self,
        theta_i_rad: FloatArray,
        theta_r_rad: FloatArray,
        phi_rad: FloatArray,
        *,
        errors: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> FloatArray:
        """Return Mueller matrices per solid angle, shape (N, 3, 3) [sr^-1]; angles as in `model.surface.pbrdf.mueller`.

        `errors` moves f00, and S1/S0 and S2/S0 in the plane of scattering, by so many of their standard errors.
        Beyond the measured angles it continues with the values of the last.
        """
        theta_i_rad, theta_r_rad = self._within(theta_i_rad, theta_r_rad)
        g = half_vector_geometry(theta_i_rad, theta_r_rad, phi_rad)
        odd = _odd(g, phi_rad)
        f00, elements = np.zeros(theta_i_rad.size), np.zeros((theta_i_rad.size, 3, 3))
        for share, fit in self.fits:
            f00 += share * np.exp(fit.log_f00.mean(_even(g)))
            elements += share * fit.elements(g, odd)
        elements[:, 0, 0] = 1.0
        if any(errors):
            moved = self.standard_error(theta_i_rad, theta_r_rad, phi_rad) * errors
            f00 *= np.exp(moved[:, 0])
            elements[:, 1:, 0] += moved[:, 1:]
            elements[:, 0, 1:] += moved[:, 1:]
        return f00[:, None, None] * (_axes(g.cos_2eta_r, -g.sin_2eta_r) @ elements @ _axes(g.cos_2eta_i, g.sin_2eta_i))

    def standard_error(self, theta_i_rad: FloatArray, theta_r_rad: FloatArray, phi_rad: FloatArray) -> FloatArray:
        """Return standard errors of f00 (relative), and of S1/S0 and S2/S0 in the plane of scattering, shape (N, 3)."""
        theta_i_rad, theta_r_rad = self._within(theta_i_rad, theta_r_rad)
        g = half_vector_geometry(theta_i_rad, theta_r_rad, phi_rad)
        odd, variance = _odd(g, phi_rad), np.zeros((theta_i_rad.size, 3))
        for share, fit in self.fits:
            variance[:, 0] += share * fit.log_f00.variance(_even(g))
            variance[:, 1] += share * fit.ratios[0].variance(_ordered(g))
            variance[:, 2] += share * odd**2 * fit.ratios[1].variance(_ordered(g))
        if len(self.fits) > 1:
            # Between two wavelengths a number may bend: by no more than it changes, and by nothing at their own.
            (share, first), (_, second) = self.fits
            bend = share * (1.0 - share)
            variance[:, 0] += (bend * (first.log_f00.mean(_even(g)) - second.log_f00.mean(_even(g)))) ** 2
            change = first.elements(g, odd) - second.elements(g, odd)
            variance[:, 1:] += (bend * change[:, 1:, 0]) ** 2
        return np.sqrt(variance)

    def covers(self, theta_i_rad: FloatArray, theta_r_rad: FloatArray) -> NDArray[np.bool_]:
        """Return where incidence and reflection are no steeper than measured; the way back counts as measured too."""
        larger, smaller = (limit + _ROOM_RAD for limit in self.largest_rad)
        return np.asarray(
            (np.maximum(theta_i_rad, theta_r_rad) <= larger) & (np.minimum(theta_i_rad, theta_r_rad) <= smaller)
        )

    def require_covered(self, theta_i_rad: FloatArray, theta_r_rad: FloatArray) -> None:
        """Raise ValueError where incidence or reflection is steeper than measured."""
        outside = np.flatnonzero(~np.ravel(self.covers(theta_i_rad, theta_r_rad)))
        if outside.size:
            more = "" if outside.size == 1 else f" (and {outside.size - 1} more)"
            i, r = (np.degrees(np.ravel(angle)[outside[0]]) for angle in np.broadcast_arrays(theta_i_rad, theta_r_rad))
            larger, smaller = np.degrees(self.largest_rad)
            raise ValueError(
                f"{self.source}: incidence {i:.4g} deg with reflection {r:.4g} deg{more} is outside of the measured "
                f"range; measured is one of them up to {larger:.4g} deg with the other up to {smaller:.4g} deg"
            )

    def hemispherical_row(self, theta_i_rad: FloatArray) -> FloatArray:
        """Return the integrals of F00 and F01 times cosine over the hemisphere, shape (2, T)."""
        return _hemispherical_row(self, tuple(theta_i_rad.tolist()))

    @property
    def reflectance_error(self) -> float:
        """Relative standard error of f00 at 45 and 0 deg, for sums over the hemisphere."""
        at = np.radians([45.0, 0.0, 90.0])[:, None]
        return float(self.standard_error(*at)[0, 0])

    def _within(self, theta_i_rad: FloatArray, theta_r_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
        larger = self.largest_rad[0]
        return np.minimum(theta_i_rad, larger), np.minimum(theta_r_rad, larger)


_HEMISPHERE_ORDER = 32


@lru_cache(maxsize=64)
def _hemispherical_row(table: TabulatedBrdf, theta_i_rad: tuple[float, ...]) -> FloatArray:
    node, weight = gauss_legendre(_HEMISPHERE_ORDER)
    theta_r, phi = 0.5 * np.pi * node, np.pi * (np.arange(_HEMISPHERE_ORDER) + 0.5) / _HEMISPHERE_ORDER
    solid = 0.5 * np.pi * np.pi * weight * np.sin(2.0 * theta_r)
    rows = []
    for theta_i in theta_i_rad:
        r, around = (grid.ravel() for grid in np.meshgrid(theta_r, phi, indexing="ij"))
        first = table.matrix(np.full(r.shape, theta_i), r, around)[:, 0, :2]
        rows.append(solid @ first.reshape(_HEMISPHERE_ORDER, _HEMISPHERE_ORDER, 2).mean(axis=1))
    return np.array(rows).reshape(-1, 2).T


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredTable:
    """Measured geometries with their Mueller matrices; the smooth functions of each wavelength are kept.

    Parameters
    ----------
    source
        Origin, in words.
    wavelength_m, theta_i_rad, theta_r_rad, phi_rad
        Shape (N,), in the frames of `model.surface.pbrdf.mueller`.
    f00_per_sr
        Shape (N,) [sr^-1].
    ratios
        Elements over f00, shape (N, 3, 3), NaN where not measured. Polarization of light that arrives polarized counts
        as lost where the lower right block was not measured.
    is_degree
        True if M10 holds the DoLP of unpolarised light alone: it is taken to stand across the plane of scattering.
    """

    source: str
    wavelength_m: FloatArray
    theta_i_rad: FloatArray
    theta_r_rad: FloatArray
    phi_rad: FloatArray
    f00_per_sr: FloatArray
    ratios: FloatArray
    is_degree: bool = False
    _kept: dict[float, "_Fit"] = field(default_factory=dict, repr=False)
    _at: dict[float, TabulatedBrdf] = field(default_factory=dict, repr=False)

    @property
    def wavelengths_m(self) -> FloatArray:
        """Measured wavelengths, ascending."""
        return np.unique(self.wavelength_m)

    def at(self, wavelength_m: float) -> TabulatedBrdf:
        """Return the surface at a wavelength, linearly between the two next to it.

        Raises
        ------
        ValueError
            If the wavelength is outside the table, or fewer than 30 geometries were measured.
        """
        if wavelength_m in self._at:
            return self._at[wavelength_m]
        measured = self.wavelengths_m
        low, high = measured[0] * (1.0 - _SAME_WAVELENGTH), measured[-1] * (1.0 + _SAME_WAVELENGTH)
        if not low <= wavelength_m <= high:
            raise ValueError(
                f"{self.source}: wavelength {wavelength_m * 1e9:.4g} nm is outside of the measured range, "
                f"{measured[0] * 1e9:.4g} to {measured[-1] * 1e9:.4g} nm"
            )
        near = measured[np.abs(measured / wavelength_m - 1.0) <= _SAME_WAVELENGTH]
        if near.size:
            shares = [(1.0, float(near[0]))]
        else:
            above = int(np.searchsorted(measured, wavelength_m))
            first, second = measured[above - 1 : above + 1].tolist()
            part = (second - wavelength_m) / (second - first)
            shares = [(part, first), (1.0 - part, second)]
        limits = []
        for _, one in shares:
            rows = self.wavelength_m == one
            pair = np.sort([self.theta_i_rad[rows], self.theta_r_rad[rows]], axis=0)
            limits.append((float(pair[1].max()), float(pair[0].max())))
        larger, smaller = (min(values) for values in zip(*limits, strict=True))
        self._at[wavelength_m] = TabulatedBrdf(
            source=self.source,
            fits=tuple((share, self._fit(one)) for share, one in shares),
            largest_rad=(larger, smaller),
        )
        return self._at[wavelength_m]

    def _fit(self, wavelength_m: float) -> "_Fit":
        if wavelength_m not in self._kept:
            self._kept[wavelength_m] = _fitted(self, np.flatnonzero(self.wavelength_m == wavelength_m))
        return self._kept[wavelength_m]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Fit:
    """Smooth functions of one wavelength: log f00, and elements over f00 at `_PLACES`; None where not measured."""

    log_f00: "_Process"
    ratios: "tuple[_Process, ...]"
    has_block: bool

    def elements(self, g: HalfVectorGeometry, odd: FloatArray) -> FloatArray:
        """Return elements over f00 in the plane of scattering, shape (N, 3, 3), without M00."""
        found = np.zeros((odd.size, 3, 3))
        there, back = _ordered(g), _ordered(g)[:, [1, 0, 2]]
        found[:, 1, 0], found[:, 0, 1] = self.ratios[0].mean(there), self.ratios[0].mean(back)
        found[:, 2, 0], found[:, 0, 2] = odd * self.ratios[1].mean(there), odd * self.ratios[1].mean(back)
        if self.has_block:
            found[:, 1, 1], found[:, 2, 2] = (process.mean(_even(g)) for process in self.ratios[2:4])
            found[:, 2, 1], found[:, 1, 2] = odd * self.ratios[4].mean(there), odd * self.ratios[4].mean(back)
        return found


def _fitted(table: MeasuredTable, rows: NDArray[np.intp]) -> _Fit:
    if rows.size < LEAST_ROWS:
        raise ValueError(
            f"{table.source}: {rows.size} geometries at {table.wavelength_m[rows[0]] * 1e9:.4g} nm; needed are "
            f"{LEAST_ROWS} or more"
        )
    phi = table.phi_rad[rows]
    g = half_vector_geometry(table.theta_i_rad[rows], table.theta_r_rad[rows], phi)
    elements = table.ratios[rows]
    if not table.is_degree:
        # Rows or blocks that were not measured are not fitted.
        elements = np.nan_to_num(elements, nan=0.0)
        elements = _axes(g.cos_2eta_r, g.sin_2eta_r) @ elements @ _axes(g.cos_2eta_i, -g.sin_2eta_i)
    has_row = not table.is_degree and bool(np.all(np.isfinite(table.ratios[rows, 0, 1])))
    has_block = has_row and bool(np.all(np.isfinite(table.ratios[rows, 1:, 1:])))
    odd, there, back = _odd(g, phi), _ordered(g), _ordered(g)[:, [1, 0, 2]]
    both = np.vstack([there, back]) if has_row else there
    twice = np.tile(odd, 2) if has_row else odd

    def directed(i: int, j: int) -> FloatArray:
        return np.append(elements[:, i, j], elements[:, j, i]) if has_row else elements[:, i, j]

    log_f00 = _process(_even(g), np.log(table.f00_per_sr[rows]))
    along = _process(both, directed(1, 0))
    across = np.zeros(rows.size) if table.is_degree else directed(2, 0)
    ratios = [along, _process(both, across, factor=twice)]
    if has_block:
        ratios += [_process(_even(g), elements[:, i, i]) for i in (1, 2)]
        ratios.append(_process(both, directed(2, 1), factor=twice))
    return _Fit(log_f00=log_f00, ratios=tuple(ratios), has_block=has_block)


def _axes(cosine: FloatArray, sine: FloatArray) -> FloatArray:
    """Return rotations of Stokes axes by half the angle of a cosine and sine, shape (N, 3, 3)."""
    matrix = np.zeros((cosine.size, 3, 3))
    matrix[:, 0, 0] = 1.0
    matrix[:, 1, 1] = matrix[:, 2, 2] = cosine
    matrix[:, 1, 2], matrix[:, 2, 1] = sine, -sine
    return matrix


def _even(g: HalfVectorGeometry) -> FloatArray:
    """Return variables that the way back has too, shape (N, 3)."""
    return np.stack([g.mean_cosine, np.abs(g.cos_i - g.cos_r), np.sqrt(g.cos2_psi)], axis=-1)


def _ordered(g: HalfVectorGeometry) -> FloatArray:
    """Return variables of which the way back has the first two exchanged, shape (N, 3)."""
    return np.stack([g.cos_i, g.cos_r, np.sqrt(g.cos2_psi)], axis=-1)


def _odd(g: HalfVectorGeometry, phi_rad: FloatArray) -> FloatArray:
    """Return the factor that changes its sign in a mirror: the volume of normal and both rays."""
    return np.asarray(g.sin_i * g.sin_r * np.sin(phi_rad))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Process:
    """A Gaussian process with inducing points: prior mean, scale and lengths, and what the data leave open."""

    level: float
    scale: float
    lengths: FloatArray
    noise: float
    centres: FloatArray
    weights: FloatArray
    prior_root: FloatArray  #: Inverse of the lower Cholesky factor of the centres' covariance.
    data_root: FloatArray  #: Inverse of that of the data's information about them.

    def mean(self, at: FloatArray) -> FloatArray:
        return np.asarray(self.level + _correlation(at, self.centres, self.lengths) @ self.weights)

    def variance(self, at: FloatArray) -> FloatArray:
        known = self.prior_root @ _correlation(at, self.centres, self.lengths).T
        open_ = np.maximum(1.0 - np.sum(known**2, axis=0), 0.0)
        return np.asarray(self.scale**2 * (open_ + np.sum((self.data_root @ known) ** 2, axis=0)))


def _correlation(at: FloatArray, centres: FloatArray, lengths: FloatArray) -> FloatArray:
    """Return Matern's correlation of smoothness 5/2, shape (N, M)."""
    a, b = at / lengths, centres / lengths
    square = np.sum(a * a, axis=1)[:, None] + np.sum(b * b, axis=1) - 2.0 * a @ b.T
    r = np.sqrt(5.0 * np.maximum(square, 0.0))
    return np.asarray((1.0 + r + r * r / 3.0) * np.exp(-r))


# Added to the diagonal of correlations of centres, so that rounding leaves them positive.
_JITTER = 1e-7
# Bounds of the search, natural logarithms: lengths in cosines, deviation of the noise over that of the function.
_LENGTHS, _NOISES = (np.log(0.08), np.log(8.0)), (np.log(3e-3), np.log(30.0))


def _process(at: FloatArray, values: FloatArray, *, factor: FloatArray | None = None) -> _Process:
    """Return the process of largest likelihood through values, each `factor` times the function."""
    from scipy.optimize import minimize

    weight = np.ones(values.size) if factor is None else factor
    level = float(np.mean(values)) if factor is None else 0.0
    left = values - level
    sample = np.random.default_rng(0).permutation(values.size)[:_SAMPLE]
    few = _spread_out(at[sample], _CENTRES // 3)

    def cost(x: FloatArray) -> float:
        return _solved(at[sample], left[sample], weight[sample], few, np.exp(x[:3]), float(np.exp(x[3])))[0]

    start = np.array([0.0, 0.0, 0.0, np.log(0.3)])
    found = minimize(cost, start, method="L-BFGS-B", bounds=[_LENGTHS] * 3 + [_NOISES], options={"maxiter": 40})
    lengths, noise = np.exp(found.x[:3]), float(np.exp(found.x[3]))
    centres = _spread_out(at, _CENTRES)
    _, scale, weights, prior_root, data_root = _solved(at, left, weight, centres, lengths, noise)
    return _Process(
        level=level,
        scale=scale,
        lengths=lengths,
        noise=noise * scale,
        centres=centres,
        weights=weights,
        prior_root=prior_root,
        data_root=data_root,
    )


def _solved(
    at: FloatArray, values: FloatArray, factor: FloatArray, centres: FloatArray, lengths: FloatArray, noise: float
) -> tuple[float, float, FloatArray, FloatArray, FloatArray]:
    """Return minus the log likelihood, the function's deviation of largest likelihood, and what prediction needs."""
    prior = np.linalg.cholesky(_correlation(centres, centres, lengths) + _JITTER * np.eye(len(centres)))
    prior_root = np.linalg.inv(prior)
    design = (_correlation(at, centres, lengths) @ prior_root.T) * (factor / noise)[:, None]
    data = np.linalg.cholesky(np.eye(len(centres)) + design.T @ design)
    data_root = np.linalg.inv(data)
    projected = data_root @ (design.T @ (values / noise))
    square = max(float(np.sum((values / noise) ** 2) - projected @ projected), np.finfo(float).tiny)
    scale = np.sqrt(square / values.size)
    cost = 0.5 * values.size * np.log(square) + np.sum(np.log(np.diag(data))) + values.size * np.log(noise)
    return float(cost), float(scale), prior_root.T @ (data_root.T @ projected), prior_root, data_root


def _spread_out(at: FloatArray, count: int) -> FloatArray:
    """Return points of a set, each as far from those before as any."""
    scaled = (at - at.min(axis=0)) / np.maximum(np.ptp(at, axis=0), 1e-9)
    chosen, distance = [0], np.full(len(at), np.inf)
    while len(chosen) < min(count, len(at)):
        distance = np.minimum(distance, np.sum((scaled - scaled[chosen[-1]]) ** 2, axis=1))
        if distance.max() < 1e-12:
            break
        chosen.append(int(np.argmax(distance)))
    return at[chosen]
