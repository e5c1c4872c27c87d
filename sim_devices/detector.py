"""The truth about a simulated lens and detector, as plain records."""

from dataclasses import dataclass
from math import inf, pi

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_PLANCK_J_S = 6.62607015e-34
_LIGHT_SPEED_M_PER_S = 299792458.0


@dataclass(frozen=True, kw_only=True)
class Lens:
    """A lens focused far away. The defaults are a 35 mm lens at f/2; the transmittance is assumed.

    Parameters
    ----------
    focal_length_m, aperture_diameter_m
        Both > 0.
    transmittance
        Share of the light that passes the lens, polarizer not included, in (0, 1].

    Raises
    ------
    ValueError
        If a value is outside of its range.
    """

    focal_length_m: float = 0.035
    aperture_diameter_m: float = 0.0175
    transmittance: float = 0.9

    def __post_init__(self) -> None:
        _require("focal_length_m", self.focal_length_m, above=0.0)
        _require("aperture_diameter_m", self.aperture_diameter_m, above=0.0)
        _require("transmittance", self.transmittance, above=0.0, most=1.0)


@dataclass(frozen=True, kw_only=True)
class Detector:
    """A detector with the geometry of a Prosilica GC780 (782 x 582 pixels of 8.3 um, 12 bit).

    Every other default, each noise number above all, is assumed: no photon-transfer data of this camera
    were found. They are of the size that measured CCDs of its class and age show.

    Parameters
    ----------
    width, height
        Pixels, each >= 1.
    pixel_pitch_m
        Square pixels, sensitive all over, > 0.
    effective_wavelength_m
        The one wavelength at which photons are counted, > 0.
    quantum_efficiency
        Electrons a photon, in (0, 1].
    gain_dn_per_e
        At a camera setting of 0 dB, > 0.
    read_noise_e
        Standard deviation of the noise of reading a pixel, >= 0.
    dark_current_e_per_s
        Mean, >= 0; the same in all pixels.
    black_level_dn
        What the camera adds to every sample, whatever its gain, >= 0.
    prnu
        Relative standard deviation of the response from pixel to pixel, in [0, 0.1].
    dsnu_e
        Standard deviation of a fixed offset from pixel to pixel, >= 0. It is no charge: it brings no shot
        noise and does not grow with exposure.
    full_well_e
        Most electrons (light and dark) that a pixel holds, > 0.
    bit_depth
        1 to 16.

    Raises
    ------
    ValueError
        If a value is outside of its range.
    """

    width: int = 782
    height: int = 582
    pixel_pitch_m: float = 8.3e-6
    effective_wavelength_m: float = 550e-9
    quantum_efficiency: float = 0.45
    gain_dn_per_e: float = 0.24
    read_noise_e: float = 10.0
    dark_current_e_per_s: float = 20.0
    black_level_dn: float = 64.0
    prnu: float = 0.005
    dsnu_e: float = 1.0
    full_well_e: float = 20_000.0
    bit_depth: int = 12

    def __post_init__(self) -> None:
        _require("width", self.width, least=1)
        _require("height", self.height, least=1)
        _require("pixel_pitch_m", self.pixel_pitch_m, above=0.0)
        _require("effective_wavelength_m", self.effective_wavelength_m, above=0.0)
        _require("quantum_efficiency", self.quantum_efficiency, above=0.0, most=1.0)
        _require("gain_dn_per_e", self.gain_dn_per_e, above=0.0)
        _require("read_noise_e", self.read_noise_e, least=0.0)
        _require("dark_current_e_per_s", self.dark_current_e_per_s, least=0.0)
        _require("black_level_dn", self.black_level_dn, least=0.0)
        _require("prnu", self.prnu, least=0.0, most=0.1)
        _require("dsnu_e", self.dsnu_e, least=0.0)
        _require("full_well_e", self.full_well_e, above=0.0)
        _require("bit_depth", self.bit_depth, least=1, most=16)


@dataclass(frozen=True, kw_only=True, eq=False)
class FixedPattern:
    """Differences of the pixels of one camera, the same in every frame; None where they do not.

    Attributes
    ----------
    response : (H, W) array or None
        Factor of the light, with expectation 1.
    offset_e : (H, W) array or None
        Added when a pixel is read, with expectation 0 [e-].
    """

    response: FloatArray | None
    offset_e: FloatArray | None


def draw_fixed_pattern(detector: Detector, *, generator: np.random.Generator) -> FixedPattern:
    """Return a fixed pattern with normal deviations of the detector's `prnu` and `dsnu_e`.

    Notes
    -----
    It is the expectation of response and offset, not their mean over the drawn map, that is 1 and 0.
    The offset is the same whether there is PRNU or not.
    """
    response_draws, offset_draws = generator.spawn(2)
    shape = (detector.height, detector.width)
    response = 1.0 + detector.prnu * response_draws.standard_normal(shape) if detector.prnu > 0.0 else None
    offset_e = detector.dsnu_e * offset_draws.standard_normal(shape) if detector.dsnu_e > 0.0 else None
    return FixedPattern(response=response, offset_e=offset_e)


def electrons_per_radiance_s(lens: Lens, detector: Detector) -> float:
    """Return the photo-electrons that a radiance of 1 W m^-2 sr^-1 behind the polarizer makes in a second.

    Notes
    -----
    On axis everywhere: no natural vignetting. Seen from a pixel the pupil is a disk of half angle theta' with
    tan(theta') = (diameter / 2) / focal length, which sends light from a projected solid angle of
    pi sin^2(theta').
    """
    tangent_squared = (lens.aperture_diameter_m / 2.0 / lens.focal_length_m) ** 2
    projected_solid_angle_sr = pi * tangent_squared / (1.0 + tangent_squared)
    power_w = projected_solid_angle_sr * detector.pixel_pitch_m**2 * lens.transmittance
    photon_energy_j = _PLANCK_J_S * _LIGHT_SPEED_M_PER_S / detector.effective_wavelength_m
    return detector.quantum_efficiency * power_w / photon_energy_j


def _require(name: str, value: float, *, above: float = -inf, least: float = -inf, most: float = inf) -> None:
    """Raise ValueError unless `value` is finite, above `above`, and between `least` and `most`."""
    if above < value < inf and least <= value <= most:
        return
    low = f"above {above:g}" if above > -inf else f"at least {least:g}"
    high = f" and at most {most:g}" if most < inf else " and finite"
    raise ValueError(f"{name} is {value}; it has to be {low}{high}")
