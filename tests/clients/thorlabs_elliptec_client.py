"""The package thorlabs-elliptec, unchanged: the sequence, then every method of its stage."""

import sys

from every_method import Every, near
from pickering import drive
from thorlabs_elliptec import ELLx

stage = ELLx(serial_port=sys.argv[1])
stage.home(blocking=True)
drive(lambda angle_deg: stage.move_absolute(angle_deg, blocking=True), stage.get_position)

every = Every(stage, {"close": "is the last call below"})
COUNTS_PER_DEG = 143360 / 360
near(every.get_position(), 135.0)
near(every.get_position_raw() / COUNTS_PER_DEG, 135.0)
every.move_absolute(135.0, blocking=True)
every.move_relative(-15.0, blocking=True)
near(every.get_position(), 120.0)
every.move_relative_raw(round(10.0 * COUNTS_PER_DEG), blocking=True)
every.move_absolute_raw(round(80.0 * COUNTS_PER_DEG))
every.wait(raise_errors=True)
near(every.get_position(), 80.0)
every.home(direction=1)
every.wait()
if every.is_moving(raise_errors=True):
    sys.exit("it moves without end")
near(every.get_position(), 0.0)
told = (stage.units, stage.model_number, stage.device_id, stage.travel, stage.year, stage.thread_type)
if told != ("\N{DEGREE SIGN}", "ELL14/M", 0, 360, 2025, "metric"):
    sys.exit(f"it says that it is {told}")
every.finish()
stage.close()
