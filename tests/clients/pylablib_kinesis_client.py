"""The APT module of pylablib, but for its pulse on RTS: a pseudo-terminal has no such line. Every method."""

import sys

from every_method import Every, near
from pickering import drive
from pylablib_module import load

kinesis = load("kinesis")
kinesis.BasicKinesisDevice._cycle_rts = staticmethod(lambda instrument: None)
# A tuple, so that it is the backend for serial ports that opens it, and not the one for FTDI chips.
motor = kinesis.KinesisMotor(("serial", (sys.argv[1], 115200)), scale="stage")
if motor.get_scale_units() != "deg":
    sys.exit("its stage is not known")
is_k_cube = motor.get_device_info().model_no == "KDC101"
if is_k_cube:
    motor.send_comm(0x0210, 1, 1)
motor.home(sync=True, force=True)


def move_to(angle_deg: float) -> None:
    """Go there and wait."""
    motor.move_to(angle_deg)
    motor.wait_move()


drive(move_to, motor.get_position)

NOT_OF_IT = "is of another controller"
left_out = {
    "close": "is the last call below",
    "open": "it is open",
    "lock": "of threads",
    "unlock": "of threads",
    "locking": "of threads",
    "send_comm_data": "is behind all others",
    "recv_comm": "is behind all others",
    "add_background_comm": "of the client alone",
    "list_devices": "asks for FTDI chips",
    "set_supported_channels": "there is one",
    "remap_axes": "there is one",
    "using_channel": "there is one",
    "setup_polctl": NOT_OF_IT,
    "get_polctl_parameters": NOT_OF_IT,
}
K_CUBE = ("kcube_trigio", "kcube_trigpos")
if not is_k_cube:
    left_out |= {f"get_{name}_parameters": NOT_OF_IT for name in K_CUBE} | {
        f"setup_{name}": NOT_OF_IT for name in K_CUBE
    }
every = Every(motor, left_out)
near(every.get_position(), 135.0)
for name in ("get_all_channels", "get_all_axes", "get_number_of_channels", "get_scale", "get_scale_units", "get_stage"):
    getattr(every, name)()
every.set_default_channel(1)
every.send_comm(0x0018)
every.blink()
every.get_device_info()
near(every.setup_velocity(max_velocity=8.0).max_velocity, 8.0)
near(every.get_velocity_parameters().max_velocity, 8.0)
near(every.setup_homing(velocity=9.0).velocity, 9.0)
near(every.get_homing_parameters().velocity, 9.0)
near(every.setup_gen_move(backlash_distance=0.5).backlash_distance, 0.5)
near(every.get_gen_move_parameters().backlash_distance, 0.5)
near(every.setup_jog(mode="step", step_size=3.0, max_velocity=8.0).step_size, 3.0)
near(every.get_jog_parameters().step_size, 3.0)
every.jog("-", kind="builtin")
every.wait_move()
near(abs(every.get_position() - 135.0), 3.0)
every.jog("+", kind="builtin")
every.wait_for_status("settled", enabled=True)
near(every.get_position(), 135.0)
every.jog("+")
if not every.is_moving() or "settled" in every.get_status() or not every.get_status_n() & 0x30:
    sys.exit("it does not go on")
every.stop(immediate=True, sync=False)
every.wait_for_stop()
every.move_to(20.0)
every.wait_move()
every.move_by(5.0)
every.wait_move()
near(every.get_position(), 25.0)
near(every.set_position_reference(0.0), 0.0)
near(every.setup_limit_switch(sw_kind="stop_imm", sw_position_cw=10.0, sw_position_ccw=-10.0).sw_position_cw, 10.0)
every.move_to(30.0)
every.wait_move()
near(every.get_position(), 10.0)
near(every.get_limit_switch_parameters().sw_position_ccw, -10.0)
every.setup_limit_switch(sw_kind="ignore")
every.home(sync=False, force=True)
if not every.is_homing() or every.is_homed():
    sys.exit("it does not look for its mark")
every.wait_for_home()
near(every.get_position(), 0.0)
if is_k_cube:
    every.setup_kcube_trigio(trig1_mode="out_in_motion")
    every.setup_kcube_trigpos(start_fw=10.0, width=1e-3)
    if every.get_kcube_trigio_parameters().trig1_mode != "out_in_motion":
        sys.exit("its trigger lines are not kept")
    near(every.get_kcube_trigpos_parameters().start_fw, 10.0)
if every.query(0x0411, 1).messageID != 0x0412 or every.check_background_comm(0x0464)[0] < 5:
    sys.exit("it does not tell its ends")
every.flush_comm()
every.get_full_info()
every.get_full_status()
every.apply_settings(every.get_settings())
every.set_device_variable("gen_move_parameters", every.get_device_variable("gen_move_parameters"))
if not every.is_opened():
    sys.exit("it is not open")
every.finish()
motor.close()
