"""Two GigE cameras on one interface at once, each with its part of the line, in a network of the test's own.

libaravis's device takes a whole address of an interface, so that the second one needs an address that the machine's own
loopback does not have. Started as a program, this file is what runs in that network.
"""

import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack

from drivers.cameras.gige import open_gige
from sim_devices.cameras.gige_server import serve_gige_camera
from tests.sim_devices.cameras.gige_port import need, need_aravis
from tests.sim_devices.cameras.known_pictures import MARK, KnownPictures, assert_known

ADDRESSES = ("127.0.0.1", "127.0.0.3")
PICTURES = 12
TIMEOUT_S = 10.0


def test_two_cameras_share_an_interface_and_their_pictures_do_not_mix():
    need_aravis()
    need(os.geteuid() == 0 and shutil.which("unshare") and shutil.which("ip"), "root, unshare and ip")
    network = f"ip link set lo up && ip addr add {ADDRESSES[1]}/8 dev lo && exec {sys.executable} -m {__name__}"
    found = subprocess.run(
        ["unshare", "--net", "sh", "-c", network], capture_output=True, text=True, timeout=120, check=False
    )
    assert found.returncode == 0, found.stderr
    assert found.stdout == "one after the other 12, 12; at once 12, 12\n"


def run():
    with ExitStack() as opened:
        cameras = []
        for mark, address in enumerate(ADDRESSES, 1):
            source = KnownPictures(width=240, height=160)
            source.mark = mark
            opened.enter_context(serve_gige_camera(source, address=address, serial_number=f"N{mark}"))
            cameras.append(opened.enter_context(open_gige(f"{address}?bandwidth_mb_per_s=116&retakes=5")))
        in_turn = [taken(camera, mark) for mark, camera in enumerate(cameras, 1)]
        with ThreadPoolExecutor() as threads:
            at_once = list(threads.map(taken, cameras, (1, 2)))
        for mark, camera in enumerate(cameras, 1):
            assert camera.identify().serial_number == f"N{mark}"
            # Packets of 1500 bytes at 116 MB/s instead of 125: all the pause that this device can make.
            assert camera.features()["GevSCPD"] == "931 ns"
        sys.stdout.write(f"one after the other {join(in_turn)}; at once {join(at_once)}\n")


def taken(camera, mark):
    """Take pictures; return how many there are, all of them whole and of this camera."""
    numbers = []
    for _ in range(PICTURES):
        frame = camera.take_frame(timeout_s=TIMEOUT_S)
        assert_known(frame.counts)
        assert frame.counts[MARK] == mark
        numbers.append(frame.sequence)
    assert numbers == sorted(set(numbers))
    return len(numbers)


def join(counts):
    return ", ".join(map(str, counts))


if __name__ == "__main__":
    run()
