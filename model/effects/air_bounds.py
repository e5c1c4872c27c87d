"""Upper bounds of the light that air scatters, from its optical depth alone and without solving anything."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.atmosphere.lighting.fidelity import Fidelity
from model.atmosphere.profile import Column, column
from model.atmosphere.sun import SolarBand
from model.scene.adjacency import BACKSCATTER
from model.scene.lit_scene import Air
from model.special_functions import expn

FloatArray = NDArray[np.float64]

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
class BandSlice:
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


@dataclass(frozen=True, kw_only=True, eq=False)
class AirBounds:
    """Upper bounds of light, all in band; infinite where nothing is known.

    Attributes
    ----------
    slices
        Parts of the band, in which the bounds add up; none where nothing is known.
    mu
        Cosine of the solar zenith angle.
    ground_albedo
        Of the ground around.
    alternative
        Of another air that it might as well be.
    """

    slices: tuple[BandSlice, ...]
    mu: float
    ground_albedo: float
    alternative: "AirBounds | None" = None

    @cached_property
    def received(self) -> float:
        """Irradiance of the ground by sun and sky [W m-2]."""
        return self._worst(lambda air: air.total(air.received_of))

    @property
    def ground_radiance(self) -> float:
        """Radiance of the ground around [W m-2 sr-1]."""
        return self._worst(lambda air: air.ground_albedo * air.total(air.received_of) / np.pi)

    @cached_property
    def sky_actinic(self) -> float:
        """Sum of the sky's radiance over all directions above a target [W m-2]."""

        def each(part: BandSlice, air: AirBounds) -> float:
            forward = part.outside * -np.expm1(-part.depth / air.mu)
            return float(forward + (1.0 - expn(2, part.depth)) * air.actinic_of(part))

        return self._worst(lambda air: _ROOM * air.total(lambda part: each(part, air)))

    @cached_property
    def depth(self) -> float:
        """Largest optical depth in the band."""
        return self._worst(lambda air: max((one.depth for one in air.slices), default=np.inf))

    def depth_below(self, height_m: float) -> float:
        """Return the largest optical depth in the band between the ground and a height [m]."""
        return self._worst(
            lambda air: max((one.depth - one.thick.depth_above(height_m) for one in air.slices), default=np.inf)
        )

    def sky(self, zenith_rad: FloatArray, scattering_rad: FloatArray) -> FloatArray:
        """Return upper bounds of the radiance of the sky by direction [W m-2 sr-1].

        Parameters
        ----------
        zenith_rad, scattering_rad
            Zenith angle of a direction, and its angle from the sun; of one shape [rad].

        Notes
        -----
        Of the beam no more is scattered than the share 1 - exp(-tau / mu) by the larger of the phase functions of
        molecules and aerosol, nor more than tau / mu of each by its own.
        """
        slant = 1.0 / np.maximum(np.cos(zenith_rad), 1e-12)

        def each(air: AirBounds) -> FloatArray:
            found = np.full(np.shape(scattering_rad), 0.0 if air.slices else np.inf)
            for part in air.slices:
                scattered = -np.expm1(-part.depth * slant)
                once = np.minimum(
                    _phase(part.asymmetries, scattering_rad) * scattered, part.scattered_once(scattering_rad) * slant
                )
                rest = air.rest_of(part, scattering_rad) * scattered
                found = found + _ROOM * (part.outside * once + rest) / (4.0 * np.pi)
            return found

        return each(self) if self.alternative is None else np.maximum(each(self), each(self.alternative))

    def sky_again(self, zenith_rad: FloatArray, scattering_rad: FloatArray) -> FloatArray:
        """Return upper bounds of the sky's radiance by light that air scattered at least twice [W m-2 sr-1].

        Light of the beam that came off the ground, and was scattered once then, is not in it.

        Parameters
        ----------
        zenith_rad, scattering_rad
            As in `sky`.
        """
        if self.alternative is not None:
            return np.full(np.shape(scattering_rad), np.inf)
        slant = 1.0 / np.maximum(np.cos(zenith_rad), 1e-12)
        found = np.full(np.shape(scattering_rad), 0.0 if self.slices else np.inf)
        for part in self.slices:
            beam = part.outside * self.mu * np.exp(-part.depth / self.mu)
            again = self.rest_of(part, scattering_rad) - 2.0 * _SPREAD_PHASE * self.ground_albedo * beam
            found = found + _ROOM * again * -np.expm1(-part.depth * slant) / (4.0 * np.pi)
        return found

    def path(self, *, height_m: float, view_zenith_rad: ArrayLike, scattering_rad: ArrayLike) -> float:
        """Return an upper bound of the radiance that air adds between the ground and a camera [W m-2 sr-1].

        Parameters
        ----------
        height_m
            Of the camera [m].
        view_zenith_rad, scattering_rad
            Zenith angles of the camera as seen from the target, and by what sunlight turns into the line of sight;
            of one shape, the largest bound counts [rad].

        Notes
        -----
        The radiance is at most the largest source times 1 - exp(-tau_below / mu_v). The source is, over 4 pi: the beam
        as it reaches the camera's height, times the larger phase function of molecules and aerosol; what was
        scattered out of the beam, times that function within 30 deg; and 2 times the actinic flux of all other light.
        """
        if height_m == 0.0:
            return 0.0
        slant, angle = 1.0 / np.cos(view_zenith_rad), np.asarray(scattering_rad, dtype=np.float64)

        def each(air: AirBounds) -> float:
            found = np.full(angle.shape, 0.0 if air.slices else np.inf)
            for part in air.slices:
                above = min(column.depth_above(height_m) for column in (part.thick, part.thin))
                below = part.depth - part.thick.depth_above(height_m)
                found = found + air.source_of(part, angle, above) * -np.expm1(-below * slant)
            return float(np.max(found))

        return self._worst(each)

    def mixed_in(self, *, height_m: float, slant: float) -> float:
        """Return the largest share of the light of wide surroundings that air scatters into a line of sight, 0 to 1.

        Parameters
        ----------
        height_m
            Of the camera [m].
        slant
            One over the cosine of its zenith angle.
        """
        if height_m == 0.0:
            return 0.0
        way = min(self.depth_below(height_m) * slant, _MOST_MIXED)
        return float(np.exp(-BACKSCATTER * way) - np.exp(-way))

    def source_of(self, part: BandSlice, scattering_rad: FloatArray, above: float) -> FloatArray:
        """Return the most that is scattered into a direction, over the depth [W m-2 sr-1]."""
        beam = part.outside * np.exp(-above / self.mu) * _phase(part.asymmetries, scattering_rad)
        return np.asarray(_ROOM * (beam + self.rest_of(part, scattering_rad)) / (4.0 * np.pi))

    def rest_of(self, part: BandSlice, scattering_rad: FloatArray) -> FloatArray:
        """Return the most that is scattered of all but the beam, over the depth and 1 / (4 pi) [W m-2]."""
        nearest = np.maximum(scattering_rad - _TURNED_RAD, 0.0)
        turned = part.outside * -np.expm1(-part.depth / self.mu) * _phase(part.asymmetries, nearest, turned=True)
        diffuse = (1.0 - expn(2, 0.5 * part.depth)) * self.actinic_of(part)
        diffuse += 2.0 * self.ground_albedo * self.received_of(part)
        return np.asarray(turned + _SPREAD_PHASE * diffuse)

    def received_of(self, part: BandSlice) -> float:
        """Return what a part of the band brings to the ground [W m-2]."""
        returned = self.ground_albedo * (1.0 - 2.0 * float(expn(3, part.depth)))
        return float(part.outside * self.mu / (1.0 - returned))

    def actinic_of(self, part: BandSlice) -> float:
        """Return the largest actinic flux of a part of the band [W m-2]."""
        return float((part.outside + 2.0 * self.ground_albedo * self.received_of(part)) / expn(2, 0.5 * part.depth))

    def total(self, each: Callable[[BandSlice], float]) -> float:
        """Return the sum over the band."""
        return sum(map(each, self.slices)) if self.slices else np.inf

    def _worst(self, of: Callable[["AirBounds"], float]) -> float:
        return of(self) if self.alternative is None else max(of(self), of(self.alternative))


UNKNOWN_AIR = AirBounds(slices=(), mu=1.0, ground_albedo=1.0)


def bound_air(air: Air) -> AirBounds:
    """Return bounds of the light at the ground.

    Parameters
    ----------
    air
        The air. For a table and for the analytic fidelity level, whose light obeys no conservation of energy, nothing
        is known.

    Notes
    -----
    With irradiance E outside the atmosphere, mu its cosine, depth tau (the largest in a part of the band), ground
    albedo A: the ground receives G <= E mu / (1 - A s), s = 1 - 2 E3(tau), since what returns to it has been scattered.
    The actinic flux anywhere is at most (E + 2 A G) / E2(tau / 2): in an isotropically scattering slab at least the
    share E2(tau / 2) of a source leaves without another scattering. Of it at most 1 - E2(tau) is scattered toward the
    ground, beside what goes on nearly forward from the beam, at most E (1 - exp(-tau / mu)).

    References
    ----------
    Definition; conservation of energy. E_n are the exponential integrals.
    """
    if air.alternative is not None:
        one = bound_air(replace(air, alternative=None, share=0.0))
        return replace(one, alternative=bound_air(air.alternative))
    if air.state is None or air.fidelity in (Fidelity.ANALYTIC, Fidelity.TABLE):
        return UNKNOWN_AIR
    return AirBounds(slices=_slices(air), mu=float(np.cos(air.sun_zenith_rad)), ground_albedo=air.ground_albedo)


def is_narrow(band: SolarBand) -> bool:
    """Return whether a band is one in which the air is all but the same.

    Parameters
    ----------
    band
        Wavelengths and irradiance.
    """
    shortest, longest = band.limits_m
    return bool(longest <= _NARROW * shortest)


def _slices(air: Air) -> tuple[BandSlice, ...]:
    if air.state is None:
        raise ValueError("air without a state has no optical depth")
    shortest, longest = air.band.limits_m
    edges = np.linspace(shortest, longest, 2 if is_narrow(air.band) else _SLICES + 1)
    columns = [column(air.state, wavelength_m=float(edge)) for edge in edges]
    place = np.clip(np.searchsorted(edges, air.band.wavelength_m, side="right") - 1, 0, edges.size - 2)
    outside = np.bincount(place, weights=air.band.shares, minlength=edges.size - 1)
    return tuple(
        BandSlice(
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
