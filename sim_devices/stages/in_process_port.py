"""A line to a simulated device without an operating system between: for long sessions in simulated time."""

from drivers.errors import NotConnectedError
from sim_devices.clock import Clock
from sim_devices.stages.serial_device import SerialDevice


class InProcessPort:
    """A driver's end of the line without an operating system between: waiting moves the clock on.

    Parameters
    ----------
    device : SerialDevice
        What is at the other end.
    clock : Clock
        The one that the device lives in.
    """

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
