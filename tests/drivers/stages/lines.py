"""Ends of a line for tests: a port that follows a script, streams that were cut and damaged, and a simulated stage."""

import itertools
from collections.abc import Callable
from importlib.metadata import entry_points
from typing import Any

from hypothesis import strategies as st

from drivers.errors import ProtocolError
from drivers.interfaces import RotationStage
from sim_devices.clock import ManualClock
from sim_devices.stages.catalogue import SCHEMES, make_stage, parse_stage_address
from sim_devices.stages.stage import InProcessPort

FAMILIES = tuple(scheme.removeprefix("sim:") for scheme in SCHEMES)
OPEN: dict[str, Callable[..., Any]] = {name: entry_points(group="rigctl.stages")[name].load() for name in FAMILIES}
Script = list[tuple[bytes, list[tuple[float, bytes]]]]
"""What must be written next, and what then comes back: (delay [s], bytes)."""


class ScriptedPort:
    """Answers the commands that it is told of, in a time that only waiting moves on."""

    name = "scripted port"

    def __init__(self, script: Script) -> None:
        self._script = list(script)
        self._coming: list[tuple[float, bytes]] = []
        self._time_s = 0.0

    @property
    def finished(self) -> bool:
        return not self._script

    def now_s(self) -> float:
        return self._time_s

    def sleep(self, duration_s: float) -> None:
        self._time_s += duration_s

    def write(self, data: bytes) -> None:
        expected, answers = self._script.pop(0)
        assert data == expected
        self._coming += [(self._time_s + delay_s, answer) for delay_s, answer in answers]

    def read_some(self, *, timeout_s: float) -> bytes:
        deadline_s = self._time_s + timeout_s
        if self._coming and self._coming[0][0] <= deadline_s:
            due_s, data = self._coming.pop(0)
            self._time_s = max(self._time_s, due_s)
            return data
        self._time_s = deadline_s
        return b""

    def close(self) -> None:
        pass


class Bench:
    """A driver and a simulated stage in one simulated time."""

    def __init__(self, address: str) -> None:
        self.clock = ManualClock()
        self.machine = make_stage(parse_stage_address(f"sim:{address}"), clock=self.clock)
        self._connect = OPEN[address.partition("?")[0]]

    def port(self) -> InProcessPort:
        return InProcessPort(self.machine, clock=self.clock)

    def connect(self, **options: object) -> RotationStage:
        stage: RotationStage = self._connect(self.port(), now_s=self.clock.now_s, sleep=self.clock.sleep, **options)
        return stage

    def homed(self, **options: object) -> RotationStage:
        stage = self.connect(**options)
        stage.home()
        return stage

    def off_deg(self, angle_deg: float) -> float:
        return abs((self.machine.true_angle_deg() - angle_deg + 180.0) % 360.0 - 180.0)


def read_all(parser: Any, pieces: list[bytes]) -> list[Any]:
    """Every message in the pieces, errors left out; any exception but ProtocolError escapes."""
    events: list[Any] = []
    for piece in pieces:
        try:
            parser.feed(piece)
        except ProtocolError:
            continue
        while True:
            try:
                event = parser.next_event()
            except ProtocolError:
                continue
            if event is None:
                break
            events.append(event)
    return events


def cut(data: bytes, at: list[int]) -> list[bytes]:
    edges = [0, *sorted({place % (len(data) + 1) for place in at}), len(data)]
    return [data[start:end] for start, end in itertools.pairwise(edges)]


@st.composite
def damaged(draw: st.DrawFn, sound: st.SearchStrategy[bytes]) -> bytes:
    """A sound stream with one to six bytes dropped, changed or inserted."""
    data = bytearray(draw(sound))
    for _ in range(draw(st.integers(1, 6))):
        place = draw(st.integers(0, max(0, len(data) - 1)))
        kind = draw(st.sampled_from(["drop", "flip", "insert"]))
        if kind == "insert":
            data.insert(place, draw(st.integers(0, 255)))
        elif data and kind == "drop":
            del data[place]
        elif data:
            data[place] ^= draw(st.integers(1, 255))
    return bytes(data)
