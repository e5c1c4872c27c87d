"""Error by the number of wavelengths: the rule tried on functions that are known at all wavelengths."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from model.accuracy.evaluation.settings import Settings
from model.atmosphere.aerosol_spectrum import AerosolSpectrum, aerosol_spectra
from model.atmosphere.molecules import rayleigh_optical_depth
from model.atmosphere.ozone import ozone_optical_depth
from model.atmosphere.profile import AtmosphereState, kinks_m
from model.atmosphere.spectral_rule import SpectralRule, spectral_rule
from model.scene.lit_scene import Air

FloatArray = NDArray[np.float64]

# Of the angles by which aerosol scatters: backward, aside, and toward the aureole.
_COSINES = (-0.5, 0.3, 0.9)
# Slant depths, in vertical ones, of the functions that stand for scattered light.
_SLANTS = (0.5, 1.0, 3.0)
# Beside the skies and paths of 160 random scenes, by one or two wavelengths, where over 1e-5 was missing: S0 is off
# by a quarter of the estimate in the middle, by 0.75 of it at most. Aerosol of many kinks, as soot, needs the rest.
_BEYOND = 1.4
# The same of S1 and S2 beside that, over what the functions are off among themselves: off by a sixth to a half of it in
# the middle, by more in one of ten; by more than both estimates together in less than one of a hundred.
_UNLIKE = 0.6
# Of which the sums over the spectrum are certain.
_ROUNDING = 1e-11


@dataclass(frozen=True, kw_only=True, eq=False)
class SpectralError:
    """Relative errors of a band's light, by the wavelengths that stand for it.

    Attributes
    ----------
    scattered
        Of light that the air scatters: of S0, S1 and S2 alike.
    by_component
        Of S1 and S2 beside that.
    rule
        The wavelengths.
    """

    scattered: float
    by_component: float
    rule: SpectralRule
    _all: "_Spectrum"
    _few: "_Spectrum"

    @property
    def mean_depth(self) -> float:
        """Optical depth of the column in the mean over the band."""
        return float(self._all.irradiance @ self._all.depth / np.sum(self._all.irradiance))

    def transmittance(self, *, slant: float) -> float:
        """Return the relative error of the beam's mean transmittance, with its sign.

        Parameters
        ----------
        slant
            Depth of the path over that of the whole column, 0 or more.
        """
        few, all_of_it = self._few.transmittance(slant), self._all.transmittance(slant)
        return few / all_of_it - 1.0


def spectral_error(air: Air, settings: Settings) -> SpectralError:
    """Return what the wavelengths of some settings leave out, before anything is solved.

    Parameters
    ----------
    air, settings
        As in `spectral_errors`.

    Raises
    ------
    ValueError
        The air is a table.
    """
    return spectral_errors(air, (settings,))[0]


def spectral_errors(air: Air, several: Sequence[Settings]) -> tuple[SpectralError, ...]:
    """Return what `spectral_error` does for each of several settings.

    Parameters
    ----------
    air
        Atmosphere and band; no table.
    several
        Their wavelengths count.

    Raises
    ------
    ValueError
        The air is a table.

    Notes
    -----
    The functions are light scattered once, on a slant depth m tau, by molecules or by aerosol at one of three angles,
    without and with a share that is scattered twice; each without and with the loss of the beam on its whole way. The
    largest error of them is taken.
    """
    state = air.state
    if state is None:
        raise ValueError("spectral_error: a table has no wavelengths")
    mu0 = float(np.cos(air.sun_zenith_rad))
    ozone = np.exp(-ozone_optical_depth(wavelength_m=air.band.wavelength_m, ozone_m=state.ozone_m) / mu0)
    lit = air.band.shares > 0.0
    everything = SpectralRule(wavelength_m=air.band.wavelength_m[lit], irradiance=(air.band.shares * ozone)[lit])
    ends_m = float(everything.wavelength_m[0]), float(everything.wavelength_m[-1])
    spectrum_of = partial(_spectrum, state, aerosol_spectra(state, shortest_m=ends_m[0], longest_m=ends_m[1]), mu0=mu0)
    whole = spectrum_of(everything)
    present = [k for k, part in enumerate(whole.parts) if np.any(part > _ROUNDING)]
    true = {k: whole.sums(whole.parts[k]) for k in present}
    kinks = kinks_m(state, aerosol=air.aerosol) if any(one.split_at_kinks for one in several) else ()
    rules = [
        spectral_rule(
            wavelength_m=everything.wavelength_m,
            irradiance=everything.irradiance,
            count=one.wavelengths,
            kinks_m=kinks if one.split_at_kinks else (),
        )
        for one in several
    ]
    return tuple(_error_of(rule, spectrum_of(rule), whole, true) for rule in rules)


def _error_of(
    rule: SpectralRule, few: "_Spectrum", whole: "_Spectrum", true: Mapping[int, FloatArray]
) -> SpectralError:
    """Error of a rule by the sums of the parts that are there, beside what they are over all wavelengths."""
    errors = np.stack([few.sums(few.parts[k]) / every - 1.0 for k, every in true.items()])
    # Polarized light is of the molecules, or of both alike.
    unlike = max(float(np.max(np.ptp(errors, axis=0))), float(np.max(np.ptp(errors, axis=1))))
    return SpectralError(
        scattered=_BEYOND * float(np.max(np.abs(errors))) + _ROUNDING,
        by_component=_UNLIKE * unlike,
        rule=rule,
        _all=whole,
        _few=few,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Spectrum:
    """Wavelengths with their irradiance, the optical depth there, and the share of it that each part of the air has."""

    irradiance: FloatArray
    depth: FloatArray
    parts: tuple[FloatArray, ...]
    mu0: float

    def sums(self, part: FloatArray) -> FloatArray:
        """Light that stands for what a part scatters, one number for each function."""
        once = np.stack([-np.expm1(-slant * self.depth) for slant in _SLANTS])
        functions = np.concatenate([once, once * (2.0 - np.exp(-self.depth))]) * part
        beam = np.exp(-self.depth / self.mu0)
        return np.asarray(np.concatenate([functions, functions * beam]) @ self.irradiance)

    def transmittance(self, slant: float) -> float:
        """Mean transmittance of a slant depth over the spectrum of the beam at the ground."""
        beam = self.irradiance * np.exp(-self.depth / self.mu0)
        return float(np.sum(beam * np.exp(-slant * self.depth)) / np.sum(beam))


def _spectrum(
    state: AtmosphereState, aerosols: tuple[AerosolSpectrum, AerosolSpectrum], rule: SpectralRule, mu0: float
) -> _Spectrum:
    wavelength_m = rule.wavelength_m
    molecules = rayleigh_optical_depth(wavelength_m=wavelength_m, surface_pressure_pa=state.surface_pressure_pa)
    depths = [aerosol.depth(wavelength_m) for aerosol in aerosols]
    depth = molecules + sum(depths)
    scattered = [own * aerosol.ssa(wavelength_m) for own, aerosol in zip(depths, aerosols, strict=True)]
    toward = [
        sum(
            own * _henyey_greenstein(aerosol.asymmetry(wavelength_m), cosine)
            for own, aerosol in zip(scattered, aerosols, strict=True)
        )
        for cosine in _COSINES
    ]
    parts = tuple(part / depth for part in (molecules, *toward))
    return _Spectrum(irradiance=rule.irradiance, depth=depth, parts=parts, mu0=mu0)


def _henyey_greenstein(asymmetry: FloatArray, cosine: float) -> FloatArray:
    """Scattering function of an asymmetry at one angle, of mean 1."""
    return np.asarray((1.0 - asymmetry**2) / (1.0 + asymmetry**2 - 2.0 * asymmetry * cosine) ** 1.5)
