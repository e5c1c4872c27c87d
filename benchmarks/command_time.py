"""Processor time of whole commands, from start to end, as ratios to a Python that starts and to one empty figure.

Usage: python -m benchmarks.command_time (`python -m benchmarks.page command_time` writes it into docs/benchmarks.md)

It makes the demo and times commands on it. Load of the machine changes seconds more than ratios; each is the best of
some runs.
"""

import hashlib
import mmap
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from rigctl.runs.folder import read_run
from rigctl.runs.records import FrameRecord

RUNS = 3
EMPTY_FIGURE = (
    "import io; from matplotlib.figure import Figure; f = Figure(layout='constrained'); f.subplots(); "
    "f.savefig(io.BytesIO(), format='png')"
)


def processor_s(words: Sequence[str], *, runs: int = RUNS, before: Callable[[], None] = lambda: None) -> float:
    """Return the least processor time of a command, with its system calls and all its threads."""
    times_s = []
    for _ in range(runs):
        before()
        start = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(words, check=True, capture_output=True)
        end = resource.getrusage(resource.RUSAGE_CHILDREN)
        times_s.append(end.ru_utime + end.ru_stime - start.ru_utime - start.ru_stime)
    return min(times_s)


def first_frame_s(rig: Path, session: Path, folder: Path) -> float:
    """Return the least time on the clock from the start of `acquire` to the first frame on the disk."""
    times_s = []
    for k in range(RUNS):
        out = folder / f"first-{k}"
        start_s = time.perf_counter()
        words = (sys.executable, "-m", "rigctl", "acquire", str(rig), str(session), "--out", str(out))
        with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
            while not any(out.glob("**/*.fits")) and process.poll() is None:
                time.sleep(0.005)
            times_s.append(time.perf_counter() - start_s)
            process.send_signal(signal.SIGINT)
            process.wait()
    return min(times_s)


def clock_s(words: Sequence[str]) -> float:
    """Return the least time on the clock of a command."""
    times_s = []
    for _ in range(RUNS):
        start_s = time.perf_counter()
        subprocess.run(words, check=True, capture_output=True)
        times_s.append(time.perf_counter() - start_s)
    return min(times_s)


def reading(run_path: Path) -> tuple[float, float, float]:
    """Return the processor time of a frame's counts, of its bytes and SHA-256 alone, the limit, and by a map [ms]."""
    run = read_run(run_path)

    def alone(record: FrameRecord) -> None:
        hashlib.sha256((run.path / record.file).read_bytes()).digest()

    def mapped(record: FrameRecord) -> None:
        with (
            (run.path / record.file).open("rb") as file,
            mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as view,
        ):
            hashlib.sha256(view).digest()

    times: dict[Callable[[FrameRecord], object], list[float]] = {run.counts: [], alone: [], mapped: []}
    for _ in range(9):
        for work, found in times.items():
            start_s = time.process_time()
            for record in run.frames:
                work(record)
            found.append(1e3 * (time.process_time() - start_s) / len(run.frames))
    ours, limit, by_map = map(min, times.values())
    return ours, limit, by_map


def table(folder: Path) -> list[str]:
    """Return the lines of the table, once everything has been timed."""
    rigctl = (sys.executable, "-m", "rigctl")
    python = processor_s((sys.executable, "-c", "pass"))
    figure = processor_s((sys.executable, "-c", EMPTY_FIGURE))
    demo = folder / "demo"
    rows = [("one empty figure of matplotlib", figure, "")]
    rows.append(("`rigctl demo`", processor_s((*rigctl, "demo", "--out", str(demo)), runs=1), "8 s"))
    scene, out = demo / "scene-panels.toml", folder / "out"
    compare = (*rigctl, "compare", str(demo / "run"), str(scene), "--noise", str(demo / "noise.json"))
    stokes = (*rigctl, "stokes", str(demo / "run"), "--regions", str(demo / "regions.toml"))
    rows.append(("`rigctl compare` of the demo", processor_s((*compare, "--out", str(out / "compare"))), "3.5 s"))
    rows.append(("`rigctl stokes` of the demo", processor_s((*stokes, "--out", str(out / "stokes"))), "1 s"))
    rows.append(("`rigctl predict` of the panels", processor_s((*rigctl, "predict", str(scene))), "0.6 s"))
    lines = [
        "| what | processor [s] | over one empty figure | over python's start | wanted |",
        "|---|---:|---:|---:|---:|",
    ]
    lines += [f"| {what} | {s:.2f} | {s / figure:.1f} | {s / python:.0f} | {wanted} |" for what, s, wanted in rows]
    first = first_frame_s(demo / "rig-sim.toml", demo / "session.toml", folder)
    start = clock_s((sys.executable, "-c", "pass"))
    ours, limit, by_map = reading(demo / "run")
    text = (
        f"`rigctl acquire` to its first frame: {first:.2f} s on the clock, {first / start:.0f} starts of python (1 s "
        f"wanted). A frame of 782 x 582 from its file, checksum and header held against the manifest: {ours:.2f} ms of "
        f"processor; its bytes and their SHA-256 alone, the limit: {limit:.2f} ms ({ours / limit:.1f} times); these "
        f"through a memory map: {by_map:.2f} ms."
    )
    return [*lines, "", text]


def main() -> int:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        print("\n".join(table(Path(folder))))
    return 0


if __name__ == "__main__":
    sys.exit(main())
