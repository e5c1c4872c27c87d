"""The specular lobe of a rough surface: Fresnel mirrors with Gaussian slopes that hide one another.

`half_vector_geometry` and `write_specular` give the Mueller matrix of the lobe between two directions,
`lobe_reflectance` the share of the light that the lobe reflects into the hemisphere, and `reflectance_table` that share
as a series, where it is needed at many angles.

Integrals over the lobe run over the slopes (x, y) of the facets, x along the sun's azimuth. The facets that see the sun
and mirror it above the horizon, and those where the V-cavity changes its branch, are bounded by curves y(x) known in
closed form. They cut the plane into panels in which the integrand is smooth and Gauss-Legendre rules converge fast.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Literal, get_args

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from model.numerics import erfc, gauss_legendre
from model.stokes import finite_angle

FloatArray = NDArray[np.float64]
AmplitudeArray = NDArray[np.inexact]
_DoubleAngle = tuple[FloatArray, FloatArray, NDArray[np.bool_]]


Shadowing = Literal["none", "v-cavity", "smith", "smith-correlated"]
SHADOWING: tuple[Shadowing, ...] = get_args(Shadowing)
# The lobe's solid angle is about 4 pi slope_rms^2; below this slope it is much narrower than the sun's disc.
SLOPE_RMS_MIN = 1e-3
INDEX_MAX = 1e9


@dataclass(frozen=True, kw_only=True)
class Lobe:
    """Parameters of the specular lobe of a surface.

    Parameters
    ----------
    n, k
        Real and imaginary part of the refractive index; 0 < n <= 1e9, 0 <= k <= 1e9.
    slope_rms
        Standard deviation of the facet slope along one axis, at least 1e-3. (Beckmann's alpha is sqrt(2) times it.)
    shadowing
        One of `SHADOWING`.

    Raises
    ------
    ValueError
        If a value is outside its range.
    """

    n: float
    k: float
    slope_rms: float
    shadowing: Shadowing

    def __post_init__(self) -> None:
        if not 0.0 < self.n <= INDEX_MAX:
            raise ValueError(f"n = {self.n}; allowed is 0 < n <= {INDEX_MAX:g} (real part of the refractive index)")
        if not 0.0 <= self.k <= INDEX_MAX:
            raise ValueError(
                f"k = {self.k}; allowed is 0 <= k <= {INDEX_MAX:g} (the index is n + ik, absorption is positive)"
            )
        if not (math.isfinite(self.slope_rms) and self.slope_rms >= SLOPE_RMS_MIN):
            raise ValueError(
                f"slope_rms = {self.slope_rms}; allowed is {SLOPE_RMS_MIN:g} and above (per axis). A smoother surface "
                "is a mirror: its lobe is narrower than the sun's disc, so a reflectance per solid angle says nothing; "
                "use a slope of the sun's half width (about 0.0023) or the mirror's Fresnel reflectance"
            )
        if self.shadowing not in SHADOWING:
            raise ValueError(f"shadowing = {self.shadowing!r}; allowed are {', '.join(map(repr, SHADOWING))}")


@dataclass(frozen=True, kw_only=True)
class HemisphericalReflectance:
    """Share of the incident light that goes into the hemisphere."""

    s0: FloatArray
    s1: FloatArray
    error: FloatArray


@lru_cache(maxsize=256)
def reflectance_at(lobe: Lobe, theta_rad: float) -> float:
    """Return the lobe's reflectance E of unpolarised light at one angle; kept for each lobe and angle."""
    return float(lobe_reflectance(theta_rad, lobe=lobe).s0)


# Nodes along x of each panel: a rule is trusted when it agrees with the one before it.
_ORDERS = (24, 36, 54, 82, 124)
_TOLERANCE = 1e-8
_ROWS_AT_ONCE = 64


def lobe_reflectance(theta_i_rad: ArrayLike, *, lobe: Lobe, tolerance: float = _TOLERANCE) -> HemisphericalReflectance:
    """Return the directional-hemispherical reflectance of a specular lobe and its estimated error.

    Parameters
    ----------
    theta_i_rad
        Zenith angle of the incident light [rad], any shape, 0 to pi/2.
    tolerance
        Rules are refined until two agree to this, absolute (relative where the reflectance exceeds 1).

    Returns
    -------
    HemisphericalReflectance
        Arrays of the shape of `theta_i_rad`.

    Raises
    ------
    ValueError
        If an angle is outside its range.

    Notes
    -----
    The error is the difference between the last two rules. Where the finest does not reach the tolerance (real n
    below 1: a critical angle) it says so.
    Without shadowing the reflectance passes 1 near grazing and grows as 1 / cos theta.

    References
    ----------
    Definition: integral of f00 cos theta_r over the hemisphere, as an integral over facet slopes.
    """
    angles = checked_zenith("theta_i_rad", theta_i_rad)
    flat = np.minimum(angles.ravel(), 0.5 * np.pi)
    if np.any(angles > 0.5 * np.pi):
        raise ValueError(f"theta_i_rad = {np.max(angles):.6g} rad; allowed is 0 to pi/2")
    parts = [
        _refined(flat[start : start + _ROWS_AT_ONCE], lobe, tolerance) for start in range(0, flat.size, _ROWS_AT_ONCE)
    ]
    s0, s1, error = np.concatenate([np.empty((3, 0)), *parts], axis=1).reshape(3, *angles.shape)
    return HemisphericalReflectance(s0=s0, s1=s1, error=error)


def checked_zenith(name: str, angle_rad: ArrayLike) -> FloatArray:
    """Return zenith angles as a float64 array."""
    angle = finite_angle(name, angle_rad)
    outside = (angle < 0.0) | (angle > np.pi)
    if np.any(outside):
        raise ValueError(
            f"{name} = {angle[outside].flat[0]:.6g} rad; allowed is 0 to pi, counted from the surface normal. "
            "The other side of the normal is the azimuth's business: add pi to phi_rad"
        )
    return angle


# Slopes beyond this many standard deviations hold 2e-11 of the facets.
SLOPE_CUT = 7.0


def facet_nodes(
    theta_i_rad: FloatArray, *, slope_rms: float, shadowing: Shadowing, order: int, cut: float = SLOPE_CUT
) -> tuple[NDArray[np.intp], FloatArray, FloatArray, FloatArray]:
    """Return nodes over the facets that mirror the sun into the upper hemisphere: row of the sun, slopes, weights.

    Definition; reflected above the horizon is 1 + x^2 + y^2 < 2 (1 + x tan theta), and with the V-cavity the way
    out is the narrower one where 1 + x^2 + y^2 > 4 (1 + x tan theta) / (2 + min(1 + x tan theta, 2)).
    """
    steepest = cut * slope_rms
    x, x_weight = _x_nodes(_x_breaks(theta_i_rad, shadowing, steepest), order)
    breaks = _y_breaks(x, theta_i_rad, shadowing, steepest)
    widths = np.diff(breaks, axis=-1)
    strip_weight = x_weight[..., None] * widths
    kept = np.nonzero(strip_weight > 0.0)
    node, node_weight = gauss_legendre(max(order // 2, 2))
    strip_x = x[kept[:2]][:, None]
    y = breaks[..., :-1][kept][:, None] + widths[kept][:, None] * node
    density = np.exp((strip_x**2 + y**2) * (-0.5 / slope_rms**2)) / (np.pi * slope_rms**2)
    return kept[0], strip_x, y, strip_weight[kept][:, None] * node_weight * density


def _refined(theta_rad: FloatArray, lobe: Lobe, tolerance: float) -> FloatArray:
    """Rows s0, s1, error; only angles that have not converged meet the next rule."""
    result = np.zeros((3, theta_rad.size))
    result[:2] = _integrals(theta_rad, lobe, _ORDERS[0])
    open_rows = np.arange(theta_rad.size)
    for order in _ORDERS[1:]:
        finer = _integrals(theta_rad[open_rows], lobe, order)
        result[2, open_rows] = np.max(np.abs(finer - result[:2, open_rows]), axis=0)
        result[:2, open_rows] = finer
        rough = result[2, open_rows] > tolerance * np.maximum(1.0, finer[0])
        open_rows = open_rows[rough]
        if open_rows.size == 0:
            break
    return result


def _integrals(theta_rad: FloatArray, lobe: Lobe, order: int) -> FloatArray:
    """Reflectance for S0 and for S1, shape (2, T), by one rule."""
    row, x, y, weight = facet_nodes(theta_rad, slope_rms=lobe.slope_rms, shadowing=lobe.shadowing, order=order)
    cos_i, sin_i = np.cos(theta_rad)[row, None], np.sin(theta_rad)[row, None]
    seen = cos_i + x * sin_i
    secant2 = 1.0 + x**2 + y**2
    # Above the horizon by the choice of nodes; rounding at the rim may say otherwise.
    cos_r = np.maximum(2.0 * seen / secant2 - cos_i, 1e-40)
    across, lean = y**2, (sin_i - x * cos_i) ** 2
    cos2_psi = seen**2 / secant2
    prefactor = _shadowed_prefactor(
        cos_i=cos_i,
        sin_i=sin_i,
        cos_r=cos_r,
        sin_r=np.sqrt(np.maximum(1.0 - cos_r**2, 0.0)),
        mean_cosine=seen / secant2,
        cos2_psi=cos2_psi,
        slope_rms=lobe.slope_rms,
        shadowing=lobe.shadowing,
    )
    m00, m01, _ = mueller_elements(cos2_psi=cos2_psi, n=lobe.n, k=lobe.k)
    visible = 4.0 * prefactor * cos_r * seen * weight
    cos_2eta = np.divide(lean - across, lean + across, out=np.ones_like(m01), where=lean + across > 0.0)
    strips = (np.sum(visible * m00, axis=1), np.sum(visible * m01 * cos_2eta, axis=1))
    return np.stack([np.bincount(row, strip, minlength=theta_rad.size) for strip in strips])


def _x_nodes(breaks: FloatArray, order: int) -> tuple[FloatArray, FloatArray]:
    """Nodes and weights of shape (T, panels * order); sin^2 spacing undoes the square roots at panel ends."""
    node, weight = gauss_legendre(order)
    spaced = np.sin(0.5 * np.pi * node) ** 2
    stretch = 0.5 * np.pi * np.sin(np.pi * node) * weight
    width = np.diff(breaks, axis=-1)[..., None]
    shape = (breaks.shape[0], -1)
    return (breaks[..., :-1, None] + width * spaced).reshape(shape), (width * stretch).reshape(shape)


def _x_breaks(theta_rad: FloatArray, shadowing: Shadowing, cut: float) -> FloatArray:
    """Return ends of the panels along x, ascending; in-plane tilts of the facet make them simple."""
    left = 0.5 * np.pi - theta_rad
    angles = [-0.5 * left, np.zeros_like(left), 0.5 * np.pi - 0.5 * left]
    if shadowing == "v-cavity":
        last = np.maximum(theta_rad, (theta_rad + 0.5 * np.pi) / 3.0)
        angles[1:1] = [-left / 3.0]
        angles[3:3] = [np.minimum(left, last), last]
    return np.clip(np.tan(np.stack(angles, axis=-1)), -cut, cut)


def _y_breaks(x: FloatArray, theta_rad: FloatArray, shadowing: Shadowing, cut: float) -> FloatArray:
    """Return ends of the panels along y >= 0, shape (T, X, panels + 1)."""
    cos, sin = np.cos(theta_rad)[:, None], np.sin(theta_rad)[:, None]
    seen = cos + x * sin
    curves = [2.0 * seen / cos]
    if shadowing == "v-cavity":
        curves.insert(0, 4.0 * seen / (2.0 * cos + np.minimum(seen, 2.0 * cos)))
    tops = [np.sqrt(np.maximum(curve - 1.0 - x * x, 0.0)) for curve in curves]
    return np.asarray(np.minimum(np.stack([np.zeros_like(x), *tops], axis=-1), cut))


def _shadowed_prefactor(
    *,
    cos_i: FloatArray,
    sin_i: FloatArray,
    cos_r: FloatArray,
    sin_r: FloatArray,
    mean_cosine: FloatArray,
    cos2_psi: FloatArray,
    slope_rms: float,
    shadowing: Shadowing,
) -> FloatArray:
    """Return G / (4 cos theta_i cos theta_r), the visible share of facets over the projections.

    With G = 1 the surface reflects more than it receives near grazing. The other three conserve energy.

    "v-cavity": Torrance and Sparrow (1967), doi:10.1364/JOSA.57.001105. Smith: Smith (1967),
    doi:10.1109/TAP.1967.1138991, for Gaussian slopes; the correlated form: Heitz (2014), J. Computer Graphics
    Techniques 3(2).
    """
    if shadowing == "none":
        return 0.25 / (cos_i * cos_r)
    if shadowing == "v-cavity":
        cavity = 0.5 * mean_cosine / (cos2_psi * np.maximum(cos_i, cos_r))
        return np.minimum(0.25 / (cos_i * cos_r), cavity)
    masked_i = _masked_cosine(cos_i, sin_i, slope_rms)
    masked_r = _masked_cosine(cos_r, sin_r, slope_rms)
    if shadowing == "smith":
        return 0.25 / ((cos_i + masked_i) * (cos_r + masked_r))
    return 0.25 / (cos_i * cos_r + cos_r * masked_i + cos_i * masked_r)


def _masked_cosine(cos: FloatArray, sin: FloatArray, slope_rms: float) -> FloatArray:
    """Cosine times Smith's Lambda for Gaussian slopes: finite at grazing, zero at the normal."""
    spread = np.sqrt(2.0) * slope_rms * sin
    with np.errstate(over="ignore"):
        a = np.divide(cos, spread, out=np.full_like(cos, np.inf), where=spread > 0.0)
        return np.asarray(0.5 * (spread * np.exp(-a * a) / np.sqrt(np.pi) - cos * erfc(a)))


def mueller_elements(*, cos2_psi: FloatArray, n: float, k: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return M00 = M11, M01 = M10 and M22 of reflection in the axes of the plane of incidence.

    M22 is negative below Brewster's angle: a mirror turns +45 deg into -45 deg.
    """
    r_s, r_p = amplitudes(cos2_psi=cos2_psi, n=n, k=k)
    if np.iscomplexobj(r_s):
        power_s = r_s.real**2 + r_s.imag**2
        power_p = r_p.real**2 + r_p.imag**2
        cross = r_s.real * r_p.real + r_s.imag * r_p.imag
    else:
        power_s, power_p, cross = r_s.real**2, r_p.real**2, r_s.real * r_p.real
    return 0.5 * (power_s + power_p), 0.5 * (power_s - power_p), cross


def amplitudes(*, cos2_psi: FloatArray, n: float, k: float) -> tuple[AmplitudeArray, AmplitudeArray]:
    """Return the amplitude reflection coefficients r_s and r_p.

    Right-handed triads, so r_p = -r_s at normal incidence. The numerators are written as differences of
    squares, which keeps all digits at Brewster's angle and for an index near 1.

    Definition (Fresnel's equations).
    """
    c = np.sqrt(cos2_psi)
    # m^2 - 1. Above 1 a real index gives a real root; below it there is a critical angle and the root turns
    # imaginary. The imaginary part is then +0, and the root is the one that decays into the medium.
    real = (n - 1.0) * (n + 1.0) - k * k
    excess = real if k == 0.0 and n >= 1.0 else complex(real, 2.0 * n * k)
    w = np.sqrt(excess + cos2_psi)
    r_s = -excess / (c + w) ** 2
    r_p = excess * ((excess + 2.0) * cos2_psi - 1.0) / ((excess + 1.0) * c + w) ** 2
    return r_s, r_p


@dataclass(frozen=True, kw_only=True)
class HalfVectorGeometry:
    """Angles between sun, sensor and the facet that mirrors one into the other; arrays of one shape."""

    cos_i: FloatArray
    sin_i: FloatArray
    cos_r: FloatArray
    sin_r: FloatArray
    cos2_psi: FloatArray
    mean_cosine: FloatArray
    tan2_beta: FloatArray
    cos_2eta_i: FloatArray
    sin_2eta_i: FloatArray
    cos_2eta_r: FloatArray
    sin_2eta_r: FloatArray


def write_specular(out: FloatArray, geometry: HalfVectorGeometry, *, lobe: Lobe, weight: float) -> None:
    """Write the Mueller matrices of the lobe into an array.

    [MK14] section II-A; Priest and Germer (2000). M = R(-eta_r) M_Fresnel R(eta_i) times D G / (4 cos cos).
    """
    g = geometry
    scale = weight * _facet_density(g.tan2_beta, slope_rms=lobe.slope_rms)
    scale *= _shadowed_prefactor(
        cos_i=g.cos_i,
        sin_i=g.sin_i,
        cos_r=g.cos_r,
        sin_r=g.sin_r,
        mean_cosine=g.mean_cosine,
        cos2_psi=g.cos2_psi,
        slope_rms=lobe.slope_rms,
        shadowing=lobe.shadowing,
    )
    m00, m01, m22 = mueller_elements(cos2_psi=g.cos2_psi, n=lobe.n, k=lobe.k)
    write_rotated(out, g, m00=m00 * scale, m01=m01 * scale, m11=m00 * scale, m22=m22 * scale)


def _facet_density(tan2_beta: FloatArray, *, slope_rms: float) -> FloatArray:
    """Return the density of facet normals over solid angle, with integral of D cos(beta) equal to 1.

    Priest and Germer (2000), Proc. Military Sensing Symposia; Beckmann's distribution with alpha = sqrt(2) slope_rms.
    """
    variance = slope_rms * slope_rms
    with np.errstate(under="ignore"):
        weight = np.exp(tan2_beta * (-0.5 / variance))
        return np.asarray(weight * (1.0 + tan2_beta) ** 2 / (2.0 * np.pi * variance))


def write_rotated(
    out: FloatArray, g: HalfVectorGeometry, *, m00: FloatArray, m01: FloatArray, m11: FloatArray, m22: FloatArray
) -> None:
    """Write matrices with M10 = M01 in the plane of scattering, turned into the horizontal axes of both rays."""
    ci, si, cr, sr = g.cos_2eta_i, g.sin_2eta_i, g.cos_2eta_r, g.sin_2eta_r
    out[:, 0, 0] = m00
    out[:, 0, 1] = m01 * ci
    out[:, 0, 2] = m01 * si
    out[:, 1, 0] = m01 * cr
    out[:, 2, 0] = m01 * sr
    row_1, row_2 = m11 * cr, m22 * sr
    out[:, 1, 1] = row_1 * ci + row_2 * si
    out[:, 1, 2] = row_1 * si - row_2 * ci
    row_1, row_2 = m11 * sr, m22 * cr
    out[:, 2, 1] = row_1 * ci - row_2 * si
    out[:, 2, 2] = row_1 * si + row_2 * ci


def half_vector_geometry(theta_i_rad: FloatArray, theta_r_rad: FloatArray, phi_rad: FloatArray) -> HalfVectorGeometry:
    """Return the facet geometry of the directions to sun and sensor.

    With p, m = (theta_i +- theta_r) / 2 the squared quantities are sums of terms that are not negative:
    cos^2 psi = cos^2 p + sin_i sin_r cos^2(phi/2), and likewise the facet's slope. The s axis comes from the half
    vector's components along (h, v) of each ray, made of the same differences in both, so that it is one axis to the
    last digit near retro-reflection. No angle is ever formed.

    Definition; the dyadic form of the microfacet Jones matrix of Priest and Germer (2000), whose rotation
    angles [MK14] takes over.
    """
    sin_i, cos_i = np.sin(theta_i_rad), np.cos(theta_i_rad)
    sin_r, cos_r = np.sin(theta_r_rad), np.cos(theta_r_rad)
    m = 0.5 * (theta_i_rad - theta_r_rad)
    sin_m, cos_m = np.sin(m), np.cos(m)
    mean_cosine = 0.5 * (cos_i + cos_r)
    # The cosine of the mean angle would lose digits where both rays graze.
    cos_p = mean_cosine / cos_m
    sin_half, cos_half = np.sin(0.5 * phi_rad), np.cos(0.5 * phi_rad)
    sin2_half = sin_half * sin_half
    forward = sin_i * sin_r * cos_half * cos_half
    across = -2.0 * sin_half * cos_half
    difference = 2.0 * sin_m * cos_m
    eta_i = _double_angle(sin_r * across, difference + 2.0 * cos_i * sin_r * sin2_half)
    eta_r = _double_angle(sin_i * across, 2.0 * sin_i * cos_r * sin2_half - difference)
    _resolve_coincident_rays(eta_i, eta_r, phi_rad)
    return HalfVectorGeometry(
        cos_i=cos_i,
        sin_i=sin_i,
        cos_r=cos_r,
        sin_r=sin_r,
        cos2_psi=cos_p * cos_p + forward,
        mean_cosine=mean_cosine,
        tan2_beta=((cos_p * sin_m) ** 2 + forward) / (mean_cosine * mean_cosine),
        cos_2eta_i=eta_i[0],
        sin_2eta_i=eta_i[1],
        cos_2eta_r=eta_r[0],
        sin_2eta_r=eta_r[1],
    )


# Below this squared sine of the angle between the rays the facet's plane of incidence is taken from h_i. The
# matrix then errs by less than this number, since r_s + r_p is of second order in that angle.
_COINCIDENT = 1e-28


def _double_angle(along_h: FloatArray, along_v: FloatArray) -> _DoubleAngle:
    """Cosine and sine of twice the angle of the axis perpendicular to (along_h, along_v); where undefined."""
    h2, v2 = along_h * along_h, along_v * along_v
    norm2 = h2 + v2
    undefined = norm2 < _COINCIDENT
    norm2[undefined] = 1.0
    return (v2 - h2) / norm2, -2.0 * along_h * along_v / norm2, undefined


def _resolve_coincident_rays(eta_i: _DoubleAngle, eta_r: _DoubleAngle, phi_rad: FloatArray) -> None:
    """Let s = h_i in both frames where sun and sensor stand in one line."""
    lost = eta_i[2] | eta_r[2]
    if not np.any(lost):
        return
    eta_i[0][lost], eta_i[1][lost] = 1.0, 0.0
    eta_r[0][lost], eta_r[1][lost] = np.cos(2.0 * phi_rad[lost]), -np.sin(2.0 * phi_rad[lost])


_SERIES_TOLERANCE = 1e-7
_DEGREES = (12, 24, 48, 96, 192)
_WORST_ERROR = 1e-4
_MEAN_NODES = 48


@dataclass(frozen=True, kw_only=True, eq=False)
class ReflectanceTable:
    """A piecewise Chebyshev series for the reflectance E(theta) of a lobe, theta in [0, pi/2)."""

    edges: FloatArray
    coefficients: tuple[FloatArray, ...]
    stretch_rad: float
    rise: float
    error: float

    def at(self, theta_rad: FloatArray) -> FloatArray:
        """Return E of unpolarised light."""
        u = np.arcsinh((0.5 * np.pi - theta_rad) / self.stretch_rad)
        series = self._piece(0, u)
        for index in range(1, len(self.coefficients)):
            beyond = u > self.edges[index]
            series[beyond] = self._piece(index, u[beyond])
        if self.rise > 0.0:
            series *= 1.0 + self.rise / np.cos(theta_rad)
        return series

    def _piece(self, index: int, u: FloatArray) -> FloatArray:
        low, high = self.edges[index], self.edges[index + 1]
        position = (2.0 * u - (low + high)) / (high - low)
        return np.asarray(chebyshev.chebval(position, self.coefficients[index]))

    def mean_nodes(self) -> tuple[FloatArray, FloatArray]:
        """Return angles and weights for the cosine-weighted mean over the hemisphere.

        Definition; Gauss-Legendre in the stretched angle, piece by piece.
        """
        node, weight = gauss_legendre(_MEAN_NODES)
        widths = np.diff(self.edges)[:, None]
        u = (self.edges[:-1, None] + widths * node).ravel()
        theta = 0.5 * np.pi - self.stretch_rad * np.sinh(u)
        return theta, (widths * weight).ravel() * self.stretch_rad * np.cosh(u) * np.sin(2.0 * theta)


_Part = Literal["s0", "s1"]


@lru_cache(maxsize=64)
def reflectance_table(lobe: Lobe, part: _Part = "s0") -> ReflectanceTable:
    """Return the series of a lobe; made once for each lobe and kept.

    Parameters
    ----------
    lobe
        Index, slopes and shadowing.
    part
        "s0" of unpolarised light, "s1" what horizontally polarised light adds to that.

    Returns
    -------
    ReflectanceTable
        Immutable, so that threads may share it.

    Raises
    ------
    ValueError
        If its error cannot be brought below 1e-4.
    """
    stretch = min(4.0 * lobe.slope_rms, 1.0)
    rise = lobe.slope_rms if lobe.shadowing == "none" else 0.0
    # The V-cavity's branches change their order at 45 deg, and E has a kink there in a higher derivative.
    angles = [0.5 * np.pi, 0.25 * np.pi, 0.0] if lobe.shadowing == "v-cavity" else [0.5 * np.pi, 0.0]
    edges = np.arcsinh((0.5 * np.pi - np.array(angles)) / stretch)
    pieces = [_series(lobe, part, stretch, rise, low, high) for low, high in pairwise(edges)]
    error = max(piece_error for _, piece_error in pieces)
    if error > _WORST_ERROR:
        raise ValueError(
            f"the reflectance of the lobe n = {lobe.n:g}, k = {lobe.k:g}, slope_rms = {lobe.slope_rms:g} is known "
            f"to {error:.1g} only; allowed is {_WORST_ERROR:g}. A real index below 1 has a critical angle at which "
            "the quadrature is slow: give the absorption k, or leave out dhr"
        )
    return ReflectanceTable(
        edges=edges,
        coefficients=tuple(coefficients for coefficients, _ in pieces),
        stretch_rad=stretch,
        rise=rise,
        error=error,
    )


def _series(lobe: Lobe, part: _Part, stretch: float, rise: float, low: float, high: float) -> tuple[FloatArray, float]:
    """Return coefficients between two stretched angles, and their error in E."""

    def samples_at(position: FloatArray) -> FloatArray:
        """Rows of the tabulated function, its quadrature error, and the factor from E to it."""
        u = low + 0.5 * (position + 1.0) * (high - low)
        theta = np.clip(0.5 * np.pi - stretch * np.sinh(u), 0.0, 0.5 * np.pi)
        factor = np.cos(theta) / (np.cos(theta) + rise)
        reflectance = lobe_reflectance(theta, lobe=lobe)
        value = reflectance.s0 if part == "s0" else reflectance.s1
        return np.stack([value * factor, reflectance.error * factor, factor])

    samples = samples_at(chebyshev_nodes(_DEGREES[0]))
    for degree in _DEGREES[1:]:
        added = chebyshev_nodes(degree)[1::2]
        between = samples_at(added)
        miss = float(np.max(np.abs(between[0] - chebyshev.chebval(added, chebyshev_series(samples[0])))))
        # The nodes of half the degree are every other node of this one.
        together = np.empty((len(samples), degree + 1))
        together[:, ::2], together[:, 1::2] = samples, between
        samples = together
        if miss < _SERIES_TOLERANCE:
            break
    values, quadrature_error, factor = samples
    coefficients = chebyshev_series(values)
    # The tail of the series only costs time.
    tail = np.cumsum(np.abs(coefficients[::-1]))[::-1]
    count = max(int(np.sum(tail > 0.1 * _SERIES_TOLERANCE)), 1)
    dropped, coefficients = float(np.sum(np.abs(coefficients[count:]))), coefficients[:count].copy()
    coefficients.flags.writeable = False
    # An error of the series is larger in E; what counts is E up to 1 (and what rounding adds to 1).
    amplification = float(np.max(1.0 / factor, where=values <= 1.001 * factor, initial=1.0))
    return coefficients, (miss + float(np.max(quadrature_error)) + dropped) * amplification


def chebyshev_nodes(degree: int) -> FloatArray:
    """Return the ends and extrema of a Chebyshev polynomial, from 1 to -1."""
    return np.asarray(np.cos(np.pi * np.arange(degree + 1) / degree))


def chebyshev_series(values: FloatArray) -> FloatArray:
    """Return the coefficients of the series through values at `chebyshev_nodes`, by the discrete cosine sum."""
    degree = values.size - 1
    j = np.arange(degree + 1)
    halved = values.copy()
    halved[[0, -1]] *= 0.5
    coefficients = np.cos(np.pi * np.outer(j, j) / degree) @ halved * (2.0 / degree)
    coefficients[[0, -1]] *= 0.5
    return np.asarray(coefficients)
