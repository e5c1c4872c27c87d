"""Pointing: simulated cameras and panels of known direction; how often the stated intervals hold the truth.

``python -m benchmarks.trial_pointing --seeds 200``
"""

import argparse
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from calibration.pointing.camera_pose import camera_axes, direction, fuse, wrapped_rad
from calibration.pointing.lens import Lens
from calibration.pointing.panel_pose import panel_stands, panel_tilt
from calibration.pointing.sources import SunSeen, compass, level, level_panel, positions, shadow, sun_in_picture

FloatArray = NDArray[np.float64]
WIDTH, HEIGHT = 782, 582
FOCAL_PX = 1500.0
LENS_STD = np.array([3.0, 3.0, 4.0, 4.0, 0.0, 0.0, 0.0, 0.0])
CORNER_STD_PX = 0.3


def true_lens(draws: np.random.Generator) -> tuple[Lens, Lens]:
    """Return the lens that pictures are taken with, and what a calibration says of it."""
    stated = np.array([FOCAL_PX, FOCAL_PX, 0.5 * (WIDTH - 1), 0.5 * (HEIGHT - 1), -0.1, 0.02, 0.0, 0.0])
    covariance = np.diag(LENS_STD**2)
    true = stated + LENS_STD * draws.standard_normal(8)
    return Lens(parameters=true, covariance=covariance), Lens(parameters=stated, covariance=covariance)


def seen(vectors: FloatArray, angles: FloatArray, lens: Lens) -> FloatArray:
    """Return where directions or places from the camera (east, north, up) appear in its picture; by OpenCV's model."""
    fx, fy, cx, cy, k1, k2, p1, p2 = lens.parameters
    right, down, forward = camera_axes(angles) @ vectors.T
    x, y = right / forward, down / forward
    r2 = x**2 + y**2
    radial = 1.0 + k1 * r2 + k2 * r2**2
    xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x**2)
    yd = y * radial + p1 * (r2 + 2.0 * y**2) + 2.0 * p2 * x * y
    return np.column_stack((fx * xd + cx, fy * yd + cy))


def panel_corners(centre: FloatArray, tilt: float, azimuth: float, spin: float, size: FloatArray) -> FloatArray:
    """Return the corners of a panel from the camera [m], east, north, up."""
    normal = np.array([np.sin(azimuth) * np.sin(tilt), np.cos(azimuth) * np.sin(tilt), np.cos(tilt)])
    along = np.cross(normal, [np.sin(spin), np.cos(spin), 0.3])
    along /= np.linalg.norm(along)
    beside = np.cross(normal, along)
    return centre + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * 0.5 * size @ np.array([along, beside])


def deviations(seed: int) -> Iterator[tuple[str, float]]:
    """Give each number's deviation from the truth in its own standard uncertainties, for one drawn rig."""
    draws = np.random.default_rng(seed)
    true, stated = true_lens(draws)
    angles = np.array([draws.uniform(0, 2 * np.pi), draws.uniform(-1.0, -0.35), draws.uniform(-0.1, 0.1)])
    forward = camera_axes(angles)[2]
    sun_azimuth, sun_elevation = draws.uniform(0, 2 * np.pi), draws.uniform(0.3, 1.2)
    sun = SunSeen(azimuth_rad=sun_azimuth, elevation_rad=sun_elevation, std_rad=0.0)
    std = np.radians([3.0, 0.4, 0.2])
    declination, declination_std = 0.2, np.radians(0.5)
    reading = angles[0] - declination + declination_std * draws.standard_normal() + std[0] * draws.standard_normal()
    tilted = angles[1:] + std[1] * draws.standard_normal(2)
    target = 30.0 * forward
    of_place = np.array([0.5, 0.5, 0.3])
    lying = panel_corners(
        32.0 * forward, std[2] * draws.standard_normal(), draws.uniform(0, 6), draws.uniform(0, 6), np.array([3.0, 2.0])
    )
    leaning_tilt, leaning_azimuth = draws.uniform(0.3, 0.8), angles[0] + np.pi + draws.uniform(-0.7, 0.7)
    leaning = panel_corners(28.0 * forward, leaning_tilt, leaning_azimuth, draws.uniform(0, 6), np.array([3.0, 2.0]))
    rod = 30.0 * forward + np.array([[0.0, 0.0, 0.0], -2.0 * direction(sun_azimuth, 0.0)])

    def pictured(points: FloatArray) -> FloatArray:
        return seen(points, angles, true) + CORNER_STD_PX * draws.standard_normal((len(points), 2))

    likeliest = panel_stands(pictured(lying), 3.0, 2.0, CORNER_STD_PX, stated)
    vertical = camera_axes(angles) @ np.array([0.0, 0.0, 1.0])
    lies = max(likeliest, key=lambda stand: float(stand.normal @ vertical))
    foot, tip = pictured(rod)
    sources = {
        "compass": compass(reading, std[0], declination_rad=declination, declination_std_rad=declination_std),
        "level": level(tilted[0], tilted[1], std[1]),
        "positions": positions(target + of_place * draws.standard_normal(3), of_place),
        "panel": level_panel("white", lies.normal, lies.covariance, std[2]),
        "shadow": shadow(foot, tip, CORNER_STD_PX, sun, stated),
    }
    toward = np.append(angles[0] + draws.uniform(-0.15, 0.15), 0.0)
    looking_up = np.array([toward[0], draws.uniform(0.3, 0.8), angles[2]])
    high = SunSeen(azimuth_rad=angles[0], elevation_rad=looking_up[1] + draws.uniform(-0.1, 0.1), std_rad=0.0)
    at = seen(high.vector[None, :], looking_up, true)[0] + CORNER_STD_PX * draws.standard_normal(2)
    held = looking_up[1:] + std[1] * draws.standard_normal(2)
    up = fuse([sun_in_picture(at, CORNER_STD_PX, high, stated), level(held[0], held[1], std[1])])
    yield "azimuth by sun and level", float(wrapped_rad(up.angles_rad - looking_up)[0] / up.std_rad[0])
    for name, chosen in (
        ("compass, level", ("compass", "level")),
        ("shadow, level", ("shadow", "level")),
        ("shadow, panel", ("shadow", "panel")),
        ("all", tuple(sources)),
    ):
        found = fuse([sources[one] for one in chosen])
        off = wrapped_rad(found.angles_rad - angles) / found.std_rad
        yield from zip((f"{name}: azimuth", f"{name}: elevation", f"{name}: roll"), off.tolist(), strict=True)
        yield f"{name}: contradictions", float(bool(found.contradictions))
    stands = panel_stands(pictured(leaning), 3.0, 2.0, CORNER_STD_PX, stated)
    tilts = [panel_tilt(stand, found.angles_rad, found.covariance) for stand in stands]
    best = min(tilts, key=lambda one: abs(one.tilt_rad - leaning_tilt))
    yield "tilt of a panel", (best.tilt_rad - leaning_tilt) / best.tilt_std_rad
    turned = wrapped_rad(np.array([best.azimuth_rad - leaning_azimuth]))[0]
    yield "azimuth of a panel", float(turned / best.azimuth_std_rad)
    yield "two stands", float(len(stands) > 1)


def coverage(seeds: range) -> dict[str, tuple[float, float, float]]:
    """Return for each number how often one and two standard uncertainties hold the truth, and the rms of z."""
    rows: dict[str, list[float]] = {}
    for seed in seeds:
        for name, value in deviations(seed):
            rows.setdefault(name, []).append(value)
    return {
        name: (
            float(np.mean(np.abs(values) < 1.0)),
            float(np.mean(np.abs(values) < 1.96)),
            float(np.sqrt(np.mean(np.square(values)))),
        )
        for name, values in rows.items()
    }


def run_pointing(seeds: int) -> bool:
    """Print the table; return whether intervals hold the truth as often as they say, within four sampling errors."""
    print(f"{seeds} seeds: share within one and 1.96 standard uncertainties (0.683, 0.950 expected), rms of z")
    found = coverage(range(seeds))
    for name, (one, two, rms) in found.items():
        print(f"{name:<32} {one:.3f}  {two:.3f}  {rms:.2f}")
    numbers = [row for name, row in found.items() if "contradictions" not in name and name != "two stands"]
    return all(two > 0.95 - 4.0 * np.sqrt(0.95 * 0.05 / seeds) for _, two, _ in numbers)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=200)
    raise SystemExit(0 if run_pointing(parser.parse_args().seeds) else 1)
