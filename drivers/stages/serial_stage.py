"""Common parts of stages on serial ports: opening, finding, the line, angles, and moves.

The module of a family has, in this order: its language without input or output, its line (a `Line`), and its stage (a
`SerialStage`). Its entry point names a function `open_...`; `PROBE` lets `drivers.discovery` find it.
"""

import math
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol, Self, TypeVar

from drivers.errors import AddressError, DeviceError, DeviceTimeoutError, LimitError, ProtocolError
from drivers.interfaces import DeviceIdentity, Move, StagePosition, Way
from drivers.serial_port import BytePort, open_serial_port

_NOTES_KEPT = 20
_TURN_DEG = 360.0
_TRIES = 3

T = TypeVar("T")
EventT = TypeVar("EventT", covariant=True)


@contextmanager
def opened(port: str | BytePort, *, baud: int) -> Iterator[BytePort]:
    """Give the line of a stage, opened here if it is named by its path; it is closed again on failure."""
    line = open_serial_port(port, baud=baud) if isinstance(port, str) else port
    try:
        yield line
    except BaseException:
        line.close()
        raise


class Notes:
    """The newest 20 remarks on a line, for the next move."""

    def __init__(self) -> None:
        self._texts: deque[str] = deque(maxlen=_NOTES_KEPT)

    def add(self, text: str) -> None:
        """Keep a remark."""
        self._texts.append(text)

    def take(self) -> tuple[str, ...]:
        """Return the remarks since the last call."""
        texts = tuple(self._texts)
        self._texts.clear()
        return texts


class Parser(Protocol[EventT]):
    """Parser of a family's language."""

    def feed(self, data: bytes) -> None:
        """Take in received bytes."""

    def next_event(self) -> EventT | None:
        """Return the next complete event; None if more bytes are needed."""


@dataclass(frozen=True, kw_only=True)
class Answer:
    """A stage that answered: its address on the line (None if there is only one), and its identity."""

    address: str | None
    identity: DeviceIdentity


class ResettableParser(Protocol):
    """Parser that can discard a partly received message."""

    def feed(self, data: bytes) -> None:
        """Take in received bytes."""

    def reset(self) -> None:
        """Discard what was received in part."""


Clock = Callable[[], float]


@dataclass(frozen=True, kw_only=True)
class StageProbe:
    """Search for a family; the module in the entry point has one as ``PROBE``."""

    baud: int  #: Bit rate [1/s].
    #: Vendor and product that identify the family; None stands for any product of the vendor.
    usb_ids: tuple[tuple[int, int | None], ...]
    ask: Callable[[BytePort], list[Answer]]  #: Returns the stages on an open line.


def events_after(
    port: BytePort, question: bytes, parser: Parser[EventT], *, wait_s: float, enough: int | None, now_s: Clock
) -> list[EventT]:
    """Ask; return the understood answers, until enough came or the time is over."""
    port.write(question)
    events: list[EventT] = []
    deadline_s = now_s() + wait_s
    while (remaining_s := deadline_s - now_s()) > 0.0 and (enough is None or len(events) < enough):
        data = port.read_some(timeout_s=remaining_s)
        events += _understood(parser, data)
    return events


def _understood(parser: Parser[EventT], data: bytes) -> list[EventT]:
    events: list[EventT] = []
    try:
        parser.feed(data)
    except ProtocolError:
        return events
    while True:
        try:
            event = parser.next_event()
        except ProtocolError:
            continue  # another device answers on this line
        if event is None:
            return events
        events.append(event)


class Line:
    """The line to one stage; every wait has a deadline."""

    def __init__(
        self, port: BytePort, parser: ResettableParser, *, name: str, now_s: Clock, sleep: Callable[[float], None]
    ) -> None:
        self._port, self._parser = port, parser
        self.name, self.now_s, self.sleep = name, now_s, sleep
        self.notes = Notes()

    def close(self) -> None:
        """Release the port. May be called twice."""
        self._port.close()

    def repeated(self, exchange: Callable[[], T], *, tries: int) -> T:
        """Return the result of an exchange, repeated if the line is silent or damaged."""
        for _ in range(tries - 1):
            try:
                return exchange()
            except (ProtocolError, DeviceTimeoutError) as error:
                self.notes.add(f"tried again: {error}")
        return exchange()

    def take_in(self, deadline_s: float) -> bool:
        """Wait for bytes; return whether any came in time."""
        remaining_s = deadline_s - self.now_s()
        data = self._port.read_some(timeout_s=remaining_s) if remaining_s > 0.0 else b""
        self._parser.feed(data)
        return bool(data)

    def drain(self, *, quiet_s: float, limit_s: float) -> None:
        """Read until nothing comes for a while; what comes answers nothing any more."""
        end_s = self.now_s() + limit_s
        while self._port.read_some(timeout_s=quiet_s) and self.now_s() < end_s:
            pass
        self._parser.reset()

    def unanswered(self, question: str, damaged: ProtocolError | None, *, check: str) -> DeviceError:
        """Return the error of a question without an answer."""
        if damaged is not None:
            return ProtocolError(f"{self.name}: after {question}: {damaged}")
        return DeviceTimeoutError(f"{self.name}: no answer to {question} in time. Check the supply, {check}")


class SerialStage:
    """Common part of all stages behind a line; a family adds home, position, status, stop and turning."""

    def __init__(self, link: Line, *, tolerance_deg: float, count_deg: float) -> None:
        half_count_deg = count_deg / 2.0
        if not half_count_deg < tolerance_deg < 180.0:
            raise AddressError(
                f"tolerance {tolerance_deg:g} deg: must be above half an encoder count, {half_count_deg:.3g} deg, "
                "and below 180 deg"
            )
        self._line, self._tolerance_deg = link, tolerance_deg

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()

    def close(self) -> None:
        """Release the port. May be called twice."""
        self._line.close()

    def _turn(self, angle_deg: float, *, way: Way) -> StagePosition:
        raise NotImplementedError

    def move_to(self, angle_deg: float, *, way: Way = "short") -> Move:
        """Go to a mechanical angle (any real number, taken modulo 360), and return once it is there.

        It turns, reads back and corrects by the short way, three times at most.
        """
        require_finite(angle_deg)
        start_s = self._line.now_s()
        for tries in range(1, _TRIES + 1):
            position = self._turn(angle_deg, way=way if tries == 1 else "short")
            if distance_deg(position.angle_deg, angle_deg) <= self._tolerance_deg:
                return Move(
                    target_deg=angle_deg,
                    position=position,
                    tries=tries,
                    duration_s=self._line.now_s() - start_s,
                    remarks=self._line.notes.take(),
                )
        raise LimitError(
            f"{self._line.name}: sent to {angle_deg:g} deg {_TRIES} times, it is at {position.angle_deg:.4f} deg, "
            f"beyond the tolerance of {self._tolerance_deg:g} deg. Clean its track and check its load, or increase "
            "tolerance_deg"
        )

    def _agreed_position(self, read: Callable[[], StagePosition]) -> StagePosition:
        """Return a position once two readings in a row agree, because answers have no checksum."""

        def differ(before: StagePosition, latest: StagePosition) -> str:
            return (
                f"readings of the position differ, at last {before.counts} and {latest.counts} counts. Check the "
                "cable, and that nothing else turns the stage"
            )

        def near(before: StagePosition, latest: StagePosition) -> bool:
            return distance_deg(before.angle_deg, latest.angle_deg) <= self._tolerance_deg

        return two_agree(read, name=self._line.name, tries=_TRIES, differ=differ, alike=near)


def two_agree(
    read: Callable[[], T],
    *,
    name: str,
    tries: int,
    differ: Callable[[T, T], str],
    alike: Callable[[T, T], bool] = lambda before, latest: before == latest,
) -> T:
    """Return a reading once two in a row agree, else raise ProtocolError: a single answer may be damaged."""
    latest = read()
    for _ in range(tries):
        before, latest = latest, read()
        if alike(before, latest):
            return latest
    raise ProtocolError(f"{name}: {differ(before, latest)}")


def wrapped_deg(angle_deg: float) -> float:
    """Return an angle modulo 360 in [-180, 180) deg."""
    return (angle_deg + 180.0) % _TURN_DEG - 180.0


def distance_deg(a_deg: float, b_deg: float) -> float:
    """Return the angle between two directions [deg], in [0, 180]."""
    return abs(wrapped_deg(a_deg - b_deg))


def require_finite(angle_deg: float) -> float:
    """Return the angle unchanged if it is a finite number, else raise LimitError."""
    if not math.isfinite(angle_deg):
        raise LimitError(f"angle {angle_deg} deg: must be a finite number")
    return angle_deg


def route_deg(from_deg: float, angle_deg: float, *, way: Way, near_deg: float) -> float:
    """Return the turn from one angle to another [deg]."""
    short_deg = wrapped_deg(angle_deg - from_deg)
    if abs(short_deg) <= near_deg or way == "short":
        return short_deg
    if way == "forward":
        return short_deg if short_deg > 0.0 else short_deg + _TURN_DEG
    return short_deg if short_deg < 0.0 else short_deg - _TURN_DEG


def target_within_deg(
    from_deg: float, angle_deg: float, *, way: Way, near_deg: float, lowest_deg: float, highest_deg: float
) -> float:
    """Return the target on a scale that continues through full turns, within its limits [deg]."""
    target_deg = from_deg + route_deg(from_deg, angle_deg, way=way, near_deg=near_deg)
    if lowest_deg <= target_deg <= highest_deg:
        return target_deg
    turns = math.ceil((lowest_deg - target_deg) / _TURN_DEG) if target_deg < lowest_deg else 0
    turns = math.floor((highest_deg - target_deg) / _TURN_DEG) if target_deg > highest_deg else turns
    if way == "short" and lowest_deg <= target_deg + turns * _TURN_DEG <= highest_deg:
        return target_deg + turns * _TURN_DEG
    raise LimitError(
        f"angle {angle_deg:g} deg ({way} way) is outside the stage's limits, {lowest_deg:g} to {highest_deg:g} deg"
    )
