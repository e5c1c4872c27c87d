"""A day in simulated time: a round each ten minutes, thousands of frames, with memory, handles and threads watched.

Wanted: memory within 10 MB of what it was after the first hour, no handle and no thread more, and frames that do not
take longer at the end than in the first hour.
"""

import itertools
import os
import statistics
import tempfile
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from rigctl.base.numbers import unix_ns
from rigctl.files.session_file import SessionFile
from rigctl.rig.simulation import with_simulation
from rigctl.runs.check import verify_run
from rigctl.runs.records import FrameRecord
from rigctl.runs.writer import RunWriter
from rigctl.session.take import take_session
from rigctl.session.timing import clock_of
from tests.rigctl.example_files import small_rig

_ROUNDS_A_DAY, _ROUNDS_AN_HOUR, _ANGLES = 144, 6, 4
_MOST_MORE_MB, _MOST_SLOWER = 10.0, 1.2
_BYTES_PER_MB = 1e6
_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")


@dataclass(frozen=True, kw_only=True)
class Sample:
    """The process once so many frames were durable.

    Attributes
    ----------
    frames : int
        Durable frames.
    memory_mb : float
        Resident memory [MB].
    handles, threads : int
        Open files, and threads.
    processor_s : float
        Of the processor, since the process began [s].
    """

    frames: int
    memory_mb: float
    handles: int
    threads: int
    processor_s: float


def run_day(*, cycles: int = 35, folder: Path | None = None) -> bool:
    """Take a day of rounds of so many cycles; return whether memory and time per frame stayed as they were."""
    every = _ROUNDS_AN_HOUR * _ANGLES * cycles
    with tempfile.TemporaryDirectory(dir=folder) as scratch, _sampled(every) as samples:
        frames = _take_day(Path(scratch), cycles)
        state = verify_run(Path(scratch) / "run").state
    if len(samples) < 2:
        return False
    for one in samples:
        print(f"{one.frames:6d} frames: {one.memory_mb:6.1f} MB, {one.handles} handles, {one.threads} threads")
    per_frame_ms = [1e3 * (two.processor_s - one.processor_s) / every for one, two in itertools.pairwise(samples)]
    first, last = samples[0], samples[-1]
    more_mb = max(one.memory_mb for one in samples) - first.memory_mb
    early_ms, late_ms = statistics.median(per_frame_ms[:3]), statistics.median(per_frame_ms[-3:])
    print(f"{frames} frames, {state}; after the first hour {more_mb:+.1f} MB at most", end=", ")
    print(f"{last.handles - first.handles:+d} handles, {last.threads - first.threads:+d} threads", end="; ")
    print(f"{early_ms:.1f} ms of processor a frame at first, {late_ms:.1f} at last")
    is_steady = more_mb <= _MOST_MORE_MB and last.handles <= first.handles and last.threads <= first.threads
    return is_steady and late_ms <= _MOST_SLOWER * early_ms and state == "whole"


def _take_day(folder: Path, cycles: int) -> int:
    rig = small_rig(folder, port="sim:ellx?speed=200")
    begin = datetime(2026, 5, 4, tzinfo=UTC)
    rig = with_simulation(rig, clock_ns=unix_ns(begin), perturb=None)
    session = SessionFile.model_validate(
        {
            "name": "day",
            "take": [{"kind": "scene", "exposure_ms": 0.03, "angles_deg": [0, 90, 45, 135], "cycles": cycles}],
            "schedule": {"start": begin, "every_min": 10, "duration_h": 24, "late_min": 10},
            "interlocks": {"disk_free_mb": 0},
        }
    )
    clock = replace(clock_of(rig), rest=lambda _seconds: None)
    return take_session(rig, session, folder / "run", files={}, clock=clock).frames


@contextmanager
def _sampled(every: int) -> Iterator[list[Sample]]:
    """Look at the process each so many frames."""
    samples: list[Sample] = []
    write_frames, count = RunWriter.write_frames, [0]

    def counting(self: RunWriter, frames: Iterable[tuple[FrameRecord, NDArray[np.uint16]]]) -> tuple[FrameRecord, ...]:
        written = write_frames(self, frames)
        count[0] += len(written)
        if count[0] % every == 0:
            samples.append(_sample(count[0]))
        return written

    with patch.object(RunWriter, "write_frames", counting):
        yield samples


def _sample(frames: int) -> Sample:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return Sample(
        frames=frames,
        memory_mb=pages * _PAGE_BYTES / _BYTES_PER_MB,
        handles=len(list(Path("/proc/self/fd").iterdir())),
        threads=threading.active_count(),
        processor_s=time.process_time(),
    )
