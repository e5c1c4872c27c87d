"""The program as others start it: commands that end, and pages that are served until a test is over."""

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

DEADLINE_S = 600.0  # ends a test that hangs; a busy machine needs minutes to start a session in a process of its own
INCOMPLETE = 75
RIGCTL = (sys.executable, "-m", "rigctl")


def rigctl(*arguments: object, cwd: Path | None = None) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [*RIGCTL, *map(str, arguments)], cwd=cwd, capture_output=True, text=True, timeout=DEADLINE_S, check=False
    )


def wait_for(condition: Callable[[], Any]) -> None:
    deadline_s = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.05)


def frames_on(run: Path) -> int:
    return len(list((run / "frames").glob("*.fits")))


@contextmanager
def served(*words: object) -> Iterator[dict[str, Any]]:
    """Serve a page by a command, and give what it says: its addresses."""
    with subprocess.Popen([*RIGCTL, *map(str, words), "--json"], stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield json.loads(process.stdout.readline())
        finally:
            process.terminate()
