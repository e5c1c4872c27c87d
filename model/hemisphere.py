"""Skylight reflected to the camera: the integral of pBRDF times sky over the hemisphere, with its error."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from model.panel_light import PanelLight, Skylight

FloatArray = NDArray[np.float64]

TOLERANCE = 1e-4
# What the far tail of a lobe sees of the ground below the horizon, share of S0: too little for a rule to notice.
_TAIL = 3e-5
# Each rule is set beside the one before it.
_ORDERS = (6, 9, 14, 21, 32, 48, 72)


@dataclass(frozen=True, kw_only=True)
class Rules:
    """Orders of the quadrature for lobe and diffuse term, as `model.panel_light.PanelLight` takes them."""

    lobe: int
    diffuse: int


@dataclass(frozen=True, kw_only=True, eq=False)
class ReflectedSkylight:
    """Skylight that a panel sends to the camera.

    Attributes
    ----------
    stokes
        S0, S1, S2 in the horizontal frame of the camera, before the path to it [W m-2 sr-1].
    error
        Estimated error of each of them [W m-2 sr-1]: of the quadrature, and of the sky.
    rules
        Which rules suffice: the finer ones differ by less than the tolerance, if any do.
    """

    stokes: FloatArray
    error: float
    rules: Rules


def reflected_skylight(panel: PanelLight, light: Skylight, *, tolerance: float = TOLERANCE) -> ReflectedSkylight:
    """Return the skylight that a panel reflects to the camera, and its estimated error.

    Parameters
    ----------
    panel
        The panel before its camera.
    light
        The sky.
    tolerance
        Rules are refined until two differ by this share of S0, above 0.

    Raises
    ------
    ValueError
        The tolerance is outside its range.

    Notes
    -----
    The error comes from the difference of the last two rules, and from the sky's own. If the last rule does not reach
    the tolerance the error says so: that happens where a tilted glossy panel mirrors the horizon.

    References
    ----------
    [MK14] eq. (3). Differs from [MK14]: F is taken at the direction of the sky, (theta_d, theta_r, phi_d - phi_r).
    """
    if not tolerance > 0.0:
        raise ValueError(f"reflected_skylight: tolerance = {tolerance!r}, but it must be above 0")
    lobe = _refined(lambda order: panel.lobe(light, order), tolerance)
    diffuse = _refined(lambda order: panel.diffuse(light, order), tolerance)
    stokes = lobe.value + diffuse.value
    tail = 0.0 if panel.is_level else _TAIL
    return ReflectedSkylight(
        stokes=stokes,
        error=lobe.error + diffuse.error + (light.relative_error + tail) * float(stokes[0]),
        rules=Rules(lobe=lobe.order, diffuse=diffuse.order),
    )


def reflected_by_rules(panel: PanelLight, light: Skylight, rules: Rules) -> FloatArray:
    """Return the skylight that a panel reflects to the camera, by given rules: no refinement, no error.

    Parameters
    ----------
    panel, light
        As in `reflected_skylight`.
    rules
        As a `ReflectedSkylight` of a similar view names them.

    Returns
    -------
    ndarray, shape (3,)
        S0, S1, S2 [W m-2 sr-1].

    References
    ----------
    [MK14] eq. (3).
    """
    return np.asarray(panel.lobe(light, rules.lobe) + panel.diffuse(light, rules.diffuse))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Refined:
    value: FloatArray
    error: float
    order: int


def _refined(rule: Callable[[int], FloatArray], tolerance: float) -> _Refined:
    """Rules of growing order until the estimated error of the last one is below the tolerance."""
    value, steps, order = rule(_ORDERS[0]), [np.inf], _ORDERS[0]
    for before, order in pairwise(_ORDERS):
        coarser, value = value, rule(order)
        steps.append(float(np.max(np.abs(value - coarser))))
        if _error(steps) <= tolerance * value[0]:
            return _Refined(value=value, error=_error(steps), order=before)
    return _Refined(value=value, error=_error(steps), order=order)


def _error(steps: list[float]) -> float:
    """Error of the last of a row of rules, from the steps between them.

    Where the last two steps are each a quarter of the one before or less, the last bounds what is still missing. Else
    steps are of the size of the error, and one may be small by chance, as at an edge of the sky within the lobe.
    """
    before, last = steps[-2:]
    regular = len(steps) > 2 and last <= 0.25 * before and before <= 0.25 * steps[-3]
    if regular or last == 0.0:
        return last
    return 3.0 * max(last, 0.5 * before) if np.isfinite(before) else np.inf
