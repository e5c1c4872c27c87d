"""Pointing: simulated cameras and panels of known direction; how often do the stated intervals hold the truth?"""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainc, ndtri

from calibration.pointing.pose import (
    Lens,
    SunSeen,
    camera_axes,
    compass,
    fuse,
    joint_covariance,
    level,
    panel_stands,
    panel_tilt,
    positions,
    sun_in_picture,
    wrapped_rad,
)
from rigctl.files.scene_file import load_scene
from rigctl.prediction.predict import NumberKey, ScenePredictor, propagate_numbers
from tests.rigctl.scene_texts import SCENE, written

FloatArray = NDArray[np.float64]
WIDTH, HEIGHT = 782, 582
FOCAL_PX = 1500.0
LENS_STD = np.array([3.0, 3.0, 4.0, 4.0, 0.0, 0.0, 0.0, 0.0])
CORNER_STD_PX = 0.3
POINTED = (
    "geometry.camera_zenith_deg",
    "regions.paint.tilt_deg",
    "geometry.camera_azimuth_deg",
    "regions.paint.tilt_azimuth_deg",
)
STATISTICS = ("s0", "s1n", "s2n", "dolp")


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
    std = np.radians([3.0, 0.4, 0.2])
    declination, declination_std = 0.2, np.radians(0.5)
    reading = angles[0] - declination + declination_std * draws.standard_normal() + std[0] * draws.standard_normal()
    tilted = angles[1:] + std[1] * draws.standard_normal(2)
    target = 30.0 * forward
    of_place = np.array([0.5, 0.5, 0.3])
    leaning_tilt, leaning_azimuth = draws.uniform(0.3, 0.8), angles[0] + np.pi + draws.uniform(-0.7, 0.7)
    leaning = panel_corners(28.0 * forward, leaning_tilt, leaning_azimuth, draws.uniform(0, 6), np.array([3.0, 2.0]))

    def pictured(points: FloatArray) -> FloatArray:
        return seen(points, angles, true) + CORNER_STD_PX * draws.standard_normal((len(points), 2))

    sources = {
        "compass": compass(reading, std[0], declination_rad=declination, declination_std_rad=declination_std),
        "level": level(tilted[0], tilted[1], std[1]),
        "positions": positions(target + of_place * draws.standard_normal(3), of_place),
    }
    toward = np.append(angles[0] + draws.uniform(-0.15, 0.15), 0.0)
    looking_up = np.array([toward[0], draws.uniform(0.3, 0.8), angles[2]])
    high = SunSeen(azimuth_rad=angles[0], elevation_rad=looking_up[1] + draws.uniform(-0.1, 0.1), std_rad=0.0)
    at = seen(high.vector[None, :], looking_up, true)[0] + CORNER_STD_PX * draws.standard_normal(2)
    held = looking_up[1:] + std[1] * draws.standard_normal(2)
    up = fuse([sun_in_picture(at, CORNER_STD_PX, high, stated), level(held[0], held[1], std[1])], stated.covariance)
    yield "azimuth by sun and level", float(wrapped_rad(up.angles_rad - looking_up)[0] / up.std_rad[0])
    for name, chosen in (
        ("compass, level", ("compass", "level")),
        ("all", tuple(sources)),
    ):
        found = fuse([sources[one] for one in chosen], stated.covariance)
        off = wrapped_rad(found.angles_rad - angles) / found.std_rad
        yield from zip((f"{name}: azimuth", f"{name}: elevation", f"{name}: roll"), off.tolist(), strict=True)
        yield f"{name}: contradictions", float(bool(found.contradictions))
    stands = panel_stands(pictured(leaning), 3.0, 2.0, CORNER_STD_PX, stated)
    tilts = [panel_tilt(stand, found) for stand in stands]
    best = min(tilts, key=lambda one: abs(one.tilt_rad - leaning_tilt))
    yield "tilt of a panel", (best.tilt_rad - leaning_tilt) / best.tilt_std_rad
    turned = wrapped_rad(np.array([best.azimuth_rad - leaning_azimuth]))[0]
    yield "azimuth of a panel", float(turned / best.azimuth_std_rad)
    yield "two stands", float(len(stands) > 1)
    errors = np.array([*(found.angles_rad - angles), best.tilt_rad - leaning_tilt, turned])
    errors[[0, 2]] = wrapped_rad(errors[[0, 2]])
    chi_square = errors @ np.linalg.solve(joint_covariance(found, [best]), errors)
    # As a standard score: what a normal number exceeds as seldom as five of them this chi-square.
    yield "camera and panel together", float(ndtri(0.5 + 0.5 * gammainc(2.5, 0.5 * chi_square)))


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


def run_pointing(*, seeds: int = 200) -> bool:
    """Print the table; return whether intervals hold the truth as often as they say, within four sampling errors."""
    print(f"{seeds} seeds: share within one and 1.96 standard uncertainties (0.683, 0.950 expected), rms of z")
    found = coverage(range(seeds))
    for name, (one, two, rms) in found.items():
        print(f"{name:<32} {one:.3f}  {two:.3f}  {rms:.2f}")
    numbers = [row for name, row in found.items() if "contradictions" not in name and name != "two stands"]
    return all(two > 0.95 - 4.0 * np.sqrt(0.95 * 0.05 / seeds) for _, two, _ in numbers)


def pointing_predictor(folder: Path, correlation: float) -> ScenePredictor:
    """Return a leaning black panel under a fast sky, whose tilt and azimuth are off together with the camera's."""
    alone = "[[regions]]".join(SCENE.split("[[regions]]")[:2]).replace("wavelengths = 2", "wavelengths = 1")
    angles = alone.replace("camera_zenith_deg = 50.0", "camera_zenith_deg = { value = 50.0, std = 2.0 }")
    angles = angles.replace("camera_azimuth_deg = 0.0", "camera_azimuth_deg = { value = 0.0, std = 3.0 }")
    tilt = "tilt_deg = { value = 20.0, std = 2.5 }\ntilt_azimuth_deg = { value = 10.0, std = 4.0 }"
    angles = angles.replace('material = "black-paint"', f'material = "black-paint"\n{tilt}')
    rows = np.eye(4)
    rows[[0, 1, 2, 3], [1, 0, 3, 2]] = correlation
    text = f"{angles}[pointing]\nparameters = {json.dumps(POINTED)}\ncorrelation = {rows.tolist()}\n"
    return ScenePredictor(load_scene(written(folder, text)), None)


def propagated(predictor: ScenePredictor) -> FloatArray:
    """Return the standard uncertainties that the angles alone make of `STATISTICS` of the panel."""
    uncertain = np.isin(predictor.inputs.names, POINTED)
    inputs = replace(predictor.inputs, cov=predictor.inputs.cov * np.outer(uncertain, uncertain))
    found = propagate_numbers(
        _numbers(predictor, {}), inputs, lambda values: predictor.predictions_of(inputs.at(values))
    )
    return np.asarray(np.sqrt(np.diag(found.cov)))


def drawn(predictor: ScenePredictor, draws: int) -> FloatArray:
    """Return their root mean square deviations over draws from the joint law, in pairs on either side."""
    inputs, base = predictor.inputs, np.array(list(_numbers(predictor, {}).values()))
    places = [inputs.names.index(key) for key in POINTED]
    root = np.linalg.cholesky(inputs.cov[np.ix_(places, places)])
    scores = np.random.default_rng(1).standard_normal((draws // 2, len(POINTED)))
    off = []
    for score in np.concatenate([scores, -scores]):
        values = inputs.values[places] + root @ score
        off.append(list(_numbers(predictor, dict(zip(POINTED, values.tolist(), strict=True))).values()) - base)
    return np.asarray(np.sqrt(np.mean(np.square(off), axis=0)))


def _numbers(predictor: ScenePredictor, changed: dict[str, float]) -> dict[NumberKey, float]:
    quantities = predictor.predictions(changed)["paint"].quantities
    return {NumberKey("paint", name, "mean"): quantities[name]["mean"] for name in STATISTICS}
