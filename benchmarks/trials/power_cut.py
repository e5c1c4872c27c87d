"""A power cut, simulated: the image under a file system is copied in the middle of a session, as a disk would hold it.

A session on the simulated rig writes into ext4 on a loop device and tells of each frame once it is durable. At a random
moment it is stopped and the image is copied; the copy is mounted (the journal is replayed), and every frame that was
acknowledged must be there with its checksum. Then `rigctl resume` goes on in the copy, to the end. The method assumes
that the disk honours a flush.
"""

import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from benchmarks.trials.harness import attempts
from benchmarks.trials.kills import write_files
from benchmarks.trials.loop_disk import ext4_image, mounted, why_not
from rigctl.files.rig_file import load_rig
from rigctl.files.session_file import load_session
from rigctl.runs.check import frame_problems, verify_run
from rigctl.runs.folder import read_contents
from rigctl.runs.records import FrameRecord
from rigctl.runs.writer import RunWriter
from rigctl.session.take import take_session

_IMAGE_BYTES = 128 * 1024 * 1024
_FRAMES = 20
_LONGEST_S = 1.5
_START_TIMEOUT_S = 60.0


def run_cuts(*, cuts: int = 50, seed: int = 1) -> bool:
    """Cut the power many times; return whether no acknowledged frame was lost or changed, and each session ended."""
    if (reason := why_not()) is not None:
        print(f"not run: {reason}")
        return True
    moments = random.Random(seed)
    return attempts("power cut", cuts, lambda _: one_cut(moments.uniform(0.0, _LONGEST_S))[1])


def one_cut(delay_s: float, *, after_frames: int = 0) -> tuple[int, list[str]]:
    """Cut the power some time after the start and so many acknowledged frames; return these, and faults."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = write_files(folder)
        image, copy = ext4_image(folder / "disk.img", size_bytes=_IMAGE_BYTES), folder / "after.img"
        with mounted(image, folder / "disk") as disk:
            told = _session_cut_short(
                files, disk / "run", delay_s, lambda: shutil.copyfile(image, copy), after_frames=after_frames
            )
        with mounted(copy, folder / "after") as after:
            return len(told), _problems(after / "run", told)


def _session_cut_short(
    files: tuple[Path, Path], run: Path, delay_s: float, cut: Callable[[], object], *, after_frames: int
) -> dict[int, str]:
    told: dict[int, str] = {}
    command: list[str | Path] = [sys.executable, "-m", "benchmarks.trials.power_cut", *files, run]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        reader = threading.Thread(target=_listen, args=(process, told))
        reader.start()
        deadline = time.monotonic() + _START_TIMEOUT_S
        while (not (run / "events.jsonl").exists() or len(told) < after_frames) and time.monotonic() < deadline:
            time.sleep(0.01)
        time.sleep(delay_s)
        process.send_signal(signal.SIGSTOP)
        before = dict(told)
        cut()
        process.kill()
        reader.join()
    return before


def _listen(process: subprocess.Popen[str], told: dict[int, str]) -> None:
    for line in process.stdout or ():
        if line.endswith("\n"):  # a line that the kill cut short acknowledges nothing
            sequence, checksum = line.split()
            told[int(sequence)] = checksum


def _problems(run: Path, told: dict[int, str]) -> list[str]:
    if not told and not (run / "session.json").exists():
        return []
    named: dict[int, FrameRecord] = {record.sequence: record for record in read_contents(run).frames}
    found = [f"frame {sequence} is lost" for sequence in told if sequence not in named]
    found += [f"frame {s} is another" for s, checksum in told.items() if s in named and named[s].checksum != checksum]
    found += [f"{record.file}: {problem}" for record in named.values() for problem in frame_problems(run, record)]
    resumed = subprocess.run(
        [sys.executable, "-m", "rigctl", "resume", run], stderr=subprocess.PIPE, text=True, check=False
    )
    if resumed.returncode:
        return [*found, f"resume ends with {resumed.returncode}: {resumed.stderr[-200:]}"]
    verification = verify_run(run)
    if verification.frames != _FRAMES or not verification.ok:
        found.append(f"after resume {verification.frames} frames, {len(verification.bad)} bad")
    return found


def _take_and_tell(rig: Path, session: Path, run: Path) -> None:
    write_frames = RunWriter.write_frames

    def telling(self: RunWriter, frames: Iterable[tuple[FrameRecord, NDArray[np.uint16]]]) -> tuple[FrameRecord, ...]:
        written = write_frames(self, frames)
        for record in written:
            print(record.sequence, record.checksum, flush=True)
        return written

    with patch.object(RunWriter, "write_frames", telling):
        take_session(load_rig(rig), load_session(session), run, files={"rig": rig, "session": session})


if __name__ == "__main__":  # the session that is cut short, in a process of its own
    _take_and_tell(*map(Path, sys.argv[1:]))
