"""Parameters that a host can set in a simulated APT controller, and read back. All is kept as the bytes that came."""

import struct

from sim_devices.stages.apt_address import MODELS, AptOptions

_SPEED_DEG_PER_S = 10.0
_ACCELERATION = 15020

# Message that sets -> (message that asks, message that tells, number of bytes behind the channel).
TABLE = {
    0x0413: (0x0414, 0x0415, 12),  # velocity: lowest, acceleration, highest
    0x0416: (0x0417, 0x0418, 20),  # jog
    0x0423: (0x0424, 0x0425, 14),  # limit switches
    0x043A: (0x043B, 0x043C, 4),  # general move: backlash
    0x0440: (0x0441, 0x0442, 12),  # homing: direction, switch, velocity, offset
}
_VELOCITY, _HOMING = 0x0413, 0x0440


class AptParameters:
    """The parameters and the velocities that they mean."""

    def __init__(self, options: AptOptions) -> None:
        self._scale = MODELS[options.model].velocity_per_deg_per_s
        speed = 0 if options.forgets else round(_SPEED_DEG_PER_S * self._scale)
        self._values = {number: bytes(length) for number, (_, _, length) in TABLE.items()}
        self._values[_VELOCITY] = struct.pack("<iii", 0, _ACCELERATION, speed)
        self._values[_HOMING] = struct.pack("<HHii", 2, 1, speed, 0)

    def set(self, number: int, data: bytes) -> None:
        """Keep what a message with a channel and parameters sets, if it is as long as it must be."""
        if len(data) == 2 + TABLE[number][2]:
            self._values[number] = data[2:]

    def asked_by(self, number: int) -> tuple[int, bytes] | None:
        """Return the message number and the parameters that answer a question, or None if it is no question."""
        for key, (asks, tells, _) in TABLE.items():
            if asks == number:
                return tells, self._values[key]
        return None

    def speed_deg_per_s(self) -> float:
        """Return the velocity of moves [deg/s]."""
        return float(struct.unpack("<iii", self._values[_VELOCITY])[2]) / self._scale

    def home_speed_deg_per_s(self) -> float:
        """Return the velocity of homing [deg/s]."""
        return float(struct.unpack("<HHii", self._values[_HOMING])[2]) / self._scale
