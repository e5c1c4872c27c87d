"""Trial: a study of thousands of cases beside two plain loops, and with its workers, scheduler and client killed.

python -m benchmarks.trials.study [--cases 10000] [--kills 10]

Says what the study reaches of two independent loops on the same cases, its overhead a case, the memory of its workers,
whether all numbers are those of the loops bit for bit, and what was computed twice after kills.
"""

import argparse
import json
import multiprocessing
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil
import xarray as xr

from rigctl.files.scene_file import load_scene
from rigctl.mapped import PARTS_FOLDER
from rigctl.prediction.predict import ScenePredictor
from rigctl.study import read_parts

SCENE = Path(__file__).parents[2] / "examples" / "scene-panels.toml"
EXPOSURE, EFFICIENCY = "acquisition.exposure_ms", "sensor.quantum_efficiency"
WORKERS = 2


def study_of(cases: int, folder: Path) -> Path:
    """Write a study of so many draws of the panels; return its path."""
    shutil.copy(SCENE, folder / "scene.toml")
    path = folder / "study.toml"
    path.write_text(
        f'name = "trial"\nscenes = ["scene.toml"]\nquantities = ["dolp.mean", "s0"]\n[cases]\nkind = "random"\n'
        f'n = {cases}\n[cases.parameters]\n"{EXPOSURE}" = {{ range = [0.01, 0.03] }}\n'
        f'"{EFFICIENCY}" = {{ range = [0.3, 0.6] }}\n'
    )
    return path


def words(study: Path, out: Path, *others: str) -> list[str]:
    """Return the command line of a study."""
    return [sys.executable, "-m", "rigctl", "study", str(study), "--out", str(out), "--json", *others]


@dataclass(frozen=True, kw_only=True)
class Loop:
    """A plain loop over cases: its time by the clock and of the processor, and DoLP of the first region."""

    wall_s: float
    cpu_s: float
    dolp: list[float]


def loop(numbers: list[tuple[float, float]]) -> Loop:
    """Predict cases one by one."""
    predictor = ScenePredictor(load_scene(SCENE), None)
    first = predictor.scene.regions[0].name
    predictor.predictions()
    start_s, cpu_s = time.perf_counter(), time.process_time()
    found = [
        predictor.predictions({EXPOSURE: exposure, EFFICIENCY: efficiency})[first].quantities["dolp"]["mean"]
        for exposure, efficiency in numbers
    ]
    return Loop(wall_s=time.perf_counter() - start_s, cpu_s=time.process_time() - cpu_s, dolp=found)


class Watched:
    """What a study takes while it runs, from its first part to its last."""

    def __init__(self, client: int, out: Path) -> None:
        self._client, self._out = psutil.Process(client), out
        self.memory_mb: list[float] = []
        self._at: list[tuple[int, float]] = []

    def look(self) -> None:
        """Note parts, time of the processor of all processes, and the largest memory of a worker."""
        parts = len(list((self._out / PARTS_FOLDER).glob("*.npz")))
        cpu_s, largest = 0.0, 0.0
        try:
            for one in (self._client, *self._client.children(recursive=True)):
                times = one.cpu_times()
                cpu_s += times.user + times.system
                largest = max(largest, one.memory_info().rss / 1e6 if one != self._client else 0.0)
        except psutil.NoSuchProcess:
            return
        if parts:
            self.memory_mb.append(largest)
            self._at.append((parts, cpu_s))

    def cpu_s_a_part(self) -> float:
        """Return the time of the processor that a part takes, of client, scheduler and workers."""
        # Once workers end, their time is no longer told.
        (first, before), (last, after) = self._at[0], max(self._at, key=lambda one: one[1])
        return (after - before) / max(last - first, 1)


def against_loops(cases: int) -> bool:
    """Time a study beside two loops over the same cases; return whether every number is the same."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        study, out = study_of(cases, folder), folder / "out"
        start_s = time.perf_counter()
        with subprocess.Popen(words(study, out, "--workers", str(WORKERS)), stdout=subprocess.PIPE) as process:
            watched = Watched(process.pid, out)
            while process.poll() is None:
                watched.look()
                time.sleep(1.0)
            said = json.loads(process.stdout.read()) if process.stdout else {}
        print(
            f"{cases} cases: {time.perf_counter() - start_s:.1f} s from command to files, {said.get('failed')} failed"
        )
        store = xr.open_zarr(out / "study.zarr").load()
        parts, span_s = len(list((out / PARTS_FOLDER).glob("*.npz"))), _span_s(out)
        numbers = list(zip(store[EXPOSURE].values.tolist(), store[EFFICIENCY].values.tolist(), strict=True))
        with multiprocessing.get_context("spawn").Pool(WORKERS) as pool:
            loops = pool.map(loop, [numbers[k::WORKERS] for k in range(WORKERS)], chunksize=1)
    dolp = np.empty(len(numbers))
    for k, found in enumerate(loops):
        dolp[k::WORKERS] = found.dolp
    _tell(cases, parts, span_s, watched, loops)
    same = bool(np.array_equal(dolp, store.dolp_mean.values[:, 0]))
    print("bit for bit the same" if same else "NUMBERS DIFFER", flush=True)
    return same


def _tell(cases: int, parts: int, span_s: float, watched: Watched, loops: list[Loop]) -> None:
    """Print rate and overhead by the clock, and by the processor, which other programs do not disturb."""
    loop_s, loop_ms = max(one.wall_s for one in loops), 1e3 * sum(one.cpu_s for one in loops) / cases
    study_ms = 1e3 * watched.cpu_s_a_part() * parts / cases
    print(
        f"by the clock: first part to last {span_s:.1f} s, two loops {loop_s:.1f} s: {loop_s / span_s:.2f} of their "
        f"rate, overhead {1e3 * WORKERS * (span_s - loop_s) / cases:.2f} ms a case"
    )
    print(
        f"by the processor: {study_ms:.2f} ms a case in client, scheduler and workers, {loop_ms:.2f} ms in a loop: "
        f"{loop_ms / study_ms:.2f}, overhead {study_ms - loop_ms:.2f} ms a case"
    )
    third = max(len(watched.memory_mb) // 3, 1)
    print(
        f"memory of the largest worker: {max(watched.memory_mb[:third]):.0f} MB in the first third of the time, "
        f"{max(watched.memory_mb[-third:]):.0f} MB in the last"
    )


def _span_s(out: Path) -> float:
    times = sorted(part.stat().st_mtime for part in (out / PARTS_FOLDER).glob("*.npz"))
    # Without the first part of each worker, whose time holds the start: as many parts as intervals.
    return (times[-1] - times[0]) * len(times) / max(len(times) - 1, 1)


def with_kills(cases: int, kills: int, *, seed: int) -> bool:
    """Kill workers of a study, then its client, then a scheduler of its own; return whether nothing was lost."""
    draws = random.Random(seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        study, out = study_of(cases, folder), folder / "out"
        killed = 0
        with subprocess.Popen(words(study, out, "--workers", str(WORKERS)), stdout=subprocess.DEVNULL) as process:
            while killed < kills and process.poll() is None:
                time.sleep(draws.uniform(0.5, 1.5))
                workers = [one for one in psutil.Process(process.pid).children(recursive=True) if _is_worker(one)]
                if workers and _done(out):
                    draws.choice(workers).send_signal(signal.SIGKILL)
                    killed += 1
            if process.poll() is None:
                process.kill()
        before = _done(out)
        print(f"{killed} workers and the client killed: {before} of {cases} done")
        lost = _on_scheduler(study, out, folder)
        done = subprocess.run(words(study, out, "--workers", str(WORKERS)), capture_output=True, check=False)
        said = json.loads(done.stdout)
        kept, _ = read_parts(out)
        twice = sum(len(part.reasons) for part in {part for part, _ in kept.values()}) - len(kept)
        print(
            f"scheduler killed at {lost}; resumed: exit {done.returncode}, {said['done_before']} done before, "
            f"{said['failed']} failed, {twice} kept twice"
        )
        return done.returncode == 0 and said["failed"] == 0 and said["done_before"] >= lost >= before and twice == 0


def _is_worker(process: psutil.Process) -> bool:
    try:
        return "spawn_main" in " ".join(process.cmdline())
    except psutil.NoSuchProcess:
        return False


def _done(out: Path) -> int:
    return len(read_parts(out)[0]) if out.exists() else 0


def _on_scheduler(study: Path, out: Path, folder: Path) -> int:
    """Go on with a study on a scheduler that is killed; return how many cases were done then."""
    file, before = folder / "scheduler.json", _done(out)
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": folder}
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler"]
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--scheduler-file", str(file), "--nthreads", "1"]
    scheduler = subprocess.Popen([*dask, "--port", "0", "--no-dashboard", "--scheduler-file", str(file)], **quiet)
    while not file.exists():
        time.sleep(0.1)
    workers = [subprocess.Popen([*worker, "--no-dashboard"], **quiet) for _ in range(WORKERS)]
    address = json.loads(file.read_text())["address"]
    time.sleep(5.0)
    client = subprocess.Popen(words(study, out, "--scheduler", address), **quiet)
    while _done(out) == before and client.poll() is None:
        time.sleep(0.2)
    scheduler.kill()
    print(f"client of the killed scheduler ends with exit {client.wait(120)}")
    for one in (scheduler, *workers):
        one.kill()
        one.wait()
    return _done(out)


def run_study(cases: int, kills: int, *, seed: int = 1) -> bool:
    """Return whether a study gave the numbers of loops, and nothing was lost in kills."""
    same = against_loops(cases)
    return with_kills(cases, kills, seed=seed) and same


def main() -> None:
    """Run the trial."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if not run_study(asked.cases, asked.kills, seed=asked.seed):
        sys.exit(1)


if __name__ == "__main__":
    main()
