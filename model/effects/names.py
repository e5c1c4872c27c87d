"""Names of the effects that a scene may call for beyond light on a surface and an ideal camera."""

from enum import StrEnum
from typing import Literal


class Effect(StrEnum):
    """Effects that can be left out of a prediction, each on its own."""

    FIELD_OF_VIEW = "field of view"
    TEXTURE = "texture"
    SKYLIGHT = "skylight"
    PATH_RADIANCE = "path radiance"
    LEAKAGE = "leakage"
    DARK_CURRENT = "dark current"
    SHOT_NOISE = "shot noise"
    READ_NOISE = "read noise"
    QUANTISATION = "quantisation"
    WAVELENGTHS = "wavelengths"
    POLARIZER_ANGLE = "polarizer angle"
    MISREGISTRATION = "misregistration"
    DRIFT = "drift"
    NONUNIFORMITY = "non-uniformity"
    SATURATION = "saturation"
    FALLOFF = "off-axis falloff"
    ADJACENCY = "adjacency"


# What decides whether an effect is left out: its bound, its estimate where that is the smaller, or nothing.
EffectRule = Literal["safe", "estimated", "all"]

ALL = frozenset(Effect)
