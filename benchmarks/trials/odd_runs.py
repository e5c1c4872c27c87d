"""Trial of the commands on random worldlike runs with random regions: exit codes that are stated, JSON without NaN.

Usage: python -m benchmarks.trials.odd_runs [--seeds 300] [--first-seed 0] [--processes 2]

Pictures are small; regions are of one pixel, in the border, clipped, off the objects, or anywhere. Numbers, FITS and
JSON files are made for every run; pages and pictures, which take most of the time, are drawn for every sixteenth.
"""

import argparse
import contextlib
import io
import json
import os
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from rigctl.cli import main as rigctl
from rigctl.console.failures import EXIT_DATA, EXIT_DISAGREES, EXIT_INCOMPLETE, EXIT_USAGE
from rigctl.report import comparison as comparison_files
from rigctl.report import comparison as measurement_files
from tests.rigctl.made_runs import at, make_run
from tests.worldlike import Faults, expose, other_world, random_world

_STATED = (0, EXIT_USAGE, EXIT_DATA, EXIT_DISAGREES, EXIT_INCOMPLETE)
_SIDES_PIXELS = (6, 9, 16, 24, 40, 64, 96)
_DRAWN_EVERY = 16
_KINDS = ("pixel", "border", "clipped", "all clipped", "dark", "any", "whole")
_CORRECTIONS = ("", "", "throughput", "dark-level", "shift", "throughput,dark-level,shift")


@dataclass(frozen=True, kw_only=True)
class Ended:
    """How a command ended; `wrong` says what should not be."""

    seed: int
    verb: str
    regions: tuple[str, ...]
    code: int
    wrong: str


def one_run(seed: int) -> list[Ended]:
    """Take one run with random faults and regions through `stokes` and `compare`."""
    rng = np.random.default_rng([seed, 6])
    world = other_world(rng) if rng.random() < 0.7 else random_world(rng)
    world = replace(world, height=int(rng.choice(_SIDES_PIXELS)), width=int(rng.choice(_SIDES_PIXELS)))
    faults = _faults(rng, len(world.angles_deg))
    frames = expose(world, faults, rng)
    kinds, text = _regions(rng, frames, faults.border_pixels)
    memory = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=memory if os.access(memory, os.W_OK) else None) as folder:
        top = Path(folder)
        bits = int(world.full_scale_dn << faults.left_shift).bit_length()
        facts = {"bit_depth": bits, "saturation_dn": float(world.full_scale_dn << faults.left_shift)}
        facts |= {"missing_dn": 0.0} if faults.border_pixels and rng.random() < 0.7 else {}
        cycles = int(rng.choice([1, 1, 2]))
        pictures = [(at(a, **facts), one) for a, one in zip(world.angles_deg, frames, strict=True)]
        make_run(top / "run", [(facts | {"cycle": c}, one) for c in range(cycles) for facts, one in pictures])
        (top / "regions.toml").write_text(text)
        correct = _CORRECTIONS[int(rng.integers(len(_CORRECTIONS)))]
        words = ["--regions", str(top / "regions.toml"), *(["--correct", correct] if correct else [])]
        with contextlib.nullcontext() if seed % _DRAWN_EVERY == 0 else _without_pictures():
            return [_ended(seed, verb, kinds, top, words) for verb in ("stokes", "compare")]


@contextlib.contextmanager
def _without_pictures() -> Iterator[None]:
    """Let the commands write no page and draw no picture."""
    figures = patch.multiple(
        measurement_files,
        scene_pictures=lambda *_, **__: b"",
        aolp_picture=lambda *_: b"",
        residual_picture=lambda *_: b"",
    )
    pages = patch.multiple(comparison_files, comparison_report=lambda _: None, html=lambda _: "", pdf=lambda _: b"")
    with figures, pages:
        yield


def _ended(seed: int, verb: str, kinds: tuple[str, ...], top: Path, words: list[str]) -> Ended:
    said = io.StringIO()
    out = top / verb
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        code = rigctl([verb, str(top / "run"), *words, "--out", str(out)])
    wrong = "" if code in _STATED else f"exit {code}: {said.getvalue()[-600:]}"
    for path in out.glob("*.json") if not wrong else ():
        try:
            json.loads(path.read_text(), parse_constant=_refused)
        except ValueError as error:
            wrong = f"{path.name}: {error}"
    return Ended(seed=seed, verb=verb, regions=kinds, code=code, wrong=wrong)


def _refused(constant: str) -> float:
    raise ValueError(f"holds {constant}")


def _faults(rng: np.random.Generator, frames: int) -> Faults:
    """Return faults, each there or not."""
    frame = int(rng.integers(frames))
    some = partial(rng.choice, [True, False], p=[0.25, 0.75])
    return Faults(
        throughput={frame: float(rng.uniform(-0.05, 0.05))} if some() else {},
        angle_deg={frame: float(rng.uniform(-3.0, 3.0))} if some() else {},
        dark_dn={frame: float(rng.uniform(-50.0, 50.0))} if some() else {},
        shift_pixels={frame: (float(rng.uniform(-2, 2)), float(rng.uniform(-2, 2)))} if some() else {},
        tone=float(rng.uniform(0.8, 1.25)) if some() else 1.0,
        drift=float(rng.uniform(-0.02, 0.02)) if some() else 0.0,
        clipped_share=float(rng.choice([0.05, 0.5, 0.95])) if some() else 0.0,
        border_pixels=int(rng.integers(1, 4)) if some() else 0,
        left_shift=2 if some() else 0,
        jpeg_quality=int(rng.integers(30, 95)) if some() else None,
    )


def _regions(rng: np.random.Generator, frames: NDArray[np.uint16], border: int) -> tuple[tuple[str, ...], str]:
    """Return one to four regions of random kinds, and the file that says so."""
    height, width = frames.shape[1:]
    kinds = tuple(str(kind) for kind in rng.choice(_KINDS, rng.integers(1, 5)))
    text = ""
    for number, kind in enumerate(kinds):
        x, y, wide, tall = _rectangle(rng, kind, frames, border)
        wide, tall = min(wide, width - x), min(tall, height - y)
        text += (
            f'[[regions]]\nname = "{kind.replace(" ", "-")}-{number}"\n'
            f"rectangle = {{ x = {x}, y = {y}, width = {wide}, height = {tall} }}\n"
        )
    return kinds, text


def _rectangle(
    rng: np.random.Generator, kind: str, frames: NDArray[np.uint16], border: int
) -> tuple[int, int, int, int]:
    height, width = frames.shape[1:]
    x, y = int(rng.integers(width)), int(rng.integers(height))
    if kind == "pixel":
        return x, y, 1, 1
    if kind == "border":
        return 0, 0, width, max(border, 1)
    if kind == "whole":
        return 0, 0, width, height
    light = frames.max(axis=0)
    if kind in ("clipped", "all clipped"):
        y, x = (int(at) for at in np.unravel_index(np.argmax(light), light.shape))
    elif kind == "dark":
        y, x = (int(at) for at in np.unravel_index(np.argmin(light), light.shape))
    if kind == "all clipped":
        return x, y, 2, 2
    return x, y, int(rng.integers(1, width + 1)), int(rng.integers(1, height + 1))


def run_odd(seeds: int, *, first_seed: int = 0, processes: int = 2, longest_s: float = np.inf) -> bool:
    """Run the trial, no longer than is given; return whether every command ended as is stated."""
    start_s, ended = time.monotonic(), list[Ended]()
    with ProcessPoolExecutor(processes) as pool:
        tasks = [pool.submit(one_run, seed) for seed in range(first_seed, first_seed + seeds)]
        for task in tasks:
            if time.monotonic() - start_s > longest_s:
                pool.shutdown(wait=True, cancel_futures=True)
                break
            ended += task.result()
    wrong = [one for one in ended if one.wrong]
    counts = Counter((one.verb, one.code) for one in ended)
    print(f"{len(ended)} commands on {len(ended) // 2} runs: {len(wrong)} ended otherwise than stated")
    print(f"    codes: {', '.join(f'{verb} {code}: {n}' for (verb, code), n in sorted(counts.items()))}")
    for one in wrong:
        print(f"    seed {one.seed} {one.verb} {one.regions}: {one.wrong}", flush=True)
    return not wrong


def main() -> int:
    """Run the trial; return 1 where it fails."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=300)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--longest-s", type=float, default=float("inf"))
    chosen = parser.parse_args()
    is_sound = run_odd(
        chosen.seeds, first_seed=chosen.first_seed, processes=chosen.processes, longest_s=chosen.longest_s
    )
    return 0 if is_sound else 1


if __name__ == "__main__":
    raise SystemExit(main())
