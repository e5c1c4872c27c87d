"""From radiance at a simulated lens to counts: the detector, and a list of effects on a frame.

Effects of lamp, polarizer and lens act on expected photo-electrons, those of the detector on counts; each is called
only if it is stated. The first makes a new picture, so the radiance stays unchanged.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache, reduce
from math import inf, pi
from typing import Literal

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_PLANCK_J_S = 6.62607015e-34
_LIGHT_SPEED_M_PER_S = 299792458.0


class Stream(IntEnum):
    """Uses of a seed: the first number of a spawn key, so that uses do not share random numbers."""

    PATTERN = 0
    NOISE = 1
    DRIFT = 2
    COSMIC_HITS = 3
    COLUMN_OFFSET = 4
    MICRO_POLARIZERS = 5


def generator(seed: int, stream: Stream, *key: int) -> np.random.Generator:
    """Return the generator of a stream, or of a frame if `key` is its sequence number.

    Notes
    -----
    A spawn key keeps streams apart; plain entropy does not: (5,) and (5, 0) give the same numbers.
    """
    return np.random.Generator(np.random.SFC64(np.random.SeedSequence(seed, spawn_key=(int(stream), *key))))


@dataclass(frozen=True, kw_only=True)
class Lens:
    """A lens focused far away. The defaults are a 35 mm lens at f/2; the transmittance is assumed.

    Parameters
    ----------
    focal_length_m, aperture_diameter_m
        Both > 0.
    transmittance
        Transmitted share of the light without polarizer, in (0, 1].

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

    All other defaults are assumed, of the size of measured CCDs of its class and age: no photon-transfer data of this
    camera were found.

    Parameters
    ----------
    width, height
        Pixels, each >= 1.
    pixel_pitch_m
        Square pixels with full fill factor, > 0.
    effective_wavelength_m
        The one wavelength at which photons are counted, > 0.
    quantum_efficiency
        Electrons per photon, in (0, 1].
    gain_dn_per_e
        At a camera setting of 0 dB, > 0.
    read_noise_e
        Standard deviation of the noise of reading a pixel, >= 0.
    dark_current_e_per_s
        Mean, >= 0; the same in all pixels.
    black_level_dn
        Added to every sample at any gain, >= 0.
    prnu
        Relative standard deviation of the response from pixel to pixel, in [0, 0.1].
    dsnu_e
        Standard deviation of a fixed offset from pixel to pixel, >= 0. Independent of exposure and without shot noise.
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
    """Fixed differences between the pixels of one camera; None if they are equal."""

    response: FloatArray | None  #: Factor of the light, with expectation 1.
    offset_e: FloatArray | None  #: Added when a pixel is read, with expectation 0 [e-].


def draw_fixed_pattern(detector: Detector, *, generator: np.random.Generator) -> FixedPattern:
    """Return a fixed pattern with normal deviations of the detector's `prnu` and `dsnu_e`.

    Response and offset have the expectations 1 and 0, not these means over the drawn map. The offset is the same
    whether there is PRNU or not.
    """
    response_draws, offset_draws = generator.spawn(2)
    shape = (detector.height, detector.width)
    response = 1.0 + detector.prnu * response_draws.standard_normal(shape) if detector.prnu > 0.0 else None
    offset_e = detector.dsnu_e * offset_draws.standard_normal(shape) if detector.dsnu_e > 0.0 else None
    return FixedPattern(response=response, offset_e=offset_e)


def electrons_per_radiance_s(lens: Lens, detector: Detector) -> float:
    """Return photo-electrons per second for a radiance of 1 W m^-2 sr^-1 behind the polarizer.

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
    raise ValueError(f"{name} is {value}; it must be {low}{high}")


# Place of an effect in the chain: on expected photo-electrons before the pixels' response, on the expected charge, on
# the drawn electrons, on the offset at read-out.
Place = Literal["light", "expected charge", "charge", "read-out"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Shot:
    """Properties of a frame for its effects.

    Attributes
    ----------
    noise
        Shot noise and read noise draw from it, in this order.
    noise_seed, sequence
        Determine the random numbers of the other effects, with the stream.
    exposure_s
        Integration time.
    axis_deg
        Direction of the polarizer's axis over whole turns, counter-clockwise from horizontal.
    """

    noise: np.random.Generator
    noise_seed: int
    sequence: int
    exposure_s: float
    axis_deg: float

    def draws(self, stream: Stream) -> np.random.Generator:
        """Return the random numbers of one effect for this frame."""
        return generator(self.noise_seed, stream, self.sequence)


# Takes the picture so far, shape (H, W) [e-], and returns the next one; it may change its argument in place.
Act = Callable[[FloatArray, Shot], FloatArray]


@dataclass(frozen=True, kw_only=True, eq=False)
class RenderingEffect:
    """An effect that a rig file names.

    Attributes
    ----------
    name
        Name in the rig file.
    place
        Place in the chain; effects of one place act in the order of the list.
    act
        The effect.
    """

    name: str
    place: Place
    act: Act


def refuse_outside(name: str, value: float, *, least: float, most: float = np.inf) -> None:
    """Raise ValueError unless `value` is finite and within least .. most."""
    if not (least <= value <= most and np.isfinite(value)):
        high = f" to {most:g}" if most < np.inf else " and above"
        raise ValueError(f"{name} is {value}; allowed is {least:g}{high}")


def drift(*, rate_per_frame: float, flicker_std: float) -> RenderingEffect:
    """Return an illumination that changes from frame to frame.

    Parameters
    ----------
    rate_per_frame
        Relative change from one sequence number to the next, compounded; 1 at sequence 0.
    flicker_std
        Additional relative deviation from frame to frame, normal in the logarithm, >= 0.
    """
    refuse_outside("drift.rate_per_frame", rate_per_frame, least=-1.0, most=1.0)
    refuse_outside("drift.flicker_std", flicker_std, least=0.0, most=1.0)

    def act(picture: FloatArray, shot: Shot) -> FloatArray:
        exponent = rate_per_frame * shot.sequence
        if flicker_std > 0.0:
            exponent += flicker_std * shot.draws(Stream.DRIFT).standard_normal()
        picture *= np.exp(exponent)
        return picture

    return RenderingEffect(name="drift", place="light", act=act)


def beam_wander(*, radius_px: float, phase_deg: float) -> RenderingEffect:
    """Return a shift on a circle as the polarizer turns, as behind a wedge.

    Parameters
    ----------
    radius_px
        Of the circle, >= 0.
    phase_deg
        Direction of the shift less that of the polarizer's axis, counter-clockwise from right.

    Notes
    -----
    Linear interpolation keeps light positive but blurs by up to half a pixel. The rim is repeated beyond the picture.
    """
    from scipy import ndimage

    refuse_outside("beam-wander.radius_px", radius_px, least=0.0)

    def act(picture: FloatArray, shot: Shot) -> FloatArray:
        direction_rad = np.deg2rad(shot.axis_deg + phase_deg)
        down, right = -radius_px * np.sin(direction_rad), radius_px * np.cos(direction_rad)
        return np.asarray(ndimage.shift(picture, (down, right), order=1, mode="nearest"))

    return RenderingEffect(name="beam-wander", place="light", act=act)


def point_spread(*, sigma_px: float) -> RenderingEffect:
    """Return a Gaussian blur of this deviation, > 0, truncated at four; the rim is repeated beyond the picture."""
    from scipy import ndimage

    refuse_outside("point-spread.sigma_px", sigma_px, least=0.0)

    def act(picture: FloatArray, _: Shot) -> FloatArray:
        return np.asarray(ndimage.gaussian_filter(picture, sigma_px, mode="nearest"))

    return RenderingEffect(name="point-spread", place="light", act=act)


def defocus(lens: Lens, detector: Detector, *, defocus_m: Callable[[], float]) -> RenderingEffect:
    """Return the blur of a detector out of focus: every point becomes an even disk.

    Parameters
    ----------
    lens
        The cone of light behind its aperture has its tip one focal length away.
    detector
        Cuts that cone.
    defocus_m
        Distance of the detector from the tip at each frame, to either side [m].

    Notes
    -----
    Geometrical optics without diffraction, which is below a pixel for a wide aperture. Linear interpolation leaves a
    picture in focus unchanged. The rim is repeated beyond the picture.
    """
    cone = lens.aperture_diameter_m / lens.focal_length_m

    def act(picture: FloatArray, _: Shot) -> FloatArray:
        radius_px = cone * abs(defocus_m()) / 2.0 / detector.pixel_pitch_m
        return picture if radius_px == 0.0 else _spread(picture, radius_px)

    return RenderingEffect(name="defocus", place="light", act=act)


def _spread(picture: FloatArray, radius_px: float) -> FloatArray:
    import cv2

    spread = cv2.filter2D(picture, cv2.CV_64F, _disk(radius_px), borderType=cv2.BORDER_REPLICATE)
    # Rounding of the Fourier transforms may be negative, which the Poisson draw does not allow.
    return np.maximum(spread, 0.0)


_FINEST, _COARSEST = 512, 32


@lru_cache(maxsize=4)
def _disk(radius_px: float) -> FloatArray:
    """Shares of an even disk's light in the pixels around its middle; they add up to 1."""
    across = int(np.clip(np.ceil(16.0 * radius_px), _COARSEST, _FINEST))
    steps = ((np.arange(across) + 0.5) / across * 2.0 - 1.0) * radius_px
    inside = steps[:, None] ** 2 + steps**2 <= radius_px**2
    half = int(np.ceil(radius_px)) + 1
    right = np.broadcast_to(steps, inside.shape)[inside] + half
    down = np.broadcast_to(steps[:, None], inside.shape)[inside] + half
    left, top = np.floor(right).astype(int), np.floor(down).astype(int)
    shares = np.zeros((2 * half + 1, 2 * half + 1))
    for row, share_row in ((top, 1.0 - (down - top)), (top + 1, down - top)):
        np.add.at(shares, (row, left), share_row * (1.0 - (right - left)))
        np.add.at(shares, (row, left + 1), share_row * (right - left))
    return np.asarray(shares / shares.sum())


def vignetting(lens: Lens, detector: Detector) -> RenderingEffect:
    """Return the fall of light toward the corners of an ideal lens: the fourth power of the cosine of the field angle.

    Notes
    -----
    The axis meets the middle of the picture. Vignetting by mounts and lens barrels is not included.
    """
    share = _cosine_squared(lens, detector) ** 2

    def act(picture: FloatArray, _: Shot) -> FloatArray:
        picture *= share
        return picture

    return RenderingEffect(name="vignetting", place="light", act=act)


def _cosine_squared(lens: Lens, detector: Detector) -> FloatArray:
    """Squared cosine of each pixel's field angle, shape (H, W)."""
    right, down = (
        (np.arange(count) - (count - 1) / 2.0) * detector.pixel_pitch_m / lens.focal_length_m
        for count in (detector.width, detector.height)
    )
    return np.asarray(1.0 / (1.0 + right[np.newaxis, :] ** 2 + down[:, np.newaxis] ** 2))


def fixed_pattern(*, column_offset_e: float, width: int, pattern_seed: int) -> RenderingEffect:
    """Return a fixed offset of each column, in addition to PRNU and DSNU of the pixels.

    Parameters
    ----------
    column_offset_e
        Standard deviation over columns [e-], >= 0.
    width
        Columns.
    pattern_seed
        Determines the pattern of the camera.
    """
    refuse_outside("fixed-pattern.column_offset_e", column_offset_e, least=0.0)
    offset_e = column_offset_e * generator(pattern_seed, Stream.COLUMN_OFFSET).standard_normal(width)

    def act(picture: FloatArray, _: Shot) -> FloatArray:
        picture += offset_e
        return picture

    return RenderingEffect(name="fixed-pattern", place="read-out", act=act)


def smear(*, row_transfer_us: float) -> RenderingEffect:
    """Return the smear of a shutterless CCD: light collected while charge moves past every row.

    Parameters
    ----------
    row_transfer_us
        Time of a charge at each row [us], >= 0.
    """
    refuse_outside("smear.row_transfer_us", row_transfer_us, least=0.0)

    def act(picture: FloatArray, shot: Shot) -> FloatArray:
        picture += picture.sum(axis=0) * (row_transfer_us * 1e-6 / shot.exposure_s)
        return picture

    return RenderingEffect(name="smear", place="expected charge", act=act)


def cosmic_hits(*, rate_per_s: float, mean_e: float) -> RenderingEffect:
    """Return charge of cosmic particles in single pixels.

    Parameters
    ----------
    rate_per_s
        Hits per second on the whole detector, >= 0.
    mean_e
        Mean of the charge of one, exponentially distributed [e-], >= 0.
    """
    refuse_outside("cosmic-hits.rate_per_s", rate_per_s, least=0.0)
    refuse_outside("cosmic-hits.mean_e", mean_e, least=0.0)

    def act(picture: FloatArray, shot: Shot) -> FloatArray:
        draws = shot.draws(Stream.COSMIC_HITS)
        count = int(draws.poisson(rate_per_s * shot.exposure_s))
        hit = draws.integers(picture.size, size=count)
        # Adds up several hits of one pixel, unlike indexing with +=.
        np.add.at(picture.reshape(-1), hit, np.rint(draws.exponential(mean_e, size=count)))
        return picture

    return RenderingEffect(name="cosmic-hits", place="charge", act=act)


def exposure_effects(
    *,
    lens: Lens,
    detector: Detector,
    pattern: FixedPattern,
    exposure_s: float,
    gain_db: float,
    rendering: Sequence[RenderingEffect] = (),
) -> tuple[Act, ...]:
    """Return the steps from light to counts, in order.

    In order: expected photo-electrons, [light], response of each pixel, [expected charge], dark electrons, Poisson
    draw of both, [charge], full well, offset of each pixel, [read-out], read noise, gain and black level. `counts_of`
    rounds and saturates.
    """
    effects = [_scaled(electrons_per_radiance_s(lens, detector) * exposure_s), *_placed(rendering, "light")]
    if pattern.response is not None:
        effects.append(_multiplied(pattern.response))
    effects += _placed(rendering, "expected charge")
    if detector.dark_current_e_per_s > 0.0:
        effects.append(_added(detector.dark_current_e_per_s * exposure_s))
    effects += [_shot_noise, *_placed(rendering, "charge"), _full_well(detector.full_well_e)]
    if pattern.offset_e is not None:
        effects.append(_added(pattern.offset_e))
    effects += _placed(rendering, "read-out")
    if detector.read_noise_e > 0.0:
        effects.append(_read_noise(detector.read_noise_e))
    effects.append(_multiplied(detector.gain_dn_per_e * 10.0 ** (gain_db / 20.0)))
    if detector.black_level_dn > 0.0:
        effects.append(_added(detector.black_level_dn))
    return tuple(effects)


def counts_of(
    radiance: FloatArray,
    *,
    effects: tuple[Act, ...],
    bit_depth: int,
    shot: Shot,
) -> NDArray[np.uint16]:
    """Return the samples of one picture [DN], rounded to the nearest and held within 0 .. 2^bit_depth - 1."""
    analogue_dn = reduce(lambda picture, effect: effect(picture, shot), effects, radiance)
    np.rint(analogue_dn, out=analogue_dn)
    np.clip(analogue_dn, 0, 2**bit_depth - 1, out=analogue_dn)
    return analogue_dn.astype(np.uint16)


def _placed(rendering: Sequence[RenderingEffect], place: Place) -> list[Act]:
    return [effect.act for effect in rendering if effect.place == place]


def _scaled(factor: float) -> Act:
    """Multiply into a picture of its own."""
    return lambda picture, _: picture * factor


def _multiplied(factor: float | FloatArray) -> Act:
    return lambda picture, _: np.multiply(picture, factor, out=picture)


def _added(summand: float | FloatArray) -> Act:
    return lambda picture, _: np.add(picture, summand, out=picture)


def _shot_noise(picture: FloatArray, shot: Shot) -> FloatArray:
    """Draw electrons by a true Poisson draw at every level, the largest cost of a frame."""
    return shot.noise.poisson(picture).astype(np.float64)


def _full_well(full_well_e: float) -> Act:
    return lambda picture, _: np.minimum(picture, full_well_e, out=picture)


def _read_noise(read_noise_e: float) -> Act:
    def effect(picture: FloatArray, shot: Shot) -> FloatArray:
        picture += read_noise_e * shot.noise.standard_normal(picture.shape)
        return picture

    return effect
