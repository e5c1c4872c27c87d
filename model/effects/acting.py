"""Where effects act on the record of a scene: what is left out is taken from the record, and computed by nobody."""

from dataclasses import replace

import numpy as np

from model.effects.names import Effect
from model.scene.lit_scene import LitRegion, LitScene
from model.sensor.imperfections import Imperfections
from model.sensor.sensor import Sensor


def acting(scene: LitScene, effects: frozenset[Effect]) -> LitScene:
    """Return the scene with those effects left out that are numbers of its record.

    Parameters
    ----------
    scene
        With all effects.
    effects
        That act. FIELD_OF_VIEW, SKYLIGHT, PATH_RADIANCE and WAVELENGTHS act elsewhere
        (`model.accuracy.evaluation.light_store`, `model.accuracy.evaluation.chain`).

    References
    ----------
    Definition.
    """
    regions = scene.regions if Effect.TEXTURE in effects else tuple(_smooth(region) for region in scene.regions)
    sensor, readout = _sensor(scene.sensor, effects), scene.readout
    if Effect.LEAKAGE not in effects:
        readout = replace(readout, extinction_ratio=np.inf)
    return replace(
        scene,
        regions=regions,
        sensor=sensor,
        readout=readout,
        imperfections=_imperfections(scene.imperfections, effects),
    )


def _sensor(sensor: Sensor, effects: frozenset[Effect]) -> Sensor:
    noise = sensor.noise
    pattern = Effect.NONUNIFORMITY in effects
    noise = replace(
        noise,
        dark_current_e_per_s=noise.dark_current_e_per_s if Effect.DARK_CURRENT in effects else 0.0,
        read_noise_e=noise.read_noise_e if Effect.READ_NOISE in effects else 0.0,
        prnu=noise.prnu if pattern else 0.0,
        dsnu_e=noise.dsnu_e if pattern else 0.0,
        shot_noise=noise.shot_noise and Effect.SHOT_NOISE in effects,
        quantisation=noise.quantisation and Effect.QUANTISATION in effects,
    )
    return replace(
        sensor,
        noise=noise,
        tau_perpendicular=sensor.tau_perpendicular if Effect.LEAKAGE in effects else 0.0,
        saturates=sensor.saturates and Effect.SATURATION in effects,
    )


def _imperfections(given: Imperfections, effects: frozenset[Effect]) -> Imperfections:
    return replace(
        given,
        polarizer_angle_std_rad=given.polarizer_angle_std_rad if Effect.POLARIZER_ANGLE in effects else 0.0,
        misregistration_pixels=given.misregistration_pixels if Effect.MISREGISTRATION in effects else 0.0,
        drift=given.drift if Effect.DRIFT in effects else 0.0,
        surround_albedo=given.surround_albedo if Effect.ADJACENCY in effects else None,
        off_axis_falloff=given.off_axis_falloff and Effect.FALLOFF in effects,
    )


def _smooth(region: LitRegion) -> LitRegion:
    return replace(region, texture_rms=0.0, texture_diagonal=(0.0, 0.0, 0.0), texture_cov=np.zeros((3, 3)))
