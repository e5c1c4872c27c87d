"""What --anonymous leaves out of results."""

import json
import re

import numpy as np
import pytest

from rigctl import cli
from rigctl.console.anonymity import anonymous, told, told_content
from tests.rigctl.made_runs import at, make_run

_SECRETS = ("CAM-4711", "/dev/ttyUSB7", "gige:192.0.2.7", "43.0845", "77.6749", "rochester-roof")
_SITE = {"latitude_deg": 43.0845, "longitude_deg": -77.6749, "elevation_m": 168.0}
_SESSION = {
    "origin": "device",
    "stage": {"model": "ELL14", "serial_number": "11401326", "firmware": "18"},
    "camera": {"model": "GC780", "serial_number": "CAM-4711", "firmware": "1"},
    "rig": {"stage": {"port": "/dev/ttyUSB7"}, "camera": {"address": "gige:192.0.2.7"}, "site": _SITE},
}


@pytest.fixture
def run(tmp_path):
    counts = np.full((6, 8), 100) + np.arange(8)
    frames = [(at(angle, camera_serial="CAM-4711", exposure_s=0.01), counts + angle) for angle in (0, 45, 90, 135)]
    return make_run(tmp_path / "rochester-roof" / "noon", frames, session=_SESSION).path


def test_texts_lose_folders_serial_numbers_ports_and_site(run):
    with anonymous([run]):
        assert told(f"{run}: camera CAM-4711 at gige:192.0.2.7") == "noon: camera left out at left out"
        content = told_content({"report": "kept", "camera_serial": "CAM-4711", "site": _SITE})
        assert content == {"report": "kept", "camera_serial": None, "site": "left out"}
    assert told(str(run)) == str(run)


def test_results_of_a_command_hold_none_of_it(run, tmp_path, capsys):
    out = tmp_path / "out"
    assert cli.main(["stokes", str(run), "--out", str(out), "--json", "--anonymous"]) == 0
    assert cli.main(["status", str(run), "--page", str(out / "page.html"), "--anonymous"]) == 0
    page = re.sub(r'base64,[^"]*', "", (out / "page.html").read_text())
    told_by_them = page + (out / "stokes.json").read_text() + capsys.readouterr().out
    assert [secret for secret in _SECRETS if secret in told_by_them] == []
    assert json.loads((out / "stokes.json").read_text())
