"""Settings of a simulated Zaber stage, from a reading of Zaber's ASCII protocol manual (firmware 7)."""

from collections.abc import Callable
from dataclasses import dataclass

from sim_devices.stages.zaber_address import ZaberOptions

_MAXSPEED_UNIT = 1.6384  # microsteps a second are this much less than the number in the setting
_TOP_SPEED_DEG_PER_S = 100.0  # what is set; a hindered motor does not come up to it
_FAR = 10**9
_INDICES_A_TURN = 8
_AT_INDEX = 1e-4  # of a turn


@dataclass(frozen=True, kw_only=True)
class _Range:
    """What a setting may be set to."""

    lowest: float
    highest: float


_SWITCH = _Range(lowest=0, highest=1)
_SPEED = _Range(lowest=1, highest=2**31)
_CURRENT = _Range(lowest=0, highest=120)
_PLACE = _Range(lowest=-_FAR, highest=_FAR)
_WRITABLE = {
    "accel": _Range(lowest=0, highest=32767),
    "comm.alert": _SWITCH,
    "comm.checksum": _SWITCH,
    "driver.current.hold": _CURRENT,
    "driver.current.run": _CURRENT,
    "knob.enable": _SWITCH,
    "limit.approach.maxspeed": _SPEED,
    "limit.max": _PLACE,
    "limit.min": _PLACE,
    "maxspeed": _SPEED,
    "motion.accelonly": _Range(lowest=0, highest=32767),
    "motion.decelonly": _Range(lowest=0, highest=32767),
    "motion.index.dist": _Range(lowest=1, highest=_FAR),
    "system.led.enable": _SWITCH,
}


# What every stage comes with.
_SAME_OF_ALL: dict[str, int | float | str] = {
    "system.axiscount": 1,
    "system.access": 1,
    "system.voltage": 48.1,
    "system.temperature": 31.5,
    "driver.temperature": 34.0,
    "version": "7.38",
    "version.build": 16000,
    "device.hw.modified": 0,
    "peripheralid": 0,
    "peripheral.id": 0,
    "comm.packet.size.max": 80,
    "comm.word.size.max": 50,
    "comm.command.packets.max": 1,
    "comm.rs232.baud": 115200,
    "comm.protocol": 2,
    "get.settings.max": 10,
    "trigger.numtriggers": 6,
    "trigger.numactions": 2,
    "limit.home.state": 0,
    "accel": 205,
    "motion.accelonly": 205,
    "motion.decelonly": 205,
    "driver.current.run": 40,
    "driver.current.hold": 20,
    "knob.enable": 1,
    "system.led.enable": 1,
    "comm.alert": 0,
    "comm.checksum": 0,
}


def _of_model(options: ZaberOptions) -> dict[str, int | float | str]:
    """Return what a stage of one model comes with."""
    turn = options.counts_per_turn
    top_speed = round(_TOP_SPEED_DEG_PER_S / 360.0 * turn * _MAXSPEED_UNIT)
    cycle = {"limit.cycle.dist": turn} if options.cycle else {}
    return {
        "deviceid": options.model,
        "device.id": options.model,
        "system.serial": options.serial_number,
        "resolution": options.resolution,
        "limit.min": 0 if options.one_turn else -_FAR,
        "limit.max": turn if options.one_turn else _FAR,
        "maxspeed": top_speed,
        "limit.approach.maxspeed": top_speed,
        "motion.index.dist": turn // _INDICES_A_TURN,
        **cycle,
    }


class ZaberSettings:
    """Name to value. Positions are asked for each time."""

    def __init__(self, options: ZaberOptions, position: Callable[[], int], now_s: Callable[[], float]) -> None:
        self._turn = options.counts_per_turn
        self._position, self._now_s = position, now_s
        self._has_encoder = options.encoder
        self._born = _SAME_OF_ALL | _of_model(options)
        self._values = dict(self._born)
        self.is_parked = False

    def get(self, name: str) -> str | None:
        """Return a setting's value as text, or None when there is no such setting."""
        if name == "pos" or (name == "encoder.pos" and self._has_encoder):
            return str(self._position())
        if name == "motion.index.num" and "limit.cycle.dist" in self._values:
            return str(self._index())
        if name == "parking.state":
            return str(int(self.is_parked))
        if name == "system.uptime":
            return f"{self._now_s():.1f}"
        value = self._values.get(name)
        return None if value is None else str(value)

    def _index(self) -> int:
        """Return the number of the index position that it stands at, counted from 1; 0 for none."""
        distance = self.number("motion.index.dist")
        nearest = round(self._position() / distance)
        is_there = abs(self._position() - nearest * distance) <= self._turn * _AT_INDEX
        return nearest % max(1, self._turn // distance) + 1 if is_there else 0

    def number(self, name: str) -> int:
        """Return a whole number that is set."""
        return int(self._values[name])

    def is_on(self, name: str) -> bool:
        """Return whether a switch is on."""
        return self._values[name] == 1

    def set(self, name: str, text: str) -> str | None:
        """Write a setting; return why not, or None."""
        if name not in _WRITABLE or name not in self._values:
            return "BADCOMMAND"
        allowed = _WRITABLE[name]
        if not text.removeprefix("-").isdecimal() or not allowed.lowest <= int(text) <= allowed.highest:
            return "BADDATA"
        self._values[name] = int(text)
        return None

    def restore(self) -> None:
        """Set everything to what it came with."""
        self._values = dict(self._born)

    def top_speed_deg_per_s(self) -> float:
        """Return how fast it may turn; what it came with is more than the motor can."""
        if self._values["maxspeed"] == self._born["maxspeed"]:
            return float("inf")
        return self.speed_deg_per_s(self.number("maxspeed"))

    def speed_deg_per_s(self, value: int) -> float:
        """Return the speed that a number means [deg/s]."""
        return value / _MAXSPEED_UNIT / self._turn * 360.0
