"""A simulated rotation stage: drive, language and line in one, safe to use from several threads.

It answers on a pseudo-terminal, for any program, or on a line within the process, for long sessions in simulated time.
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
from sim_devices.stages.drive import Drive
from sim_devices.stages.options import StageOptions

_LONGEST_NAP_S = 0.5
_PLUG_NAP_S = 0.02
_CHUNK_BYTES = 4096
_BITS_PER_BYTE = 10  # start bit, eight data bits, stop bit
_PIECE_BYTES = 2
_PIECE_GAP_S = 0.002
_LATE_EVERY = 3

Reply = tuple[float, bytes]
"""Time of sending [s], and bytes."""


class SerialDevice(Protocol):
    """A simulated device on a serial line. Safe to use from several threads."""

    def receive(self, data: bytes) -> None:
        """Take in what the host has sent."""

    def transmit(self) -> bytes:
        """Return the bytes that have reached the host since the last call."""

    def next_event_s(self) -> float | None:
        """Return the time of the next transmission [s], or None if nothing is pending."""

    def is_plugged_in(self) -> bool:
        """Return whether the host sees a port at all."""


class Language:
    """A stage's side of the protocol; a family defines the commands and their effects.

    Times are arguments and never decrease. The stage has at most one appointment for a later action.
    """

    def __init__(self, options: StageOptions, drive: Drive) -> None:
        self._options, self._drive = options, drive
        self._now_s = 0.0
        self.heard = 0  #: Number of complete commands.
        self._appointment: tuple[float, Callable[[], None]] | None = None
        self._replies: list[Reply] = []

    def receive(self, time_s: float, data: bytes) -> list[Reply]:
        """Return the replies until a time [s] at which these bytes arrive."""
        self._live_until(time_s)
        self._hear(data)
        return self._take_replies()

    def advance(self, time_s: float) -> list[Reply]:
        """Return the replies up to a time [s]."""
        self._live_until(time_s)
        return self._take_replies()

    def next_event_s(self) -> float | None:
        """Return the time of the next unasked action, or None."""
        times_s = (self._appointment[0] if self._appointment else None, self._next_routine_s())
        return min((time_s for time_s in times_s if time_s is not None), default=None)

    def _hear(self, data: bytes) -> None:
        """Obey the commands that these bytes complete."""
        raise NotImplementedError

    def _next_routine_s(self) -> float | None:
        """Return the time of the next action other than the appointment."""
        return None

    def _do_routine(self) -> None:
        """Do what is to be done beside the appointment."""

    def _live_until(self, time_s: float) -> None:
        while (event_s := self.next_event_s()) is not None and event_s <= time_s:
            self._now_s = max(self._now_s, event_s)
            if self._appointment and self._appointment[0] <= self._now_s:
                (_, keep), self._appointment = self._appointment, None
                keep()
            self._do_routine()
        self._now_s = max(self._now_s, time_s)

    def _say(self, message: bytes) -> None:
        if self._options.silent is None or self.heard < self._options.silent:
            self._replies.append((self._now_s, message))

    def _take_replies(self) -> list[Reply]:
        replies, self._replies = self._replies, []
        return replies


class SimulatedStage:
    """The stage, served on a pseudo-terminal or in this process, with its true angle.

    Parameters
    ----------
    options : StageOptions
        Its properties.
    make_language : callable
        Makes its language from its options and drive.
    baud : int
        Bits per second of a paced line.
    clock : Clock
        Its clock.
    """

    def __init__(
        self,
        options: StageOptions,
        make_language: Callable[[StageOptions, Drive], Language],
        *,
        baud: int,
        clock: Clock,
    ) -> None:
        drive_generator, line_generator, self._host_generator = np.random.default_rng(options.seed).spawn(3)
        self._options, self._clock = options, clock
        self._drive = Drive(options, generator=drive_generator)
        self._language = make_language(options, self._drive)
        self._line = Line(options, baud=baud, generator=line_generator)
        self._lock = threading.Lock()
        self._vanished_s: float | None = None

    def true_angle_deg(self) -> float:
        """Return the present angle of the ring in its housing [deg], in [0, 360)."""
        with self._lock:
            return self._live() % 360.0 % 360.0  # the first modulo turns a tiny negative angle into 360.0

    def commands_heard(self) -> int:
        """Return how many commands have come in whole."""
        with self._lock:
            return self._language.heard

    def receive(self, data: bytes) -> None:
        """Take in what the host has sent."""
        with self._lock:
            arriving = damaged(data, self._options, self._host_generator)
            self._send(self._language.receive(self._clock.now_s(), arriving))

    def transmit(self) -> bytes:
        """Return the bytes that have reached the host since the last call."""
        with self._lock:
            self._live()
            return self._line.arrived(self._clock.now_s())

    def next_event_s(self) -> float | None:
        """Return the time of the next transmission [s], or None if nothing is pending."""
        with self._lock:
            times = (self._line.next_arrival_s(), self._language.next_event_s())
            return min((time_s for time_s in times if time_s is not None), default=None)

    def is_plugged_in(self) -> bool:
        """Return whether the port is present: it is absent for a time after a given command."""
        with self._lock:
            if self._options.vanish is None or self._language.heard < self._options.vanish:
                return True
            if self._vanished_s is None:
                self._vanished_s = self._clock.now_s()
            return self._clock.now_s() >= self._vanished_s + self._options.back_s

    def _live(self) -> float:
        """Advance the stage to the present; return its angle through full turns [deg]."""
        now_s = self._clock.now_s()
        self._send(self._language.advance(now_s))
        return self._drive.ring.angle_deg(now_s)

    def _send(self, replies: list[Reply]) -> None:
        for time_s, reply in replies:
            self._line.send(time_s, reply)


class Line:
    """The line from a stage to its host, which keeps the order of bytes."""

    def __init__(self, options: StageOptions, *, baud: int, generator: np.random.Generator) -> None:
        self._options, self._generator = options, generator
        self._byte_s = _BITS_PER_BYTE / baud if options.pace else 0.0
        self._sent = 0
        self._free_s = 0.0
        self._queue: deque[tuple[float, bytes]] = deque()

    def send(self, time_s: float, reply: bytes) -> None:
        """Put one reply on its way at a time [s]."""
        self._sent += 1
        delay_s = self._options.late_s if self._sent % _LATE_EVERY == 0 else 0.0
        self._free_s = max(self._free_s, time_s + delay_s)
        for piece in self._cut(damaged(reply, self._options, self._generator)):
            self._free_s += len(piece) * self._byte_s
            self._queue.append((self._free_s, piece))
            self._free_s += _PIECE_GAP_S if self._options.pieces else 0.0

    def arrived(self, time_s: float) -> bytes:
        """Return the bytes that have arrived by a time [s] since the last call."""
        data = b""
        while self._queue and self._queue[0][0] <= time_s:
            data += self._queue.popleft()[1]
        return data

    def next_arrival_s(self) -> float | None:
        """Return the arrival time of the next byte [s], or None."""
        return self._queue[0][0] if self._queue else None

    def _cut(self, data: bytes) -> list[bytes]:
        size = 1 if self._byte_s else _PIECE_BYTES if self._options.pieces else len(data)
        return [data[start : start + size] for start in range(0, len(data), max(1, size))]


def damaged(data: bytes, options: StageOptions, generator: np.random.Generator) -> bytes:
    """Return bytes after a bad line: some lost, doubled or changed."""
    rates = (options.drop, options.double, options.flip)
    if not any(rates):
        return data
    arrived = b""
    for byte in data:
        is_lost, is_doubled, is_changed = generator.random(3) < rates
        changed = byte ^ (1 << int(generator.integers(8))) if is_changed else byte
        arrived += bytes([changed]) * (0 if is_lost else 2 if is_doubled else 1)
    return arrived


@contextmanager
def serve_on_pty(device: SerialDevice, *, clock: SimClock, link: Path | None = None) -> Iterator[str]:
    """Serve a device on a pseudo-terminal and yield its path, until the context is left.

    Parameters
    ----------
    device : SerialDevice
        The device at the other end.
    clock : SimClock
        The device's clock.
    link : Path or None
        Symbolic link to the terminal; None makes one in a temporary folder.

    Raises
    ------
    FileExistsError
        The path of the link exists.

    Notes
    -----
    Leaving the context looks to the host like a pulled cable. So does a temporarily absent device: its link is then
    broken, and later leads to another terminal. A pseudo-terminal has no modem lines.
    """
    with tempfile.TemporaryDirectory(prefix="rigctl-") as folder:
        server = _PtyServer(device, clock, Path(folder) / "port" if link is None else link)
        server.thread.start()
        try:
            yield str(server.link)
        finally:
            server.stop()


class _Terminal:
    """A pseudo-terminal and the link to it."""

    def __init__(self, link: Path) -> None:
        self.host, self._held_open = os.openpty()  # keeps the terminal open when a host leaves
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
    """Thread that transfers bytes between a pseudo-terminal and a device."""

    def __init__(self, device: SerialDevice, clock: SimClock, link: Path) -> None:
        self._device = device
        self._clock = clock
        self._error: Exception | None = None
        self.link = link
        self._terminal: _Terminal | None = _Terminal(link)
        self._stop_reads, self._stop_writes = os.pipe()
        self.thread = threading.Thread(target=self._serve, name=f"simulated device on {link}", daemon=True)

    def stop(self) -> None:
        """End the thread and the terminal; raise exceptions of the device."""
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
        """Transfer bytes or wait for them; return False once the server should stop."""
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
        with suppress(BlockingIOError):  # a host that never reads loses bytes, as on a real line
            os.write(terminal.host, data)

    def _nap_s(self) -> float:
        if self._terminal is None:
            return _PLUG_NAP_S
        event_s = self._device.next_event_s()
        return _LONGEST_NAP_S if event_s is None else min(_LONGEST_NAP_S, self._clock.wall_s_until(event_s))


class InProcessPort:
    """A driver's end of the line without the operating system; waiting advances the clock."""

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
        """Return the received bytes, waiting at most this long [s]; empty if none came."""
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
        if self._gone:  # a port that comes back is a new port
            raise NotConnectedError(f"{self.name}: the port was disconnected. Check the cable, then open it again")
