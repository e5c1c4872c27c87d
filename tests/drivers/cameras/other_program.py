"""A program of somebody else's that saves pictures into a folder all the time."""

import threading
from contextlib import contextmanager

import numpy as np

from tests.drivers.cameras.dng import write_dng

PERIOD_S = 0.02


@contextmanager
def other_program(folder, *, exposure=None):
    """Save DNG files until the context is left, the first one at once, each under its final name when it is whole."""
    stopped = threading.Event()
    save(folder, 0, exposure)
    thread = threading.Thread(target=_run, args=(folder, exposure, stopped))
    thread.start()
    try:
        yield
    finally:
        stopped.set()
        thread.join()


def save(folder, number, exposure=None):
    counts = np.random.default_rng(number).integers(200, 4096, (48, 64), dtype=np.uint16)
    write_dng(folder / "unfinished", counts, exposure=exposure)
    (folder / "unfinished").rename(folder / f"{number:06d}.dng")
    return counts


def _run(folder, exposure, stopped):
    number = 0
    while not stopped.wait(PERIOD_S):
        number += 1
        save(folder, number, exposure)
