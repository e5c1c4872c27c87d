"""A simulated device on a pseudo-terminal, where any program can talk to it."""

import os
import select
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from sim_devices.clock import SimClock
from sim_devices.stages.serial_device import SerialDevice

_LONGEST_NAP_S = 0.5
_CHUNK_BYTES = 4096


@contextmanager
def serve_on_pty(device: SerialDevice, *, clock: SimClock) -> Iterator[str]:
    """Serve a device on a pseudo-terminal, whose path it gives, until the context is left.

    Parameters
    ----------
    device : SerialDevice
        What is at the other end.
    clock : SimClock
        The one that the device lives in.

    Notes
    -----
    Leaving the context is to the host as if the cable were pulled. A pseudo-terminal has no modem lines.
    """
    server = _PtyServer(device, clock)
    server.thread.start()
    try:
        yield server.path
    finally:
        server.stop()


class _PtyServer:
    """The thread that carries bytes between a pseudo-terminal and a device."""

    def __init__(self, device: SerialDevice, clock: SimClock) -> None:
        self._device = device
        self._clock = clock
        self._error: Exception | None = None
        self._host, self._held_open = os.openpty()  # without our own hold, each leaving host would end the terminal
        tty.setraw(self._held_open)
        os.set_blocking(self._host, False)
        self._stop_reads, self._stop_writes = os.pipe()
        self.path = os.ttyname(self._held_open)
        self.thread = threading.Thread(target=self._serve, name=f"simulated device on {self.path}", daemon=True)

    def stop(self) -> None:
        """End the thread and the terminal; raise what went wrong in the device."""
        os.write(self._stop_writes, b"x")
        self.thread.join()
        for descriptor in (self._host, self._held_open, self._stop_reads, self._stop_writes):
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
        readable, _, _ = select.select([self._host, self._stop_reads], [], [], self._nap_s())
        if self._stop_reads in readable:
            return False
        if self._host in readable:
            self._device.receive(os.read(self._host, _CHUNK_BYTES))
        if data := self._device.transmit():
            self._send(data)
        return True

    def _send(self, data: bytes) -> None:
        with suppress(BlockingIOError):  # a host that never reads loses bytes, as on a true line
            os.write(self._host, data)

    def _nap_s(self) -> float:
        event_s = self._device.next_event_s()
        return _LONGEST_NAP_S if event_s is None else min(_LONGEST_NAP_S, self._clock.wall_s_until(event_s))
