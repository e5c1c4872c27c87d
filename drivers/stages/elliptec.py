"""A Thorlabs Elliptec (ELLx) rotation stage: ELL14, ELL16, ELL18, ELL21."""

import time
from collections.abc import Callable
from functools import partial

from drivers.errors import DeviceFaultError, DeviceTimeoutError, LimitError, ProtocolError
from drivers.interfaces import DeviceIdentity, StagePosition, StageStatus, Way
from drivers.serial_port import BytePort
from drivers.stages import elliptec_protocol as protocol
from drivers.stages.elliptec_link import EllxLink, ask_elliptec
from drivers.stages.serial_stage import SerialStage, StageProbe, open_stage_on, route_deg, two_agree

# How `rigctl devices` finds one: behind the FT230X of its interface board.
PROBE = StageProbe(baud=protocol.BAUD, usb_ids=((0x0403, 0x6015),), ask=ask_elliptec)

_TRIES = 3
_SLOWEST_DEG_PER_S = 10.0  # an ELL14 does about 430; slower than this, something is wrong
_START_S = 2.0
_FULL_TURN_S = _START_S + 360.0 / _SLOWEST_DEG_PER_S


class EllxStage(SerialStage):
    """The stage behind a link. `open_elliptec` and `connect_elliptec` make one.

    Notes
    -----
    Moves are refused until `home` has been called on this connection, and again after the stage was seen to
    restart: the protocol does not tell whether the
    stage has found its reference mark since power-up, and without it every angle is off by an unknown amount.

    What a person did with the handset shows up in the remarks of the next `Move`, and in `position`.
    """

    def __init__(self, link: EllxLink, information: protocol.Information, *, tolerance_deg: float) -> None:
        self._link = link
        self._information = information
        self._pulses = _plausible_pulses(link.name, information)
        super().__init__(link, tolerance_deg=tolerance_deg, count_deg=360.0 / self._pulses)
        self._homed = False
        self._last_counts: int | None = None

    def identify(self) -> DeviceIdentity:
        """Return what the stage said of itself when the connection was made."""
        return DeviceIdentity(
            model=protocol.ROTATION_STAGES[self._information.stage_type],
            serial_number=self._information.serial_number,
            firmware=self._information.firmware,
        )

    def home(self) -> StagePosition:
        """Search the reference mark; return the readback.

        Raises
        ------
        DeviceFaultError
            The stage reports a fault, such as a stall.
        DeviceTimeoutError
            The stage is silent, or does not get home within 38 s, three times.
        """
        self._homed = False
        for _ in range(_TRIES):
            if self._link.run_motion(protocol.home(self._link.address), timeout_s=_FULL_TURN_S):
                self._homed = True
                self._link.restarted = False
                return self.position()
        raise DeviceTimeoutError(
            f"{self._link.name}: homing was commanded {_TRIES} times and not confirmed. Last seen: "
            + "; ".join(self._link.notes.take())
        )

    def position(self) -> StagePosition:
        """Return the encoder's reading, once two in a row agree: a single reply carries no checksum.

        Raises
        ------
        ProtocolError
            Readings keep differing by more than the tolerance: the line is bad, or something turns the stage.
        """
        return self._agreed_position(self._read_encoder)

    def status(self) -> StageStatus:
        """Ask the stage what it is doing; a fault that it remembers is told, and by that forgotten by the stage."""
        try:
            code = self._link.ask(protocol.status(self._link.address), protocol.Status).code
        except DeviceFaultError as error:
            code = int(error.code)
        return StageStatus(
            moving=code == protocol.BUSY,
            homed=self._homed and not self._link.restarted,
            code=code,
            meaning=protocol.STATUS_MEANINGS.get(code, "reserved"),
        )

    def stop(self) -> None:
        """Stop a continuous motion. A move to a target cannot be broken off: the stage has no such command."""
        command = protocol.stop(self._link.address)
        code = self._link.ask(command, protocol.Status).code
        if code not in (protocol.OK, protocol.BUSY):
            raise self._link.fault(code, command)

    def _require_homed(self) -> None:
        if not self._homed or self._link.restarted:
            since = "it was restarted" if self._link.restarted else "the connection was made"
            raise LimitError(
                f"{self._link.name}: it was not homed since {since}, so its angles mean nothing yet. Home it first"
            )

    def _read_encoder(self) -> StagePosition:
        counts = self._link.ask(protocol.position(self._link.address), protocol.Position).counts
        angle_deg = protocol.angle_from_counts(counts, pulses=self._pulses)
        self._last_counts = counts
        return StagePosition(angle_deg=angle_deg, counts=counts)

    def _turn(self, angle_deg: float, *, way: Way) -> StagePosition:
        """Turn, by an absolute move where that leads the wanted way (none leads through zero)."""
        self._require_homed()
        here = self._read_encoder().counts if self._last_counts is None else self._last_counts
        by = self._route(here, angle_deg, way=way)
        target = protocol.counts_from_angle(angle_deg, pulses=self._pulses)
        if abs(here + by - target) > 1:  # each of the two was rounded
            here = self.position().counts  # one damaged reading must not lead a relative move astray
            by = self._route(here, angle_deg, way=way)
        if abs(here + by - target) <= 1:
            command = protocol.move_absolute(self._link.address, counts=target)
        else:
            command = protocol.move_relative(self._link.address, counts=by)
        self._link.run_motion(command, timeout_s=_START_S + abs(by) * 360.0 / self._pulses / _SLOWEST_DEG_PER_S)
        position = self._read_encoder()
        self._require_homed()
        return position

    def _route(self, here: int, angle_deg: float, *, way: Way) -> int:
        """Return by how many counts to turn."""
        from_deg = here * 360.0 / self._pulses
        return round(route_deg(from_deg, angle_deg, way=way, near_deg=self._tolerance_deg) * self._pulses / 360.0)


def connect_elliptec(
    port: BytePort,
    *,
    address: str = protocol.FIRST_ADDRESS,
    tolerance_deg: float = 0.02,
    now_s: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> EllxStage:
    """Return the stage on an open link, once it has told twice over the same what it is.

    Parameters
    ----------
    port : BytePort
        A link at 9600 bits/s; the stage closes it.
    address : str
        One character, 0-9 or A-F.
    tolerance_deg : float
        How far a readback may lie from its target [deg], above half an encoder count.
    now_s, sleep : callables
        A clock that never goes back [s], and a pause [s].

    Raises
    ------
    DeviceTimeoutError
        Nothing answers at this address.
    ProtocolError
        What answers is no rotation stage of a known type, or cannot be understood.
    LimitError
        The address or the tolerance is outside of its range.
    """
    link = EllxLink(port, address=address, busy_timeout_s=_FULL_TURN_S, now_s=now_s, sleep=sleep)
    link.begin()
    return EllxStage(link, _ask_information(link), tolerance_deg=tolerance_deg)


def open_elliptec(
    port: str,
    *,
    address: str = protocol.FIRST_ADDRESS,
    tolerance_deg: float = 0.02,
    now_s: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> EllxStage:
    """Return the stage on a serial port; see `connect_elliptec`.

    Raises
    ------
    NotConnectedError
        There is no such port, or it may not be opened, or another program holds it.
    """
    connect = partial(connect_elliptec, address=address, tolerance_deg=tolerance_deg, now_s=now_s, sleep=sleep)
    return open_stage_on(port, baud=protocol.BAUD, connect=connect)


def _ask_information(link: EllxLink) -> protocol.Information:
    """Return what the stage says of itself, twice in a row alike: one damaged digit would bend every angle."""
    command = protocol.identify(link.address)
    return two_agree(
        lambda: link.ask(command, protocol.Information),
        name=link.name,
        tries=_TRIES,
        differ=lambda before, latest: f"it says something else of itself each time: {before}, {latest}",
    )


def _plausible_pulses(name: str, information: protocol.Information) -> int:
    try:
        return protocol.pulses_per_revolution(information)
    except ProtocolError as error:
        raise ProtocolError(f"{name}: {error}. It is not used, since its angles could not be trusted") from error
