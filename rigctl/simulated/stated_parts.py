"""Parts of a simulated rig, as its rig file states them: stage, scene, polarizer, camera and its flaws."""

import hashlib
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from rigctl.files.regions import Region, masks
from rigctl.files.rig_file import RigFile
from rigctl.files.scene_file import SceneFile, SceneRegion
from rigctl.files.simulation_sections import (
    BeamWanderSection,
    CosmicHitsSection,
    DriftSection,
    FixedPatternSection,
    PointSpreadSection,
    RenderingSection,
    SimulatedCamera,
    SimulatedPolarizer,
    SimulationSection,
    SmearSection,
    VignettingSection,
)
from rigctl.simulated.lens_position import LensPosition
from rigctl.simulated.simulated_clock import SimulatedClock
from sim_devices.camera import SimCamera
from sim_devices.detector import Detector, Lens
from sim_devices.micro_polarizers import MicroPolarizers, crosstalk
from sim_devices.random_streams import Stream, generator
from sim_devices.rendering.effect import RenderingEffect
from sim_devices.rendering.optics import beam_wander, defocus, drift, point_spread, vignetting
from sim_devices.rendering.readout import cosmic_hits, fixed_pattern, smear
from sim_devices.scene_truth import Region as PaintedRegion
from sim_devices.scene_truth import Surface, paint_scene
from sim_devices.stages.catalogue import StageOptions, parse_stage_address
from sim_devices.stages.simulated_stage import SimulatedStage
from sim_devices.truth_log import TruthLog
from sim_devices.world import Polarizer, World

FloatArray = NDArray[np.float64]

# Effects that move or blur light before it meets polarizers on the pixels.
_BEFORE_POLARIZERS = ("point-spread", "beam-wander")
# Second number of a seed sequence, so that no two uses of a rig's seed share a stream.
TEXTURE_STREAM = 1


def stage_options(port: str, seed: int) -> StageOptions:
    """Return what an address says of a simulated stage; its errors hang on the rig's seed where it states none."""
    options = parse_stage_address(port)
    return options if "seed=" in port else replace(options, seed=seed)


def on_sensor(regions: Sequence[Region], rig: RigFile, camera: SimulatedCamera) -> dict[str, NDArray[np.bool_]]:
    """Return where regions lie on the sensor: they are drawn on frames, whose pixels may be whole cells of it."""
    width, height = frame_size(rig, camera)
    inside = masks(list(regions), width=width, height=height)
    if (width, height) == (camera.width, camera.height):
        return inside
    return {name: mask.repeat(2, axis=0).repeat(2, axis=1) for name, mask in inside.items()}


def frame_size(rig: RigFile, camera: SimulatedCamera) -> tuple[int, int]:
    """Return width and height of the frames of a simulated rig.

    Raises
    ------
    ValueError
        A sensor of cells has an odd side.
    """
    if rig.camera.mosaic_deg is None:
        return camera.width, camera.height
    if camera.width % 2 or camera.height % 2:
        raise ValueError(f"the sensor has {camera.width} x {camera.height} pixels; cells of 2 x 2 need even sides")
    halved = 2 if rig.camera.interpolation == "none" else 1
    return camera.width // halved, camera.height // halved


def stated_radiance(scene: SceneFile, rig: RigFile, camera: SimulatedCamera, seed: int) -> FloatArray:
    """Return the radiance that a scene file states, with its texture: a (3, H, W) array [W m-2 sr-1]."""
    inside = on_sensor(scene.regions, rig, camera)
    return paint_scene(
        width=camera.width,
        height=camera.height,
        background=Surface(mean_stokes=(scene.background_radiance, 0.0, 0.0)),
        regions=[PaintedRegion(surface=_surface(region), where=inside[region.name]) for region in scene.regions],
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


def stated_world(
    simulation: SimulationSection,
    radiance: FloatArray,
    stage: SimulatedStage | None,
    polarizers: MicroPolarizers | None = None,
) -> World:
    """Return what stands before the camera: a scene behind the polarizer that a stage turns, or those on its pixels."""
    pixel_axes_deg = None
    if polarizers is not None:
        height, width = radiance.shape[1:]
        made_with = generator(simulation.seed, Stream.MICRO_POLARIZERS)
        pixel_axes_deg = polarizers.axes_deg((height, width), generator=made_with)
    return World(
        radiance=radiance,
        polarizer=stated_polarizer(simulation.polarizer),
        stage_angle_deg=_nothing_turns if stage is None else stage.true_angle_deg,
        flat_radiance=simulation.flat_radiance,
        pixel_axes_deg=pixel_axes_deg,
    )


def _nothing_turns() -> float:
    return 0.0


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
    polarizers: MicroPolarizers | None = None,
) -> SimCamera:
    """Return the camera before a world; `log` notes what is true of its frames, `clock` None is the host's.

    `wrapped` makes another of each effect of its pictures, such as one that is timed.
    """
    lens, detector = _lens(simulation.camera), _detector(simulation.camera)
    # A lens blurs light before it meets polarizers on the pixels, which is not simulated.
    lens_blur = [defocus(lens, detector, defocus_m=LensPosition(simulation).defocus_m)] if polarizers is None else []
    leaks = [crosstalk(polarizers.crosstalk)] if polarizers is not None and polarizers.crosstalk else []
    blurred = [section.effect for section in simulation.effects if section.effect in _BEFORE_POLARIZERS]
    if polarizers is not None and blurred:
        raise ValueError(f"{', '.join(blurred)}: acts before the polarizers on the pixels, which is not simulated")
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
            *lens_blur,
            *(
                wrapped(rendering_effect(section, lens=lens, detector=detector, pattern_seed=simulation.seed))
                for section in simulation.effects
            ),
            *leaks,
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
