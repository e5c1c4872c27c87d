"""Questions and answers with one APT controller: every wait has a deadline, and no answer is taken for another's.

The protocol has neither checksums nor message numbers. The link therefore knows whether it is in step, that is, whether
every question so far has had its answer. When it is not, it listens until the line is quiet before it asks the next.
Nothing that a message says is kept: a status is one that was asked for now.
"""

import time
from collections.abc import Callable
from typing import TypeVar

from drivers.errors import DeviceError, DeviceFaultError, DeviceTimeoutError, ProtocolError
from drivers.interfaces import DeviceIdentity
from drivers.serial_port import BytePort
from drivers.stages import apt_protocol as protocol
from drivers.stages.apt_models import HomeParameters, VelocityParameters
from drivers.stages.probes import Answer, events_after
from drivers.stages.stage_port import Notes

_PROBE_ANSWER_S = 0.3
_TRIES = 6
_REPLY_TIMEOUT_S = 0.5  # the longest message takes 8 ms on the line, a USB adapter adds 16 ms
_TAIL_S = 0.002  # twenty bytes' worth
_QUIET_S = 0.05
_QUIET_LIMIT_S = 1.0

AnswerT = TypeVar(
    "AnswerT",
    protocol.Information,
    protocol.Status,
    protocol.ChannelState,
    VelocityParameters,
    HomeParameters,
)


class AptLink:
    """The line to one controller.

    Parameters
    ----------
    port : BytePort
        Open, at 115200 bits/s. The link closes it.
    now_s, sleep : callables
        A clock that never goes back [s], and a pause [s].

    Attributes
    ----------
    notes : Notes
        What was noticed: repeated questions, damaged answers.
    """

    def __init__(self, port: BytePort, *, now_s: Callable[[], float], sleep: Callable[[float], None]) -> None:
        self.name = f"APT stage on {port.name}"
        self._port = port
        self.now_s = now_s
        self.sleep = sleep
        self._parser = protocol.MessageParser()
        self._in_step = False
        self.notes = Notes()

    def close(self) -> None:
        """Release the port. May be called twice."""
        self._port.close()

    def tell(self, message: bytes) -> None:
        """Send a message that nothing answers."""
        self._port.write(message)

    def ask(self, question: bytes, answer: type[AnswerT]) -> AnswerT:
        """Return the answer to a question, asking up to six times.

        Raises
        ------
        DeviceTimeoutError
            The controller is silent (about 3 s).
        ProtocolError
            Its answers are damaged.
        DeviceFaultError
            It reports trouble.
        """
        for _ in range(_TRIES - 1):
            try:
                return self._exchange(question, answer)
            except (ProtocolError, DeviceTimeoutError) as error:
                self.notes.add(f"tried again: {error}")
        return self._exchange(question, answer)

    def ask_until_two_agree(self, question: bytes, answer: type[AnswerT]) -> AnswerT:
        """Return the answer to a question about something that does not change, once two in a row are the same.

        Raises
        ------
        ProtocolError
            It answers something else each time; for others see `ask`.
        """
        latest = self.ask(question, answer)
        for _ in range(_TRIES):
            before, latest = latest, self.ask(question, answer)
            if before == latest:
                return latest
        raise ProtocolError(f"{self.name}: it answers {question.hex(' ')} otherwise each time: {before}, {latest}")

    def _exchange(self, question: bytes, answer: type[AnswerT]) -> AnswerT:
        self._listen(quiet_s=0.0 if self._in_step else _QUIET_S)
        self._in_step = False
        self._port.write(question)
        event = self._await(question, answer, deadline_s=self.now_s() + _REPLY_TIMEOUT_S)
        self._require_sound_tail(question)
        self._in_step = True
        return event

    def _require_sound_tail(self, question: bytes) -> None:
        """See that nothing but whole messages follows an answer: else a byte was lost or doubled within the answer."""
        try:
            self._parser.feed(self._port.read_some(timeout_s=_TAIL_S))
            while self._parser.next_event() is not None:
                pass
        except ProtocolError as error:
            raise ProtocolError(f"{self.name}: behind the answer to {question.hex(' ')}: {error}") from error
        if self._parser.unread:
            raise ProtocolError(f"{self.name}: {self._parser.unread} bytes too many behind {question.hex(' ')}")

    def _await(self, question: bytes, answer: type[AnswerT], *, deadline_s: float) -> AnswerT:
        damaged: ProtocolError | None = None
        while True:
            try:
                event = self._parser.next_event()
            except ProtocolError as error:
                damaged = error  # what was asked for may yet come behind it
                continue
            if isinstance(event, answer):
                return event
            if isinstance(event, protocol.Trouble):
                raise self._trouble(event)
            if event is None and not self._take_in(deadline_s):
                raise self._unanswered(question, damaged)

    def _take_in(self, deadline_s: float) -> bool:
        """Wait for bytes; return whether any came in time."""
        remaining_s = deadline_s - self.now_s()
        data = self._port.read_some(timeout_s=remaining_s) if remaining_s > 0.0 else b""
        self._parser.feed(data)
        return bool(data)

    def _unanswered(self, question: bytes, damaged: ProtocolError | None) -> DeviceError:
        if damaged is not None:
            return ProtocolError(f"{self.name}: after {question.hex(' ')}: {damaged}")
        return DeviceTimeoutError(
            f"{self.name}: no answer to {question.hex(' ')} in time. Check the supply and the cable"
        )

    def _trouble(self, event: protocol.Trouble) -> DeviceFaultError:
        meaning = event.text or "not told"
        return DeviceFaultError(
            f"{self.name}: it reports trouble {event.code} ({meaning}). Switch it off and on, then home it",
            code=event.code,
            meaning=meaning,
        )

    def _listen(self, *, quiet_s: float) -> None:
        """Read until nothing comes for a while; what comes answers nothing any more."""
        end_s = self.now_s() + _QUIET_LIMIT_S
        while self._port.read_some(timeout_s=quiet_s) and self.now_s() < end_s:
            pass
        self._parser.reset()


def ask_apt(port: BytePort, *, now_s: Callable[[], float] = time.monotonic) -> list[Answer]:
    """Return the APT controller on a line at 115200 bits/s."""
    question, parser = protocol.identify(), protocol.MessageParser()
    return [
        Answer(
            address=None,
            identity=DeviceIdentity(model=event.model, serial_number=str(event.serial_number), firmware=event.firmware),
        )
        for event in events_after(port, question, parser, wait_s=_PROBE_ANSWER_S, enough=1, now_s=now_s)
        if isinstance(event, protocol.Information)
    ]
