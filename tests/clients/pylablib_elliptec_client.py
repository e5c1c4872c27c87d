"""The Elliptec module of pylablib, unchanged."""

import sys

from pickering import drive
from pylablib_module import load

motor = load("elliptec").ElliptecMotor(sys.argv[1])
motor.home()
drive(motor.move_to, motor.get_position)
motor.close()
