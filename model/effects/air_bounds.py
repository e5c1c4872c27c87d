"""Upper bounds of the light that air scatters, from its optical depth alone and without solving anything."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import expn

from model.atmosphere.lighting.fidelity import Fidelity
from model.atmosphere.profile import Column, column
from model.scene.lit_scene import Air

# Of what is scattered more than once, directions are known to nobody: its phase function is taken as this, and a beam
# that was scattered once before as turned by up to that angle.
_SPREAD_PHASE = 2.0
_TURNED_RAD = np.radians(30.0)
# Room for interpolation over wavelengths and for the phase functions of spheres, which are no Henyey-Greenstein ones.
_ROOM = 1.5


@dataclass(frozen=True, kw_only=True)
class AirBounds:
    """Upper bounds of light, all in band.

    Attributes
    ----------
    sky_actinic
        Sum of the sky's radiance over all directions above a target [W m-2].
    ground_radiance
        Of the ground around [W m-2 sr-1].
    received
        Irradiance of the ground by sun and sky [W m-2].
    """

    sky_actinic: float
    ground_radiance: float
    received: float


UNKNOWN_AIR = AirBounds(sky_actinic=np.inf, ground_radiance=np.inf, received=np.inf)


def bound_air(air: Air) -> AirBounds:
    """Return bounds of the light at the ground.

    Parameters
    ----------
    air
        The air. For a table and for the analytic fidelity level, whose light obeys no conservation of energy, nothing
        is known.

    Notes
    -----
    With irradiance E outside the atmosphere, mu its cosine, depth tau (the largest in the band), ground albedo A:
    the ground receives G <= E mu / (1 - A s), s = 1 - 2 E3(tau), since what returns to it has been scattered. The
    actinic flux anywhere is at most (E + 2 A G) / E2(tau / 2): in an isotropically scattering slab at least the share
    E2(tau / 2) of a source leaves without another scattering. Of it at most 1 - E2(tau) is scattered toward the
    ground, beside what goes on nearly forward from the beam, at most E (1 - exp(-tau / mu)).

    References
    ----------
    Definition; conservation of energy. E_n are the exponential integrals.
    """
    if air.alternative is not None:
        one, other = bound_air(replace(air, alternative=None, share=0.0)), bound_air(air.alternative)
        return AirBounds(
            sky_actinic=max(one.sky_actinic, other.sky_actinic),
            ground_radiance=max(one.ground_radiance, other.ground_radiance),
            received=max(one.received, other.received),
        )
    if air.state is None or air.fidelity in (Fidelity.ANALYTIC, Fidelity.TABLE):
        return UNKNOWN_AIR
    outside, mu, tau = _outside(air), float(np.cos(air.sun_zenith_rad)), _deepest(air).depth
    received = _received(air, outside, tau)
    forward = outside * -np.expm1(-tau / mu)
    return AirBounds(
        sky_actinic=_ROOM * (forward + (1.0 - expn(2, tau)) * _actinic(air, outside, tau)),
        ground_radiance=air.ground_albedo * received / np.pi,
        received=received,
    )


def path_bound(air: Air, *, height_m: float, view_zenith_rad: float, scattering_rad: float) -> float:
    """Return an upper bound of the radiance that air adds between the ground and a camera [W m-2 sr-1, in band].

    Parameters
    ----------
    height_m
        Of the camera [m].
    view_zenith_rad
        Zenith angle of the camera as seen from the target [rad].
    scattering_rad
        Angle by which sunlight turns into the line of sight [rad].

    Notes
    -----
    The radiance is at most the largest source times 1 - exp(-tau_below / mu_v). The source is E P / 4 pi of the beam,
    P the larger phase function of molecules and aerosol within 30 deg of the scattering angle, and
    2 / 4 pi times the actinic flux of all other light, as in `bound_air`.

    References
    ----------
    As `bound_air`.
    """
    if height_m == 0.0:
        return 0.0
    if air.alternative is not None:
        where = {"height_m": height_m, "view_zenith_rad": view_zenith_rad, "scattering_rad": scattering_rad}
        return max(path_bound(one, **where) for one in (replace(air, alternative=None, share=0.0), air.alternative))
    if air.state is None or air.fidelity in (Fidelity.ANALYTIC, Fidelity.TABLE):
        return np.inf
    deepest, outside = _deepest(air), _outside(air)
    tau = deepest.depth
    below = tau - float(deepest.tau_above(height_m))
    diffuse = (1.0 - expn(2, 0.5 * tau)) * _actinic(air, outside, tau)
    diffuse += 2.0 * air.ground_albedo * _received(air, outside, tau)
    g = max(deepest.lower.g, deepest.upper.g)
    source = outside * _phase(g, scattering_rad) + _SPREAD_PHASE * diffuse
    share = -np.expm1(-below / np.cos(view_zenith_rad))
    return float(_ROOM * source / (4.0 * np.pi) * share)


def depth_below(air: Air, *, height_m: float) -> float:
    """Return the largest optical depth in the band between the ground and a height; infinite where it is not known."""
    if air.state is None:
        return np.inf
    deepest = _deepest(air)
    return deepest.depth - float(deepest.tau_above(height_m))


def depth(air: Air) -> float:
    """Return the largest optical depth in the band; infinite where it is not known."""
    return np.inf if air.state is None else _deepest(air).depth


def _deepest(air: Air) -> Column:
    """Return the air at the end of the band where it is thickest."""
    if air.state is None:
        raise ValueError("air without a state has no optical depth")
    return max((column(air.state, wavelength_m=one) for one in air.band.limits_m), key=lambda found: found.depth)


def _outside(air: Air) -> float:
    return float(air.band.integral(np.ones_like(air.band.wavelength_m)))


def _received(air: Air, outside: float, tau: float) -> float:
    returned = air.ground_albedo * (1.0 - 2.0 * float(expn(3, tau)))
    return float(outside * np.cos(air.sun_zenith_rad) / (1.0 - returned))


def _actinic(air: Air, outside: float, tau: float) -> float:
    return float((outside + 2.0 * air.ground_albedo * _received(air, outside, tau)) / expn(2, 0.5 * tau))


def _phase(g: float, scattering_rad: float) -> float:
    """Largest phase function within 30 deg of an angle: of molecules 1.5, of aerosol that of Henyey and Greenstein."""
    nearest = max(scattering_rad - _TURNED_RAD, 0.0)
    aerosol = (1.0 - g**2) / (1.0 + g**2 - 2.0 * g * np.cos(nearest)) ** 1.5
    return float(max(1.5, aerosol))
