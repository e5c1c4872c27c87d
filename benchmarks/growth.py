"""How cost grows with pixels, frames, regions, streams and cases, beside its limit: a table and a picture.

Usage: python -m benchmarks.growth [--out docs/pictures/benchmark-growth.svg]

Each point is the least processor time of some runs. Limits: a copy of the frames (pixels), bytes and SHA-256 of the
files (frames), one sum over the counts of all frames (regions), the flops of the solver's matrix products at the rate
of one large product (streams), one case alone times their number (cases).
"""

import argparse
import hashlib
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import cos, radians
from pathlib import Path

import numpy as np

from model.atmosphere.air import AtmosphereState, column
from model.atmosphere.solver import solve
from model.processing.maps import polarization_maps
from model.processing.reconstruction import design
from rigctl.files.regions import Rectangle, Region
from rigctl.files.scene_file import load_scene
from rigctl.measure.measure import measure
from rigctl.prediction.predict import ScenePredictor
from rigctl.runs.folder import Run, read_run
from rigctl.runs.records import FrameRecord
from rigctl.runs.writer import RunWriter

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "docs" / "pictures" / "benchmark-growth.svg"
SHAPE = (582, 782)
ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)
RUNS = 5


@dataclass(frozen=True, kw_only=True)
class Growth:
    """Cost of something against its size: sizes, processor times and those of the limit [ms]."""

    what: str
    of: str
    limit: str
    sizes: tuple[int, ...]
    cost_ms: tuple[float, ...]
    limit_ms: tuple[float, ...]

    @property
    def power(self) -> float:
        """Exponent of the size between the two largest."""
        (a, b), (c, d) = self.sizes[-2:], self.cost_ms[-2:]
        return float(np.log(d / c) / np.log(b / a))


def best_ms(work: Callable[[], object], runs: int = RUNS) -> float:
    """Return the least processor time of a call; the first is not counted."""
    times_s = []
    for _ in range(runs + 1):
        start_s = time.process_time()
        work()
        times_s.append(time.process_time() - start_s)
    return 1e3 * min(times_s[1:])


def grown(
    what: str, of: str, limit: str, points: Iterator[tuple[int, Callable[[], object], Callable[[], object]]]
) -> Growth:
    """Return what each size costs, and its limit."""
    rows = [(size, best_ms(work), best_ms(least)) for size, work, least in points]
    sizes, cost_ms, limit_ms = zip(*rows, strict=True)
    return Growth(what=what, of=of, limit=limit, sizes=sizes, cost_ms=cost_ms, limit_ms=limit_ms)


def by_pixels() -> Growth:
    plan, generator = design(np.deg2rad(ANGLES_DEG)), np.random.default_rng(1)

    def points() -> Iterator[tuple[int, Callable[[], object], Callable[[], object]]]:
        for side in (128, 256, 512, 1024, 2048):
            frames = generator.integers(500, 3500, (4, side, side), dtype=np.uint16).astype(np.float32)
            yield side * side, lambda frames=frames: polarization_maps(frames, plan), frames.copy

    return grown("maps of four frames", "pixels", "a copy of the frames", points())


def drawn_run(folder: Path, cycles: int) -> Run:
    """Return a run of even light with noise, written as a session does."""
    generator = np.random.default_rng(2)
    with RunWriter.create(folder, {"origin": "device", "rig": {"polarizer": {"extinction_ratio": 500.0}}}) as writer:
        for place in range(cycles * len(ANGLES_DEG)):
            angle_deg = ANGLES_DEG[place % len(ANGLES_DEG)]
            record = FrameRecord(
                kind="scene",
                sequence=place,
                cycle=place // len(ANGLES_DEG),
                polarizer_angle_deg=angle_deg,
                polarizer_angle_target_deg=angle_deg,
                exposure_s=0.01,
                bit_depth=12,
                saturation_dn=4095.0,
                black_level_dn=64.0,
            )
            writer.write_frame(record, generator.normal(1500.0, 20.0, SHAPE).astype(np.uint16))
    return read_run(folder)


def by_frames(run: Run) -> Growth:
    def points() -> Iterator[tuple[int, Callable[[], object], Callable[[], object]]]:
        for count in (4, 8, 16, 32, 64):
            some = run.frames[:count]
            yield (
                count,
                lambda some=some: sum(int(run.counts(record)[0, 0]) for record in some),
                lambda some=some: [hashlib.sha256((run.path / one.file).read_bytes()).digest() for one in some],
            )

    return grown("reading a run of 782 x 582", "frames", "bytes and SHA-256", points())


def by_regions(run: Run) -> Growth:
    counts = run.counts(run.frames[0])

    def points() -> Iterator[tuple[int, Callable[[], object], Callable[[], object]]]:
        for count in (1, 4, 16, 64):
            regions = [
                Region(
                    name=f"r{k}", rectangle=Rectangle(x=12 + 90 * (k % 8), y=12 + 70 * (k // 8), width=60, height=50)
                )
                for k in range(count)
            ]
            limit = lambda: [counts.astype(np.float64).sum() for _ in run.frames]  # noqa: E731
            yield count, lambda regions=regions: measure(run, regions=regions), limit

    return grown("measuring 64 frames", "regions", "one sum over the counts", points())


def by_streams() -> Growth:
    state = AtmosphereState(visibility_m=23_000.0)
    layers = column(state, wavelength_m=550e-9).layers(fine=False)
    matrix = np.random.default_rng(3).random((256, 256))
    second_a_flop = best_ms(lambda: matrix @ matrix) * 1e-3 / (2.0 * 256**3)

    def points() -> Iterator[tuple[int, Callable[[], object], Callable[[], object]]]:
        for nodes in (4, 6, 8, 12, 16):
            # Adding two layers takes some ten products of matrices of three Stokes parameters times the nodes, of each
            # order and at each of the doublings and layers.
            flops = 2.0 * (3 * nodes) ** 3 * 10.0 * len(layers) * nodes
            limit_s = flops * second_a_flop
            yield (
                2 * nodes,
                lambda nodes=nodes: solve(layers, mu0=cos(radians(50.0)), albedo=0.1, nodes=nodes),
                lambda limit_s=limit_s: _spend(limit_s),
            )

    return grown("one wavelength of the sky", "streams", "ten matrix products a layer and order", points())


def _spend(seconds: float) -> None:
    """Take so much of the processor."""
    end_s = time.process_time() + seconds
    while time.process_time() < end_s:
        pass


def by_cases() -> Growth:
    predictor = ScenePredictor(load_scene(ROOT / "examples" / "scene-panels.toml"), None)
    key = "acquisition.exposure_ms"

    def predicted(count: int) -> None:
        for k in range(count):
            predictor.predictions({key: 0.03 + 1e-4 * k})

    one_ms = best_ms(lambda: predicted(1))

    def points() -> Iterator[tuple[int, Callable[[], object], Callable[[], object]]]:
        for count in (1, 4, 16, 64):
            yield count, lambda count=count: predicted(count), lambda count=count: _spend(1e-3 * one_ms * count)

    return grown("predictions of the panels", "cases", "one case times their number", points())


def picture(found: list[Growth], file: Path) -> None:
    """Draw each cost and its limit against the size, both axes logarithmic."""
    from matplotlib import rcParams
    from matplotlib.figure import Figure

    rcParams.update({"svg.hashsalt": "benchmark-growth", "svg.fonttype": "none"})
    figure = Figure(figsize=(15.0, 3.4), layout="constrained")
    for axes, one in zip(figure.subplots(1, len(found)), found, strict=True):
        axes.loglog(one.sizes, one.cost_ms, "o-", color="#0072b2", label="rigctl")
        axes.loglog(one.sizes, one.limit_ms, "s--", color="#d55e00", label=one.limit)
        axes.set_title(f"{one.what}\ngrows with power {one.power:.2f}", fontsize=9)
        axes.set_xticks(one.sizes, [f"{size}" if size < 10_000 else f"{size:.1e}" for size in one.sizes])
        axes.tick_params(axis="x", which="minor", bottom=False, labelbottom=False)
        axes.tick_params(axis="x", labelsize=7)
        axes.set_xlabel(one.of)
        axes.set_ylabel("processor [ms]")
        axes.legend(fontsize=7)
        axes.grid(alpha=0.3)
    figure.savefig(file, metadata={"Date": None})


def main() -> int:
    """Print the table and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=PICTURE)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        run = drawn_run(Path(folder) / "run", 16)
        found = [by_pixels(), by_frames(run), by_regions(run), by_streams(), by_cases()]
    picture(found, options.out)
    print("| what | grows with | size: ms of the processor (times its limit) | power | limit |")
    print("|---|---|---|---:|---|")
    for one in found:
        cells = ", ".join(
            f"{size}: {cost:.3g} ({cost / least:.1f})"
            for size, cost, least in zip(one.sizes, one.cost_ms, one.limit_ms, strict=True)
        )
        print(f"| {one.what} | {one.of} | {cells} | {one.power:.2f} | {one.limit} |")
    print("\n![Cost against size](pictures/benchmark-growth.svg)")
    return 0


if __name__ == "__main__":
    sys.exit(main())
