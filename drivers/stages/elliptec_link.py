"""Questions and answers with one Elliptec stage: every wait has a deadline, and no answer is taken for another's.

The protocol has no message numbers, so an answer can only be told from a late one by order. The link therefore
knows whether it is in step, that is, whether every command so far has had its answer. When it is not, it makes
the stage forget what it has received in part, listens until the line is quiet, and asks for the status until
the stage is no longer busy; only then is the next command sent.
"""

import time
from collections.abc import Callable
from typing import TypeVar

from drivers.errors import DeviceFaultError, DeviceTimeoutError, ProtocolError
from drivers.interfaces import DeviceIdentity
from drivers.serial_port import BytePort
from drivers.stages import elliptec_protocol as protocol
from drivers.stages.serial_stage import Answer, Line, events_after

_PROBE_ANSWER_S = 0.15  # an answer takes 36 ms on the line, a USB adapter adds 16 ms
_TRIES = 3
_REPLY_TIMEOUT_S = 1.0  # the longest reply takes 36 ms on the line, a USB adapter adds 16 ms
_QUIET_S = 0.05  # 48 bytes' worth of silence
_QUIET_LIMIT_S = 1.0
_POLL_S = 0.1
_GAP_S = 0.1  # a move sent sooner after the one before "can move to 0 instead", other drivers' authors found

AnswerT = TypeVar("AnswerT", protocol.Information, protocol.Status, protocol.Position)


class EllxLink(Line):
    """The line to one stage (address 0-9 or A-F), open at 9600 bits/s.

    `busy_timeout_s` is how long it may stay busy with what another asked of it; `restarted` whether it was seen
    initialising since somebody last set this to False; notes are of buttons, repeated questions and late answers.
    """

    def __init__(
        self,
        port: BytePort,
        *,
        address: str,
        busy_timeout_s: float,
        now_s: Callable[[], float],
        sleep: Callable[[float], None],
    ) -> None:
        self._parser: protocol.ReplyParser
        self.address = protocol.check_address(address)
        name = f"Elliptec stage {address} on {port.name}"
        super().__init__(port, protocol.ReplyParser(), name=name, now_s=now_s, sleep=sleep)
        self._busy_timeout_s = busy_timeout_s
        self.restarted = False
        self._in_step = False
        self._last_heard_s = now_s()

    def begin(self) -> None:
        """Get in step with a stage in an unknown state; an error left from before is noted and cleared."""
        code = self._resynchronise(busy_until_s=self.now_s() + self._busy_timeout_s)
        if code != protocol.OK:
            self.notes.add(f"left from before: status {_in_words(code)}")

    def ask(self, command: bytes, answer: type[AnswerT]) -> AnswerT:
        """Return the answer to a command that moves nothing, asking up to three times.

        Raises
        ------
        DeviceTimeoutError
            The stage is silent (about 4 s), or busy for longer than its busy timeout.
        ProtocolError
            Its answers are damaged.
        DeviceFaultError
            It answers with a fault.
        """
        self._get_in_step()
        for _ in range(_TRIES - 1):
            try:
                return self._exchange(command, answer, deadline_s=self.now_s() + _REPLY_TIMEOUT_S)
            except (ProtocolError, DeviceTimeoutError, DeviceFaultError) as error:
                self._note_or_raise(error)
            self._get_in_step()
        return self._exchange(command, answer, deadline_s=self.now_s() + _REPLY_TIMEOUT_S)

    def run_motion(self, command: bytes, *, timeout_s: float) -> bool:
        """Send a command that moves the stage, once, and wait for the motion's end.

        Returns
        -------
        bool
            Whether the stage answered with its position. If not, the command or its answer was damaged: the
            stage rests, but not for certain where it should.

        Raises
        ------
        DeviceTimeoutError
            The stage is silent, or still busy after ``timeout_s`` [s].
        DeviceFaultError
            It reports a fault, such as a stall.
        """
        self._get_in_step()
        self.sleep(max(0.0, self._last_heard_s + _GAP_S - self.now_s()))
        deadline_s = self.now_s() + timeout_s
        try:
            self._exchange(command, protocol.Position, deadline_s=deadline_s)
        except (ProtocolError, DeviceTimeoutError, DeviceFaultError) as error:
            self._note_or_raise(error)
            self._get_in_step(busy_until_s=deadline_s)
            return False
        return True

    def fault(self, code: int, command: bytes) -> DeviceFaultError:
        """Return the error that tells of a status."""
        return DeviceFaultError(
            f"{self.name}: after {command!r} it reports status {_in_words(code)}. "
            "Check that nothing blocks it and that its supply is good, then home it again",
            code=code,
            meaning=protocol.STATUS_MEANINGS.get(code, "reserved"),
        )

    def _exchange(self, command: bytes, answer: type[AnswerT], *, deadline_s: float) -> AnswerT:
        """Return the one answer to one command; when that fails, the link is out of step."""
        self._note_unasked()
        self._in_step = False
        self._port.write(command)
        event = self._await(command, answer, deadline_s=deadline_s)
        self._in_step = True
        return event

    def _await(self, command: bytes, answer: type[AnswerT], *, deadline_s: float) -> AnswerT:
        while True:
            event = self._next_event(command, deadline_s=deadline_s)
            if isinstance(event, protocol.Status) and event.code == protocol.INITIALISING:
                self.restarted = True
            if isinstance(event, answer):
                return event
            if isinstance(event, protocol.Status) and event.code not in (protocol.OK, protocol.BUSY):
                self._clear_fault()
                raise self.fault(event.code, command)

    def _next_event(self, command: bytes, *, deadline_s: float) -> protocol.Event:
        """Return the next reply of our stage; buttons are noted on the way."""
        while True:
            try:
                event = self._parser.next_event()
                if event is None:
                    self._parser.feed(self._read(command, deadline_s=deadline_s))
            except ProtocolError as error:
                raise ProtocolError(f"{self.name}: after {command!r}: {error}") from error
            if event is not None and not self._is_of_others(event):
                return event

    def _read(self, command: bytes, *, deadline_s: float) -> bytes:
        remaining_s = deadline_s - self.now_s()
        if remaining_s <= 0.0:
            raise DeviceTimeoutError(
                f"{self.name}: no answer to {command!r} in time. Check the supply, the cable and the address"
            )
        data = self._port.read_some(timeout_s=remaining_s)
        if data:
            self._last_heard_s = self.now_s()
        return data

    def _is_of_others(self, event: protocol.Event) -> bool:
        """Return whether an event is none of our business; a pressed button is noted."""
        if event.address != self.address:
            return True
        if isinstance(event, protocol.ButtonStatus):
            self.notes.add("a button of the handset was pressed")
        elif isinstance(event, protocol.ButtonPosition):
            self.notes.add(f"a button of the handset moved the stage to {event.counts} counts")
        else:
            return False
        return True

    def _note_unasked(self) -> None:
        """Take in what waits to be read, so that nothing older than a command can be taken for its answer."""
        self._listen(quiet_s=0.0)

    def _listen(self, *, quiet_s: float) -> None:
        """Read until nothing comes for a while; what comes answers nothing any more."""
        end_s = self.now_s() + _QUIET_LIMIT_S
        while data := self._port.read_some(timeout_s=quiet_s):
            self._note_stale(data)
            if self.now_s() >= end_s:
                break
        self._parser.reset()

    def _note_stale(self, data: bytes) -> None:
        try:
            self._parser.feed(data)
            while (event := self._parser.next_event()) is not None:
                if not self._is_of_others(event):
                    self.notes.add(f"ignored, since it came too late or unasked: {event}")
        except ProtocolError as error:
            self.notes.add(f"ignored: {error}")

    def _note_or_raise(self, error: Exception) -> None:
        """Note an error that sending the command once more may cure; raise any other."""
        if isinstance(error, DeviceFaultError) and error.code not in protocol.GARBLED_CODES:
            raise error
        self.notes.add(f"tried again: {error}")

    def _get_in_step(self, *, busy_until_s: float | None = None) -> None:
        """See that every command so far is done with. Raises the fault that the stage reports meanwhile."""
        if self._in_step:
            return
        until_s = self.now_s() + self._busy_timeout_s if busy_until_s is None else busy_until_s
        code = self._resynchronise(busy_until_s=until_s)
        if code in protocol.GARBLED_CODES:
            self.notes.add(f"a command was damaged: status {_in_words(code)}")
        elif code != protocol.OK:
            raise self.fault(code, protocol.status(self.address))

    def _resynchronise(self, *, busy_until_s: float) -> int:
        """Return the status of the stage once it is not busy; reading clears it."""
        self._reset_line()
        while (code := self._read_status()) in (protocol.BUSY, protocol.INITIALISING):
            if self.now_s() >= busy_until_s:
                raise DeviceTimeoutError(
                    f"{self.name}: still at status {_in_words(code)} after its deadline; its angle is not known "
                    "until it rests. If it is turning too slowly, it is worn or hindered"
                )
            self.sleep(_POLL_S)
        self._in_step = True
        return code

    def _read_status(self) -> int:
        command = protocol.status(self.address)
        for _ in range(_TRIES - 1):
            try:
                return self._ask_status(command)
            except (ProtocolError, DeviceTimeoutError) as error:
                self.notes.add(f"tried again: {error}")
            self._reset_line()
        return self._ask_status(command)

    def _ask_status(self, command: bytes) -> int:
        self._port.write(command)
        return self._await(command, protocol.Status, deadline_s=self.now_s() + _REPLY_TIMEOUT_S).code

    def _clear_fault(self) -> None:
        """Read the status once, which makes the stage forget the fault that it has just told."""
        try:
            self._ask_status(protocol.status(self.address))
        except (ProtocolError, DeviceTimeoutError) as error:
            self.notes.add(f"the fault may still be set in the stage: {error}")

    def _reset_line(self) -> None:
        self._port.write(protocol.RESET_RECEIVER)
        self._listen(quiet_s=_QUIET_S)


def _in_words(code: int) -> str:
    return f"{code} ({protocol.STATUS_MEANINGS.get(code, 'reserved')})"


def ask_elliptec(port: BytePort, *, now_s: Callable[[], float] = time.monotonic) -> list[Answer]:
    """Return the Elliptec rotation stages on a line at 9600 bits/s, all sixteen addresses asked."""
    answers = []
    for address in "0123456789ABCDEF":
        parser = protocol.ReplyParser()
        question = protocol.identify(address)
        events = events_after(port, question, parser, wait_s=_PROBE_ANSWER_S, enough=1, now_s=now_s)
        for event in events:
            if isinstance(event, protocol.Information) and event.address == address:
                identity = DeviceIdentity(
                    model=protocol.ROTATION_STAGES.get(event.stage_type, f"ELL{event.stage_type}"),
                    serial_number=event.serial_number,
                    firmware=event.firmware,
                )
                answers.append(Answer(address=address, identity=identity))
    return answers
