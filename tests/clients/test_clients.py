"""Independent clients, each in its own process and environment, drive the simulated stages.

They were written by others from the same manuals: a simulator that only our own driver understands would not pass.
"""

import os
import subprocess
from pathlib import Path

import pytest

from sim_devices.clock import SimClock
from sim_devices.stages.catalogue import make_stage, parse_stage_address
from sim_devices.stages.stage import serve_on_pty
from tests.clients.make_venvs import CLIENTS, default_folder, python_of
from tests.clients.pickering import ANGLES_DEG

HERE = Path(__file__).parent
# Clients cut off where they should round, which is a count (0.0055 degrees at most), and see the landing error (four
# standard deviations of 0.004 degrees).
TOLERANCE_DEG = 0.0055 + 4 * 0.004


def apart_deg(a_deg: float, b_deg: float) -> float:
    return abs((a_deg - b_deg + 180.0) % 360.0 - 180.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", list(CLIENTS))
def test_drives_the_pickering_sequence_and_calls_every_method(name: str) -> None:
    requirement, script, address = CLIENTS[name]
    python = python_of(requirement, default_folder())
    if not python.exists():
        required = os.environ.get("RIGCTL_CLIENTS") == "1"
        (pytest.fail if required else pytest.skip)(f"`python tests/clients/make_venvs.py` installs {requirement}")
    options = parse_stage_address(address)
    clock = SimClock(speed=options.speed)
    machine = make_stage(options, clock=clock)
    with (
        serve_on_pty(machine, clock=clock) as path,
        subprocess.Popen(
            [python, HERE / script, path],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        ) as client,
    ):
        assert client.stdin is not None
        assert client.stdout is not None
        for angle_deg in ANGLES_DEG:
            line = client.stdout.readline()
            if not line:
                pytest.fail(f"the client gave up before {angle_deg} deg: {client.communicate()[1][-2000:]}")
            asked_deg, read_deg = map(float, line.split())
            assert asked_deg == angle_deg
            assert apart_deg(read_deg, angle_deg) <= TOLERANCE_DEG
            assert apart_deg(machine.true_angle_deg(), angle_deg) <= TOLERANCE_DEG
            client.stdin.write("\n")
            client.stdin.flush()
        told, errors = client.communicate(timeout=60)
    assert client.returncode == 0, errors
    assert "methods" in told  # `every_method` has counted them, and ends the client with an error if one is missing
