"""The verb devices finds cameras through whatever finders are installed."""

import json
from importlib.metadata import EntryPoint

import pytest

from drivers.errors import NotConnectedError
from drivers.interfaces import DeviceIdentity
from rigctl import cli
from rigctl.verbs import devices


def find_one():
    yield "mine:3", DeviceIdentity(model="Mine", serial_number="33", firmware="1.0")


def find_none():
    raise NotConnectedError("its library is not installed")


@pytest.fixture
def installed(monkeypatch):
    """A plug-in's finder and one that fails, and no serial port."""
    finders = [EntryPoint(name, f"{__name__}:{name}", "rigctl.camera_finders") for name in ("find_none", "find_one")]
    monkeypatch.setattr(devices, "entry_points", lambda group: finders if group == "rigctl.camera_finders" else [])
    monkeypatch.setattr("drivers.serial_port.serial_ports", list)


def test_a_plug_ins_camera_is_printed_as_the_rig_file_wants_it(installed, capsys):
    assert cli.main(["devices"]) == 0
    told = capsys.readouterr()
    assert (
        'Mine, serial number 33, firmware 1.0\n    [camera]\n    address = "mine:3"\n    serial_number = "33"'
        in told.out
    )
    assert "cameras (find_none) were not looked for: its library is not installed" in told.err


def test_cameras_are_in_the_json(installed, capsys):
    assert cli.main(["devices", "--json"]) == 0
    (camera,) = json.loads(capsys.readouterr().out)["cameras"]
    assert camera == {
        "address": "mine:3", "identity": {"model": "Mine", "serial_number": "33", "firmware": "1.0"},
    }  # fmt: skip


def test_probing_one_port_lists_no_cameras(installed, tmp_path, capsys):
    (tmp_path / "port").touch()
    assert cli.main(["devices", "--port", str(tmp_path / "port")]) == 0
    assert "camera" not in capsys.readouterr().out
