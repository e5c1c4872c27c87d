"""Nodes over facet slopes for integrals over the specular lobe.

The slopes (x, y), x along the sun's azimuth, carry a Gaussian weight. What sees the sun and mirrors it above the
horizon, and where the V-cavity changes its branch, are bounded by curves y(x) known in closed form, so that the
plane is cut into panels in which the integrand is smooth and Gauss-Legendre rules converge at their full rate.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.quadrature import gauss_legendre
from model.surface.shadowing import Shadowing

FloatArray = NDArray[np.float64]

# Slopes beyond this many standard deviations hold 2e-11 of the facets.
SLOPE_CUT = 7.0


@dataclass(frozen=True, kw_only=True)
class FacetNodes:
    """Facets and their weights.

    Parameters
    ----------
    row
        Shape (R,): which of the angles of incidence the panel strip belongs to.
    x
        Slope along the sun's azimuth, shape (R, 1); positive where the facet leans to the sun.
    y
        Slope across, shape (R, Q), one of the two signs.
    weight
        Shape (R, Q), for both signs of y together; Gaussian density included.
    """

    row: NDArray[np.intp]
    x: FloatArray
    y: FloatArray
    weight: FloatArray


def facet_nodes(
    theta_i_rad: FloatArray, *, slope_rms: float, shadowing: Shadowing, order: int, cut: float = SLOPE_CUT
) -> FacetNodes:
    """Return nodes over the facets that mirror the sun into the upper hemisphere.

    Parameters
    ----------
    theta_i_rad
        Zenith angles of the sun [rad], shape (T,), in [0, pi/2].
    slope_rms
        Standard deviation of the slope along one axis.
    shadowing
        Decides which curves the panels follow.
    order
        Nodes of each panel along x; half of it along y.
    cut
        Standard deviations beyond which no slopes are taken.

    Returns
    -------
    FacetNodes
        Strips of no area are left out.

    References
    ----------
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
    return FacetNodes(row=kept[0], x=strip_x, y=y, weight=strip_weight[kept][:, None] * node_weight * density)


def _x_breaks(theta_rad: FloatArray, shadowing: Shadowing, cut: float) -> FloatArray:
    """Return ends of the panels along x, ascending; in-plane tilts of the facet make them simple."""
    left = 0.5 * np.pi - theta_rad
    angles = [-0.5 * left, np.zeros_like(left), 0.5 * np.pi - 0.5 * left]
    if shadowing == "v-cavity":
        last = np.maximum(theta_rad, (theta_rad + 0.5 * np.pi) / 3.0)
        angles[1:1] = [-left / 3.0]
        angles[3:3] = [np.minimum(left, last), last]
    return np.clip(np.tan(np.stack(angles, axis=-1)), -cut, cut)


def _x_nodes(breaks: FloatArray, order: int) -> tuple[FloatArray, FloatArray]:
    """Nodes and weights of shape (T, panels * order); sin^2 spacing undoes the square roots at panel ends."""
    node, weight = gauss_legendre(order)
    spaced = np.sin(0.5 * np.pi * node) ** 2
    stretch = 0.5 * np.pi * np.sin(np.pi * node) * weight
    width = np.diff(breaks, axis=-1)[..., None]
    shape = (breaks.shape[0], -1)
    return (breaks[..., :-1, None] + width * spaced).reshape(shape), (width * stretch).reshape(shape)


def _y_breaks(x: FloatArray, theta_rad: FloatArray, shadowing: Shadowing, cut: float) -> FloatArray:
    """Return ends of the panels along y >= 0, shape (T, X, panels + 1)."""
    cos, sin = np.cos(theta_rad)[:, None], np.sin(theta_rad)[:, None]
    seen = cos + x * sin
    curves = [2.0 * seen / cos]
    if shadowing == "v-cavity":
        curves.insert(0, 4.0 * seen / (2.0 * cos + np.minimum(seen, 2.0 * cos)))
    tops = [np.sqrt(np.maximum(curve - 1.0 - x * x, 0.0)) for curve in curves]
    return np.asarray(np.minimum(np.stack([np.zeros_like(x), *tops], axis=-1), cut))
