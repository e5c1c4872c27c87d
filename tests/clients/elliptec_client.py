"""The package elliptec, unchanged: the sequence, then every method of its rotator."""

import sys

import elliptec
from every_method import Every, near
from pickering import drive

controller = elliptec.Controller(sys.argv[1], debug=False)
rotator = elliptec.Rotator(controller)
rotator.home()
drive(rotator.set_angle, rotator.get_angle)

every = Every(rotator, {"close_connection": "is the last call below", "extract_angle_from_status": "reads a tuple"})
near(every.get_angle(), 135.0)
every.load_motor_info()
offset_deg = every.get_home_offset()
every.set_home_offset(offset_deg + 2.0)
near(every.get_home_offset(), offset_deg + 2.0)
every.home(clockwise=False)
near(every.get_angle(), 0.0)
every.set_home_offset(offset_deg)
every.home()
every.set_jog_step(7.5)
near(every.get_jog_step(), 7.5)
near(every.jog("forward"), 7.5)
near(every.jog("backward"), 0.0)
every.set_angle(20.0)
near(every.shift_angle(-5.0), 15.0)
near(every.pos_to_angle(every.angle_to_pos(33.0)), 33.0)
for question in ("info", "status", "position", "stepsize", "home_offset", "motor_1_info", "motor_2_info"):
    if every.get(question) is None:
        sys.exit(f"no answer to {question}")
near(every.get("motor_1_info")["Forward frequency"], 78e3, 1e3)
every.save_user_data()
near(int(every.do("save_user_data")[2]), 0)
every.change_address("B")
near(every.get_angle(), 15.0)
every.send_instruction(b"ca", message="0")
rotator.address = "0"
near(int(every.set("isolate", "00")[2]), 0)
near(every.move("absolute", every.angle_to_pos(60.0))[2] / rotator.pulse_per_rev * 360.0, 60.0)
if [found["info"]["Serial No."] for found in elliptec.scan_for_devices(controller, debug=False)] != [rotator.serial_no]:
    sys.exit("the scan has not found it")
near(every.get_angle(), 60.0)
every.finish()
rotator.close_connection()
