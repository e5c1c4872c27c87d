"""A camera that runs by itself, a busy host, a polarizer that turns: is any picture of the old angle accepted?

The stage is a simulated ELL14 behind its driver and a serial line, the camera a simulated one behind its driver and
the network. Each picture holds, in every pixel, where the polarizer truly stood when its exposure began. Before each
turn the host computes and reads no pictures, so that old ones wait; other processes keep its cores busy. A reader who
takes the picture that comes first, as many programs do, is tried beside the driver.
"""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.trials.lossy_network import why_no_camera
from drivers.cameras.aravis import load_aravis
from drivers.cameras.gige import GigeLink, open_gige, read_gige_place
from drivers.interfaces import Frame, RotationStage
from drivers.stages.elliptec import open_elliptec
from sim_devices.cameras.gige_server import serve_gige_camera
from sim_devices.clock import SimClock
from sim_devices.stages.catalogue import make_stage, parse_stage_address
from sim_devices.stages.stage import serve_on_pty
from tests.sim_devices.cameras.known_pictures import KnownPictures

ADDRESS = "127.0.0.1"
WIDTH, HEIGHT = 782, 582
EXPOSURE_S, FRAME_RATE_HZ = 0.02, 20.0
PLACE = f"{ADDRESS}?pixel_format=Mono12&trigger=free&frame_rate_hz={FRAME_RATE_HZ:g}"
TURN_DEG = 77.0  # no multiple of it comes to an angle that was there before
# A picture's counts are tenths of a degree, rounded. The stage rests to a thousandth.
CODES_PER_DEG = 10
TOLERANCE_DEG = 0.06
TIMEOUT_S = 20.0

Reader = Callable[[], float]


@dataclass(frozen=True, kw_only=True)
class Score:
    """How a reader did."""

    turns: int
    wrong: int  #: pictures of another angle that it took for pictures of the new angle
    slowest_s: float  #: longest wait for a picture
    passed_over: int = 0  #: pictures that came and were refused as too old


class AngleCamera(KnownPictures):
    """A source of pictures that hold the true angle of the polarizer."""

    def __init__(self, true_angle_deg: Callable[[], float], *, width: int, height: int) -> None:
        super().__init__(width=width, height=height)
        self._true_angle_deg = true_angle_deg

    def take_frame(self, *, timeout_s: float) -> Frame:
        code = round(self._true_angle_deg() % 360.0 * CODES_PER_DEG)
        frame = super().take_frame(timeout_s=timeout_s)
        return replace(frame, counts=np.full_like(frame.counts, code))


@contextmanager
def running_rig(*, speed: float, width: int = WIDTH, height: int = HEIGHT) -> Iterator[RotationStage]:
    """Give the stage, once the camera that sees its polarizer is on the network."""
    clock = SimClock(speed=speed)
    simulated = make_stage(parse_stage_address(f"sim:ellx?speed={speed:g}"), clock=clock)
    source = AngleCamera(simulated.true_angle_deg, width=width, height=height)
    with (
        serve_on_pty(simulated, clock=clock) as port,
        open_elliptec(port, tolerance_deg=0.05) as stage,
        serve_gige_camera(source, address=ADDRESS),
    ):
        stage.home()
        yield stage


def driver_score(stage: RotationStage, *, turns: int, busy_s: float) -> Score:
    """Return how the driver does."""
    with open_gige(PLACE) as camera:
        camera.configure(exposure_s=EXPOSURE_S, gain_db=0.0)
        score = _turned(stage, lambda: _angle(camera.take_frame(timeout_s=TIMEOUT_S).counts), turns, busy_s)
        return replace(score, passed_over=camera.tally().too_old)


def first_come_score(stage: RotationStage, *, turns: int, busy_s: float) -> Score:
    """Return how a reader does who takes whatever complete picture comes first."""
    link = GigeLink(load_aravis(), read_gige_place(PLACE))
    try:
        link.configure(exposure_s=EXPOSURE_S, gain_db=0.0)
        link.restart()
        return _turned(stage, lambda: _first(link), turns, busy_s)
    finally:
        link.close(answers=True)


def _turned(stage: RotationStage, read: Reader, turns: int, busy_s: float) -> Score:
    """Turn again and again; return how often the picture's angle was not the stage's."""
    wrong, waits_s = 0, []
    for turn in range(1, turns + 1):
        _compute(busy_s)
        angle_deg = stage.move_to(turn * TURN_DEG % 360.0).position.angle_deg
        begin_s = time.monotonic()
        off_deg = (read() - angle_deg + 180.0) % 360.0 - 180.0
        waits_s.append(time.monotonic() - begin_s)
        wrong += abs(off_deg) > TOLERANCE_DEG
    return Score(turns=turns, wrong=wrong, slowest_s=max(waits_s))


def _first(link: GigeLink) -> float:
    while True:
        received = link.stream.receive(timeout_s=TIMEOUT_S)
        if received is None:
            raise TimeoutError("no picture came")
        if received.damage is None:
            return _angle(np.frombuffer(received.data, "<u2"))


def _angle(counts: np.ndarray) -> float:
    """Return the angle that a picture holds; it has to be one and the same in every pixel."""
    if counts.min() != counts.max():
        raise ValueError("a picture is made up of several")
    return float(counts.flat[0]) / CODES_PER_DEG


def _compute(duration_s: float) -> None:
    end_s = time.monotonic() + duration_s
    while time.monotonic() < end_s:
        sum(range(1000))


@contextmanager
def burners(count: int) -> Iterator[None]:
    """Keep so many cores busy."""
    processes = [subprocess.Popen([sys.executable, "-c", "while True: sum(range(10000))"]) for _ in range(count)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def run_turns(*, turns: int = 100, busy_s: float = 1.0, busy_processes: int = 2) -> bool:
    """Try both readers and print their scores; return whether the driver took no wrong picture."""
    if (reason := why_no_camera()) is not None:
        print(f"not run: {reason}")
        return True
    with running_rig(speed=1.0) as stage, burners(busy_processes):
        naive = first_come_score(stage, turns=max(2, turns // 10), busy_s=busy_s)
        print(f"first come, first taken: {naive.wrong} of {naive.turns} pictures are of another angle")
        score = driver_score(stage, turns=turns, busy_s=busy_s)
    print(
        f"the driver: {score.wrong} of {score.turns} pictures are of another angle; it passed over {score.passed_over} "
        f"that came too early, and waited for {score.slowest_s:.2f} s at most"
    )
    return score.wrong == 0
