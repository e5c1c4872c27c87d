"""Questions and answers with one Zaber device: every wait has a deadline, and no answer is taken for another's.

Each command has its message id and each reply its checksum, so that a late answer and a damaged one are told from the
right one at once. Any command used here may be sent again: none of them moves by a distance.
"""

import time
from collections.abc import Callable

from drivers.errors import DeviceFaultError, DeviceTimeoutError, ProtocolError
from drivers.interfaces import DeviceIdentity
from drivers.serial_port import BytePort
from drivers.stages import zaber_protocol as protocol
from drivers.stages.serial_stage import Answer, Line, events_after
from drivers.stages.zaber_protocol import Reply

_PROBE_ANSWER_S = 0.2
_TRIES = 6
_REPLY_TIMEOUT_S = 0.5  # the longest reply takes 7 ms on the line, a USB adapter adds 16 ms
_AGAIN_PAUSE_S = 0.1
# A command that was damaged on its way may be refused for any of these, although it was good when it was sent.
_WORTH_ANOTHER_TRY = frozenset({"AGAIN", "BADAXIS", "BADCOMMAND", "BADDATA", "BADMESSAGEID"})


class ZaberLink(Line):
    """The line to one device (address 1 to 99) at 115200 bits/s; its notes are flags and repeated questions."""

    def __init__(
        self, port: BytePort, *, address: str, now_s: Callable[[], float], sleep: Callable[[float], None]
    ) -> None:
        self._parser: protocol.ReplyParser
        self._device = protocol.check_address(address)
        name = f"Zaber stage {address} on {port.name}"
        super().__init__(port, protocol.ReplyParser(), name=name, now_s=now_s, sleep=sleep)
        self._next_id = 0

    def begin(self) -> None:
        """Make the device add a checksum to all that it says from now on.

        Raises
        ------
        DeviceTimeoutError, ProtocolError
            Nothing answers, or what answers is no Zaber device.
        """
        self._ask("set comm.checksum 1", axis=0, unchecked=True)

    def ask(self, words: str, *, axis: int = 1) -> Reply:
        """Return the reply to a command, which may be sent up to six times.

        Raises
        ------
        DeviceTimeoutError
            The device is silent (about 3 s).
        ProtocolError
            Its answers are damaged.
        DeviceFaultError
            It refuses; the code is its reason, such as BADDATA.
        """
        return self._ask(words, axis=axis, unchecked=False)

    def get_or_none(self, setting: str, *, axis: int = 1) -> str | None:
        """Return a setting's value, or None when this device's firmware does not know the setting."""
        try:
            return self.ask(f"get {setting}", axis=axis).data
        except DeviceFaultError as error:
            if error.code != "BADCOMMAND":
                raise
            return None

    def fault(self, code: str, meaning: str, *, advice: str) -> DeviceFaultError:
        """Return the error that tells of a fault."""
        return DeviceFaultError(f"{self.name}: it reports {code} ({meaning}). {advice}", code=code, meaning=meaning)

    def _ask(self, words: str, *, axis: int, unchecked: bool) -> Reply:
        refused: int | str | None = None
        for _ in range(_TRIES - 1):
            try:
                return self._exchange(words, axis=axis, unchecked=unchecked)
            except (ProtocolError, DeviceTimeoutError) as error:
                self.notes.add(f"tried again: {error}")
            except DeviceFaultError as error:
                if error.code not in _WORTH_ANOTHER_TRY or error.code == refused != "AGAIN":
                    raise
                refused = error.code
                self.sleep(_AGAIN_PAUSE_S)
        return self._exchange(words, axis=axis, unchecked=unchecked)

    def _exchange(self, words: str, *, axis: int, unchecked: bool) -> Reply:
        self.drain(quiet_s=0.0, limit_s=_REPLY_TIMEOUT_S)
        message_id, self._next_id = self._next_id, (self._next_id + 1) % protocol.IDS
        sent = protocol.command(words, device=self._device, axis=axis, message_id=message_id)
        self._port.write(sent)
        reply = self._await(sent, message_id, deadline_s=self.now_s() + _REPLY_TIMEOUT_S)
        if not (reply.checked or unchecked):
            raise ProtocolError(f"{self.name}: after {sent!r}: a reply came without checksum: {reply.data!r}")
        if not reply.accepted:
            meaning = protocol.REJECTIONS.get(reply.data, "not in the manual")
            raise self.fault(reply.data, meaning, advice=f"That was refused: {sent!r}")
        return reply

    def _await(self, sent: bytes, message_id: int, *, deadline_s: float) -> Reply:
        damaged: ProtocolError | None = None
        while True:
            try:
                event = self._parser.next_event()
            except ProtocolError as error:
                damaged = error  # it may be another's: what was asked for may yet come
                continue
            if isinstance(event, Reply) and event.device == self._device and event.message_id == message_id:
                return event
            if event is None and not self.take_in(deadline_s):
                raise self.unanswered(f"{sent!r}", damaged, check="the cable and the address")


def ask_zaber(port: BytePort, *, now_s: Callable[[], float] = time.monotonic) -> list[Answer]:
    """Return the Zaber devices on a line at 115200 bits/s; every device of a chain answers for itself."""
    told: dict[int, dict[str, str]] = {}
    for message_id, setting in enumerate(("deviceid", "system.serial", "version")):
        question = protocol.command(f"get {setting}", device=0, axis=0, message_id=message_id)
        parser = protocol.ReplyParser()
        for event in events_after(port, question, parser, wait_s=_PROBE_ANSWER_S, enough=None, now_s=now_s):
            if isinstance(event, protocol.Reply) and event.accepted and event.message_id == message_id:
                told.setdefault(event.device, {})[setting] = event.data
    return [
        Answer(
            address=str(device),
            identity=DeviceIdentity(
                model=f"Zaber {found['deviceid']}", serial_number=found["system.serial"], firmware=found["version"]
            ),
        )
        for device, found in sorted(told.items())
        if len(found) == 3
    ]
