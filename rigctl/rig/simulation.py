"""A simulated rig, made of a rig file: one world, seen by the stage through bytes and by the camera through light.

A session can be rehearsed before it is taken, and the time of each effect on a picture measured.
"""

import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigctl.base.numbers import NS_PER_S
from rigctl.errors import ConfigError
from rigctl.files.choices import RoofChange
from rigctl.files.regions import Region, masks
from rigctl.files.rig_file import RigFile, SimulatedCamera, SimulationSection
from rigctl.files.scene_file import SceneFile, load_scene
from rigctl.rig.simulated_parts import (
    ON_NETWORK,
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
from sim_devices.cameras.gige_server import serve_behind_network, serve_gige_camera
from sim_devices.clock import SimClock
from sim_devices.exposure import Place, RenderingEffect, Shot
from sim_devices.micro_polarizers import MicroPolarizers
from sim_devices.stages.catalogue import make_stage
from sim_devices.stages.stage import SimulatedStage, serve_on_pty
from sim_devices.world import TexturedScene, World

if TYPE_CHECKING:
    from rigctl.rig.roof import LitRoof

FloatArray = NDArray[np.float64]

Clock = Callable[[], float]


@dataclass(frozen=True, kw_only=True)
class RenderingCost:
    """What an effect that a rig file names costs a frame."""

    effect: str  #: Its name, and where in the chain it acts.
    place: Place
    cost_s: float  #: Median over the frames [s].


@dataclass(frozen=True, kw_only=True)
class RenderingCosts:
    """Costs of all effects that a rig file names, in its order, and of a whole frame beside them [s]."""

    costs: tuple[RenderingCost, ...]
    frame_s: float
    frames: int


@dataclass(kw_only=True)
class _Timed:
    """An effect that notes how long each of its calls took."""

    effect: RenderingEffect
    clock: Clock
    taken_s: list[float] = field(default_factory=list)

    def act(self, picture: FloatArray, shot: Shot) -> FloatArray:
        begin = self.clock()
        found = self.effect.act(picture, shot)
        self.taken_s.append(self.clock() - begin)
        return found


def rendering_costs(
    simulation: SimulationSection, *, frames: int = 9, clock: Clock = time.perf_counter
) -> RenderingCosts:
    """Return what each effect that a rig file names costs a frame.

    The picture is even: no effect takes more or less time for what is in it. An effect that is not named is not called.
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
    timed: list[_Timed] = []

    def noting(effect: RenderingEffect) -> RenderingEffect:
        timed.append(_Timed(effect=effect, clock=clock))
        return replace(effect, act=timed[-1].act)

    camera = stated_camera(simulation, world, "costs", None, None, wrapped=noting)
    camera.configure(exposure_s=1e-4, gain_db=0.0)
    whole_s = []
    for _ in range(frames + 1):
        begin = clock()
        camera.take_frame(timeout_s=10.0)
        whole_s.append(clock() - begin)
    costs = (
        RenderingCost(effect=one.effect.name, place=one.effect.place, cost_s=statistics.median(one.taken_s[1:]))
        for one in timed
    )
    return RenderingCosts(costs=tuple(costs), frame_s=statistics.median(whole_s[1:]), frames=frames)


# Of the background's radiance, where a session's clock begins at night: hardly a photon.
_NIGHT_SHARE = 1e-6
# From one frame to the next, turning and storing, as a plan of a session has it [s].
STEP_S = 0.42

BeginStep = Callable[[int], bool]


@dataclass(frozen=True, kw_only=True, eq=False)
class Simulation:
    """The simulated part of a rig."""

    world: World  #: What stands in front of the camera.
    camera: SimCamera  #: Looks at it.
    #: Pseudo-terminal on which the simulated stage answers; None where the camera has polarizers on its pixels.
    stage_port: str | None
    #: Address of the camera for its driver, where it is served as a GigE Vision camera; None where it is not.
    network_address: str | None
    #: To be told, by its sequence number, of each step before its first frame: the noise of frames hangs on it. Says
    #: whether the numbers of the camera's frames jump there. Simulated time passes there, and the light moves.
    begin_step: Callable[[int], bool]
    #: What lights a scene of materials; None where the scene file states every radiance.
    light: SimulatedLight | None = None


def with_simulation(rig: RigFile, *, clock_ns: int | None, perturb: RoofChange | None) -> RigFile:
    """Return a rig file whose simulation has another clock, or a roof that was changed; None leaves what it says."""
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
    """Return which devices are real, on the network, or those of a record."""
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
    """Give the simulated stage, camera and world of a rig file until the context is left."""
    if rig.simulation is None:
        raise ConfigError(f"rig {rig.name}: there is no [simulation] table")
    require_known_camera(rig.camera.address, is_mosaic=rig.camera.mosaic_deg is not None)
    try:
        stage, stage_clock = _made_stage(rig, rig.simulation)
        seen = seen_scene(rig, utc_ns=time.time_ns if clock is None else clock.utc_ns)
        address, log = split_truth(rig.camera.address)
        polarizers, address = _polarizers(rig, address)
        world = stated_world(rig.simulation, seen.radiance, stage, polarizers)
        camera = stated_camera(rig.simulation, world, session_name, log, clock, polarizers=polarizers)
    except ValueError as error:
        raise ConfigError(f"rig {rig.name}: the simulation cannot be made: {error}") from error
    served = nullcontext(None) if stage is None else serve_on_pty(stage, clock=stage_clock)
    with served as port, camera, _serve_if_gige(address, camera) as network_address:
        noise = NoiseNumbers(camera, run) if network_address is None else FreshNoise(camera, run)
        yield Simulation(
            world=world,
            camera=camera,
            stage_port=port,
            network_address=network_address,
            begin_step=_begin_step(noise.begin_step, world, camera, seen, clock),
            light=None if seen.roof is None else seen.roof.record,
        )


def _made_stage(rig: RigFile, simulation: SimulationSection) -> tuple[SimulatedStage | None, SimClock]:
    """Return the stage of a simulated rig and its clock; no stage where the camera has polarizers on its pixels."""
    if rig.stage is None:
        return None, SimClock(speed=1.0)
    options = stage_options(rig.stage.port, simulation.seed)
    clock = SimClock(speed=options.speed)
    return make_stage(options, clock=clock), clock


def _polarizers(rig: RigFile, address: str) -> tuple[MicroPolarizers | None, str]:
    """Return the polarizers on the pixels of a simulated camera, and its address without what is said of them."""
    if rig.camera.mosaic_deg is None:
        return None, address
    name, _, options = address.partition("?")
    polarizers, rest = split_polarizers(options)
    return polarizers, f"{name}?{rest}" if rest else name


def _begin_step(
    begin_step: BeginStep, world: World, camera: SimCamera, seen: "SeenScene", clock: SimulatedClock | None
) -> BeginStep:
    if seen.roof is not None and seen.textured is not None:
        utc_ns = time.time_ns if clock is None else clock.utc_ns
        begin_step = _with_light(begin_step, world, roof=seen.roof, scene=seen.textured, utc_ns=utc_ns)
    return begin_step if clock is None else _with_time(begin_step, camera, clock)


def _with_time(begin_step: BeginStep, camera: SimCamera, clock: SimulatedClock) -> BeginStep:
    """Return a begin of a step that lets as much time pass as a step takes."""

    def begin(sequence: int) -> bool:
        clock.reach(camera.busy_until_monotonic_ns)
        clock.sleep(STEP_S)
        return begin_step(sequence)

    return begin


def _with_light(
    begin_step: BeginStep, world: World, *, roof: "LitRoof", scene: TexturedScene, utc_ns: Callable[[], int]
) -> BeginStep:
    """Return a begin of a step that lights the world as it is at that moment."""

    def begin(sequence: int) -> bool:
        now_ns = utc_ns()
        world.show(scene.painted(roof.at(now_ns), background_share=roof.dimmed(now_ns)))
        return begin_step(sequence)

    return begin


@contextmanager
def _serve_if_gige(address: str, camera: SimCamera) -> Iterator[str | None]:
    """Give where a camera is served as a GigE Vision camera, until the context is left; None for another address."""
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


@dataclass(frozen=True, kw_only=True, eq=False)
class SeenScene:
    """What the camera looks at."""

    radiance: FloatArray  #: At the beginning [W m-2 sr-1].
    #: What computes and what paints the light of a scene of materials; None where its radiances are stated.
    roof: "LitRoof | None" = None
    textured: TexturedScene | None = None


def seen_scene(rig: RigFile, *, utc_ns: Callable[[], int]) -> SeenScene:
    """Return what the camera of a simulated rig looks at."""
    if rig.simulation is None:
        raise ConfigError(f"rig {rig.name}: there is no [simulation] table")
    scene, camera = load_scene(rig.simulation.scene), rig.simulation.camera
    if not scene.has_materials:
        if rig.simulation.perturb is not None:
            raise ConfigError("--perturb: is for a simulated roof, a scene whose regions have a material")
        return SeenScene(radiance=stated_radiance(scene, rig, camera, rig.simulation.seed))
    from rigctl.rig.roof import LitRoof

    roof = LitRoof(scene, rig)
    inside = on_sensor(scene.regions, rig, camera)
    textured = TexturedScene(
        masks={region.name: inside[region.name] for region in scene.regions},
        background_radiance=scene.background_radiance,
        shape=(camera.height, camera.width),
        generator=np.random.default_rng([rig.simulation.seed, TEXTURE_STREAM]),
    )
    radiance = textured.painted(roof.at(utc_ns())) if roof.is_day(utc_ns()) else _night(scene, camera)
    return SeenScene(radiance=radiance, roof=roof, textured=textured)


def _night(scene: SceneFile, camera: SimulatedCamera) -> FloatArray:
    """Return a dark world, until the first step is taken by day."""
    radiance = np.zeros((3, camera.height, camera.width))
    radiance[0] = _NIGHT_SHARE * scene.background_radiance
    return radiance


def made_camera(rig: RigFile, seen: SeenScene, *, session_name: str) -> SimCamera:
    """Return the camera of a simulated rig before its scene, without anything that turns."""
    if rig.simulation is None:
        raise ConfigError(f"rig {rig.name}: there is no [simulation] table")
    stage, _ = _made_stage(rig, rig.simulation)
    polarizers, _ = _polarizers(rig, rig.camera.address)
    world = stated_world(rig.simulation, seen.radiance, stage, polarizers)
    return stated_camera(rig.simulation, world, session_name, None, None, polarizers=polarizers)


def rehearse(
    rig: RigFile, *, times_ns: Sequence[int], exposures_s: Sequence[float], regions: Sequence[Region]
) -> tuple[str, ...]:
    """Return in words under which sun each round of a simulated roof is seen, and where it is not that of its scene."""
    if rig.simulation is None:
        return ()
    try:
        seen = seen_scene(rig, utc_ns=lambda: times_ns[0])
        camera = made_camera(rig, seen, session_name="rehearsal")
    except ValueError as error:
        raise ConfigError(f"rig {rig.name}: the simulation cannot be made: {error}") from error
    for exposure_s in exposures_s:
        camera.configure(exposure_s=exposure_s, gain_db=rig.camera.gain_db)
    width, height = frame_size(rig, rig.simulation.camera)
    masks(list(regions), width=width, height=height)
    roof = seen.roof
    if roof is None:
        return ()
    for time_ns in times_ns:
        roof.require_day(time_ns)
    said = [] if roof.record.perturbed is None else [f"the roof is changed on purpose: {roof.record.perturbed}"]
    suns = dict.fromkeys(roof.sun_text(time_ns) for time_ns in (times_ns[0], times_ns[-1]))
    return (*roof.record.remarks, *said, *(f"sun: {text}" for text in suns))
