"""The verbs devices, stage and sim as people call them."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest
import serial

from drivers.errors import NotConnectedError
from drivers.interfaces import DeviceIdentity
from rigctl import cli
from rigctl.rig.simulation import serve_stage
from rigctl.verbs import devices
from tests.rigctl.example_files import EXAMPLES


@contextmanager
def served(address: str, link: Path, *more: str) -> Iterator[subprocess.Popen[str]]:
    """`rigctl sim stage`, as a program of its own."""
    command = [sys.executable, "-m", "rigctl", "sim", "stage", address, "--link", str(link), *more]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as program:
        assert program.stderr is not None
        assert "answers on" in program.stderr.readline()
        try:
            yield program
        finally:
            program.terminate()


def test_a_served_stage_answers_any_program_until_it_is_stopped(tmp_path: Path) -> None:
    link, truth = tmp_path / "stage", tmp_path / "truth.csv"
    with served("sim:ellx?landing=0&start=0", link, "--truth", str(truth)) as program:
        with serial.Serial(str(link), 9600, timeout=60.0) as port:
            port.write(b"0ma00004600")
            assert port.read(13) == b"0PO00004600\r\n"
        deadline_s = time.monotonic() + 60.0
        while not truth.read_text().endswith(",45.000000\n"):
            assert time.monotonic() < deadline_s
            time.sleep(0.02)
        program.send_signal(signal.SIGTERM)
        assert program.wait(60.0) == 0
    assert not link.is_symlink()
    assert truth.read_text().startswith("time_s,angle_deg\n0.")


def test_devices_finds_a_served_stage_and_prints_its_lines(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    link = tmp_path / "stage"
    with serve_stage("sim:zaber?speed=20", link=link, truth=None):
        assert cli.main(["devices", "--probe", "--port", str(link)]) == 0
    text = capsys.readouterr().out
    assert "Zaber 50931, serial number 114821" in text
    assert f'    port = "{link}"\n    address = "1"\n    serial_number = "114821"' in text


def test_devices_without_probe_does_not_ask_a_port_of_unknown_kind(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "port").touch()
    assert cli.main(["devices", "--port", str(tmp_path / "port"), "--json"]) == 0
    (found,) = json.loads(capsys.readouterr().out)["ports"]
    assert found["answer"] is None
    assert "--probe" in found["remark"]
    assert cli.main(["devices", "--port", str(tmp_path / "none"), "--json"]) == 2


def test_the_file_of_a_characterisation_is_used_by_a_session(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text((EXAMPLES / "rig-sim.toml").read_text().replace("speed=20", "speed=50"))
    (tmp_path / "scene-panels.toml").write_text((EXAMPLES / "scene-panels.toml").read_text())
    out, plot = tmp_path / "stage.json", tmp_path / "stage.png"
    arguments = ["--out", str(out), "--plot", str(plot), "--repeats", "2", "--watch-s", "0.1"]
    assert cli.main(["calibrate", "stage", str(rig), str(EXAMPLES / "session.toml"), *arguments]) == 0
    text = capsys.readouterr().out
    assert "angle [deg]" in text
    assert "ELL14 11401326" in text
    assert json.loads(out.read_text())["is_settled"]
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_characterise_without_a_folder_for_its_file_touches_no_stage(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "nowhere" / "stage.json"
    assert cli.main(["calibrate", "stage", str(EXAMPLES / "rig-sim.toml"), "--out", str(out)]) == 2
    assert "there is no folder" in capsys.readouterr().err


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
    assert "cameras (find_none) were not searched: its library is not installed" in told.err


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
