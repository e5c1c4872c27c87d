"""Where effects act on the record of a scene: what is left out is taken from the record, and computed by nobody."""

from dataclasses import replace

import numpy as np

from model.effects.names import Effect
from model.lit_scene import LitRegion, LitScene


def acting(scene: LitScene, effects: frozenset[Effect]) -> LitScene:
    """Return the scene with those effects left out that are numbers of its record.

    Parameters
    ----------
    scene
        With all effects.
    effects
        That act. FIELD_OF_VIEW, SKYLIGHT, PATH_RADIANCE and WAVELENGTHS act elsewhere
        (`model.accuracy.light_store`, `model.accuracy.chain`).
    """
    regions = scene.regions if Effect.TEXTURE in effects else tuple(_smooth(region) for region in scene.regions)
    sensor, readout = scene.sensor, scene.readout
    noise = sensor.noise
    if Effect.DARK_CURRENT not in effects:
        noise = replace(noise, dark_current_e_per_s=0.0)
    if Effect.READ_NOISE not in effects:
        noise = replace(noise, read_noise_e=0.0)
    if Effect.NONUNIFORMITY not in effects:
        noise = replace(noise, prnu=0.0, dsnu_e=0.0)
    sensor = replace(sensor, noise=noise)
    if Effect.LEAKAGE not in effects:
        sensor = replace(sensor, tau_perpendicular=0.0)
        readout = replace(readout, extinction_ratio=np.inf)
    return replace(scene, regions=regions, sensor=sensor, readout=readout)


def _smooth(region: LitRegion) -> LitRegion:
    return replace(region, texture_rms=0.0, texture_diagonal=(0.0, 0.0, 0.0), texture_cov=np.zeros((3, 3)))
