"""Trial of the numbers of a region: is each standard error what it says where texture, lens, mosaic or resampling are?

Usage: python -m benchmarks.trials.rows [--seeds 200] [--first-seed 0] [--processes 2]

Regions of even polarization and of texture that is drawn anew with each seed, beside what the light was made of.
"""

import argparse
from collections import defaultdict
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np

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
# A mean or variance of scores so many of its own errors off is no chance: of 200 such numbers one in eighty trials.
_SUSPICIOUS = 4.0
# Where texture does not end within a region, errors of its counts are wide by purpose; of their ratios they are not.
_SMALL_PIXELS, _OF_COUNTS = 24, ("dn_", "s0", "s1", "s2")


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


def run_rows(seeds: int, *, first_seed: int = 0, processes: int = 2) -> bool:
    """Run the trial; return whether every row's scores are standard normal within their sampling error."""
    of_row: dict[tuple[str, int, str], list[float]] = defaultdict(list)
    with ProcessPoolExecutor(processes) as pool:
        for kind in WORLDS:
            tried = pool.map(partial(scores, kind), range(first_seed, first_seed + seeds), chunksize=10)
            for row, score in (pair for one in tried for pair in one.items()):
                of_row[row].append(score)
    suspicious = 0
    print(f"{'kind':22} {'side':>4} {'number':10} {'mean z':>7} {'var z':>7}  off by (mean, var)")
    for (kind, side, name), values in of_row.items():
        z = np.array(values)
        variance = float(z.var(ddof=1))
        off = float(z.mean() * np.sqrt(z.size / variance)), (variance - 1.0) / np.sqrt(2.0 / (z.size - 1))
        is_off = max(map(abs, off)) > _SUSPICIOUS
        is_of_counts = name.startswith(_OF_COUNTS) and not name.endswith("n")
        is_wide = is_off and is_of_counts and side <= _SMALL_PIXELS and off[1] < 0.0 and abs(off[0]) <= _SUSPICIOUS
        suspicious += is_off and not is_wide
        flag = "  (wide)" if is_wide else "  <--" if is_off else ""
        print(f"{kind:22} {side:4d} {name:10} {z.mean():+7.2f} {variance:7.3f}  {off[0]:+5.1f} {off[1]:+5.1f}{flag}")
    print(f"{suspicious} of {len(of_row)} rows are off by more than {_SUSPICIOUS:g} standard errors")
    return suspicious == 0


def main() -> int:
    """Run the trial; return 1 where it fails."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=2)
    chosen = parser.parse_args()
    return 0 if run_rows(chosen.seeds, first_seed=chosen.first_seed, processes=chosen.processes) else 1


if __name__ == "__main__":
    raise SystemExit(main())
