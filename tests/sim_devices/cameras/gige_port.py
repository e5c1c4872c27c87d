"""The one GigE camera that can be served on this machine's own address: one test at a time."""

import ctypes
import fcntl
import os
import tempfile
from contextlib import contextmanager
from pathlib import Path

import pytest

ADDRESS = "127.0.0.1"


def need(present, what):
    """Skip a test for which something is not installed, or fail it where nothing may be skipped."""
    if present:
        return
    if os.environ.get("RIGCTL_REQUIRE_CAMERAS") == "1":
        pytest.fail(f"needs {what}, and RIGCTL_REQUIRE_CAMERAS is set")
    pytest.skip(f"needs {what}")


def need_aravis():
    try:
        ctypes.CDLL("libaravis-0.8.so.0")
    except OSError:
        need(False, "libaravis: apt install libaravis-0.8-0")


@contextmanager
def gige_port():
    """Hold the port of GigE cameras, against tests that run at the same time in other processes."""
    need_aravis()
    with (Path(tempfile.gettempdir()) / "rigctl-tests-gige.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
