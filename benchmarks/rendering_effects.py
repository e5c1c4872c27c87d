"""What the simulated camera's effects cost a frame, and that one which the rig file does not name costs nothing.

Usage: python -m benchmarks.rendering_effects [--frames 40]

Every rig takes its frame in turn, round by round, so that another program's turn on the processor falls on all of
them; the medians over the rounds are compared. Two rigs without effects are timed: they show what no difference looks
like on this machine. That an effect which is not named is not called is counted, not timed.
"""

import argparse
import statistics
import sys
import time
from collections.abc import Sequence

import numpy as np

from sim_devices.camera import SimCamera
from sim_devices.exposure import (
    Detector,
    FloatArray,
    Lens,
    RenderingEffect,
    Shot,
    beam_wander,
    cosmic_hits,
    drift,
    fixed_pattern,
    point_spread,
    smear,
    vignetting,
)
from sim_devices.world import Polarizer, World

_LENS, _DETECTOR = Lens(), Detector()
_MS = 1e3


def all_effects() -> list[RenderingEffect]:
    return [
        drift(rate_per_frame=1e-5, flicker_std=1e-3),
        beam_wander(radius_px=0.4, phase_deg=10.0),
        point_spread(sigma_px=0.8),
        vignetting(_LENS, _DETECTOR),
        smear(row_transfer_us=0.05),
        cosmic_hits(rate_per_s=2.0, mean_e=500.0),
        fixed_pattern(column_offset_e=2.0, width=_DETECTOR.width, pattern_seed=1),
    ]


def camera(rendering: Sequence[RenderingEffect]) -> SimCamera:
    radiance = np.full((3, _DETECTOR.height, _DETECTOR.width), 2.0)
    radiance[0] = 30.0
    world = World(
        radiance=radiance,
        polarizer=Polarizer(transmittance_along=0.8, transmittance_across=0.0016, offset_deg=0.0, sense=1),
        stage_angle_deg=lambda: 30.0,
        flat_radiance=60.0,
    )
    made = SimCamera(world=world, lens=_LENS, detector=_DETECTOR, pattern_seed=1, noise_seed=1, rendering=rendering)
    made.configure(exposure_s=3e-5, gain_db=0.0)
    return made


def counted(effect: RenderingEffect, calls: list[str]) -> RenderingEffect:
    """The same effect, which notes that it was called."""

    def act(picture: FloatArray, shot: Shot) -> FloatArray:
        calls.append(effect.name)
        return effect.act(picture, shot)

    return RenderingEffect(name=effect.name, place=effect.place, act=act)


def frame_times_s(cameras: dict[str, SimCamera], *, frames: int) -> dict[str, list[float]]:
    spent: dict[str, list[float]] = {name: [] for name in cameras}
    for _ in range(frames):
        for name, one in cameras.items():
            begin = time.perf_counter()
            one.take_frame(timeout_s=1.0)
            spent[name].append(time.perf_counter() - begin)
    return spent


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=40)
    arguments = parser.parse_args()
    calls: list[str] = []
    effects = [counted(effect, calls) for effect in all_effects()]
    rigs: dict[str, list[RenderingEffect]] = {"no effect": [], "no effect again": []}
    rigs |= {effect.name: [effect] for effect in effects} | {"all": effects}
    spent = frame_times_s({name: camera(rendering) for name, rendering in rigs.items()}, frames=arguments.frames)
    bare = statistics.median(spent["no effect"])
    for name, times in spent.items():
        median = statistics.median(times)
        print(f"{name:18} {median * _MS:7.2f} ms a frame {(median - bare) * _MS:+7.2f} ms")
    expected = sum(len(rendering) for rendering in rigs.values()) * arguments.frames
    print(f"calls of effects: {len(calls)}; those of the rigs that name them: {expected}")
    return 0 if len(calls) == expected else 1


if __name__ == "__main__":
    sys.exit(main())
