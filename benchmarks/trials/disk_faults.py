"""A disk that freezes in every phase of a session: the session says so, in time, and its frames are whole.

The disk is ext4 on a loop device that the kernel freezes; writers then wait. Needs the right to mount. Phases
are counted in flushes: the disk freezes before the n-th.
"""

import ctypes
import fcntl
import os
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeVar
from unittest import mock

from benchmarks.trials.camera_faults import GRACE_S, CameraOutcome, Cell
from benchmarks.trials.loop_disk import ext4_image, mounted, why_not
from drivers.caller import Caller
from rigctl.base import durable as disk_calls
from rigctl.errors import RunFolderError
from rigctl.files.rig_file import RigFile, load_rig
from rigctl.files.session_file import SessionFile
from rigctl.runs.check import verify_run
from rigctl.runs.folder import read_run
from rigctl.runs.writer import RunWriter
from rigctl.session.take import take_session

Result = TypeVar("Result")

ALLOWED_S, _THAW_S = 0.5, 5.0
_FREEZE, _THAW = 0xC0045877, 0xC0045878
_THREADS = ("frame writer", "calls to the disk")
_RIG = Path(__file__).parents[2] / "examples" / "rig-sim.toml"
_DISK_BYTES = 24 * 1024 * 1024
_SESSION = SessionFile.model_validate(
    {
        "name": "frozen",
        "take": [{"kind": "scene", "exposure_ms": 0.03, "cycles": 1, "angles_deg": [0, 90]}],
        "interlocks": {"disk_free_mb": 0},
    }
)


class FreezingDisk:
    """A mounted disk that freezes before its n-th flush; None: never."""

    def __init__(self, place: Path, *, before_flush: int | None) -> None:
        self._place, self._before = place, before_flush
        self._flush: Callable[[int], None] = os.fsync
        self._lock = threading.Lock()
        self._under_way: dict[int, float] = {}
        self.flushes: list[str] = []
        self.frozen_s: float | None = None

    def flush(self, descriptor: int) -> None:
        """Stand in for `os.fsync`."""
        name = Path(f"/proc/self/fd/{descriptor}").readlink()
        if name.is_relative_to(self._place):
            with self._lock:
                self.flushes.append(name.name)
                if len(self.flushes) == self._before:
                    _control(self._place, _FREEZE)
                    self.frozen_s = time.monotonic()
        self._flush(descriptor)

    def watched(self, call: Callable[..., Result]) -> Callable[..., Result]:
        """Return a function that does the same, and is known to be under way meanwhile."""

        def watched(*arguments: object, **more: object) -> Result:
            thread = threading.get_ident()
            self._under_way.setdefault(thread, time.monotonic())
            result = call(*arguments, **more)  # of one that is left behind it stays known
            self._under_way.pop(thread)
            return result

        return watched

    def held_s(self) -> float:
        """Return for how long calls have been held by now, since the first of them [s]."""
        starts_s = [start_s for start_s in self._under_way.values() if self.frozen_s is not None]
        return time.monotonic() - max(self.frozen_s or 0.0, min(starts_s)) if starts_s else 0.0

    def thaw(self) -> None:
        """Let it go on. May be called twice."""
        if self.frozen_s is not None:
            with suppress(OSError):  # it may have gone on already
                _control(self._place, _THAW)


def run_disk_cell(rig_file: RigFile, before_flush: int | None) -> tuple[CameraOutcome, list[str]]:
    """Return how a session ended whose disk froze, and what was flushed until then."""
    with tempfile.TemporaryDirectory() as folder:
        image, place = ext4_image(Path(folder) / "disk.img", size_bytes=_DISK_BYTES), Path(folder) / "disk"
        with mounted(image, place), _freezing(place, before_flush) as disk:
            word, duration_s = _taken(rig_file, place / "run", disk)
            disk.thaw()
            _await_left_behind()
            is_whole = _is_whole(place / "run")
    is_right = word in ("complete", "the disk hangs") and duration_s <= ALLOWED_S + GRACE_S and is_whole
    return CameraOutcome(word=word, duration_s=duration_s, is_right=is_right), disk.flushes


def _taken(rig_file: RigFile, run: Path, disk: FreezingDisk) -> tuple[str, float]:
    """Take a session; return how it ended, and how long after the disk froze [s]."""
    watchdog = threading.Timer(_THAW_S, disk.thaw)
    watchdog.start()
    try:
        take_session(rig_file, _SESSION, run, files={})
        word = "complete"
    except RunFolderError as error:
        word = "the disk hangs" if "the disk hangs" in str(error) else str(error)
    finally:
        watchdog.cancel()
    return word, disk.held_s()


def _is_whole(run: Path) -> bool:
    """Return whether every frame that the manifest names is what was written; where there is no run yet, too."""
    if not (run / "manifest.jsonl").exists():
        return True
    try:
        return not read_run(run).frames or verify_run(run).ok
    except RunFolderError:
        return False


def _await_left_behind() -> None:
    """Return once the threads that the disk held have come to their end."""
    for thread in threading.enumerate():
        if thread.name in _THREADS:
            thread.join(_THAW_S)


@contextmanager
def _freezing(place: Path, before_flush: int | None) -> Iterator[FreezingDisk]:
    disk = FreezingDisk(place, before_flush=before_flush)
    work, write = disk.watched(Caller.call), disk.watched(RunWriter.write_frames)
    with (
        mock.patch.object(os, "fsync", disk.flush),
        mock.patch.object(disk_calls, "STALLED_S", ALLOWED_S),
        mock.patch.object(Caller, "call", lambda *arguments, **more: work(*arguments, **more)),
        mock.patch.object(RunWriter, "write_frames", lambda *arguments: write(*arguments)),
    ):
        try:
            yield disk
        finally:
            disk.thaw()


def _control(place: Path, number: int) -> None:
    descriptor = os.open(place, os.O_RDONLY)
    try:
        fcntl.ioctl(descriptor, number, ctypes.c_int(0))
    finally:
        os.close(descriptor)


def disk_rows() -> Iterator[tuple[str, list[Cell]]]:
    """Yield each flush before which the disk freezes, with its cell."""
    if (reason := why_not()) is not None:
        print(f"not run: {reason}")
        return
    rig_file = load_rig(_RIG)
    _, flushes = run_disk_cell(rig_file, None)
    for number, name in enumerate(flushes, 1):
        outcome, _ = run_disk_cell(rig_file, number)
        yield f"{number}: `{name}`", [(f"{outcome.word}; {outcome.duration_s:.1f} s", outcome.is_right)]
