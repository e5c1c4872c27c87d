"""A simulated rig, made from a rig file: a stage that answers on a port, and a camera that sees the same world.

`rehearse` checks a session before it is taken; `rendering_costs` measures the time of each effect on a picture;
`serve_stage` and `serve_rig_camera` serve simulated devices to other programs.
"""

import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib.resources import as_file, files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import Camera
from rigctl.base.numbers import NS_PER_S
from rigctl.errors import ConfigError
from rigctl.files.choices import RoofChange
from rigctl.files.regions import Region, masks
from rigctl.files.rig_file import RigFile, SimulationSection, load_rig
from rigctl.files.scene_file import load_scene
from rigctl.rig.simulated_parts import (
    ON_NETWORK,
    SERVED,
    TEXTURE_STREAM,
    THIS_MACHINE,
    FreshNoise,
    NoiseNumbers,
    SimulatedClock,
    frame_size,
    on_sensor,
    require_known_camera,
    split_faults,
    split_polarizers,
    split_truth,
    stage_options,
    stated_camera,
    stated_polarizer,
    stated_radiance,
    stated_world,
)
from rigctl.runs.records import SimulatedLight
from sim_devices.camera import SimCamera
from sim_devices.cameras.gige_server import AravisDevice, GigeFaults, serve_behind_network, serve_gige_camera
from sim_devices.clock import SimClock
from sim_devices.exposure import Place, RenderingEffect, Shot
from sim_devices.micro_polarizers import MicroPolarizers
from sim_devices.stages.catalogue import make_stage, parse_stage_address
from sim_devices.stages.stage import SimulatedStage, serve_on_pty
from sim_devices.world import TexturedScene, World

if TYPE_CHECKING:
    from rigctl.rig.roof import LitRoof

FloatArray = NDArray[np.float64]

BeginStep = Callable[[int], bool]
# Share of the radiance when a session begins at night.
_NIGHT_SHARE = 1e-6
_EXAMPLE = "rig-sim.toml"
_LOOK_EACH_S = 0.02
_LOOPBACK = "127."
_SMALLEST_CHANGE_DEG = 1e-6
# Time for turning and storing between two frames, as in the plan of a session [s].
STEP_S = 0.42
# Number of frames of which the median time is taken.
_TIMED_FRAMES = 9


def rendering_costs(simulation: SimulationSection) -> tuple[tuple[tuple[str, Place, float], ...], float, int]:
    """Return the time that each effect of a rig file takes per frame.

    The result has name, place in the chain and median time [s] of each effect in the order of the file, the median time
    of a whole frame [s], and the number of frames. The picture is uniform; the times do not depend on its content.
    """
    truth = simulation.camera
    radiance = np.zeros((3, truth.height, truth.width))
    radiance[0] = simulation.flat_radiance
    world = World(
        radiance=radiance,
        polarizer=stated_polarizer(simulation.polarizer),
        stage_angle_deg=lambda: 30.0,
        flat_radiance=simulation.flat_radiance,
    )
    times_s: dict[tuple[str, Place], list[float]] = {}

    def timed(effect: RenderingEffect) -> RenderingEffect:
        def act(picture: FloatArray, shot: Shot) -> FloatArray:
            begin_s = time.perf_counter()
            result = effect.act(picture, shot)
            times_s.setdefault((effect.name, effect.place), []).append(time.perf_counter() - begin_s)
            return result

        return replace(effect, act=act)

    camera = stated_camera(simulation, world, "costs", None, None, wrapped=timed)
    camera.configure(exposure_s=1e-4, gain_db=0.0)
    whole_s = []
    for _ in range(_TIMED_FRAMES + 1):  # the first is not counted
        begin_s = time.perf_counter()
        camera.take_frame(timeout_s=10.0)
        whole_s.append(time.perf_counter() - begin_s)
    costs = tuple((name, place, statistics.median(taken_s[1:])) for (name, place), taken_s in times_s.items())
    return costs, statistics.median(whole_s[1:]), _TIMED_FRAMES


@dataclass(frozen=True, kw_only=True, eq=False)
class Simulation:
    """The simulated part of a rig."""

    world: World  #: The scene and the polarizer.
    camera: SimCamera  #: The camera that sees the world.
    #: Pseudo-terminal of the simulated stage; None for a camera with polarizers on its pixels.
    stage_port: str | None
    #: Address of a camera that is served as a GigE Vision camera; otherwise None.
    network_address: str | None
    #: Called with the sequence number of each step before its first frame. Sets the noise of the frames, and moves
    #: simulated time and light on. Returns True if the camera's frame numbers jump.
    begin_step: BeginStep
    #: Light of a scene of materials; None if the scene file states all radiances.
    light: SimulatedLight | None = None


def with_simulation(rig: RigFile, *, clock_ns: int | None, perturb: RoofChange | None) -> RigFile:
    """Return a rig file with another clock or a perturbed roof; None changes nothing."""
    if perturb is not None and rig.simulation is None:
        raise ConfigError("--perturb: only a simulated roof can be changed; this rig is real")
    if rig.simulation is None and clock_ns is None:
        return rig
    given: dict[str, Any] = {} if clock_ns is None else {"clock": datetime.fromtimestamp(clock_ns / NS_PER_S, tz=UTC)}
    if perturb is not None:
        given |= {"perturb": perturb}
    changed = None if rig.simulation is None else rig.simulation.model_copy(update=given)
    real = _not_within_program(rig) if changed is None or changed.clock is not None else ()
    if changed is None or real:
        raise ConfigError(
            "--clock: the time can be chosen only of a rig whose stage and camera are simulated within the program "
            f"(sim:...), not real or on the network; this one has {' and '.join(real) or 'no [simulation]'}"
        )
    return rig.model_copy(update={"simulation": changed})


def _not_within_program(rig: RigFile) -> tuple[str, ...]:
    """Return texts on the devices that are real or on the network."""
    camera = rig.camera.address
    found = []
    if rig.stage is not None and not rig.stage.port.startswith("sim:"):
        found.append(f"the stage {rig.stage.port}")
    if not camera.startswith("sim:") or camera.partition("?")[0] == ON_NETWORK:
        found.append(f"the camera {camera}")
    return tuple(found)


@contextmanager
def simulate(
    rig: RigFile, *, session_name: str, run: Path | None = None, clock: SimulatedClock | None = None
) -> Iterator[Simulation]:
    """Make the simulated stage, camera and world of a rig file; they end when the context is left."""
    if rig.simulation is None:
        raise ConfigError(f"rig {rig.name}: there is no [simulation] table")
    require_known_camera(rig.camera.address, is_mosaic=rig.camera.mosaic_deg is not None)
    try:
        stage, stage_clock = _made_stage(rig, rig.simulation)
        utc_ns = time.time_ns if clock is None else clock.utc_ns
        radiance, lit = _scene(rig, utc_ns=utc_ns)
        address, log = split_truth(rig.camera.address)
        polarizers, address = _polarizers(rig, address)
        world = stated_world(rig.simulation, radiance, stage, polarizers)
        camera = stated_camera(rig.simulation, world, session_name, log, clock, polarizers=polarizers)
    except ValueError as error:
        raise ConfigError(f"rig {rig.name}: the simulation cannot be made: {error}") from error
    served = nullcontext(None) if stage is None else serve_on_pty(stage, clock=stage_clock)
    with served as port, camera, _serve_if_gige(address, camera) as network_address:
        noise = NoiseNumbers(camera, run) if network_address is None else FreshNoise(camera, run)

        def begin_step(sequence: int) -> bool:
            if clock is not None:
                clock.reach(camera.busy_until_monotonic_ns)
                clock.sleep(STEP_S)
            if lit is not None:
                roof, scene = lit
                now_ns = utc_ns()
                world.show(scene.painted(roof.at(now_ns), background_share=roof.dimmed(now_ns)))
            return noise.begin_step(sequence)

        yield Simulation(
            world=world,
            camera=camera,
            stage_port=port,
            network_address=network_address,
            begin_step=begin_step,
            light=None if lit is None else lit[0].record,
        )


def _made_stage(rig: RigFile, simulation: SimulationSection) -> tuple[SimulatedStage | None, SimClock]:
    """Return the stage of a simulated rig and its clock; no stage for a camera with polarizers on its pixels."""
    if rig.stage is None:
        return None, SimClock(speed=1.0)
    options = stage_options(rig.stage.port, simulation.seed)
    clock = SimClock(speed=options.speed)
    return make_stage(options, clock=clock), clock


def _polarizers(rig: RigFile, address: str) -> tuple[MicroPolarizers | None, str]:
    """Return the polarizers on the pixels of a simulated camera, and its address without these options."""
    if rig.camera.mosaic_deg is None:
        return None, address
    name, _, options = address.partition("?")
    polarizers, rest = split_polarizers(options)
    return polarizers, f"{name}?{rest}" if rest else name


@contextmanager
def _serve_if_gige(address: str, camera: SimCamera) -> Iterator[str | None]:
    """Serve a camera as a GigE Vision camera if its address says so; give that address, or None."""
    scheme, _, tail = address.partition("?")
    if scheme != ON_NETWORK:
        yield None
        return
    faults, rest = split_faults(tail)
    serial_number = camera.identify().serial_number
    if faults.lost_share or faults.clock is not None:
        with serve_behind_network(camera, serial_number=serial_number, faults=faults) as place:
            yield f"gige:{place}?{rest}"
        return
    with serve_gige_camera(camera, address=THIS_MACHINE, serial_number=serial_number, faults=faults):
        yield f"gige:{THIS_MACHINE}?{rest}"


def _scene(rig: RigFile, *, utc_ns: Callable[[], int]) -> tuple[FloatArray, tuple["LitRoof", TexturedScene] | None]:
    """Return the radiance before the camera at the beginning [W m-2 sr-1], and the light of a scene of materials.

    The light is None if the scene file states all radiances. At night the scene is dark until the first step by day.
    """
    if rig.simulation is None:
        raise ConfigError(f"rig {rig.name}: there is no [simulation] table")
    scene, camera = load_scene(rig.simulation.scene), rig.simulation.camera
    if not scene.has_materials:
        if rig.simulation.perturb is not None:
            raise ConfigError("--perturb: is for a simulated roof, a scene whose regions have a material")
        return stated_radiance(scene, rig, camera, rig.simulation.seed), None
    from rigctl.rig.roof import LitRoof

    roof = LitRoof(scene, rig)
    inside = on_sensor(scene.regions, rig, camera)
    textured = TexturedScene(
        masks={region.name: inside[region.name] for region in scene.regions},
        background_radiance=scene.background_radiance,
        shape=(camera.height, camera.width),
        generator=np.random.default_rng([rig.simulation.seed, TEXTURE_STREAM]),
    )
    if roof.is_day(utc_ns()):
        return textured.painted(roof.at(utc_ns())), (roof, textured)
    dark = np.zeros((3, camera.height, camera.width))
    dark[0] = _NIGHT_SHARE * scene.background_radiance
    return dark, (roof, textured)


def rehearse(
    rig: RigFile, *, times_ns: Sequence[int], exposures_s: Sequence[float], regions: Sequence[Region]
) -> tuple[str, ...]:
    """Check that a session on a simulated rig can be taken; return a text on the sun of a simulated roof.

    Remarks state where sun, place or camera differ from the scene file.
    """
    if rig.simulation is None:
        return ()
    try:
        radiance, lit = _scene(rig, utc_ns=lambda: times_ns[0])
        stage, _ = _made_stage(rig, rig.simulation)
        polarizers, _ = _polarizers(rig, rig.camera.address)
        world = stated_world(rig.simulation, radiance, stage, polarizers)
        camera = stated_camera(rig.simulation, world, "rehearsal", None, None, polarizers=polarizers)
    except ValueError as error:
        raise ConfigError(f"rig {rig.name}: the simulation cannot be made: {error}") from error
    for exposure_s in exposures_s:
        camera.configure(exposure_s=exposure_s, gain_db=rig.camera.gain_db)
    width, height = frame_size(rig, rig.simulation.camera)
    masks(list(regions), width=width, height=height)
    if lit is None:
        return ()
    roof, _ = lit
    for time_ns in times_ns:
        roof.require_day(time_ns)
    changed = [] if roof.record.perturbed is None else [f"the roof is changed on purpose: {roof.record.perturbed}"]
    suns = dict.fromkeys(roof.sun_text(time_ns) for time_ns in (times_ns[0], times_ns[-1]))
    return (*roof.record.remarks, *changed, *(f"sun: {text}" for text in suns))


@contextmanager
def serve_stage(address: str, *, link: Path, truth: Path | None) -> Iterator[Callable[[], None]]:
    """Serve a simulated stage on a pseudo-terminal; give a function that logs its true angle."""
    try:
        options = parse_stage_address(address)
    except ValueError as error:
        raise ConfigError(str(error)) from error
    clock = SimClock(speed=options.speed)
    stage = make_stage(options, clock=clock)
    log = nullcontext(None) if truth is None else truth.open("w", encoding="utf-8")
    with log as opened, serve_on_pty(stage, clock=clock, link=link):
        if opened is not None:
            opened.write("time_s,angle_deg\n")

        def run() -> None:
            logged_deg = np.inf
            while True:
                angle_deg = stage.true_angle_deg()
                if opened is not None and abs(angle_deg - logged_deg) >= _SMALLEST_CHANGE_DEG:
                    opened.write(f"{clock.now_s():.3f},{angle_deg:.6f}\n")
                    opened.flush()
                    logged_deg = angle_deg
                time.sleep(_LOOK_EACH_S)

        yield run


@contextmanager
def serve_rig_camera(address: str, *, rig_path: Path | None, lost_share: float) -> Iterator[str]:
    """Serve the camera of a rig; give the port of the rig's stage, which turns the polarizer."""
    place, _, options = address.partition("?")
    faults, rest = split_faults(options)
    if rest:
        raise ConfigError(f"{address}: {rest}: no fault that the simulated camera has; docs/cameras.md lists them")
    faults = replace(faults, lost_share=lost_share or faults.lost_share)
    with as_file(files("rigctl") / "data" / "examples") as examples:
        rig = load_rig(rig_path or examples / _EXAMPLE)
        camera_section = rig.camera.model_copy(update={"address": SERVED})  # not twice on the network
        rig = rig.model_copy(update={"camera": camera_section})
        with simulate(rig, session_name="served") as simulation:
            serial_number = simulation.camera.identify().serial_number
            with _served(simulation.camera, place, serial_number=serial_number, faults=faults):
                yield simulation.stage_port or "none: the camera has polarizers on its pixels"


def _served(
    camera: Camera, place: str, *, serial_number: str, faults: GigeFaults
) -> AbstractContextManager[AravisDevice | str]:
    """Serve a camera at its address; another loopback address is a network of its own."""
    if place != THIS_MACHINE and place.startswith(_LOOPBACK):
        return serve_behind_network(camera, address=place, serial_number=serial_number, faults=faults)
    return serve_gige_camera(camera, address=place, serial_number=serial_number, faults=faults)
