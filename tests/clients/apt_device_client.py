"""The package thorlabs-apt-device, unchanged: the sequence, then every method. Its status is a cache."""

import sys
import time
from collections.abc import Callable

from every_method import Every, near
from pickering import drive
from thorlabs_apt_device import KDC101

COUNTS_PER_DEG = 1919.6418578623391
VELOCITY = 42941.66  # of a degree a second
CACHE_S = 0.3
PATIENCE_S = 20.0

device = KDC101(serial_port=sys.argv[1], serial_number=None, home=True)


def until(done: Callable[[], bool], what: str) -> None:
    """Wait until something is so."""
    end_s = time.monotonic() + PATIENCE_S
    while not done():
        if time.monotonic() > end_s:
            sys.exit(f"not within {PATIENCE_S:g} s: {what}")
        time.sleep(0.02)


def rests() -> bool:
    """Whether it says that it stands."""
    names = ("moving_forward", "moving_reverse", "jogging_forward", "jogging_reverse", "homing")
    return not any(device.status[name] for name in names)


def wait() -> None:
    """Return once the cached status is newer than the command, and tells that the stage rests."""
    time.sleep(CACHE_S)
    until(rests, "a motion")
    time.sleep(CACHE_S)


def position_deg() -> float:
    """Where it says that it is."""
    return device.status["position"] / COUNTS_PER_DEG


def move_to(angle_deg: float) -> None:
    """Go there and wait."""
    device.move_absolute(round(angle_deg * COUNTS_PER_DEG))
    wait()


until(lambda: device.status.get("homed"), "homing")
wait()
drive(move_to, position_deg)

every = Every(
    device,
    {
        "close": "is the last call below",
        "unregister_error_callback": "raises TypeError in the package, whoever is asked",
    },
)
every.move_absolute(round(40.0 * COUNTS_PER_DEG))
wait()
near(position_deg(), 40.0)
every.move_relative(round(-10.0 * COUNTS_PER_DEG))
wait()
near(position_deg(), 30.0)
every.set_jog_params(round(4.0 * COUNTS_PER_DEG), 1000, round(20.0 * VELOCITY))
every.set_velocity_params(1000, round(20.0 * VELOCITY))
every.set_move_params(round(0.2 * COUNTS_PER_DEG))
every.set_home_params(round(20.0 * VELOCITY), 0)
until(lambda: device.jogparams["step_size"] == round(4.0 * COUNTS_PER_DEG), "jog parameters")
until(lambda: device.velparams["max_velocity"] == round(20.0 * VELOCITY), "velocity parameters")
until(lambda: device.genmoveparams["backlash_distance"] == round(0.2 * COUNTS_PER_DEG), "general parameters")
until(lambda: device.homeparams["home_velocity"] == round(20.0 * VELOCITY), "parameters of homing")
every.move_jog("forward")
wait()
near(position_deg(), 34.0)
every.move_jog("reverse")
wait()
near(position_deg(), 30.0)
every.move_velocity("forward")
until(lambda: device.status["moving_forward"], "to go on and on")
every.stop()
wait()
every.move_absolute(round(50.0 * COUNTS_PER_DEG), now=False)
every.move_relative(round(5.0 * COUNTS_PER_DEG), now=False)
every.set_enabled(False)
until(lambda: not device.status["channel_enabled"], "to be switched off")
every.set_enabled(True)
until(lambda: device.status["channel_enabled"], "to be switched on")
every.identify()
every.home()
wait()
near(position_deg(), 0.0)
every.register_error_callback(sys.exit)
every.finish()
device.close()
