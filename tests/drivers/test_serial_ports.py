from pathlib import Path

import pytest
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from drivers.errors import NotConnectedError
from drivers.serial_port import resolve_port, serial_ports


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
