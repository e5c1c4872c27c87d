"""Trial: a study of thousands of cases beside two plain loops, and with its workers, scheduler and client killed.

python -m benchmarks.trial_study [--cases 10000] [--kills 10]

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
from pathlib import Path

import numpy as np
import psutil
import xarray as xr

from rigctl.cluster.held_folder import PARTS_FOLDER
from rigctl.files.scene_file import load_scene
from rigctl.prediction.scene_prediction import ScenePredictor
from rigctl.study.kept_parts import read_parts

SCENE = Path(__file__).parents[1] / "examples" / "scene-panels.toml"
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


def loop(numbers: list[tuple[float, float]]) -> tuple[float, list[float]]:
    """Predict cases one by one; return the time that took and DoLP of the first region."""
    predictor = ScenePredictor(load_scene(SCENE), None)
    first = predictor.scene.regions[0].name
    start_s = time.perf_counter()
    found = [
        predictor.predictions({EXPOSURE: exposure, EFFICIENCY: efficiency})[first].quantities["dolp"]["mean"]
        for exposure, efficiency in numbers
    ]
    return time.perf_counter() - start_s, found


def against_loops(cases: int) -> bool:
    """Time a study beside two loops over the same cases; return whether every number is the same."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        study, out = study_of(cases, folder), folder / "out"
        start_s, most_mb = time.perf_counter(), 0.0
        with subprocess.Popen(words(study, out, "--workers", str(WORKERS)), stdout=subprocess.PIPE) as process:
            while process.poll() is None:
                workers = psutil.Process(process.pid).children(recursive=True)
                most_mb = max([most_mb, *(_memory_mb(worker) for worker in workers)])
                time.sleep(0.2)
            said = json.loads(process.stdout.read()) if process.stdout else {}
        whole_s = time.perf_counter() - start_s
        store = xr.open_zarr(out / "study.zarr").load()
        numbers = list(zip(store[EXPOSURE].values.tolist(), store[EFFICIENCY].values.tolist(), strict=True))
        span_s = _span_s(out)
        with multiprocessing.get_context("spawn").Pool(WORKERS) as pool:
            loops = pool.map(loop, [numbers[k::WORKERS] for k in range(WORKERS)], chunksize=1)
    loop_s = max(seconds for seconds, _ in loops)
    dolp = np.empty(len(numbers))
    for k, (_, found) in enumerate(loops):
        dolp[k::WORKERS] = found
    overhead_ms = 1e3 * WORKERS * (span_s - loop_s) / cases
    same = bool(np.array_equal(dolp, store.dolp_mean.values[:, 0]))
    print(f"{cases} cases: from command to files {whole_s:.1f} s, from first part to last {span_s:.1f} s")
    print(f"two loops {loop_s:.1f} s: {loop_s / span_s:.2f} of their rate; overhead {overhead_ms:.2f} ms a case")
    print(f"most memory of a worker {most_mb:.0f} MB; {said.get('failed')} failed")
    print("bit for bit the same" if same else "NUMBERS DIFFER", flush=True)
    return same


def _span_s(out: Path) -> float:
    times = sorted(part.stat().st_mtime for part in (out / PARTS_FOLDER).glob("*.npz"))
    # Without the first part of each worker, whose time holds the start: as many parts as intervals.
    return (times[-1] - times[0]) * len(times) / max(len(times) - 1, 1)


def _memory_mb(process: psutil.Process) -> float:
    try:
        return float(process.memory_info().rss) / 1e6
    except psutil.NoSuchProcess:
        return 0.0


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
        kept = read_parts(out)
        twice = sum(len(part.numbers) for part in kept.parts) - len(kept.places)
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
    return len(read_parts(out).places) if out.exists() else 0


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


def main() -> None:
    """Run the trial."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    whole = against_loops(asked.cases)
    if not with_kills(asked.cases, asked.kills, seed=asked.seed) or not whole:
        sys.exit(1)


if __name__ == "__main__":
    main()
