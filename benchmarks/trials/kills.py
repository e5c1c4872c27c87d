"""`rigctl acquire` is killed at random moments and resumed: no frame is lost, torn, doubled or mislabelled.

Labels are compared with the log that the simulator writes of each exposure (`truth=FILE` in the camera's address),
counts with those of an undisturbed session. `lost_terminals` runs each session on a terminal of its own and closes that
at a random moment; half of these sessions are killed later on, the others have to finish.
"""

import fcntl
import os
import pty
import random
import select
import shutil
import subprocess
import sys
import tempfile
import termios
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.trials.harness import attempts
from rigctl.base.numbers import NS_PER_S, utc_text
from rigctl.runs.check import verify_run
from rigctl.runs.fits import decode_frame
from rigctl.runs.folder import FRAMES_FOLDER, MANIFEST_FILE, Run, read_run
from rigctl.runs.records import EVENTS_FILE, SESSION_FILE, FrameRecord, read_events
from sim_devices.truth_log import TrueFrame, read_truth

EXAMPLES = Path(__file__).parents[2] / "examples"
_START_TIMEOUT_S = 120.0
# A terminal may be gone before the devices are open: so long after the program begins.
_BEFORE_S = 1.0
# Without landing errors of the stage the light of each frame is that of the undisturbed session.
_STAGE, _EXACT_STAGE = "sim:ellx?speed=20", "sim:ellx?speed=60&landing=0"
_CAMERA, _TRUTH_FILE = "sim:gc780", "truth.jsonl"
# The encoder's step of an ELL14 is 360 / 143360 deg: a readback is off by half of it at most, and by rounding.
_ANGLE_TOLERANCE_DEG = 0.5 * 360.0 / 143360.0 + 1e-9
_SESSION = """
name = "killed"
[[take]]
kind = "dark"
exposure_ms = 0.03
cycles = 4
[[take]]
kind = "scene"
exposure_ms = 0.03
cycles = 4
[interlocks]
disk_free_mb = 0
"""
_OF_THE_MOMENT = ("start_utc", "end_utc", "start_monotonic_ns", "settle_s", "checksum")


@contextmanager
def _undisturbed_session() -> Iterator[tuple[Path, tuple[Path, Path], Run, float]]:
    """A folder with a rig and a session file, the run that nothing disturbs, and how long it takes [s]."""
    with tempfile.TemporaryDirectory() as folder:
        files = write_files(Path(folder))
        undisturbed = undisturbed_run(files)
        yield Path(folder), files, undisturbed, duration_s(undisturbed)


def run_kills(*, kills: int = 200, seed: int = 1) -> bool:
    """Kill sessions and resume each; return whether all became the undisturbed session."""
    moments = random.Random(seed)
    with _undisturbed_session() as (folder, files, undisturbed, session_s):

        def kill(_: int) -> list[str]:
            run, truth = folder / "killed", folder / _TRUTH_FILE
            truth.unlink()
            killed_session(run, files, delay_s=moments.uniform(0.0, session_s))
            bad = problems_of(run) + problems_after_resume(run, undisturbed, truth)
            shutil.rmtree(run)
            return bad

        return attempts("kill", kills, kill)


def run_lost_terminals(*, sessions: int = 50, seed: int = 1) -> bool:
    """Close the terminals of sessions, kill half of these, and resume; return whether all became whole."""
    moments = random.Random(seed)
    with _undisturbed_session() as (folder, files, undisturbed, session_s):

        def close(number: int) -> list[str]:
            run, truth = folder / "lost", folder / _TRUTH_FILE
            truth.unlink(missing_ok=True)
            closed_s, is_killed = moments.uniform(-_BEFORE_S, session_s), number % 2 == 1
            code = session_without_terminal(
                run, files, closed_s=closed_s, killed_s=moments.uniform(0.0, session_s) if is_killed else None
            )
            bad = [] if is_killed or code == 0 else [f"exit {code}"]
            bad += problems_of(run) if (run / MANIFEST_FILE).exists() else []
            # A terminal that is closed before there is a run costs nothing.
            if bad or (run / SESSION_FILE).exists():
                bad += problems_after_resume(run, undisturbed, truth)
            shutil.rmtree(run, ignore_errors=True)
            return bad

        return attempts("terminal", sessions, close)


def session_without_terminal(run: Path, files: tuple[Path, Path], *, closed_s: float, killed_s: float | None) -> int:
    """Start a session on a terminal, close that so long after its first event (negative: after the program began).

    Returns
    -------
    int
        The exit code, negative where it was killed.
    """
    near, far = pty.openpty()

    def own_terminal() -> None:
        os.setsid()
        fcntl.ioctl(far, termios.TIOCSCTTY, 0)

    with subprocess.Popen(
        _acquire(files, run), stdin=far, stdout=far, stderr=far, preexec_fn=own_terminal, close_fds=True
    ) as process:
        os.close(far)
        deadline = time.monotonic() + _START_TIMEOUT_S
        while closed_s >= 0.0 and not (run / EVENTS_FILE).exists() and time.monotonic() < deadline:
            _drained(near, 0.01)
        end = time.monotonic() + abs(closed_s)
        while time.monotonic() < end:
            _drained(near, 0.01)
        os.close(near)
        if killed_s is not None:
            while not (run / EVENTS_FILE).exists() and process.poll() is None and time.monotonic() < deadline:
                time.sleep(0.01)
            time.sleep(killed_s)
            process.kill()
        return process.wait(_START_TIMEOUT_S * 10)


def _drained(near: int, wait_s: float) -> None:
    if select.select([near], [], [], wait_s)[0]:
        with suppress(OSError):
            os.read(near, 65536)


def write_files(folder: Path) -> tuple[Path, Path]:
    """Write a rig file and a session file; return both."""
    rig, session = folder / "rig.toml", folder / "session.toml"
    example = (EXAMPLES / "rig-sim.toml").read_text().replace(_STAGE, _EXACT_STAGE)
    rig.write_text(example.replace(_CAMERA, f"{_CAMERA}?truth={folder / _TRUTH_FILE}"))
    shutil.copyfile(EXAMPLES / "scene-panels.toml", folder / "scene-panels.toml")
    session.write_text(_SESSION)
    return rig, session


def undisturbed_run(files: tuple[Path, Path]) -> Run:
    """Return the run that nobody kills."""
    out = files[0].parent / "undisturbed"
    subprocess.run(_acquire(files, out), check=True, stderr=subprocess.DEVNULL)
    return read_run(out)


def duration_s(run: Run) -> float:
    """Return how long a session took from its first event to its last."""
    times = [event.monotonic_ns for event in read_events(run.path)]
    return float((times[-1] - times[0]) / NS_PER_S)


def killed_session(run: Path, files: tuple[Path, Path], *, delay_s: float) -> tuple[int, int]:
    """Start a session, kill it with SIGKILL after its first event and a delay; return frames named and files there."""
    with subprocess.Popen(_acquire(files, run), stderr=subprocess.DEVNULL) as process:
        deadline = time.monotonic() + _START_TIMEOUT_S
        while not (run / EVENTS_FILE).exists() and time.monotonic() < deadline:
            time.sleep(0.01)
        time.sleep(delay_s)
        process.kill()
    named = (run / MANIFEST_FILE).read_bytes().count(b"\n")
    return named, len(list((run / FRAMES_FOLDER).glob("*.fits")))


def problems_of(run: Path) -> list[str]:
    """Return what is wrong with a run folder after a kill."""
    found = [f"{finding.file}: {finding.problem}" for finding in verify_run(run).bad]
    for file in (run / FRAMES_FOLDER).glob("*.fits"):
        try:
            decode_frame(file.read_bytes())
        except Exception as error:
            found.append(f"{file.name} has a final name and is not whole: {error}")
    return found


def problems_after_resume(run: Path, undisturbed: Run, truth: Path) -> list[str]:
    """Go on with a run; return in what it differs from the simulator's truth, and from the undisturbed run."""
    result = subprocess.run(
        [sys.executable, "-m", "rigctl", "resume", run], stderr=subprocess.PIPE, text=True, check=False
    )
    if result.returncode:
        return [f"resume ends with {result.returncode}: {result.stderr[-300:]}"]
    found = [f"{finding.file}: {finding.problem}" for finding in (*verify_run(run).bad, *verify_run(run).leftovers)]
    resumed = read_run(run)
    if [record.sequence for record in resumed.frames] != [record.sequence for record in undisturbed.frames]:
        return [*found, "not every planned frame is there once"]
    found += mislabelled(resumed, read_truth(truth))
    for one, two in zip(resumed.frames, undisturbed.frames, strict=True):
        moment = {name: getattr(two, name) for name in _OF_THE_MOMENT}
        if replace(one, **moment) != two:
            found.append(f"{one.file}: another label than undisturbed")
        if not np.array_equal(resumed.counts(one), undisturbed.counts(two)):
            found.append(f"{one.file}: other counts than undisturbed")
    return found


def mislabelled(run: Run, truth: tuple[TrueFrame, ...]) -> list[str]:
    """Return which frames bear another label than the simulator's own log of the exposure says."""
    exposures = {(frame.sequence, utc_text(frame.start_utc_ns)): frame for frame in truth}
    found = []
    for record in run.frames:
        true = exposures.get((record.camera_frame or 0, record.start_utc or ""))
        if true is None:
            found.append(f"{record.file}: the simulator has exposed no such frame")
        elif wrong := _wrong_fields(record, true):
            found.append(f"{record.file}: the simulator's log has another {', '.join(wrong)}")
    return found


def _wrong_fields(record: FrameRecord, true: TrueFrame) -> list[str]:
    pairs = {
        "kind": (record.kind, true.subject),
        "exposure": (record.exposure_s, true.exposure_s),
        "gain": (record.gain_db, true.gain_db),
        "time": (record.start_monotonic_ns, true.start_monotonic_ns),
    }
    wrong = [name for name, (stated, truth) in pairs.items() if stated != truth]
    if record.polarizer_angle_deg is not None:
        off_deg = (record.polarizer_angle_deg - true.polarizer_angle_deg + 90.0) % 180.0 - 90.0
        wrong += ["angle"] if abs(off_deg) > _ANGLE_TOLERANCE_DEG else []
    return wrong


def _acquire(files: tuple[Path, Path], out: Path) -> list[str | Path]:
    return [sys.executable, "-m", "rigctl", "acquire", *files, "--out", out]
