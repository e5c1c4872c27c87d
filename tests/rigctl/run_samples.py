"""Frames and runs for tests."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.runs.records import FrameRecord
from rigctl.runs.writer import RunWriter

FULL_RECORD = FrameRecord(
    kind="scene",
    sequence=7,
    cycle=1,
    polarizer_angle_target_deg=45.0,
    polarizer_angle_deg=45.00230000000001,
    stage_angle_target_deg=12.5,
    stage_angle_deg=12.502300000000002,
    stage_counts=-4977,
    exposure_s=3e-05,
    gain_db=0.1,
    egain_e_per_dn=3.7,
    bit_depth=12,
    black_level_dn=14.8,
    saturation_dn=4095.0,
    missing_dn=0.0,
    start_utc="2026-05-04T10:00:00.000000001Z",
    end_utc="2026-05-04T10:00:00.030000001Z",
    start_monotonic_ns=123456789012345,
    start_uncertainty_s=4.5e-5,
    start_source="camera clock",
    camera_model="GC780 (simulated)",
    camera_serial="Böhm's № 1",
    stage_model="ELL14",
    stage_serial="11400001",
    stage_tries=2,
    settle_s=0.31,
    camera_frame=19,
    camera_temperature_c=31.5,
    round=3,
    sun_azimuth_deg=187.123456789,
    sun_elevation_deg=-3.25,
    site_latitude_deg=51.4,
    site_longitude_deg=-0.97,
    site_elevation_m=66.5,
    source_file="/data/" + "a rather long folder/" * 12 + "it's.png",
    remarks=("button pressed", "left-justified: 12 bits in 16; counts were divided by 16 " * 3),
)


def make_record(sequence: int = 0, **facts: Any) -> FrameRecord:
    """Return a record with what a frame must have, and what else is given."""
    return replace(FrameRecord(kind="scene", sequence=sequence, bit_depth=12, saturation_dn=4095.0), **facts)


def noisy_counts(seed: int = 0, shape: tuple[int, int] = (5, 7)) -> NDArray[np.uint16]:
    """Return counts of twelve bits, all different from seed to seed."""
    return np.random.default_rng(seed).integers(0, 4096, shape, dtype=np.uint16)


def write_run(path: Path, frames: int = 3, *, is_closed: bool = True) -> Path:
    """Return a run folder with some frames at 0, 45, 90 ... degrees."""
    with RunWriter.create(path, {"origin": "simulated"}) as writer:
        for i in range(frames):
            angle_deg = 45.0 * i
            record = make_record(i, polarizer_angle_target_deg=angle_deg, polarizer_angle_deg=angle_deg + 0.002)
            writer.write_frame(record, noisy_counts(i))
        if is_closed:
            writer.closing_event("finished", frames=frames)
    return path
