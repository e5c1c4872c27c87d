"""The settings of a simulated Zaber stage that a host can read, and the few that it can write."""

from collections.abc import Callable

from sim_devices.stages.zaber_address import ZaberOptions

_MAXSPEED_UNIT = 1.6384  # microsteps a second are this much less than the number in the setting
_TOP_SPEED_DEG_PER_S = 100.0  # what is set; a hindered motor does not come up to it
_FAR = 10**9


class ZaberSettings:
    """Name to value. Positions are asked for each time."""

    def __init__(self, options: ZaberOptions, position: Callable[[], int]) -> None:
        turn = options.counts_per_turn
        self.alerts = False
        self.checksums = False
        self._position = position
        self._has_encoder = options.encoder
        self._fixed: dict[str, int | str] = {
            "deviceid": options.model,
            "device.id": options.model,
            "system.serial": options.serial_number,
            "system.axiscount": 1,
            "version": "7.38",
            "version.build": 16000,
            "device.hw.modified": 0,
            "comm.packet.size.max": 80,
            "comm.word.size.max": 50,
            "comm.command.packets.max": 1,
            "get.settings.max": 10,
            "resolution": options.resolution,
            "limit.min": 0 if options.one_turn else -_FAR,
            "limit.max": turn if options.one_turn else _FAR,
            "maxspeed": round(_TOP_SPEED_DEG_PER_S / 360.0 * turn * _MAXSPEED_UNIT),
        }
        if options.cycle:
            self._fixed["limit.cycle.dist"] = turn

    def get(self, name: str) -> str | None:
        """Return a setting's value as text, or None when there is no such setting."""
        if name == "pos" or (name == "encoder.pos" and self._has_encoder):
            return str(self._position())
        switches = {"comm.alert": self.alerts, "comm.checksum": self.checksums}
        if name in switches:
            return str(int(switches[name]))
        value = self._fixed.get(name)
        return None if value is None else str(value)

    def set(self, name: str, value: str) -> bool:
        """Write a setting; return whether there is one that can take this value."""
        if value not in ("0", "1"):
            return False
        if name == "comm.alert":
            self.alerts = value == "1"
        elif name == "comm.checksum":
            self.checksums = value == "1"
        else:
            return False
        return True
