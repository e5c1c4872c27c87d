"""The APT module of pylablib, but for its pulse on RTS: a pseudo-terminal has no such line."""

import sys

from pickering import drive
from pylablib_module import load

kinesis = load("kinesis")
kinesis.BasicKinesisDevice._cycle_rts = staticmethod(lambda instrument: None)
# A tuple, so that it is the backend for serial ports that opens it, and not the one for FTDI chips.
motor = kinesis.KinesisMotor(("serial", (sys.argv[1], 115200)), scale="K10CR1")
motor.home(sync=True, force=True)


def move_to(angle_deg: float) -> None:
    """Go there and wait."""
    motor.move_to(angle_deg)
    motor.wait_move()


drive(move_to, motor.get_position)
motor.close()
