"""A simulated device on a pseudo-terminal, where any program can talk to it."""

import os
import select
import tempfile
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from sim_devices.clock import SimClock
from sim_devices.stages.serial_device import SerialDevice

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
