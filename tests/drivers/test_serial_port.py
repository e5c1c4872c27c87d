import errno
import os
import threading
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest
import serial
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from drivers.errors import DeviceTimeoutError, NotConnectedError
from drivers.serial_port import UDEV_RULE, open_serial_port, resolve_port, serial_ports


class Terminal:
    """A pseudo-terminal whose far end the test holds."""

    def __init__(self) -> None:
        self.far, self._near = os.openpty()
        tty.setraw(self._near)
        self.path = os.ttyname(self._near)
        self._open = True

    def pull(self) -> None:
        if self._open:
            # First: the timer of a test and the end of it may both pull.
            self._open = False
            os.close(self.far)
            os.close(self._near)


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    terminal = Terminal()
    yield terminal
    terminal.pull()


def test_carries_bytes_both_ways(terminal: Terminal) -> None:
    port = open_serial_port(terminal.path, baud=9600)
    port.write(b"0in")
    os.write(terminal.far, b"0GS00\r\n")
    received = b""
    while len(received) < 7:
        received += port.read_some(timeout_s=1.0)
    port.close()
    assert os.read(terminal.far, 10) == b"0in"
    assert received == b"0GS00\r\n"


def test_a_read_ends_at_its_deadline_with_nothing(terminal: Terminal) -> None:
    port = open_serial_port(terminal.path, baud=9600)
    assert port.read_some(timeout_s=0.0) == b""
    port.close()


def test_a_port_that_does_not_exist(tmp_path: Path) -> None:
    with pytest.raises(NotConnectedError, match="there is no such port"):
        open_serial_port(str(tmp_path / "ttyUSB0"), baud=9600)


def test_a_file_that_is_no_port() -> None:
    with pytest.raises(NotConnectedError, match="is not a serial port"):
        open_serial_port("/dev/null", baud=9600)


def test_a_port_that_is_in_use(terminal: Terminal) -> None:
    holder = open_serial_port(terminal.path, baud=9600)
    with pytest.raises(NotConnectedError, match="another program is using it"):
        open_serial_port(terminal.path, baud=9600)
    holder.close()


def test_a_port_without_permission(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*args: object, **kwargs: object) -> None:
        raise serial.SerialException(errno.EACCES, "Permission denied")

    monkeypatch.setattr(serial, "Serial", refuse)
    with pytest.raises(NotConnectedError, match="group dialout") as caught:
        open_serial_port("/dev/ttyUSB0", baud=9600)
    assert UDEV_RULE in str(caught.value)


def test_a_terminal_without_modem_lines_is_no_hindrance(terminal: Terminal) -> None:
    port = open_serial_port(terminal.path, baud=115200)
    port.request_to_send()
    port.write(b"0in")
    assert os.read(terminal.far, 10) == b"0in"
    port.close()


def test_reading_a_port_that_goes_away(terminal: Terminal) -> None:
    port = open_serial_port(terminal.path, baud=9600)
    threading.Timer(0.02, terminal.pull).start()
    with pytest.raises(NotConnectedError, match="disconnected"):
        port.read_some(timeout_s=20.0)
    port.close()


def test_writing_to_a_port_that_has_gone_away(terminal: Terminal) -> None:
    port = open_serial_port(terminal.path, baud=9600)
    terminal.pull()
    with pytest.raises(NotConnectedError, match="disconnected"):
        port.write(b"0in")
    port.close()


def test_a_port_that_takes_no_bytes(terminal: Terminal, monkeypatch: pytest.MonkeyPatch) -> None:
    def never_ready(*args: object) -> None:
        raise serial.SerialTimeoutException("Write timeout")

    port = open_serial_port(terminal.path, baud=9600)
    monkeypatch.setattr(serial.Serial, "write", never_ready)
    with pytest.raises(DeviceTimeoutError, match="did not accept b'0in'"):
        port.write(b"0in")
    port.close()


def test_a_closed_port_says_so(terminal: Terminal) -> None:
    port = open_serial_port(terminal.path, baud=9600)
    port.close()
    port.close()
    with pytest.raises(NotConnectedError, match="was closed"):
        port.read_some(timeout_s=0.0)
    with pytest.raises(NotConnectedError, match="was closed"):
        port.write(b"x")


def port(device: str, *, usb_serial_number: str | None = None) -> ListPortInfo:
    info = ListPortInfo(device)
    info.vid, info.pid, info.serial_number = 0x0403, 0x6015, usb_serial_number
    return info


@pytest.fixture
def by_id(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two adapters, one of them with a lasting name."""
    folder = tmp_path / "by-id"
    folder.mkdir()
    (folder / "usb-FTDI_FT230X_DK0AHAJZ-if00-port0").symlink_to("/dev/ttyUSB7")
    found = [port("/dev/ttyUSB7", usb_serial_number="DK0AHAJZ"), port("/dev/ttyUSB3", usb_serial_number="TWIN")]
    monkeypatch.setattr(list_ports, "comports", lambda: found)
    return folder


def test_ports_are_listed_with_the_name_that_lasts(by_id: Path) -> None:
    ports = serial_ports(by_id=by_id)
    assert [found.device for found in ports] == ["/dev/ttyUSB3", "/dev/ttyUSB7"]
    assert ports[1].lasting_name == str(by_id / "usb-FTDI_FT230X_DK0AHAJZ-if00-port0")
    assert ports[0].lasting_name == "/dev/ttyUSB3"
    assert ports[0].usb_id == (0x0403, 0x6015)


def test_a_port_is_found_by_the_serial_number_of_its_adapter(by_id: Path) -> None:
    assert resolve_port("usb:DK0AHAJZ", warn=pytest.fail, by_id=by_id) == "/dev/ttyUSB7"


def test_an_adapter_that_is_not_there_is_told_with_those_that_are(by_id: Path) -> None:
    with pytest.raises(NotConnectedError, match=r"usb:OTHER: 0 ports.*TWIN, DK0AHAJZ"):
        resolve_port("usb:OTHER", warn=pytest.fail, by_id=by_id)


def test_a_numbered_name_is_warned_about_with_the_better_one(by_id: Path) -> None:
    warnings: list[str] = []
    assert resolve_port("/dev/ttyUSB7", warn=warnings.append, by_id=by_id) == "/dev/ttyUSB7"
    assert str(by_id / "usb-FTDI_FT230X_DK0AHAJZ-if00-port0") in warnings[0]


@pytest.mark.parametrize("name", ["/dev/serial/by-id/usb-x", "/dev/ttyS0", "/tmp/stage"])
def test_other_names_are_taken_as_they_are(by_id: Path, name: str) -> None:
    assert resolve_port(name, warn=pytest.fail, by_id=by_id) == name
