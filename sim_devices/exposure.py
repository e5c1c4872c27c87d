"""From the radiance that enters a lens to counts: a plain list of effects, each called only if it is there.

An effect takes the picture so far, shape (H, W), and returns the next one; it may change its argument in
place. The first effect makes a picture of its own, so the radiance stays as it was.
"""

from collections.abc import Callable
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from sim_devices.detector import Detector, FixedPattern, Lens, electrons_per_radiance_s

FloatArray = NDArray[np.float64]
Effect = Callable[[FloatArray, np.random.Generator], FloatArray]


def exposure_effects(
    *, lens: Lens, detector: Detector, pattern: FixedPattern, exposure_s: float, gain_db: float
) -> tuple[Effect, ...]:
    """Return what happens to light on its way to counts, in order.

    Parameters
    ----------
    lens, detector, pattern
        The truth about the camera.
    exposure_s
        Integration time, > 0.
    gain_db
        The camera's gain setting: counts an electron grow by 10^(gain_db / 20), the black level stays.

    Notes
    -----
    In order: expected photo-electrons, response of each pixel, dark electrons, Poisson draw of both, full
    well, offset of each pixel, read noise, gain and black level. `counts_of` rounds and saturates.
    """
    effects = [_scaled(electrons_per_radiance_s(lens, detector) * exposure_s)]
    if pattern.response is not None:
        effects.append(_multiplied(pattern.response))
    if detector.dark_current_e_per_s > 0.0:
        effects.append(_added(detector.dark_current_e_per_s * exposure_s))
    effects += [_shot_noise, _full_well(detector.full_well_e)]
    if pattern.offset_e is not None:
        effects.append(_added(pattern.offset_e))
    if detector.read_noise_e > 0.0:
        effects.append(_read_noise(detector.read_noise_e))
    effects.append(_multiplied(detector.gain_dn_per_e * 10.0 ** (gain_db / 20.0)))
    if detector.black_level_dn > 0.0:
        effects.append(_added(detector.black_level_dn))
    return tuple(effects)


def counts_of(
    radiance: FloatArray,
    *,
    effects: tuple[Effect, ...],
    bit_depth: int,
    generator: np.random.Generator,
) -> NDArray[np.uint16]:
    """Return the samples of one picture [DN], rounded to the nearest and held within 0 .. 2^bit_depth - 1."""
    analogue_dn = reduce(lambda picture, effect: effect(picture, generator), effects, radiance)
    np.rint(analogue_dn, out=analogue_dn)
    np.clip(analogue_dn, 0, 2**bit_depth - 1, out=analogue_dn)
    return analogue_dn.astype(np.uint16)


def _scaled(factor: float) -> Effect:
    """Multiply into a picture of its own."""
    return lambda picture, _: picture * factor


def _multiplied(factor: float | FloatArray) -> Effect:
    return lambda picture, _: np.multiply(picture, factor, out=picture)


def _added(summand: float | FloatArray) -> Effect:
    return lambda picture, _: np.add(picture, summand, out=picture)


def _shot_noise(picture: FloatArray, generator: np.random.Generator) -> FloatArray:
    """Draw whole electrons. A true Poisson draw at every level, though it is most of a frame's cost."""
    return generator.poisson(picture).astype(np.float64)


def _full_well(full_well_e: float) -> Effect:
    return lambda picture, _: np.minimum(picture, full_well_e, out=picture)


def _read_noise(read_noise_e: float) -> Effect:
    def effect(picture: FloatArray, generator: np.random.Generator) -> FloatArray:
        picture += read_noise_e * generator.standard_normal(picture.shape)
        return picture

    return effect
