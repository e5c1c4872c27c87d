"""A study of thousands of cases: compared with plain loops, and with its workers, scheduler and client killed."""

import json
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

from benchmarks.trials.harness import over
from rigctl.files.scene_file import load_scene
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


def loop(numbers: list[tuple[float, float]]) -> list[float]:
    """Predict cases in a plain loop; return DoLP of the first region."""
    predictor = ScenePredictor(load_scene(SCENE), None)
    first = predictor.scene.regions[0].name
    return [
        predictor.predictions({EXPOSURE: exposure, EFFICIENCY: efficiency})[first].quantities["dolp"]["mean"]
        for exposure, efficiency in numbers
    ]


def against_loops(cases: int) -> bool:
    """Return whether a study gives the same numbers as plain loops over its cases."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        study, out = study_of(cases, folder), folder / "out"
        subprocess.run(words(study, out, "--workers", str(WORKERS)), stdout=subprocess.DEVNULL, check=True)
        store = xr.open_zarr(out / "study.zarr").load()
        numbers = list(zip(store[EXPOSURE].values.tolist(), store[EFFICIENCY].values.tolist(), strict=True))
    dolp = np.concatenate(list(over(loop, [numbers[k : k + 500] for k in range(0, len(numbers), 500)])))
    same = bool(np.array_equal(dolp, store.dolp_mean.values[:, 0]))
    print(f"{cases} cases: {'bit for bit the same' if same else 'NUMBERS DIFFER'}", flush=True)
    return same


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


def run_study(*, cases: int = 10_000, kills: int = 10, seed: int = 1) -> bool:
    """Return whether a study gave the numbers of loops, and nothing was lost in kills."""
    same = against_loops(cases)
    return with_kills(cases, kills, seed=seed) and same
