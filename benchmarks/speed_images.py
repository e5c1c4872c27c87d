"""Pictures: polarization maps beside polanalyser, regions, packed samples, reading frames, pictures of the page."""

import hashlib
import importlib.util
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.peers import peer_python
from benchmarks.timing import Row, least_s
from drivers.cameras.samples import GENICAM, needed_bytes, unpack
from model.processing.maps import polarization_maps
from model.processing.reconstruction import design
from rigctl.files.regions import Rectangle, Region
from rigctl.measure.measure import measure
from rigctl.runs.folder import Run, read_run
from rigctl.runs.records import FrameRecord
from rigctl.runs.writer import RunWriter
from rigctl.web.pictures import MAP_WIDTH, MOST_WIDTH, CyclePictures, map_pictures, picture_of, smaller

SHAPES = {"782 x 582": (582, 782), "2448 x 2048": (2048, 2448)}
ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)
_MS = 1e3
# What the peer's process runs: a time of the processor for every line that it is sent.
_POLANALYSER = """
import sys, time
import numpy as np, polanalyser
height, width = map(int, sys.argv[1:])
frames = list(np.random.default_rng(1).integers(500, 3500, (4, height, width), dtype=np.uint16))
angles = np.deg2rad([0.0, 45.0, 90.0, 135.0])
for _ in sys.stdin:
    start = time.process_time()
    stokes = polanalyser.calcStokes(frames, angles)
    polanalyser.cvtStokesToDoLP(stokes)
    polanalyser.cvtStokesToAoLP(stokes)
    print(time.process_time() - start, flush=True)
"""


def rows() -> Iterator[Row]:
    """Time maps at two sizes, then what the session and the page do with a frame."""
    for size, shape in SHAPES.items():
        yield from _maps(size, shape)
    yield _unpacking()
    with tempfile.TemporaryDirectory() as folder:
        run = _drawn_run(Path(folder) / "run")
        yield _reading(run)
        yield from _regions(run)
    for size, shape in SHAPES.items():
        yield from _page(size, shape)


def _maps(size: str, shape: tuple[int, int]) -> Iterator[Row]:
    frames = np.random.default_rng(1).integers(500, 3500, (4, *shape), dtype=np.uint16)
    plan, single = design(np.deg2rad(ANGLES_DEG)), frames.astype(np.float32)
    deviations = np.full((4, *shape), 20.0, dtype=np.float32)
    works: dict[str, Callable[[], object]] = {"numpy": lambda: polarization_maps(frames, plan)}
    works["numpy, with deviations"] = lambda: polarization_maps(frames, plan, deviations=deviations)
    if importlib.util.find_spec("numba") is not None:
        works["fast"] = lambda: polarization_maps(frames, plan, engine="fast")
        works["fast, with deviations"] = lambda: polarization_maps(frames, plan, deviations=deviations, engine="fast")
    *times, copy = least_s(*works.values(), single.copy)
    took = dict(zip(works, times, strict=True))
    with _polanalyser(shape) as call:
        peer = None if call is None else min(call() for _ in range(8))
    for name, seconds in took.items():
        beside, theirs, most = ("polanalyser", peer, 0.12 if name == "numpy" else 0.04)
        if "deviations" in name:
            beside, theirs, most = ("numpy engine", took["numpy, with deviations"], 0.125)
        if beside == "polanalyser" and peer is None:
            beside, theirs, most = ("a copy of the frames", copy, None)
        if seconds is theirs:
            beside, theirs, most = ("a copy of the frames", copy, None)
        work = f"maps of {size}, {name}"
        yield Row(
            work=work,
            ours=_MS * seconds,
            unit="ms",
            beside=beside,
            theirs=_MS * theirs if theirs else None,
            most_ratio=most,
        )


@contextmanager
def _polanalyser(shape: tuple[int, int]) -> Iterator[Callable[[], float] | None]:
    """Give what has the peer compute once, and returns its time; None without a peer."""
    python = peer_python("polanalyser")
    if python is None:
        yield None
        return
    words = [str(python), "-c", _POLANALYSER, *map(str, shape)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        asked, answered = process.stdin, process.stdout
        if asked is None or answered is None:
            raise OSError("the peer's process has no streams")

        def call() -> float:
            asked.write("\n")
            asked.flush()
            return float(answered.readline())

        yield call
        asked.close()


def _unpacking() -> Row:
    height, width = SHAPES["782 x 582"]
    packed = next(one for one in GENICAM.values() if one.name == "Mono12Packed")
    data = np.random.default_rng(1).integers(0, 256, needed_bytes(packed, samples=width * height), dtype=np.uint8)
    ours, copy = least_s(
        lambda: unpack(data, pixel_format=packed, width=width, height=height), np.zeros((height, width), np.uint16).copy
    )
    return Row(
        work="unpacking Mono12Packed, 782 x 582",
        ours=_MS * ours,
        unit="ms",
        beside="a copy of the counts",
        theirs=_MS * copy,
        most=1.0,
    )


def _drawn_run(folder: Path) -> Run:
    """Return 64 frames of even light with noise, written as a session does."""
    generator = np.random.default_rng(2)
    with RunWriter.create(folder, {"origin": "device", "rig": {"polarizer": {"extinction_ratio": 500.0}}}) as writer:
        for place in range(64):
            angle_deg = ANGLES_DEG[place % 4]
            record = FrameRecord(
                kind="scene",
                sequence=place,
                cycle=place // 4,
                polarizer_angle_deg=angle_deg,
                polarizer_angle_target_deg=angle_deg,
                exposure_s=0.01,
                bit_depth=12,
                saturation_dn=4095.0,
                black_level_dn=64.0,
            )
            writer.write_frame(record, generator.normal(1500.0, 20.0, SHAPES["782 x 582"]).astype(np.uint16))
    return read_run(folder)


def _reading(run: Run) -> Row:
    def alone() -> None:
        for record in run.frames:
            hashlib.sha256((run.path / record.file).read_bytes()).digest()

    ours, limit = least_s(lambda: [run.counts(record) for record in run.frames], alone)
    frames = len(run.frames)
    return Row(
        work="a frame read and checked, 782 x 582",
        ours=_MS * ours / frames,
        unit="ms",
        beside="its bytes and SHA-256",
        theirs=_MS * limit / frames,
        most_ratio=1.6,
    )


def _regions(run: Run) -> Iterator[Row]:
    def regions(count: int) -> list[Region]:
        return [
            Region(name=f"r{k}", rectangle=Rectangle(x=12 + 90 * (k % 8), y=12 + 70 * (k // 8), width=60, height=50))
            for k in range(count)
        ]

    def sums() -> None:
        for record in run.frames:
            counts = run.counts(record)
            for k in range(64):
                x, y = 12 + 90 * (k % 8), 12 + 70 * (k // 8)
                part = counts[y : y + 50, x : x + 60].astype(np.float64)
                part.mean(), part.var()

    one, many, least = least_s(
        lambda: measure(run, regions=regions(1)), lambda: measure(run, regions=regions(64)), sums, rounds=3
    )
    yield Row(work="measuring 64 frames, 1 region", ours=_MS * one, unit="ms")
    yield Row(
        work="measuring 64 frames, 64 regions",
        ours=_MS * many,
        unit="ms",
        beside="reading, mean and variance of each",
        theirs=_MS * least,
        most_ratio=2.0,
    )


def _page(size: str, shape: tuple[int, int]) -> Iterator[Row]:
    rng = np.random.default_rng(1)
    frames = [rng.normal(1000.0 + 100.0 * k, 20.0, shape).round().astype(np.uint16) for k in range(4)]

    def maps() -> None:
        small = np.stack([smaller(counts, most_width=MAP_WIDTH) for counts in frames])
        cycle: Any = CyclePictures(
            frames=small, angles_rad=np.deg2rad(ANGLES_DEG), dark_dn=np.zeros(4), extinction_ratio=np.inf
        )
        map_pictures(cycle, dolp_top=1.0)

    picture, three = least_s(
        lambda: picture_of(frames[0], saturation_dn=4095.0, most_width=MOST_WIDTH, zebra=True), maps
    )
    yield Row(work=f"a frame as a picture of the page, {size}", ours=_MS * picture, unit="ms", most=33.0)
    yield Row(work=f"the three maps of the page, {size}", ours=_MS * three, unit="ms", most=100.0)
