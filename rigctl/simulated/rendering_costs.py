"""Time that each effect of a simulated camera's pictures takes, measured on a picture of its size."""

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.files.simulation_sections import SimulationSection
from rigctl.simulated.stated_parts import stated_camera, stated_polarizer
from sim_devices.rendering.effect import Place, RenderingEffect, Shot
from sim_devices.world import World

FloatArray = NDArray[np.float64]

Clock = Callable[[], float]


@dataclass(frozen=True, kw_only=True)
class RenderingCost:
    """What an effect that a rig file names costs a frame.

    Attributes
    ----------
    effect, place
        Its name, and where in the chain it acts.
    cost_s
        Median over the frames [s].
    """

    effect: str
    place: Place
    cost_s: float


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

    Parameters
    ----------
    simulation : SimulationSection
        The simulated rig.
    frames : int
        Of which the medians are taken, 1 or more; one more is taken before them, for what is made but once.
    clock : callable
        Seconds, rising.

    Notes
    -----
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
