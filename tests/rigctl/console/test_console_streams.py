"""Tests of output that cannot be written, and of texts that would steer a terminal."""

import io
import os
import subprocess
import sys
from pathlib import Path

import pytest

from rigctl.console.console_streams import LastingStream, visible

PLAN = ["plan", "examples/rig-sim.toml", "examples/session.toml", "--at", "2026-05-04T10:00Z", "--all"]


def _plan(**streams) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "rigctl", *PLAN],
        cwd=Path(__file__).parents[3],
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
        text=True,
        timeout=120,
        check=False,
        **{"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | streams,
    )


def test_a_closed_pipe_ends_with_0_and_no_message():
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "w") as pipe:
        done = _plan(stdout=pipe)
    assert done.returncode == 0
    assert "rigctl" not in done.stderr
    assert "Error" not in done.stderr


def test_a_full_disk_under_standard_output_is_told_and_changes_no_exit_code():
    with Path("/dev/full").open("w") as full:
        done = _plan(stdout=full)
    assert done.returncode == 0
    assert "standard output cannot be written: No space left on device" in done.stderr
    assert "Traceback" not in done.stderr


class _Broken(io.StringIO):
    def write(self, text: str) -> int:
        raise OSError(5, "Input/output error")


def test_the_first_failure_is_kept_and_later_output_goes_nowhere():
    stream = LastingStream(_Broken())
    assert stream.write("one") == 3
    first = stream.failure
    stream.write("two")
    stream.flush()
    assert first is not None
    assert stream.failure is first


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("\x1b[2J gone", r"\x1b[2J gone"),
        ("one\rtwo", r"one\rtwo"),
        ("right\u202eleft", r"right\u202eleft"),
        ("file\udcff", r"file\udcff"),
        ("lines\nand\ttabs, ±1° µm", "lines\nand\ttabs, ±1° µm"),
    ],
)
def test_control_characters_are_shown_and_not_obeyed(text, shown):
    assert visible(text) == shown
