"""The Elliptec module of pylablib, unchanged: the sequence, then every method of its motor."""

import sys

from every_method import Every, near
from pickering import drive
from pylablib_module import load

motor = load("elliptec").ElliptecMotor(sys.argv[1])
motor.home()
drive(motor.move_to, motor.get_position)

every = Every(
    motor,
    {
        "close": "is the last call below",
        "open": "it is open",
        "lock": "of threads",
        "unlock": "of threads",
        "locking": "of threads",
        "send_comm": "is behind all others",
        "recv_comm": "is behind all others",
        "using_default_addr": "sets and restores the address of the client",
        "set_device_variable": "there is none to set",
    },
)
ADDRESS, OTHER = 0, 5
if every.get_connected_addrs() != [ADDRESS] or not every.is_opened():
    sys.exit("the scan has not found it")
every.set_default_addr(ADDRESS)
near(every.get_default_addr(), ADDRESS)
near(every.get_device_info().travel, 360)
offset_deg = every.get_home_offset()
near(every.set_home_offset(offset_deg + 1.5), offset_deg + 1.5)
every.set_home_offset(offset_deg)
every.home(home_dir="ccw")
near(every.set_velocity(60), 60)
near(every.get_velocity(), 60)
near(every.get_motor_info(motor=2).fw_freq, 78.4e3, 100)
near(every.set_frequency(fw_freq=80e3, bk_freq=100e3)[0], 80e3, 500)
near(every.search_frequency()[0], 78e3, 100)
near(every.get_frequency()[1], 106e3, 100)
every.store_parameters()
every.change_addr(OTHER)
near(every.get_default_addr(), OTHER)
every.change_addr(ADDRESS)
every.update_connected_addrs([ADDRESS])
every.set_scale("step")
near(every.get_position(), 0, 20)
every.set_scale("stage")
if every.get_scale() != "stage" or not every.move_to(30.0) or not every.move_by(12.0):
    sys.exit("it did not move")
near(every.get_position(), 42.0)
if every.get_status() != "ok" or every.query("gs").comm != "GS" or every.check_background_comm("BO")[0]:
    sys.exit("it is not well")
every.add_background_comm("BO")
full = every.get_full_info()
every.apply_settings(every.get_settings())
if full["position"] is None or not every.get_device_variable("position") or every.get_full_status()["status"] is None:
    sys.exit("it tells too little of itself")
every.finish()
motor.close()
