"""The run of a hard case, taken by the simulated camera: its light is given, and nothing of the model is in it."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigctl.scene.scene import Scene
from sim_devices.exposure import (
    Detector,
    Lens,
    Shot,
    Stream,
    counts_of,
    draw_fixed_pattern,
    exposure_effects,
    generator,
)
from sim_devices.world import Polarizer, Surface, World, paint_scene
from tests.rigctl.made_runs import at, make_run

FloatArray = NDArray[np.float64]

WIDTH, HEIGHT, CYCLES = 96, 48, 4
_FOCAL_M, _ENDLESS = 0.035, 1e30
# So many times the electrons, each worth so much less: shot noise that a scene leaves out is gone, the counts stay.
_WITHOUT_SHOT_NOISE = 1e9


def draw_run(path: Path, scene: Scene, light: Mapping[str, tuple[FloatArray, FloatArray]], *, seed: int = 23) -> None:
    """Write the run of a scene of which mean and covariance of each region's Stokes radiance are given.

    Raises ValueError where no camera could take it: a drawn pixel has S0 of 0 or less, or DoLP above 1, or counts are
    not rounded.
    """
    if "quantisation" in scene.effects.left_out:
        raise ValueError("the scene leaves out quantisation, and every camera rounds its counts")
    angle_deg = [0.0]
    along = scene.sensor.polarizer_transmittance.value
    polarizer = Polarizer(
        transmittance_along=along,
        transmittance_across=along / scene.sensor.extinction_ratio.value,
        offset_deg=0.0,
        sense=1,
    )
    world = World(
        radiance=_painted(scene, light, np.random.default_rng(seed)),
        polarizer=polarizer,
        stage_angle_deg=lambda: angle_deg[0],
        flat_radiance=1.0,
    )
    detector, exposure_s = _detector(scene)
    lens = Lens(
        focal_length_m=_FOCAL_M,
        aperture_diameter_m=_FOCAL_M / scene.sensor.f_number.value,
        transmittance=scene.sensor.optics_transmittance.value,
    )
    pattern = draw_fixed_pattern(detector, generator=generator(seed, Stream.PATTERN))
    effects = exposure_effects(lens=lens, detector=detector, pattern=pattern, exposure_s=exposure_s, gain_db=0.0)
    frames = []
    for cycle in range(CYCLES):
        for angle_deg[0] in scene.acquisition.angles_deg:
            shot = Shot(
                noise=generator(seed, Stream.NOISE, len(frames)),
                noise_seed=seed,
                sequence=len(frames),
                exposure_s=exposure_s,
                axis_deg=angle_deg[0],
            )
            counts = counts_of(
                world.radiance_behind_polarizer(), effects=effects, bit_depth=detector.bit_depth, shot=shot
            )
            known = at(
                angle_deg[0],
                cycle=cycle,
                exposure_s=scene.exposure_s,
                black_level_dn=detector.black_level_dn,
                bit_depth=detector.bit_depth,
                saturation_dn=float(2**detector.bit_depth - 1),
            )
            frames.append((known, counts))
    rig = {"polarizer": {"extinction_ratio": scene.sensor.extinction_ratio.value}}
    make_run(path, frames, session={"origin": "device", "rig": rig})


def _painted(
    scene: Scene, light: Mapping[str, tuple[FloatArray, FloatArray]], draws: np.random.Generator
) -> FloatArray:
    regions = []
    for region in scene.regions:
        place, (mean, cov) = region.given.rectangle, light[region.name]
        s0, s1, s2 = mean.tolist()
        if region.material is None:
            # A common factor: of light polarized to 1 no pixel is polarized to more.
            rms = 0.0 if "texture" in scene.effects.left_out else region.given.texture_rms.value
            surface = Surface(mean_stokes=(s0, s1, s2), texture_rms=rms)
        else:
            surface = Surface(mean_stokes=(s0, s1, s2), extra_covariance=0.5 * (cov + cov.T))
        where = np.zeros((HEIGHT, WIDTH), dtype=np.bool_)
        where[place.y : place.y + place.height, place.x : place.x + place.width] = True
        regions.append((surface, where))
    background = Surface(mean_stokes=(1.0, 0.0, 0.0))
    return paint_scene(width=WIDTH, height=HEIGHT, background=background, regions=regions, generator=draws)


def _detector(scene: Scene) -> tuple[Detector, float]:
    """Return the detector and its exposure [s], without the noise that the scene leaves out."""
    noise, left_out = scene.noise, scene.effects.left_out
    share = _WITHOUT_SHOT_NOISE if "shot-noise" in left_out else 1.0

    def unless(effect: str, value: float) -> float:
        return 0.0 if effect in left_out else value

    detector = Detector(
        width=WIDTH,
        height=HEIGHT,
        pixel_pitch_m=scene.sensor.pixel_pitch_um.value * 1e-6,
        effective_wavelength_m=scene.sensor.wavelength_nm.value * 1e-9,
        quantum_efficiency=scene.sensor.quantum_efficiency.value,
        gain_dn_per_e=noise.gain_dn_per_e.value / share,
        read_noise_e=unless("read-noise", noise.read_noise_e.value * share),
        dark_current_e_per_s=unless("dark-current", noise.dark_current_e_per_s.value),
        black_level_dn=noise.black_level_dn.value,
        prnu=unless("non-uniformity", noise.prnu.value),
        dsnu_e=unless("non-uniformity", noise.dsnu_e.value * share),
        full_well_e=_ENDLESS,
        bit_depth=scene.sensor.bit_depth,
    )
    return detector, scene.exposure_s * share
