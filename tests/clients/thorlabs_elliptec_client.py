"""The package thorlabs-elliptec, unchanged."""

import sys

from pickering import drive
from thorlabs_elliptec import ELLx

stage = ELLx(serial_port=sys.argv[1])
stage.home(blocking=True)
drive(lambda angle_deg: stage.move_absolute(angle_deg, blocking=True), stage.get_position)
stage.close()
