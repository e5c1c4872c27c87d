"""A Thorlabs rotation stage with an APT controller: K10CR1, K10CR2, and a PRM1-Z8 on a KDC101 or TDC001."""

import time
from collections.abc import Callable

from drivers.errors import DeviceFaultError, DeviceTimeoutError, LimitError, ProtocolError
from drivers.interfaces import DeviceIdentity, StagePosition, StageStatus, Way
from drivers.serial_port import BytePort, SerialPort
from drivers.stages import apt_protocol as protocol
from drivers.stages.apt_link import AptLink, ask_apt
from drivers.stages.apt_models import AptModel, HomeParameters, VelocityParameters, find_model
from drivers.stages.serial_stage import SerialStage, StageProbe, open_stage_on, target_within_deg, two_agree

# How `rigctl devices` finds one.
PROBE = StageProbe(baud=protocol.BAUD, usb_ids=((0x0403, 0xFAF0),), ask=ask_apt)

_TRIES = 3
_POLL_S = 0.1
_START_S = 2.0
_SLOWER_THAN_SET = 2.0  # acceleration, and a motor that is not quite up to it
_HOME_S = 90.0  # a turn and a half at half the speed that is set, and the start
_BEGIN_S = 1.0  # a motion that has not shown itself by then was not understood
_AFTER_ENABLE_S = 1.0  # a TDC001 locks up when it is told to home right after
_HIGHEST_COUNTS = (1 << 31) - 1


class AptStage(SerialStage):
    """The stage behind a link. `open_apt` and `connect_apt` make one.

    Notes
    -----
    Whether it was homed since its power-up is known to the controller (status bit 0x400) and asked before each move.
    Motions are watched by asking for the status: the messages HOMED and MOVE_COMPLETED may be missing, and the
    position in them may be wrong. The readback of a K10CR is what its motor was told: it has no encoder.
    """

    def __init__(self, link: AptLink, identity: DeviceIdentity, model: AptModel, *, tolerance_deg: float) -> None:
        super().__init__(link, tolerance_deg=tolerance_deg, count_deg=1.0 / model.counts_per_deg)
        self._link = link
        self._identity = identity
        self._model = model

    def identify(self) -> DeviceIdentity:
        """Return what the controller said of itself when the connection was made."""
        return self._identity

    def home(self) -> StagePosition:
        """Search the reference mark; return the readback.

        Raises
        ------
        DeviceFaultError
            The stage reports a fault.
        DeviceTimeoutError
            The controller is silent, or the stage does not get home within 90 s, or never says that it is home.
        """
        for _ in range(_TRIES):
            self._link.tell(protocol.home())
            if self._homing_begins() and self._await_rest(deadline_s=self._link.now_s() + _HOME_S).homed:
                return self.position()
        raise DeviceTimeoutError(
            f"{self._link.name}: told to home {_TRIES} times, it does not say that it found its mark (status bit "
            "0x400). Switch it off and on, and check its home parameters in the maker's program"
        )

    def position(self) -> StagePosition:
        """Return the position, once two in a row agree: a message carries no checksum.

        Raises
        ------
        ProtocolError
            Readings keep differing by more than the tolerance: the line is bad, or the stage turns.
        """
        return self._agreed_position(self._read_position)

    def status(self) -> StageStatus:
        """Ask the controller what the stage is doing; the code is its status bits."""
        status = self._ask_status()
        meaning = protocol.fault_in_words(status.faults) if status.faults else "no fault"
        return StageStatus(moving=status.moving, homed=status.homed, code=status.bits, meaning=meaning)

    def stop(self) -> None:
        """Stop any motion."""
        self._link.tell(protocol.stop())
        self._await_rest(deadline_s=self._link.now_s() + _START_S)

    def _turn(self, angle_deg: float, *, way: Way) -> StagePosition:
        self._require_homed()
        model = self._model
        highest_deg = _HIGHEST_COUNTS / model.counts_per_deg
        from_deg = self.position().counts / model.counts_per_deg
        target_deg = target_within_deg(
            from_deg,
            angle_deg,
            way=way,
            near_deg=self._tolerance_deg,
            lowest_deg=-highest_deg,
            highest_deg=highest_deg,
        )
        way_s = abs(target_deg - from_deg) / model.speed_deg_per_s
        self._link.tell(protocol.move_absolute(round(target_deg * model.counts_per_deg)))
        self._await_rest(deadline_s=self._link.now_s() + _START_S + _SLOWER_THAN_SET * way_s)
        return self.position()

    def _homing_begins(self) -> bool:
        """Return whether the stage says that it is homing, or no longer homed; both were false or true before."""
        deadline_s = self._link.now_s() + _BEGIN_S
        while self._link.now_s() < deadline_s:
            status = self._ask_status()
            if status.bits & protocol.HOMING or not status.homed:
                return True
            self._link.sleep(_POLL_S)
        return False

    def _await_rest(self, *, deadline_s: float) -> protocol.Status:
        """Return the status once the stage says twice in a row that it rests: the first may be older than a command."""
        resting = 0
        while True:
            status = self._ask_status()
            if status.faults:
                self._raise_fault(self._agreed(lambda status: status.faults))
            resting = 0 if status.moving else resting + 1
            if resting == 2:
                return status
            if self._link.now_s() >= deadline_s:
                self._link.tell(protocol.stop())
                raise DeviceTimeoutError(
                    f"{self._link.name}: still moving after its deadline, so it was stopped. It is worn or hindered, "
                    "or it lost its parameters: open it again"
                )
            self._link.sleep(_POLL_S)

    def _ask_status(self) -> protocol.Status:
        return self._link.ask(protocol.status(is_stepper=self._model.is_stepper), protocol.Status)

    def _read_position(self) -> StagePosition:
        counts = self._ask_status().counts
        return StagePosition(angle_deg=counts / self._model.counts_per_deg % 360.0, counts=counts)

    def _agreed(self, what: Callable[[protocol.Status], int]) -> int:
        """Return something of the status, once two in a row agree on it: a message carries no checksum."""
        return two_agree(
            lambda: what(self._ask_status()),
            name=self._link.name,
            tries=_TRIES,
            differ=lambda *_: "its status is otherwise each time. Check the cable",
        )

    def _raise_fault(self, faults: int) -> None:
        if faults:
            meaning = protocol.fault_in_words(faults)
            raise DeviceFaultError(
                f"{self._link.name}: it reports status bits {faults:#x} ({meaning}). Check that nothing blocks it, "
                "then home it again",
                code=faults,
                meaning=meaning,
            )

    def _require_homed(self) -> None:
        if not self._agreed(lambda status: status.homed):
            raise LimitError(
                f"{self._link.name}: it was not homed since its power-up, so its angles mean nothing yet. Home it first"
            )


def connect_apt(
    port: BytePort,
    *,
    tolerance_deg: float = 0.02,
    actuator: str | None = None,
    now_s: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> AptStage:
    """Return the stage on an open link, once it has told what it is and taken its parameters.

    Parameters
    ----------
    port : BytePort
        A link at 115200 bits/s; the stage closes it.
    tolerance_deg : float
        How far a readback may lie from its target [deg], above half a count.
    actuator : str or None
        "PRM1-Z8" for a KDC101 or TDC001 that does not tell its stage.
    now_s, sleep : callables
        A clock that never goes back [s], and a pause [s].

    Raises
    ------
    DeviceTimeoutError
        Nothing answers.
    ProtocolError
        What answers is no known stage, does not keep its parameters, or cannot be understood.
    LimitError
        The tolerance is outside of its range.
    """
    link = AptLink(port, now_s=now_s, sleep=sleep)
    link.tell(protocol.no_flash_programming())
    link.tell(protocol.stop_updates())
    information = link.ask_until_two_agree(protocol.identify(), protocol.Information)
    try:
        model = find_model(information.model, stage_id=information.stage_id, actuator=actuator)
    except ProtocolError as error:
        raise ProtocolError(f"{link.name}: {error}") from error
    stage = AptStage(link, identity_of(information), model, tolerance_deg=tolerance_deg)
    _set_up(link, model)
    return stage


def open_apt(
    port: str,
    *,
    tolerance_deg: float = 0.02,
    actuator: str | None = None,
    now_s: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> AptStage:
    """Return the stage on a serial port; see `connect_apt`.

    Raises
    ------
    NotConnectedError
        There is no such port, or it may not be opened, or another program holds it.
    """

    def connect(link: SerialPort) -> AptStage:
        link.request_to_send()
        return connect_apt(link, tolerance_deg=tolerance_deg, actuator=actuator, now_s=now_s, sleep=sleep)

    return open_stage_on(port, baud=protocol.BAUD, connect=connect)


def identity_of(information: protocol.Information) -> DeviceIdentity:
    """Return what a controller says of itself."""
    return DeviceIdentity(
        model=information.model, serial_number=str(information.serial_number), firmware=information.firmware
    )


def _set_up(link: AptLink, model: AptModel) -> None:
    """Set what some controllers forget at power-off, and see that it was taken; switch the motor on."""
    for _ in range(_TRIES):
        link.tell(protocol.set_velocity(model.velocity))
        link.tell(protocol.set_home(model.home))
        velocity = link.ask_until_two_agree(protocol.velocity(), VelocityParameters)
        home = link.ask_until_two_agree(protocol.home_parameters(), HomeParameters)
        if (velocity, home) == (model.velocity, model.home):
            break
    else:
        raise ProtocolError(f"{link.name}: it does not keep its parameters: it has {velocity} and {home}")
    for _ in range(_TRIES):
        if link.ask_until_two_agree(protocol.channel_state(), protocol.ChannelState).enabled:
            return
        link.tell(protocol.enable())
        link.sleep(_AFTER_ENABLE_S)
    raise ProtocolError(f"{link.name}: its motor does not switch on")
