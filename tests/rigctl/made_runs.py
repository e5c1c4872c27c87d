"""Runs made of given counts, for tests."""

from pathlib import Path

import numpy as np

from rigctl.runs.folder import Run, read_run
from rigctl.runs.records import FrameRecord
from rigctl.runs.writer import RunWriter


def make_run(
    path: Path, frames: list[tuple[dict[str, object], np.ndarray]], *, session: dict[str, object] | None = None
) -> Run:
    """Return a run of the frames, each given by what differs from a plain 12-bit scene frame, and its counts."""
    with RunWriter.create(path, {"origin": "import"} if session is None else session) as writer:
        for sequence, (facts, counts) in enumerate(frames):
            known = {"kind": "scene", "sequence": sequence, "bit_depth": 12, "saturation_dn": 4095.0} | facts
            writer.write_frame(FrameRecord(**known), np.asarray(counts, dtype=np.uint16))
        writer.closing_event("finished", frames=len(frames))
    return read_run(path)


def at(angle_deg: float, **facts: object) -> dict[str, object]:
    """Return what a scene frame at a polarizer angle says, with a black level of 0 unless another is given."""
    return {"polarizer_angle_target_deg": angle_deg, "polarizer_angle_deg": angle_deg, "black_level_dn": 0.0} | facts
