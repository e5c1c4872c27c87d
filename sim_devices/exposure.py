"""From the radiance that enters a lens to counts: a plain list of effects, each called only if it is there.

The first effect makes a picture of its own, so the radiance stays as it was.
"""

from collections.abc import Sequence
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from sim_devices.detector import Detector, FixedPattern, Lens, electrons_per_radiance_s
from sim_devices.rendering.effect import Act, FloatArray, Place, RenderingEffect, Shot


def exposure_effects(
    *,
    lens: Lens,
    detector: Detector,
    pattern: FixedPattern,
    exposure_s: float,
    gain_db: float,
    rendering: Sequence[RenderingEffect] = (),
) -> tuple[Act, ...]:
    """Return what happens to light on its way to counts, in order.

    Parameters
    ----------
    lens, detector, pattern
        The truth about the camera.
    exposure_s
        Integration time, > 0.
    gain_db
        The camera's gain setting: counts an electron grow by 10^(gain_db / 20), the black level stays.
    rendering
        What the rig file names beside; each acts at its place, those of one place in this order.

    Notes
    -----
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
    """Draw whole electrons. A true Poisson draw at every level, though it is most of a frame's cost."""
    return shot.noise.poisson(picture).astype(np.float64)


def _full_well(full_well_e: float) -> Act:
    return lambda picture, _: np.minimum(picture, full_well_e, out=picture)


def _read_noise(read_noise_e: float) -> Act:
    def effect(picture: FloatArray, shot: Shot) -> FloatArray:
        picture += read_noise_e * shot.noise.standard_normal(picture.shape)
        return picture

    return effect
