"""V4L2 against the kernel's own test device, in a virtual machine: about a minute."""

import os
import sys
from pathlib import Path

import pytest

from tests.sim_devices.cameras.gige_port import need
from tests.vm import vivid_vm

CACHE = Path(os.environ.get("RIGCTL_VIVID_CACHE") or "build/vivid")
CAMERA = "v4l2:/dev/video0?pixel_format=Y12&width=640&height=360&exposure_control=none"


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_driver_and_contract_hold_on_a_device_of_the_kernel(capfd):
    need(vivid_vm.is_installed(), f"a virtual machine: apt install {vivid_vm.PACKAGES}")
    tests = ["tests/vm/in_guest.py", "tests/contracts/test_camera_contract.py", "--camera", CAMERA]
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", *tests]
    status = vivid_vm.run(CACHE, command, timeout_s=360.0)
    assert status == 0, capfd.readouterr().out
