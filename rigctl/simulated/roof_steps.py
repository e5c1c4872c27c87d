"""The begin of each step of a session on a simulated rig: its time passes, and the light is that of the moment."""

from collections.abc import Callable

from rigctl.simulated.lit_roof import LitRoof
from rigctl.simulated.simulated_clock import SimulatedClock
from sim_devices.camera import SimCamera
from sim_devices.textured_scene import TexturedScene
from sim_devices.world import World

BeginStep = Callable[[int], bool]

# From one frame to the next, turning and storing, as a plan of a session has it [s].
STEP_S = 0.42


def with_time(begin_step: BeginStep, camera: SimCamera, clock: SimulatedClock) -> BeginStep:
    """Return a begin of a step that lets as much time pass as a step takes."""

    def begin(sequence: int) -> bool:
        clock.reach(camera.busy_until_monotonic_ns)
        clock.sleep(STEP_S)
        return begin_step(sequence)

    return begin


def with_light(
    begin_step: BeginStep, world: World, *, roof: LitRoof, scene: TexturedScene, utc_ns: Callable[[], int]
) -> BeginStep:
    """Return a begin of a step that lights the world as it is at that moment."""

    def begin(sequence: int) -> bool:
        now_ns = utc_ns()
        world.show(scene.painted(roof.at(now_ns), background_share=roof.dimmed(now_ns)))
        return begin_step(sequence)

    return begin
