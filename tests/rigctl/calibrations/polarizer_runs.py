"""Runs of a simulated polarizer scan with known truth, by Malus' law and a little noise."""

from collections.abc import Sequence
from math import cos, radians
from pathlib import Path

import numpy as np

from rigctl.runs.writer import RunWriter
from tests.rigctl.run_samples import make_record

SENSE, OFFSET_DEG, DIATTENUATION, DOLP = -1, 22.5, 0.996, 0.995
BLACK_DN = 60.0
SHAPE = (20, 30)
STAGE_DEG = (0.0, 45.0, 90.0, 135.0)
GENERATOR_DEG = tuple(float(angle) for angle in range(0, 360, 10))


def transmitted(stage_deg: float, light_deg: float) -> float:
    axis_deg = SENSE * stage_deg + OFFSET_DEG
    return 0.5 * (1.0 + DIATTENUATION * DOLP * cos(radians(2.0 * (axis_deg - light_deg))))


def write_scan(
    path: Path,
    pairs: Sequence[tuple[float, float, int]],
    *,
    dark: bool = True,
    peak_dn: float = 3000.0,
    landing_deg: float = 0.0,
    hot_pixels: int = 0,
) -> Path:
    """Return a run of one frame for each (stage angle, direction of the light, cycle), and four dark frames.

    The stage lands by `landing_deg` (rms) beside its target and reads that back.
    """
    draws = np.random.default_rng(1)
    with RunWriter.create(path, {"origin": "simulated"}) as writer:
        for stage_deg, light_deg, cycle in pairs:
            signal = peak_dn * transmitted(stage_deg, light_deg) + 20.0 * draws.standard_normal(SHAPE)
            counts = np.clip(np.rint(BLACK_DN + signal), 0, 4095).astype(np.uint16)
            counts[0, :hot_pixels] = 4095
            landed_deg = (stage_deg + 0.001 + landing_deg * draws.standard_normal()) % 360.0
            writer.write_frame(
                make_record(writer.next_sequence, stage_angle_deg=landed_deg, cycle=cycle, exposure_s=0.01), counts
            )
        for _ in range(4 if dark else 0):
            counts = np.rint(BLACK_DN + 3.0 * draws.standard_normal(SHAPE)).astype(np.uint16)
            writer.write_frame(make_record(writer.next_sequence, kind="dark", exposure_s=0.01), counts)
    return path


def write_generator_run(path: Path, *, dark: bool = True) -> Path:
    return write_scan(
        path, [(stage, light, cycle) for cycle, light in enumerate(GENERATOR_DEG) for stage in STAGE_DEG], dark=dark
    )


def write_reference_run(path: Path, reference_deg: float, *, peak_dn: float = 3000.0) -> Path:
    return write_scan(path, [(10.0 * step, reference_deg, 0) for step in range(36)], peak_dn=peak_dn)
