"""A simulated rig, made of a rig file: one world, seen by the stage through bytes and by the camera through light."""

import hashlib
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import ConfigError
from rigctl.files.choices import RoofChange
from rigctl.files.regions import masks
from rigctl.files.rig_file import RigFile, SimulatedCamera, SimulatedPolarizer, SimulationSection
from rigctl.files.scene_file import SceneFile, SceneRegion, load_scene
from rigctl.numbers.utc_time import NS_PER_S
from rigctl.runs.simulated_light import SimulatedLight
from rigctl.simulated.camera_address import ON_NETWORK, THIS_MACHINE, require_known_camera, split_faults, split_truth
from rigctl.simulated.lit_roof import LitRoof
from rigctl.simulated.noise_numbers import FreshNoise, NoiseNumbers
from rigctl.simulated.rendering import rendering_effect
from rigctl.simulated.roof_steps import BeginStep, with_light, with_time
from rigctl.simulated.simulated_clock import SimulatedClock
from sim_devices.camera import SimCamera
from sim_devices.cameras.gige_server import serve_gige_camera
from sim_devices.clock import SimClock
from sim_devices.detector import Detector, Lens
from sim_devices.scene_truth import Region, Surface, paint_scene
from sim_devices.stages.catalogue import StageOptions, make_stage, parse_stage_address
from sim_devices.stages.pty_server import serve_on_pty
from sim_devices.stages.simulated_stage import SimulatedStage
from sim_devices.textured_scene import TexturedScene
from sim_devices.truth_log import TruthLog
from sim_devices.world import Polarizer, World

FloatArray = NDArray[np.float64]

# Second number of a seed sequence, so that no two uses of a rig's seed share a stream.
_TEXTURE_STREAM = 1
# Of the background's radiance, where a session's clock begins at night: hardly a photon.
_NIGHT_SHARE = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class Simulation:
    """The simulated part of a rig.

    Attributes
    ----------
    world : World
        What stands in front of the camera.
    camera : SimCamera
        Looks at it.
    stage_port : str
        Pseudo-terminal on which the simulated stage answers.
    network_address : str or None
        Address of the camera for its driver, where it is served as a GigE Vision camera; None where it is not.
    begin_step : callable
        To be told, by its sequence number, of each step before its first frame: the noise of frames hangs on it.
        Says whether the numbers of the camera's frames jump there. Simulated time passes there, and the light moves.
    light : SimulatedLight or None
        What lights a scene of materials; None where the scene file states every radiance.
    """

    world: World
    camera: SimCamera
    stage_port: str
    network_address: str | None
    begin_step: Callable[[int], bool]
    light: SimulatedLight | None = None


def with_simulation(rig: RigFile, *, clock_ns: int | None, perturb: RoofChange | None) -> RigFile:
    """Return a rig file whose simulation has another clock, or a roof that was changed; None leaves what it says.

    Parameters
    ----------
    rig : RigFile
        The rig.
    clock_ns : int or None
        When its clock begins [ns since 1970 UTC].
    perturb : str or None
        What changes in its roof.

    Raises
    ------
    ConfigError
        A device of the rig is real, or its camera is on the network: their time is not simulated.
    """
    if perturb is not None and rig.simulation is None:
        raise ConfigError("--perturb: only a simulated roof can be changed; this rig is real")
    if rig.simulation is None and clock_ns is None:
        return rig
    given: dict[str, Any] = {} if clock_ns is None else {"clock": datetime.fromtimestamp(clock_ns / NS_PER_S, tz=UTC)}
    if perturb is not None:
        given |= {"perturb": perturb}
    changed = None if rig.simulation is None else rig.simulation.model_copy(update=given)
    if changed is None or (changed.clock is not None and not _is_within_program(rig)):
        raise ConfigError(
            "--clock: is for a rig whose stage and camera are simulated within the program (sim:...), not real or on "
            "the network: their time cannot be chosen"
        )
    return rig.model_copy(update={"simulation": changed})


def _is_within_program(rig: RigFile) -> bool:
    camera = rig.camera.address
    return rig.stage.port.startswith("sim:") and camera.startswith("sim:") and camera.partition("?")[0] != ON_NETWORK


@contextmanager
def simulate(
    rig: RigFile, *, session_name: str, run: Path | None = None, clock: SimulatedClock | None = None
) -> Iterator[Simulation]:
    """Give the simulated stage, camera and world of a rig file until the context is left.

    Parameters
    ----------
    rig : RigFile
        With a [simulation] table.
    session_name : str
        Decides, with the rig's seed, the noise of the frames: two sessions of one rig have different noise and the
        same fixed pattern, texture and landing errors.
    run : Path or None
        Run folder of the session, which may hold a part of it: the noise goes on from there.
    clock : SimulatedClock or None
        The time of a rig with a clock of its own; None is the host's.

    Raises
    ------
    ConfigError
        The rig file describes no simulation that can be.
    """
    if rig.simulation is None:
        raise ConfigError(f"rig {rig.name}: there is no [simulation] table")
    require_known_camera(rig.camera.address)
    try:
        options = _stage_options(rig.stage.port, rig.simulation.seed)
        stage_clock = SimClock(speed=options.speed)
        stage = make_stage(options, clock=stage_clock)
        seen = seen_scene(rig, utc_ns=time.time_ns if clock is None else clock.utc_ns)
        world = _world(rig.simulation, seen.radiance, stage)
        address, log = split_truth(rig.camera.address)
        camera = _camera(rig.simulation, world, session_name, log, clock)
    except ValueError as error:
        raise ConfigError(f"rig {rig.name}: the simulation cannot be made: {error}") from error
    with serve_on_pty(stage, clock=stage_clock) as port, camera, _serve_if_gige(address, camera) as network_address:
        noise = NoiseNumbers(camera, run) if network_address is None else FreshNoise(camera, run)
        yield Simulation(
            world=world,
            camera=camera,
            stage_port=port,
            network_address=network_address,
            begin_step=_begin_step(noise.begin_step, world, camera, seen, clock),
            light=None if seen.roof is None else seen.roof.record,
        )


def _begin_step(
    begin_step: BeginStep, world: World, camera: SimCamera, seen: "SeenScene", clock: SimulatedClock | None
) -> BeginStep:
    if seen.roof is not None and seen.textured is not None:
        utc_ns = time.time_ns if clock is None else clock.utc_ns
        begin_step = with_light(begin_step, world, roof=seen.roof, scene=seen.textured, utc_ns=utc_ns)
    return begin_step if clock is None else with_time(begin_step, camera, clock)


@contextmanager
def _serve_if_gige(address: str, camera: SimCamera) -> Iterator[str | None]:
    """Give where a camera is served as a GigE Vision camera, until the context is left; None for another address.

    Parameters
    ----------
    address : str
        The camera's in the rig file. Keys of faults (see `split_faults`) are for the simulation; what else there is
        behind the "?" is for the driver.
    camera : Camera
        The simulated one.

    Raises
    ------
    ConfigError
        A fault is none.
    NotConnectedError
        libaravis is not installed, or there is another GigE camera on this machine's own address.
    """
    scheme, _, tail = address.partition("?")
    if scheme != ON_NETWORK:
        yield None
        return
    faults, rest = split_faults(tail)
    serial_number = camera.identify().serial_number
    with serve_gige_camera(camera, address=THIS_MACHINE, serial_number=serial_number, faults=faults):
        yield f"gige:{THIS_MACHINE}?{rest}"


def _stage_options(port: str, seed: int) -> StageOptions:
    options = parse_stage_address(port)
    return options if "seed=" in port else replace(options, seed=seed)


@dataclass(frozen=True, kw_only=True, eq=False)
class SeenScene:
    """What the camera looks at.

    Attributes
    ----------
    radiance : (3, H, W) array
        At the beginning [W m-2 sr-1].
    roof, textured : LitRoof, TexturedScene or None
        What computes and what paints the light of a scene of materials; None where its radiances are stated.
    """

    radiance: FloatArray
    roof: LitRoof | None = None
    textured: TexturedScene | None = None


def seen_scene(rig: RigFile, *, utc_ns: Callable[[], int]) -> SeenScene:
    """Return what the camera of a simulated rig looks at.

    Parameters
    ----------
    rig : RigFile
        With a [simulation] table.
    utc_ns : callable
        The time [ns since 1970 UTC], by which a roof is lit.

    Raises
    ------
    ConfigError, ValueError
        The scene is wrong, or its light cannot be.
    """
    if rig.simulation is None:
        raise ConfigError(f"rig {rig.name}: there is no [simulation] table")
    scene, camera = load_scene(rig.simulation.scene), rig.simulation.camera
    if not scene.has_materials:
        if rig.simulation.perturb is not None:
            raise ConfigError("--perturb: is for a simulated roof, a scene whose regions have a material")
        return SeenScene(radiance=_radiance(scene, camera, rig.simulation.seed))
    roof = LitRoof(scene, rig)
    inside = masks(list(scene.regions), width=camera.width, height=camera.height)
    textured = TexturedScene(
        masks={region.name: inside[region.name] for region in scene.regions},
        background_radiance=scene.background_radiance,
        shape=(camera.height, camera.width),
        generator=np.random.default_rng([rig.simulation.seed, _TEXTURE_STREAM]),
    )
    radiance = textured.painted(roof.at(utc_ns())) if roof.is_day(utc_ns()) else _night(scene, camera)
    return SeenScene(radiance=radiance, roof=roof, textured=textured)


def _night(scene: SceneFile, camera: SimulatedCamera) -> FloatArray:
    """Return a dark world, until the first step is taken by day."""
    radiance = np.zeros((3, camera.height, camera.width))
    radiance[0] = _NIGHT_SHARE * scene.background_radiance
    return radiance


def made_camera(rig: RigFile, seen: SeenScene, *, session_name: str) -> SimCamera:
    """Return the camera of a simulated rig before its scene, without anything that turns.

    Raises
    ------
    ConfigError, ValueError
        Stage, polarizer or camera cannot be.
    """
    if rig.simulation is None:
        raise ConfigError(f"rig {rig.name}: there is no [simulation] table")
    options = _stage_options(rig.stage.port, rig.simulation.seed)
    stage = make_stage(options, clock=SimClock(speed=options.speed))
    return _camera(rig.simulation, _world(rig.simulation, seen.radiance, stage), session_name, None, None)


def _world(simulation: SimulationSection, radiance: FloatArray, stage: SimulatedStage) -> World:
    return World(
        radiance=radiance,
        polarizer=_polarizer(simulation.polarizer),
        stage_angle_deg=stage.true_angle_deg,
        flat_radiance=simulation.flat_radiance,
    )


def _radiance(scene: SceneFile, camera: SimulatedCamera, seed: int) -> FloatArray:
    inside = masks(list(scene.regions), width=camera.width, height=camera.height)
    return paint_scene(
        width=camera.width,
        height=camera.height,
        background=Surface(mean_stokes=(scene.background_radiance, 0.0, 0.0)),
        regions=[Region(surface=_surface(region), where=inside[region.name]) for region in scene.regions],
        generator=np.random.default_rng([seed, _TEXTURE_STREAM]),
    )


def _surface(region: SceneRegion) -> Surface:
    s0, s1, s2 = (component.value for component in region.given_radiance())
    covariance = region.texture_covariance
    return Surface(
        mean_stokes=(s0, s1, s2),
        texture_rms=region.texture_rms.value,
        extra_covariance=None if covariance is None else np.array([[one.value for one in row] for row in covariance]),
    )


def _polarizer(truth: SimulatedPolarizer) -> Polarizer:
    return Polarizer(
        transmittance_along=truth.transmittance_along,
        transmittance_across=truth.transmittance_along / truth.extinction_ratio,
        offset_deg=truth.offset_deg,
        sense=truth.sense,
    )


def _camera(
    simulation: SimulationSection,
    world: World,
    session_name: str,
    log: TruthLog | None,
    clock: SimulatedClock | None,
) -> SimCamera:
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
            rendering_effect(section, lens=lens, detector=detector, pattern_seed=simulation.seed)
            for section in simulation.effects
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
