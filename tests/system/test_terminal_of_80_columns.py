"""Screens of commands in a terminal of 80 columns: no line is broken by the terminal, and the first one answers."""

import fcntl
import os
import pty
import re
import struct
import subprocess
import sys
import termios

import pytest

_STYLE = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


def screen_of(*words):
    """Return the lines that a command prints on a terminal of 80 columns."""
    ours, its = pty.openpty()
    fcntl.ioctl(its, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    environment = {name: value for name, value in os.environ.items() if name != "COLUMNS"}
    command = [sys.executable, "-m", "rigctl", *words]
    with subprocess.Popen(command, stdout=its, stderr=subprocess.DEVNULL, env=environment) as running:
        os.close(its)
        shown = bytearray()
        while True:
            try:
                some = os.read(ours, 65536)
            except OSError:  # the other end was closed
                break
            if not some:
                break
            shown += some
    os.close(ours)
    assert running.returncode == 0
    return _STYLE.sub("", shown.decode()).replace("\r\n", "\n").splitlines()


@pytest.mark.parametrize(
    ("words", "answer"),
    [
        ("predict examples/scene-panels.toml", "DoLP of single pixels: black_panel 0.380"),
        ("predict examples/scene-airborne.toml --tolerance 0.01", "DoLP of single pixels: black_paint"),
        ("effects examples/scene-airborne.toml", "17 effects act"),
        ("surface black-paint asphalt", "black paint polarizes most"),
        ("surface black-paint", "black paint polarizes up to DoLP 0.9"),
        ("plan examples/rig-sim.toml examples/session.toml", "frames from"),
        ("--help", "Usage: rigctl COMMAND"),
        ("calibrate noise --help", "Usage: rigctl calibrate noise"),
    ],
)
def test_a_screen_fits_and_begins_with_the_answer(words, answer):
    lines = screen_of(*words.split())
    assert answer in lines[0]
    assert [line for line in lines if len(line) > 80] == []
