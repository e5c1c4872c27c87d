"""Trial of the numbers of a region: is each standard error what it says where texture, lens, mosaic or resampling are?

Regions of even polarization and of texture that is drawn anew with each seed, beside what the light was made of.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from benchmarks.trials.harness import are_normal, by_row, over
from model.processing.reconstruction import design
from model.processing.samples import repeated
from rigctl.measure.measure import measure_region, measured_with_ratios
from tests.worldlike import Faults, World, expose, light

_EVEN = World(scene="grain", polarized=0.3, is_evenly_polarized=True, height=112, width=112, texture=0.2)
WORLDS: Mapping[str, World] = {
    "plain": replace(_EVEN, texture=0.0, blur_pixels=0.0),
    "textured": replace(_EVEN, texture_pixels=1.5),
    "coarse texture": replace(_EVEN, texture_pixels=4.0),
    "blurred": replace(_EVEN, texture=0.05, blur_pixels=3.0),
    "demosaiced": replace(_EVEN, blur_pixels=0.5, is_demosaiced=True),
    "resampled": replace(_EVEN, resampled_deg=3.0),
    "demosaiced, resampled": replace(_EVEN, texture=0.03, is_demosaiced=True, resampled_deg=-2.0, polarized=0.8),
}
# Side of the regions, in the middle of the picture [pixels].
SIDES_PIXELS = (24, 64)


def scores(kind: str, seed: int) -> dict[tuple[str, int, str], float]:
    """Return how many standard errors each number of each region is off, by kind, side of the region and number."""
    world = WORLDS[kind]
    _, share, axis = light(world, np.random.default_rng([seed, 5, *kind.encode()]))
    frames = expose(world, Faults(), np.random.default_rng([seed, 5, *kind.encode()])).astype(np.float64)
    plan = design(np.radians(world.angles_deg))
    stokes = 0.45 * world.full_scale_dn * np.array([1.0, *(share[0, 0] * _of_axis(2.0 * axis[0, 0]))])
    channels = plan.system @ stokes
    truth = dict(zip(("s0", "s1", "s2"), stokes, strict=True))
    truth |= {"s1n": stokes[1] / stokes[0], "s2n": stokes[2] / stokes[0]}
    truth |= {"dolp": share[0, 0], "aolp_deg": np.degrees(axis[0, 0])}
    names = tuple(f"dn_{angle:g}" for angle in world.angles_deg)
    truth |= dict(zip(names, channels, strict=True))
    truth |= {name.replace("dn", "ratio"): one / channels.mean() for name, one in zip(names, channels, strict=True)}
    found = {}
    for side in SIDES_PIXELS:
        inside = np.zeros(frames.shape[1:], dtype=np.bool_)
        inside[56 - side // 2 : 56 + side // 2, 56 - side // 2 : 56 + side // 2] = True
        region = measure_region(
            name="region",
            pixels=repeated(frames[None][:, :, inside], plan.inverse),
            inside=inside,
            excluded=0,
            edge=0,
            channel_names=names,
            plan=plan,
            level_std_error=np.zeros(len(names)),
            relative_error=np.zeros(len(names)),
        )
        for name, statistics in measured_with_ratios(region).items():
            if name in truth and "mean" in statistics:
                off = statistics["mean"].value - truth[name]
                off = (off + 90.0) % 180.0 - 90.0 if name == "aolp_deg" else off
                found[kind, side, name] = float(off / statistics["mean"].std_error)
    return found


def _of_axis(angle_rad: float) -> np.ndarray:
    return np.array([np.cos(angle_rad), np.sin(angle_rad)])


def run_rows(*, seeds: int = 200, first_seed: int = 0) -> bool:
    """Measure regions of every kind and compare them with what the light was made of."""
    found = [
        one for kind in WORLDS for one in over(partial(scores, kind), range(first_seed, first_seed + seeds), chunk=10)
    ]
    return are_normal("kind, side of the region, number", by_row(found), may_be_small=_is_wide_on_purpose)


def _is_wide_on_purpose(row: tuple[object, ...]) -> bool:
    """Return whether the row is of counts in a region within which the texture does not end."""
    _, side, name = row
    return side == SIDES_PIXELS[0] and str(name).startswith(("dn_", "s0", "s1", "s2")) and not str(name).endswith("n")
