"""A simulated rotation stage: drive, language and line in one, safe to use from several threads.

It answers on a pseudo-terminal, where any program can talk to it, or on a line within the process, for long sessions in
simulated time.
"""

import os
import select
import tempfile
import threading
import tty
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Protocol

import numpy as np

from drivers.errors import NotConnectedError
from sim_devices.clock import Clock, SimClock
from sim_devices.faults import LineNoise
from sim_devices.stages.drive import Drive, SerialDevice
from sim_devices.stages.options import LineOptions, MotionOptions

_LONGEST_NAP_S = 0.5
_PLUG_NAP_S = 0.02
_CHUNK_BYTES = 4096


@contextmanager
def serve_on_pty(device: SerialDevice, *, clock: SimClock, link: Path | None = None) -> Iterator[str]:
    """Serve a device on a pseudo-terminal, whose path it gives, until the context is left.

    Parameters
    ----------
    device : SerialDevice
        What is at the other end.
    clock : SimClock
        The one that the device lives in.
    link : Path or None
        Symbolic link to make, which always leads to the terminal; None makes one in a temporary folder.

    Raises
    ------
    FileExistsError
        There is something at the link's place already.

    Notes
    -----
    Leaving the context is to the host as if the cable were pulled; so is a device that is not plugged in for a while:
    the link then leads nowhere, and afterwards to another terminal. A pseudo-terminal has no modem lines.
    """
    with tempfile.TemporaryDirectory(prefix="rigctl-") as folder:
        server = _PtyServer(device, clock, Path(folder) / "port" if link is None else link)
        server.thread.start()
        try:
            yield str(server.link)
        finally:
            server.stop()


class _Terminal:
    """A pseudo-terminal and the link that leads to it."""

    def __init__(self, link: Path) -> None:
        self.host, self._held_open = os.openpty()  # without our own hold, each leaving host would end the terminal
        tty.setraw(self._held_open)
        os.set_blocking(self.host, False)
        self._link = link
        try:
            link.symlink_to(os.ttyname(self._held_open))
        except OSError:
            self._close_files()
            raise

    def close(self) -> None:
        self._link.unlink(missing_ok=True)
        self._close_files()

    def _close_files(self) -> None:
        os.close(self.host)
        os.close(self._held_open)


class _PtyServer:
    """The thread that carries bytes between a pseudo-terminal and a device."""

    def __init__(self, device: SerialDevice, clock: SimClock, link: Path) -> None:
        self._device = device
        self._clock = clock
        self._error: Exception | None = None
        self.link = link
        self._terminal: _Terminal | None = _Terminal(link)
        self._stop_reads, self._stop_writes = os.pipe()
        self.thread = threading.Thread(target=self._serve, name=f"simulated device on {link}", daemon=True)

    def stop(self) -> None:
        """End the thread and the terminal; raise what went wrong in the device."""
        os.write(self._stop_writes, b"x")
        self.thread.join()
        self._unplug()
        for descriptor in (self._stop_reads, self._stop_writes):
            os.close(descriptor)
        if self._error is not None:
            raise self._error

    def _serve(self) -> None:
        try:
            while self._carry_some():
                pass
        except Exception as error:
            self._error = error  # a thread has no caller; `stop` raises it

    def _carry_some(self) -> bool:
        """Carry what there is to carry, or wait for it; return False once the server is to stop."""
        self._plug_in_or_out()
        sources = [self._stop_reads] if self._terminal is None else [self._stop_reads, self._terminal.host]
        readable, _, _ = select.select(sources, [], [], self._nap_s())
        if self._stop_reads in readable:
            return False
        if self._terminal is None:
            return True
        if self._terminal.host in readable:
            self._device.receive(os.read(self._terminal.host, _CHUNK_BYTES))
        if self._device.is_plugged_in() and (data := self._device.transmit()):
            self._send(self._terminal, data)
        return True

    def _plug_in_or_out(self) -> None:
        if not self._device.is_plugged_in():
            self._unplug()
        elif self._terminal is None:
            self._terminal = _Terminal(self.link)

    def _unplug(self) -> None:
        if self._terminal is not None:
            self._terminal.close()
            self._terminal = None

    def _send(self, terminal: _Terminal, data: bytes) -> None:
        with suppress(BlockingIOError):  # a host that never reads loses bytes, as on a true line
            os.write(terminal.host, data)

    def _nap_s(self) -> float:
        if self._terminal is None:
            return _PLUG_NAP_S
        event_s = self._device.next_event_s()
        return _LONGEST_NAP_S if event_s is None else min(_LONGEST_NAP_S, self._clock.wall_s_until(event_s))


class InProcessPort:
    """A driver's end of the line without an operating system between: waiting moves the clock on."""

    def __init__(self, device: SerialDevice, *, clock: Clock) -> None:
        self._device = device
        self._clock = clock
        self._open = True
        self._gone = False

    @property
    def name(self) -> str:
        """Name of this port in messages."""
        return "simulated line"

    def read_some(self, *, timeout_s: float) -> bytes:
        """Return what has come in, waiting at most this long [s] for it; empty when nothing came."""
        self._require_open()
        deadline_s = self._clock.now_s() + timeout_s
        while True:
            self._require_plugged_in()
            data = self._device.transmit()
            event_s = self._device.next_event_s()
            if data or event_s is None or event_s > deadline_s:
                break
            self._clock.wait_until(event_s)
        if not data:
            self._clock.wait_until(deadline_s)
        return data

    def write(self, data: bytes) -> None:
        """Send all of it."""
        self._require_open()
        self._require_plugged_in()
        self._device.receive(data)

    def close(self) -> None:
        """Close this end. May be called twice."""
        self._open = False

    def _require_open(self) -> None:
        if not self._open:
            raise NotConnectedError(f"{self.name}: this connection was closed; open it again")

    def _require_plugged_in(self) -> None:
        self._gone = self._gone or not self._device.is_plugged_in()
        if self._gone:  # a port that comes back is another port
            raise NotConnectedError(f"{self.name}: the port has gone away. Check the cable, then open it again")


_BITS_PER_BYTE = 10  # start bit, eight data bits, stop bit
_PIECE_BYTES = 2
_PIECE_GAP_S = 0.002
_LATE_EVERY = 3


class Line:
    """A serial line that keeps the order of what is sent."""

    def __init__(
        self,
        *,
        baud: int | None,
        in_pieces: bool,
        late_s: float,
        noise: LineNoise,
        generator: np.random.Generator,
    ) -> None:
        self._byte_s = 0.0 if baud is None else _BITS_PER_BYTE / baud
        self._in_pieces = in_pieces
        self._late_s = late_s
        self._noise = noise
        self._generator = generator
        self._sent = 0
        self._free_s = 0.0
        self._queue: deque[tuple[float, bytes]] = deque()

    def send(self, time_s: float, reply: bytes) -> None:
        """Put one reply on its way at a time [s]."""
        self._sent += 1
        delay_s = self._late_s if self._sent % _LATE_EVERY == 0 else 0.0
        self._free_s = max(self._free_s, time_s + delay_s)
        for piece in self._cut(self._noise.corrupt(reply, self._generator)):
            self._free_s += len(piece) * self._byte_s
            self._queue.append((self._free_s, piece))
            self._free_s += _PIECE_GAP_S if self._in_pieces else 0.0

    def arrived(self, time_s: float) -> bytes:
        """Return what has arrived by a time [s] and was not returned before."""
        data = b""
        while self._queue and self._queue[0][0] <= time_s:
            data += self._queue.popleft()[1]
        return data

    def next_arrival_s(self) -> float | None:
        """Return when the next byte arrives [s], or None when nothing is on its way."""
        return self._queue[0][0] if self._queue else None

    def _cut(self, data: bytes) -> list[bytes]:
        size = 1 if self._byte_s else _PIECE_BYTES if self._in_pieces else len(data)
        return [data[start : start + size] for start in range(0, len(data), max(1, size))]


Reply = tuple[float, bytes]
"""Time of sending [s], and bytes."""


class Language(Protocol):
    """A stage's side of the conversation. The time is an argument, and never goes back."""

    @property
    def heard(self) -> int:
        """Number of commands that have come in whole."""

    def receive(self, time_s: float, data: bytes) -> list[Reply]:
        """Return the replies up to a time [s] at which these bytes arrive."""

    def advance(self, time_s: float) -> list[Reply]:
        """Return the replies up to a time [s]."""

    def next_event_s(self) -> float | None:
        """Return when the stage does something unasked, or None."""


class Options(Protocol):
    """Options of every family."""

    @property
    def motion(self) -> MotionOptions:
        """Motion, and what goes wrong with it."""

    @property
    def line(self) -> LineOptions:
        """Line, and what happens to its bytes."""

    @property
    def seed(self) -> int:
        """Of all that is random."""


class SimulatedStage:
    """The stage itself. Serve it on a pseudo-terminal, or in this process, and look at its true angle.

    Parameters
    ----------
    language : Language
        What it says.
    drive : Drive
        What it turns.
    line : LineOptions
        What happens to the bytes.
    baud : int
        Bits per second of the line, where its bytes are paced.
    clock : Clock
        The time that it lives in.
    line_generator, host_generator : numpy.random.Generator
        Where the damage to what it sends, and to what it is sent, is drawn from.
    """

    def __init__(
        self,
        language: Language,
        drive: Drive,
        *,
        line: LineOptions,
        baud: int,
        clock: Clock,
        line_generator: np.random.Generator,
        host_generator: np.random.Generator,
    ) -> None:
        self._language = language
        self._drive = drive
        self._options = line
        self._clock = clock
        self._host_generator = host_generator
        self._lock = threading.Lock()
        self._vanished_s: float | None = None
        self._noise = LineNoise(drop=line.drop, double=line.double, flip=line.flip)
        self._line = Line(
            baud=baud if line.pace else None,
            in_pieces=line.pieces,
            late_s=line.late_s,
            noise=self._noise,
            generator=line_generator,
        )

    def true_angle_deg(self) -> float:
        """Return the angle at which the ring now stands in its housing [deg], in [0, 360)."""
        with self._lock:
            return self._live() % 360.0 % 360.0  # a tiny negative angle makes 360.0 the first time

    def commands_heard(self) -> int:
        """Return how many commands have come in whole."""
        with self._lock:
            return self._language.heard

    def receive(self, data: bytes) -> None:
        """Take in what the host has sent."""
        with self._lock:
            arriving = self._noise.corrupt(data, self._host_generator)
            self._send(self._language.receive(self._clock.now_s(), arriving))

    def transmit(self) -> bytes:
        """Return what has reached the host by now and was not returned before."""
        with self._lock:
            self._live()
            return self._line.arrived(self._clock.now_s())

    def next_event_s(self) -> float | None:
        """Return when there will be something new to transmit [s], or None while nothing is under way."""
        with self._lock:
            times = (self._line.next_arrival_s(), self._language.next_event_s())
            return min((time_s for time_s in times if time_s is not None), default=None)

    def is_plugged_in(self) -> bool:
        """Return whether the host sees a port: not for a while from the command on at which it is to vanish."""
        with self._lock:
            if self._options.vanish is None or self._language.heard < self._options.vanish:
                return True
            if self._vanished_s is None:
                self._vanished_s = self._clock.now_s()
            return self._clock.now_s() >= self._vanished_s + self._options.back_s

    def _live(self) -> float:
        """Let the stage do what it does until now; return its angle [deg], counted on through full turns."""
        now_s = self._clock.now_s()
        self._send(self._language.advance(now_s))
        return self._drive.ring.angle_deg(now_s)

    def _send(self, replies: list[Reply]) -> None:
        for time_s, reply in replies:
            self._line.send(time_s, reply)


def assemble(
    options: Options, speak: Callable[[Drive], Language], *, counts_per_turn: float, baud: int, clock: Clock
) -> SimulatedStage:
    """Return a stage at its power-up, put together from a drive and its language."""
    drive_generator, line_generator, host_generator = np.random.default_rng(options.seed).spawn(3)
    drive = Drive(options.motion, counts_per_turn=counts_per_turn, generator=drive_generator)
    return SimulatedStage(
        speak(drive),
        drive,
        line=options.line,
        baud=baud,
        clock=clock,
        line_generator=line_generator,
        host_generator=host_generator,
    )
