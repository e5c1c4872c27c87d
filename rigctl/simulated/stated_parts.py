"""Parts of a simulated rig, as its rig file states them: stage, scene, polarizer, camera and its flaws."""

import hashlib
import time
from collections.abc import Callable
from dataclasses import replace
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from rigctl.files.regions import masks
from rigctl.files.rendering_sections import (
    BeamWanderSection,
    CosmicHitsSection,
    DriftSection,
    FixedPatternSection,
    PointSpreadSection,
    RenderingSection,
    SmearSection,
    VignettingSection,
)
from rigctl.files.rig_file import SimulatedCamera, SimulatedPolarizer, SimulationSection
from rigctl.files.scene_file import SceneFile, SceneRegion
from rigctl.simulated.lens_position import LensPosition
from rigctl.simulated.simulated_clock import SimulatedClock
from sim_devices.camera import SimCamera
from sim_devices.detector import Detector, Lens
from sim_devices.rendering.effect import RenderingEffect
from sim_devices.rendering.optics import beam_wander, defocus, drift, point_spread, vignetting
from sim_devices.rendering.readout import cosmic_hits, fixed_pattern, smear
from sim_devices.scene_truth import Region, Surface, paint_scene
from sim_devices.stages.catalogue import StageOptions, parse_stage_address
from sim_devices.stages.simulated_stage import SimulatedStage
from sim_devices.truth_log import TruthLog
from sim_devices.world import Polarizer, World

FloatArray = NDArray[np.float64]

# Second number of a seed sequence, so that no two uses of a rig's seed share a stream.
TEXTURE_STREAM = 1


def stage_options(port: str, seed: int) -> StageOptions:
    """Return what an address says of a simulated stage; its errors hang on the rig's seed where it states none."""
    options = parse_stage_address(port)
    return options if "seed=" in port else replace(options, seed=seed)


def stated_radiance(scene: SceneFile, camera: SimulatedCamera, seed: int) -> FloatArray:
    """Return the radiance that a scene file states, with its texture: a (3, H, W) array [W m-2 sr-1]."""
    inside = masks(list(scene.regions), width=camera.width, height=camera.height)
    return paint_scene(
        width=camera.width,
        height=camera.height,
        background=Surface(mean_stokes=(scene.background_radiance, 0.0, 0.0)),
        regions=[Region(surface=_surface(region), where=inside[region.name]) for region in scene.regions],
        generator=np.random.default_rng([seed, TEXTURE_STREAM]),
    )


def _surface(region: SceneRegion) -> Surface:
    s0, s1, s2 = (component.value for component in region.given_radiance())
    covariance = region.texture_covariance
    return Surface(
        mean_stokes=(s0, s1, s2),
        texture_rms=region.texture_rms.value,
        extra_covariance=None if covariance is None else np.array([[one.value for one in row] for row in covariance]),
    )


def stated_world(simulation: SimulationSection, radiance: FloatArray, stage: SimulatedStage) -> World:
    """Return what stands before the camera: a scene behind the polarizer that a stage turns."""
    return World(
        radiance=radiance,
        polarizer=stated_polarizer(simulation.polarizer),
        stage_angle_deg=stage.true_angle_deg,
        flat_radiance=simulation.flat_radiance,
    )


def stated_polarizer(truth: SimulatedPolarizer) -> Polarizer:
    """Return the polarizer of a simulated rig."""
    return Polarizer(
        transmittance_along=truth.transmittance_along,
        transmittance_across=truth.transmittance_along / truth.extinction_ratio,
        offset_deg=truth.offset_deg,
        sense=truth.sense,
    )


def _as_it_is(effect: RenderingEffect) -> RenderingEffect:
    return effect


def stated_camera(
    simulation: SimulationSection,
    world: World,
    session_name: str,
    log: TruthLog | None,
    clock: SimulatedClock | None,
    *,
    wrapped: Callable[[RenderingEffect], RenderingEffect] = _as_it_is,
) -> SimCamera:
    """Return the camera before a world; `log` notes what is true of its frames, `clock` None is the host's.

    `wrapped` makes another of each effect of its pictures, such as one that is timed.
    """
    lens, detector = _lens(simulation.camera), _detector(simulation.camera)
    return SimCamera(
        world=world,
        lens=lens,
        detector=detector,
        pattern_seed=simulation.seed,
        noise_seed=_noise_seed(simulation.seed, session_name),
        truth=log,
        utc_ns=time.time_ns if clock is None else clock.utc_ns,
        monotonic_ns=time.monotonic_ns if clock is None else clock.monotonic_ns,
        rendering=[
            defocus(lens, detector, defocus_m=LensPosition(simulation).defocus_m),
            *(
                wrapped(rendering_effect(section, lens=lens, detector=detector, pattern_seed=simulation.seed))
                for section in simulation.effects
            ),
        ],
    )


def _lens(truth: SimulatedCamera) -> Lens:
    return Lens(
        focal_length_m=truth.focal_length_mm / 1e3,
        aperture_diameter_m=truth.aperture_diameter_mm / 1e3,
        transmittance=truth.optics_transmittance,
    )


def _detector(truth: SimulatedCamera) -> Detector:
    return Detector(
        width=truth.width,
        height=truth.height,
        pixel_pitch_m=truth.pixel_pitch_um / 1e6,
        effective_wavelength_m=truth.wavelength_nm / 1e9,
        quantum_efficiency=truth.quantum_efficiency,
        gain_dn_per_e=truth.gain_dn_per_e,
        read_noise_e=truth.read_noise_e,
        dark_current_e_per_s=truth.dark_current_e_per_s,
        black_level_dn=truth.black_level_dn,
        prnu=truth.prnu,
        dsnu_e=truth.dsnu_e,
        full_well_e=truth.full_well_e,
        bit_depth=truth.bit_depth,
    )


def _noise_seed(seed: int, session_name: str) -> int:
    digest = hashlib.sha256(f"{seed}/{session_name}".encode()).digest()
    return int.from_bytes(digest[:8], "big")


def rendering_effect(
    section: RenderingSection, *, lens: Lens, detector: Detector, pattern_seed: int
) -> RenderingEffect:
    """Return the effect that a table of a rig file names."""
    match section:
        case PointSpreadSection():
            return point_spread(sigma_px=section.sigma_px)
        case VignettingSection():
            return vignetting(lens, detector)
        case FixedPatternSection():
            return fixed_pattern(
                column_offset_e=section.column_offset_e, width=detector.width, pattern_seed=pattern_seed
            )
        case DriftSection():
            return drift(rate_per_frame=section.rate_per_frame, flicker_std=section.flicker_std)
        case BeamWanderSection():
            return beam_wander(radius_px=section.radius_px, phase_deg=section.phase_deg)
        case SmearSection():
            return smear(row_transfer_us=section.row_transfer_us)
        case CosmicHitsSection():
            return cosmic_hits(rate_per_s=section.rate_per_s, mean_e=section.mean_e)
        case _:
            assert_never(section)
