"""The vendor's library, unchanged, in native units: names of devices would come from a database in the network."""

import sys

from pickering import drive
from zaber_motion.ascii import Connection

with Connection.open_serial_port(sys.argv[1]) as connection:
    (device,) = connection.detect_devices(identify_devices=False)
    axis = device.get_axis(1)
    turn = int(axis.generic_command("get limit.cycle.dist").data)
    axis.home()
    drive(
        lambda angle_deg: axis.generic_command(f"move abs {round(angle_deg * turn / 360)}") and axis.wait_until_idle(),
        lambda: int(axis.generic_command("get pos").data) * 360 / turn,
    )
