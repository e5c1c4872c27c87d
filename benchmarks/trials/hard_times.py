"""Troubles of sessions other than kills: two `resume` at once, a stopped process, a clock set, devices and disks gone.

Each trouble comes at a random moment. Required: a documented exit code, no internal error, no frame lost, torn or
mislabelled, and a run that is whole after `rigctl resume`. Needs root for the disks.
"""

import fcntl
import random
import signal
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from benchmarks.trials.harness import attempts
from benchmarks.trials.kills import killed_session, mislabelled, write_files
from benchmarks.trials.loop_disk import ext4_image, mounted, why_not
from drivers.cameras.aravis import load_aravis
from drivers.errors import NotConnectedError
from rigctl.base.numbers import NS_PER_S
from rigctl.files.session_file import load_session
from rigctl.runs.check import verify_run
from rigctl.runs.folder import read_run
from rigctl.runs.records import EVENTS_FILE, read_events
from rigctl.session.take import take_session
from rigctl.session.timing import SessionClock
from sim_devices.truth_log import read_truth
from tests.rigctl.example_files import small_rig

_FRAMES, _LONGEST_S, _PATIENCE_S = 20, 2.0, 300.0
_STOPPED_S, _GONE_S, _JUMP_S = 20.0, 3.0, 3600.0
_ADDRESS = "127.0.0.1"
_DISK_BYTES = 128 * 1024 * 1024
# EXT4_IOC_SHUTDOWN without a flush of the journal: what a disk that fails leaves of a mounted file system.
_SHUTDOWN, _NO_FLUSH = 0x8004587D, 2
_KNOWN_EXITS = (0, 3, 4, 75)
Trouble = Callable[[Path, random.Random], list[str]]


def run_hard_times(*, times: int = 5, seed: int = 1) -> bool:
    """Cause each trouble several times; return whether all runs became whole."""
    sound = True
    for name, trouble in _TROUBLES.items():

        def attempt(number: int, name: str = name, trouble: Trouble = trouble) -> list[str]:
            with tempfile.TemporaryDirectory() as folder:
                return trouble(Path(folder), random.Random(f"{name}-{seed}-{number - 1}"))

        sound &= attempts(name, times, attempt)
    return sound


def two_go_on(folder: Path, draws: random.Random) -> list[str]:
    """Kill a session, and let two go on with it at once."""
    files, run = write_files(folder), folder / "run"
    killed_session(run, files, delay_s=draws.uniform(0.0, _LONGEST_S))
    both = [_started(["resume", run]) for _ in range(2)]
    codes = sorted(_ended(process)[0] for process in both)
    # Whoever comes second is told so, or finds nothing left to do; both stand back only where they met at the devices.
    bad = [] if codes[0] == 0 and set(codes) <= {0, 3, 4} else [f"exit {codes}"]
    return bad + _wrong(run, folder, frames=_FRAMES)


def stopped_process(folder: Path, draws: random.Random) -> list[str]:
    """Stop the process of a session for a while, as a busy host or a debugger does."""
    files, run = write_files(folder), folder / "run"
    process = _begun(files, run)
    time.sleep(draws.uniform(0.0, _LONGEST_S))
    process.send_signal(signal.SIGSTOP)
    time.sleep(_STOPPED_S)
    process.send_signal(signal.SIGCONT)
    return _known(process, run) + _wrong(run, folder, frames=_FRAMES)


def simulator_goes(folder: Path, draws: random.Random) -> list[str]:
    """Kill the simulator of camera and stage, often in mid-move: a terminal closes, a camera is silent; both return."""
    try:
        load_aravis()
    except NotConnectedError:
        return []
    files, run, link = write_files(folder), folder / "run", folder / "stage"
    text = files[0].read_text()
    port = next(line for line in text.splitlines() if line.startswith("port = "))
    real = folder / "real.toml"
    real.write_text(
        text[: text.index("# What the simulated rig truly is.")]
        .replace(port, f'port = "{link}"')
        .replace(f'address = "sim:gc780?truth={folder / "truth.jsonl"}"', f'address = "gige:{_ADDRESS}"')
    )
    files[1].write_text('name = "gone"\n[[take]]\nkind = "scene"\nexposure_ms = 0.03\ncycles = 5\n')
    with _simulator(files[0], link) as first:
        process = _begun((real, files[1]), run)
        time.sleep(draws.uniform(0.0, _LONGEST_S))
        first.kill()
        first.wait()
        time.sleep(_GONE_S)
        with _simulator(files[0], link):
            return _known(process, run) + _wrong(run, folder, frames=_FRAMES, is_labelled=False)


def clock_is_set(folder: Path, draws: random.Random) -> list[str]:
    """Set the host's clock by an hour, forward or back, in the middle of a session."""
    begun_ns, jump_ns = time.monotonic_ns(), round(draws.choice((-1, 1)) * _JUMP_S * NS_PER_S)
    at_ns = begun_ns + round(draws.uniform(0.2, 1.0) * NS_PER_S)

    def utc_ns() -> int:
        return time.time_ns() + (jump_ns if time.monotonic_ns() > at_ns else 0)

    session = load_session(write_files(folder)[1])
    take_session(small_rig(folder), session, folder / "run", files={}, clock=SessionClock(utc_ns=utc_ns))
    times = [frame.start_utc or "" for frame in read_run(folder / "run").frames]
    seconds = [float(text[11:13]) * 3600 + float(text[14:16]) * 60 + float(text[17:19]) for text in times]
    bad = [] if max(seconds) - min(seconds) < _JUMP_S / 2 else ["frames have the time of the clock that was set"]
    return bad + _wrong(folder / "run", folder, frames=_FRAMES, is_labelled=False)


def disk_fails(folder: Path, draws: random.Random) -> list[str]:
    """Let the disk under a run fail: every later write is refused. After a new mount the session is gone on with."""
    if (reason := why_not()) is not None:
        return [] if "root" in reason else [reason]
    files, image = write_files(folder), ext4_image(folder / "disk.img", size_bytes=_DISK_BYTES)
    with mounted(image, folder / "disk") as disk:
        process = _begun(files, disk / "run")
        time.sleep(draws.uniform(0.0, _LONGEST_S))
        with (disk / "run" / "session.json").open("rb") as file:
            fcntl.ioctl(file, _SHUTDOWN, struct.pack("I", _NO_FLUSH))
        code, words = _ended(process)
    bad = [] if code in _KNOWN_EXITS else [f"exit {code}: {words[-200:]}"]
    with mounted(image, folder / "disk") as disk:
        resumed = _ended(_started(["resume", disk / "run"]))
        bad += [] if resumed[0] == 0 else [f"resume ends with {resumed[0]}: {resumed[1][-200:]}"]
        return bad + _wrong(disk / "run", folder, frames=_FRAMES)


_TROUBLES: dict[str, Trouble] = {
    "two go on at once": two_go_on,
    "process stopped for 20 s": stopped_process,
    "simulator gone and back": simulator_goes,
    "clock set by an hour": clock_is_set,
    "disk fails": disk_fails,
}


def _started(words: list[str | Path]) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "rigctl", *words]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def _begun(files: tuple[Path, Path], run: Path) -> "subprocess.Popen[str]":
    """Start a session; return once it has noted its first event."""
    process = _started(["acquire", *files, "--out", run])
    deadline = time.monotonic() + _PATIENCE_S
    while not (run / EVENTS_FILE).exists() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    return process


def _ended(process: "subprocess.Popen[str]") -> tuple[int, str]:
    _, words = process.communicate(timeout=_PATIENCE_S)
    return process.returncode, words


def _known(process: "subprocess.Popen[str]", run: Path) -> list[str]:
    """Wait for a session, and go on with it where it ended before its end; return what is wrong."""
    code, words = _ended(process)
    if code not in _KNOWN_EXITS:
        return [f"exit {code}: {words[-200:]}"]
    again = (0, "") if code == 0 else _ended(_started(["resume", run]))
    return [] if again[0] == 0 else [f"resume ends with {again[0]}: {again[1][-200:]}"]


def _wrong(run: Path, folder: Path, *, frames: int, is_labelled: bool = True) -> list[str]:
    found = verify_run(run)
    bad = [f"{one.file}: {one.problem}" for one in found.bad]
    bad += [] if (found.state, found.frames) == ("whole", frames) else [f"{found.state}, {found.frames} frames"]
    bad += mislabelled(read_run(run), read_truth(folder / "truth.jsonl")) if is_labelled and not bad else []
    return bad + [f"event: {event.facts}" for event in read_events(run) if "Traceback" in str(event.facts)]


@contextmanager
def _simulator(rig: Path, link: Path) -> Iterator["subprocess.Popen[str]"]:
    """Give the process that serves camera and stage of a rig; the link leads to the stage's terminal."""
    process = _started(["sim", "camera", _ADDRESS, "--rig", rig])
    words = process.stderr.readline() if process.stderr is not None else ""
    link.unlink(missing_ok=True)
    link.symlink_to(words.partition("its stage on ")[2].partition(";")[0])
    try:
        yield process
    finally:
        process.terminate()
        process.communicate()
