"""A Zaber rotation stage that speaks the ASCII protocol: X-RST, X-RSW, X-RSM and their kin."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from drivers.errors import DeviceTimeoutError, LimitError, ProtocolError
from drivers.interfaces import DeviceIdentity, StagePosition, StageStatus, Way
from drivers.serial_port import BytePort
from drivers.stages import zaber_protocol as protocol
from drivers.stages.serial_stage import SerialStage, StageProbe, open_stage_on, target_within_deg
from drivers.stages.zaber_link import ZaberLink, ask_zaber

# How `rigctl devices` finds one. A plain FT232R (0403:6001), which some cables have, is in thousands of other devices.
PROBE = StageProbe(baud=protocol.BAUD, usb_ids=((0x2939, None),), ask=ask_zaber)

_POLL_S = 0.05
_START_S = 2.0
_SLOWER_THAN_TOLD = 3.0  # a motion may take this many times what the stage's own top speed makes of it
_HOME_S = 120.0
_MAXSPEED_UNIT = 1.6384  # the setting `maxspeed` is this many times the microsteps in a second
_TURN_RANGE = (1 << 12, 1 << 28)  # microsteps a turn; 0.09 to 0.0000013 degrees each


@dataclass(frozen=True, kw_only=True)
class Scale:
    """Relation of microsteps and angles of a stage, as read from it.

    Attributes
    ----------
    counts_per_turn : int
        Microsteps of a full turn.
    lowest_deg, highest_deg : float
        Limits of the position, counted on through full turns.
    speed_deg_per_s : float
        The stage's own top speed.
    reading : str
        The setting that tells where the ring is: the encoder's where there is one.
    """

    counts_per_turn: int
    lowest_deg: float
    highest_deg: float
    speed_deg_per_s: float
    reading: str


class ZaberStage(SerialStage):
    """The stage behind a link. `open_zaber` and `connect_zaber` make one.

    Notes
    -----
    Whether it was homed since its power-up is known to the stage itself (flags WR and WH) and asked before each move.
    Without an encoder the readback is what the motor was told: a slipping gear does not show in it.
    """

    def __init__(self, link: ZaberLink, identity: DeviceIdentity, scale: Scale, *, tolerance_deg: float) -> None:
        super().__init__(link, tolerance_deg=tolerance_deg, count_deg=360.0 / scale.counts_per_turn)
        self._link = link
        self._identity = identity
        self._scale = scale

    def identify(self) -> DeviceIdentity:
        """Return what the stage said of itself when the connection was made."""
        return self._identity

    def home(self) -> StagePosition:
        """Search the reference mark; return the readback.

        Raises
        ------
        DeviceFaultError
            The stage reports a fault, or still says that it has no reference.
        DeviceTimeoutError
            The stage is silent, or does not get home within 120 s.
        """
        self._link.ask("home")
        self._await_rest(deadline_s=self._link.now_s() + _HOME_S)
        for flag in sorted(protocol.NOT_HOMED & set(self._take_flags())):
            raise self._link.fault(
                flag, protocol.FLAG_MEANINGS[flag], advice="It was told to home and came to rest without. Try again"
            )
        return self.position()

    def position(self) -> StagePosition:
        """Return the reading of the encoder, or of the motor's own count where there is no encoder."""
        counts = protocol.whole_number(self._link.ask(f"get {self._scale.reading}").data)
        return StagePosition(angle_deg=counts * 360.0 / self._scale.counts_per_turn % 360.0, counts=counts)

    def status(self) -> StageStatus:
        """Ask the stage what it is doing; flags stay set."""
        moving = self._link.ask("").busy
        flags = protocol.flags(self._link.ask("warnings").data)
        return StageStatus(
            moving=moving,
            homed=not protocol.NOT_HOMED & set(flags),
            code=" ".join(flags) or protocol.NOTHING,
            meaning="; ".join(protocol.FLAG_MEANINGS.get(flag, "not in the manual") for flag in flags)
            or protocol.FLAG_MEANINGS[protocol.NOTHING],
        )

    def stop(self) -> None:
        """Stop any motion."""
        self._link.ask("stop")
        self._await_rest(deadline_s=self._link.now_s() + _START_S)

    def _turn(self, angle_deg: float, *, way: Way) -> StagePosition:
        self._require_homed()
        scale = self._scale
        from_deg = self.position().counts * 360.0 / scale.counts_per_turn
        target_deg = target_within_deg(
            from_deg,
            angle_deg,
            way=way,
            near_deg=self._tolerance_deg,
            lowest_deg=scale.lowest_deg,
            highest_deg=scale.highest_deg,
        )
        way_s = abs(target_deg - from_deg) / scale.speed_deg_per_s
        self._link.ask(f"move abs {round(target_deg * scale.counts_per_turn / 360.0)}")
        self._await_rest(deadline_s=self._link.now_s() + _START_S + _SLOWER_THAN_TOLD * way_s)
        self._take_flags()
        return self.position()

    def _await_rest(self, *, deadline_s: float) -> None:
        while self._link.ask("").busy:
            if self._link.now_s() >= deadline_s:
                self._link.ask("stop")
                raise DeviceTimeoutError(
                    f"{self._link.name}: still moving after its deadline, so it was stopped. It is worn or hindered, "
                    "or its speed is set too low"
                )
            self._link.sleep(_POLL_S)

    def _take_flags(self) -> tuple[str, ...]:
        """Return the stage's flags and clear them; warnings become notes, a fault is raised."""
        flags = protocol.flags(self._link.ask("warnings").data)
        if set(flags) - protocol.NOT_HOMED:
            self._link.ask("warnings clear")
        for flag in flags:
            if flag.startswith("F"):
                meaning = protocol.FLAG_MEANINGS.get(flag, "a fault that is not in the manual")
                raise self._link.fault(flag, meaning, advice="Check that nothing blocks it, then home it again")
            if flag not in protocol.NOT_HOMED:
                self._link.notes.add(f"the stage reports {protocol.in_words(flag)}")
        return flags

    def _require_homed(self) -> None:
        if protocol.NOT_HOMED & set(protocol.flags(self._link.ask("warnings").data)):
            raise LimitError(
                f"{self._link.name}: it was not homed since its power-up, so its angles mean nothing yet. Home it first"
            )


def connect_zaber(
    port: BytePort,
    *,
    address: str = protocol.FIRST_ADDRESS,
    tolerance_deg: float = 0.02,
    steps_per_turn: int | None = None,
    now_s: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> ZaberStage:
    """Return the stage on an open link, once it has told what it is and how it counts.

    Parameters
    ----------
    port : BytePort
        A link at 115200 bits/s; the stage closes it.
    address : str
        1 to 99.
    tolerance_deg : float
        How far a readback may lie from its target [deg], above half a microstep.
    steps_per_turn : int or None
        Motor steps of a full turn of the ring, from the data sheet. Needed where the firmware does not tell the
        microsteps of a turn (``limit.cycle.dist``), checked where it does.
    now_s, sleep : callables
        A clock that never goes back [s], and a pause [s].

    Raises
    ------
    DeviceTimeoutError
        Nothing answers at this address.
    ProtocolError
        What answers cannot be understood, or its counts of a turn are not plausible.
    LimitError
        The address or the tolerance is outside of its range, or the counts of a turn are not known.
    """
    link = ZaberLink(port, address=address, now_s=now_s, sleep=sleep)
    link.begin()
    return ZaberStage(
        link, read_identity(link), _read_scale(link, steps_per_turn=steps_per_turn), tolerance_deg=tolerance_deg
    )


def open_zaber(
    port: str,
    *,
    address: str = protocol.FIRST_ADDRESS,
    tolerance_deg: float = 0.02,
    steps_per_turn: int | None = None,
    now_s: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> ZaberStage:
    """Return the stage on a serial port; see `connect_zaber`.

    Raises
    ------
    NotConnectedError
        There is no such port, or it may not be opened, or another program holds it.
    """
    connect = partial(connect_zaber, address=address, tolerance_deg=tolerance_deg, steps_per_turn=steps_per_turn)
    return open_stage_on(port, baud=protocol.BAUD, connect=partial(connect, now_s=now_s, sleep=sleep))


def read_identity(link: ZaberLink) -> DeviceIdentity:
    """Return what a device says of itself; its names are in a database of the maker's, so it is called by number."""
    model, serial_number, firmware = (
        link.ask(f"get {setting}", axis=0).data for setting in ("deviceid", "system.serial", "version")
    )
    return DeviceIdentity(model=f"Zaber {model}", serial_number=serial_number, firmware=firmware)


def _read_scale(link: ZaberLink, *, steps_per_turn: int | None) -> Scale:
    turn = _counts_per_turn(link, steps_per_turn=steps_per_turn)
    lowest, highest, speed = (
        protocol.whole_number(link.ask(f"get {setting}").data) for setting in ("limit.min", "limit.max", "maxspeed")
    )
    if speed <= 0 or lowest >= highest:
        raise ProtocolError(f"{link.name}: maxspeed {speed}, limits {lowest} to {highest}: it cannot turn like that")
    return Scale(
        counts_per_turn=turn,
        lowest_deg=lowest * 360.0 / turn,
        highest_deg=highest * 360.0 / turn,
        speed_deg_per_s=speed / _MAXSPEED_UNIT * 360.0 / turn,
        reading="pos" if link.get_or_none("encoder.pos") is None else "encoder.pos",
    )


def _counts_per_turn(link: ZaberLink, *, steps_per_turn: int | None) -> int:
    """Return the microsteps of a turn: told by the stage, or from the data sheet and the resolution that is set."""
    resolution = protocol.whole_number(link.ask("get resolution").data)
    told = link.get_or_none("limit.cycle.dist")
    if told is None and steps_per_turn is None:
        raise LimitError(
            f"{link.name}: its firmware does not tell the microsteps of a turn. Give the motor steps of a full turn "
            "from its data sheet: steps_per_turn = (motor steps a revolution) x (gear ratio)"
        )
    turn = resolution * (steps_per_turn or 0) if told is None else protocol.whole_number(told)
    if steps_per_turn is not None and turn != resolution * steps_per_turn:
        raise LimitError(
            f"{link.name}: it counts {turn} microsteps a turn, and steps_per_turn = {steps_per_turn} at its resolution "
            f"of {resolution} makes {resolution * steps_per_turn}. Another stage, or a wrong number"
        )
    lowest, highest = _TURN_RANGE
    if not lowest <= turn <= highest:
        raise ProtocolError(f"{link.name}: {turn} microsteps a turn are not plausible ({lowest} to {highest})")
    return turn
