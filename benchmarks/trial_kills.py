"""`rigctl acquire` killed at random moments: what the manifest names is whole, what is not whole has no final name."""

import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rigctl.runs.fits_frame import decode_frame
from rigctl.runs.run_folder import EVENTS_FILE, FRAMES_FOLDER, MANIFEST_FILE
from rigctl.runs.verification import verify_run

EXAMPLES = Path(__file__).parents[1] / "examples"
_START_TIMEOUT_S = 60.0
# A session takes about this long after its first event; the kill falls anywhere in it [s].
_SESSION_S = 5.0


def run_kills(kills: int, *, seed: int = 1) -> bool:
    """Kill so many sessions; print what was left of each; return whether nothing was lost or torn."""
    moments = random.Random(seed)
    sound = True
    for kill in range(kills):
        with tempfile.TemporaryDirectory() as folder:
            run = Path(folder) / "run"
            named, files = killed_session(run, delay_s=moments.uniform(0.0, _SESSION_S))
            bad = problems_of(run)
            sound &= not bad
            print(
                f"kill {kill + 1:3d}: {named:3d} frames in the manifest, {files:3d} files: {'; '.join(bad) or 'sound'}"
            )
    print(f"{kills} kills: {'every named frame whole, nothing torn under a final name' if sound else 'FAILED'}")
    return sound


def killed_session(run: Path, *, delay_s: float) -> tuple[int, int]:
    """Start a session, kill it with SIGKILL after its first event and a delay; return frames named and files there."""
    command = [sys.executable, "-m", "rigctl", "acquire", EXAMPLES / "rig-sim.toml", EXAMPLES / "session.toml"]
    with subprocess.Popen([*command, "--out", run], stderr=subprocess.DEVNULL) as process:
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
