"""Questions and answers with one APT controller: every wait has a deadline, and no answer is taken for another's.

The protocol has neither checksums nor message numbers. The link therefore knows whether it is in step, that is, whether
every question so far has had its answer. When it is not, it listens until the line is quiet before it asks the next.
Nothing that a message says is kept: a status is one that was asked for now.
"""

import time
from collections.abc import Callable
from typing import TypeVar

from drivers.errors import DeviceFaultError, ProtocolError
from drivers.interfaces import DeviceIdentity
from drivers.serial_port import BytePort
from drivers.stages import apt_protocol as protocol
from drivers.stages.apt_models import HomeParameters, VelocityParameters
from drivers.stages.serial_stage import Answer, Line, events_after, two_agree

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


class AptLink(Line):
    """The line to one controller, open at 115200 bits/s; its notes are of repeated questions and damaged answers."""

    def __init__(self, port: BytePort, *, now_s: Callable[[], float], sleep: Callable[[float], None]) -> None:
        self._parser: protocol.MessageParser
        super().__init__(port, protocol.MessageParser(), name=f"APT stage on {port.name}", now_s=now_s, sleep=sleep)
        self._in_step = False

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
        return self.repeated(lambda: self._exchange(question, answer), tries=_TRIES)

    def ask_until_two_agree(self, question: bytes, answer: type[AnswerT]) -> AnswerT:
        """Return the answer to a question about something that does not change, once two in a row are the same."""
        return two_agree(
            lambda: self.ask(question, answer),
            name=self.name,
            tries=_TRIES,
            differ=lambda before, latest: f"it answers {question.hex(' ')} otherwise each time: {before}, {latest}",
        )

    def _exchange(self, question: bytes, answer: type[AnswerT]) -> AnswerT:
        self.drain(quiet_s=0.0 if self._in_step else _QUIET_S, limit_s=_QUIET_LIMIT_S)
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
            if event is None and not self.take_in(deadline_s):
                raise self.unanswered(question.hex(" "), damaged, check="and the cable")

    def _trouble(self, event: protocol.Trouble) -> DeviceFaultError:
        meaning = event.text or "not told"
        return DeviceFaultError(
            f"{self.name}: it reports trouble {event.code} ({meaning}). Switch it off and on, then home it",
            code=event.code,
            meaning=meaning,
        )


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
