"""Serial ports: a list of them, names that survive a restart, and a stream of bytes."""

import errno
import re
import termios
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn, Protocol

import serial
from serial.tools import list_ports

from drivers.errors import DeviceTimeoutError, NotConnectedError

_BY_ID = Path("/dev/serial/by-id")
_USB = "usb:"
_NUMBERED = re.compile(r"/dev/tty(USB|ACM)[0-9]+")


@dataclass(frozen=True, kw_only=True)
class PortInfo:
    """A serial port.

    Attributes
    ----------
    device : str
        Its device file, such as ``/dev/ttyUSB0``; the number depends on the order of plugging in.
    lasting_name : str
        A name that survives a restart: its link in ``/dev/serial/by-id``, or else its device file.
    usb_id : (int, int) or None
        Vendor and product, for a port on USB.
    usb_serial_number : str or None
        Of the adapter, not of the device.
    """

    device: str
    lasting_name: str
    usb_id: tuple[int, int] | None
    usb_serial_number: str | None


def serial_ports(*, by_id: Path = _BY_ID) -> list[PortInfo]:
    """Return the serial ports of this computer, sorted by device file."""
    return [
        PortInfo(
            device=found.device,
            lasting_name=_link_to(found.device, by_id) or found.device,
            usb_id=None if found.vid is None or found.pid is None else (found.vid, found.pid),
            usb_serial_number=found.serial_number,
        )
        for found in sorted(list_ports.comports())
    ]


def resolve_port(name: str, *, warn: Callable[[str], None], by_id: Path = _BY_ID) -> str:
    """Return the path of a port that a person named.

    Parameters
    ----------
    name : str
        A path, or ``usb:`` and the serial number of the USB adapter.
    warn : callable
        Called if another device may have this name after a restart.
    by_id : Path
        Folder of the lasting names.

    Raises
    ------
    NotConnectedError
        No adapter, or more than one, has this serial number.
    """
    if name.startswith(_USB):
        return _port_of_adapter(name.removeprefix(_USB), by_id=by_id)
    if _NUMBERED.fullmatch(name):
        better = _link_to(name, by_id)
        advice = f"use {better}" if better else "`ls -l /dev/serial/by-id` shows lasting names"
        warn(f"port {name}: after a restart another device may have this name; {advice}")
    return name


def _port_of_adapter(serial_number: str, *, by_id: Path) -> str:
    ports = serial_ports(by_id=by_id)
    found = [port.device for port in ports if port.usb_serial_number == serial_number]
    if len(found) != 1:
        known = ", ".join(port.usb_serial_number for port in ports if port.usb_serial_number) or "none"
        raise NotConnectedError(
            f"{_USB}{serial_number}: {len(found)} ports have this USB serial number. Plugged in are: {known}"
        )
    return found[0]


def _link_to(device: str, by_id: Path) -> str | None:
    links = sorted(by_id.iterdir()) if by_id.is_dir() else []
    return next((str(link) for link in links if link.resolve() == Path(device).resolve()), None)


_WRITE_TIMEOUT_S = 1.0
UDEV_RULE = """\
SUBSYSTEM=="tty", ATTRS{idVendor}=="0403|2939", GROUP="dialout", MODE="0660", TAG+="uaccess"
ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", ATTR{latency_timer}="1"
"""
"""Lets local users and the group dialout use the ports of the supported stages, without long waits."""

_NO_MODEM_LINES = (errno.ENOTTY, errno.EINVAL)


class Heard(Protocol):
    """Listener to the bytes of a port in both directions; empty bytes mean that the device has gone."""

    def __call__(self, data: bytes, *, port: str, from_host: bool) -> None:
        """Receive some bytes."""


_LISTENERS: list[Heard] = []


@contextmanager
def heard_by(listener: Heard) -> Iterator[None]:
    """Send every byte of ports opened within the context to a listener."""
    _LISTENERS.append(listener)
    try:
        yield
    finally:
        _LISTENERS.remove(listener)


class BytePort(Protocol):
    """A link for device drivers. Waiting uses the link's own clock."""

    @property
    def name(self) -> str:
        """The name that messages to people use."""

    def read_some(self, *, timeout_s: float) -> bytes:
        """Return the received bytes, waiting at most this long [s] for the first; empty if none came."""

    def write(self, data: bytes) -> None:
        """Send all bytes."""

    def close(self) -> None:
        """Release the link. May be called twice."""


class SerialPort:
    """A serial port or pseudo-terminal, locked for this program."""

    def __init__(self, port: serial.Serial, listeners: Sequence[Heard] = ()) -> None:
        self._port, self._listeners = port, tuple(listeners)

    @property
    def name(self) -> str:
        """The path that was opened."""
        return str(self._port.port)

    def read_some(self, *, timeout_s: float) -> bytes:
        """Return the received bytes, waiting at most this long [s] for the first; empty if none came."""
        try:
            self._port.timeout = timeout_s
            first = self._port.read(1)
            came = first + self._port.read(self._port.in_waiting) if first else b""
        except (OSError, termios.error) as error:
            self._gone(error)
        if came:
            self._tell(came, from_host=False)
        return came

    def write(self, data: bytes) -> None:
        """Send all bytes."""
        self._tell(data, from_host=True)
        try:
            self._port.write(data)
        except serial.SerialTimeoutException as error:
            message = f"{self.name}: the port did not accept {data!r} within {_WRITE_TIMEOUT_S:g} s"
            raise DeviceTimeoutError(message) from error
        except (OSError, termios.error) as error:
            self._gone(error)

    def request_to_send(self) -> None:
        """Set the modem line RTS, which some controllers need; a pseudo-terminal has none."""
        try:
            self._port.rts = True
        except OSError as error:
            if error.errno not in _NO_MODEM_LINES:
                self._gone(error)

    def close(self) -> None:
        """Release the port. May be called twice."""
        self._port.close()

    def _tell(self, data: bytes, *, from_host: bool) -> None:
        for listener in self._listeners:
            listener(data, port=self.name, from_host=from_host)

    def _gone(self, error: Exception) -> NoReturn:
        self._tell(b"", from_host=False)
        if not self._port.is_open:
            raise NotConnectedError(f"{self.name}: this connection was closed; open it again") from error
        raise NotConnectedError(
            f"{self.name}: the port was disconnected ({error}). Check the cable and the supply, then open it again"
        ) from error


def open_serial_port(path: str, *, baud: int) -> SerialPort:
    """Return the port at ``path``, opened for this program alone: 8 data bits, no parity, 1 stop bit."""
    try:
        return SerialPort(serial.Serial(path, baud, exclusive=True, write_timeout=_WRITE_TIMEOUT_S), _LISTENERS)
    except (OSError, termios.error, ValueError) as error:
        raise NotConnectedError(_why_not_opened(path, error)) from error


def _why_not_opened(path: str, error: Exception) -> str:
    number = getattr(error, "errno", None)
    if number == errno.ENOENT:
        return f"{path}: there is no such port. `rigctl devices` lists the connected ones"
    if number in (errno.EACCES, errno.EPERM):
        return (
            f"{path}: no permission to open it. Serial ports belong to the group dialout: "
            "`sudo usermod -aG dialout $USER`, then log in again. Or put these lines into "
            f"/etc/udev/rules.d/70-rigctl.rules, `sudo udevadm control --reload`, and plug it in anew:\n{UDEV_RULE}"
        )
    if number in (errno.EAGAIN, errno.EBUSY):
        return f"{path}: another program is using it. `fuser -v {path}` names that program"
    if Path(path).is_file() or Path(path).is_dir() or number == errno.ENOTTY or "Inappropriate ioctl" in str(error):
        return f"{path}: is not a serial port; `rigctl devices` lists the connected ones"
    return f"{path}: cannot be opened as a serial port ({error})"
