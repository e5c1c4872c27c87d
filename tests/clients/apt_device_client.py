"""The package thorlabs-apt-device, unchanged. Its status is a cache: a motion has ended once that has been renewed."""

import sys
import time

from pickering import drive
from thorlabs_apt_device import KDC101

COUNTS_PER_DEG = 1919.6418578623391
CACHE_S = 0.5

device = KDC101(serial_port=sys.argv[1], serial_number=None, home=True)


def wait() -> None:
    """Return once the cached status is newer than the command, and tells that the stage rests."""
    time.sleep(CACHE_S)
    while device.status["moving_forward"] or device.status["moving_reverse"] or device.status["homing"]:
        time.sleep(CACHE_S)
    time.sleep(CACHE_S)


def move_to(angle_deg: float) -> None:
    """Go there and wait."""
    device.move_absolute(round(angle_deg * COUNTS_PER_DEG))
    wait()


while not device.status.get("homed"):
    time.sleep(CACHE_S)
wait()
drive(move_to, lambda: device.status["position"] / COUNTS_PER_DEG)
device.close()
