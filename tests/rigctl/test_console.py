"""What leaves the program: progress, streams that break, JSON, anonymous results, failures."""

import io
import json
import os
import re
import subprocess
import sys
import threading
from math import inf, nan
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from rigctl import cli, console
from rigctl.cli import main
from rigctl.console import LastingStream, anonymized, anonymized_content, anonymous, failure_json, json_text, visible
from rigctl.errors import ConfigError
from rigctl.rig.rig import find_driver
from rigctl.rig.simulated_parts import require_known_camera
from tests.hard_cases.cases import HARD_CASES
from tests.rigctl.example_files import EXAMPLES, SMALL_SCENE
from tests.rigctl.made_runs import at, make_run


@pytest.fixture
def scene(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    # As if the air of a plain day were deep: truly deep air takes half a minute.
    monkeypatch.setattr(console, "_DEEP", 0.1)
    (tmp_path / "scene.toml").write_text(next(one.text for one in HARD_CASES if one.name == "plain: a material"))
    return str(tmp_path / "scene.toml")


@pytest.mark.parametrize(
    "words",
    [
        ("predict",),
        ("predict", "--tolerance", "0.1"),
        ("sweep", "sensor.f_number=2:2.5:2"),
        ("sky",),
    ],
    ids=" ".join,
)
def test_deep_air_is_not_solved_in_silence(scene, capsys, words):
    assert main([words[0], scene, *words[1:], "--json"]) == 0
    assert capsys.readouterr().err.count("each wavelength takes seconds to minutes") == 1


def test_on_a_terminal_a_bar_says_what_is_solved(monkeypatch):
    shown = io.StringIO()
    monkeypatch.setattr(console, "progress", lambda: Console(file=shown, force_terminal=True, width=100))
    with console.solving_shown() as tell:
        assert shown.getvalue() == ""
        tell(50.1)
    assert "sky 1, of optical depth 50.1" in shown.getvalue()
    assert "takes seconds" not in shown.getvalue()


def test_on_a_terminal_a_bar_is_shown_after_a_second_without_a_sky(monkeypatch):
    shown, waits = io.StringIO(), []

    class AtOnce(threading.Timer):
        def __init__(self, seconds, call):
            waits.append(seconds)
            super().__init__(0.0, call)

        def start(self):
            super().start()
            self.join()

    monkeypatch.setattr(console, "Timer", AtOnce)
    monkeypatch.setattr(console, "progress", lambda: Console(file=shown, force_terminal=True, width=100))
    with console.solving_shown():
        pass
    assert waits == [1.0]
    assert "computing" in shown.getvalue()


PLAN = ["plan", "examples/rig-sim.toml", "examples/session.toml", "--at", "2026-05-04T10:00Z", "--all"]


def _plan(**streams) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "rigctl", *PLAN],
        cwd=Path(__file__).parents[2],
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
        text=True,
        timeout=120,
        check=False,
        **{"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | streams,
    )


def test_a_closed_pipe_ends_with_0_and_no_message():
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "w") as pipe:
        done = _plan(stdout=pipe)
    assert done.returncode == 0
    assert "rigctl" not in done.stderr
    assert "Error" not in done.stderr


def test_a_full_disk_under_standard_output_is_told_and_changes_no_exit_code():
    with Path("/dev/full").open("w") as full:
        done = _plan(stdout=full)
    assert done.returncode == 0
    assert "standard output cannot be written: No space left on device" in done.stderr
    assert "Traceback" not in done.stderr


class _Broken(io.StringIO):
    def write(self, text: str) -> int:
        raise OSError(5, "Input/output error")


def test_the_first_failure_is_kept_and_later_output_goes_nowhere():
    stream = LastingStream(_Broken())
    assert stream.write("one") == 3
    first = stream.failure
    stream.write("two")
    stream.flush()
    assert first is not None
    assert stream.failure is first


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("\x1b[2J gone", r"\x1b[2J gone"),
        ("one\rtwo", r"one\rtwo"),
        ("right\u202eleft", r"right\u202eleft"),
        ("file\udcff", r"file\udcff"),
        ("lines\nand\ttabs, ±1° µm", "lines\nand\ttabs, ±1° µm"),
    ],
)
def test_control_characters_are_shown_and_not_obeyed(text, shown):
    assert visible(text) == shown


def test_what_is_no_number_is_null_with_its_reason():
    told = json.loads(json_text({"a": nan, "b": {"c": inf}, "d": [1.0, nan], "e": 2.0}))
    assert told["a"] is None
    assert told["b"]["c"] is None
    assert told["d"] == [1.0, None]
    assert told["e"] == 2.0
    assert sorted(told) == ["a", "a_reason", "b", "d", "d_reason", "e"]
    assert "infinite" in told["b"]["c_reason"]


def test_a_reason_that_is_known_stays():
    assert json.loads(json_text({"a": nan, "a_reason": "no light"})) == {"a": None, "a_reason": "no light"}


def test_a_scene_without_light_has_no_dolp_and_the_prediction_says_so(tmp_path, capsys):
    dark = SMALL_SCENE.replace("[10.0, 3.0, 1.0]", "[0.0, 0.0, 0.0]").replace("[40.0, -2.0, 3.0]", "[0.0, 0.0, 0.0]")
    (tmp_path / "scene.toml").write_text(dark)
    code = cli.main(["predict", str(tmp_path / "scene.toml"), "--json"])
    answer = capsys.readouterr()
    assert code in (0, 2), answer.err
    if code == 0:
        json.loads(answer.out, parse_constant=lambda name: 1 / 0)
    assert cli.main(["predict", str(tmp_path / "scene.toml")]) == code
    assert " nan" not in capsys.readouterr().out


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
        assert anonymized(f"{run}: camera CAM-4711 at gige:192.0.2.7") == "noon: camera left out at left out"
        content = anonymized_content({"report": "kept", "camera_serial": "CAM-4711", "site": _SITE})
        assert content == {"report": "kept", "camera_serial": None, "site": "left out"}
    assert anonymized(str(run)) == str(run)


def test_results_of_a_command_hold_none_of_it(run, tmp_path, capsys):
    out = tmp_path / "out"
    assert cli.main(["stokes", str(run), "--out", str(out), "--json", "--anonymous"]) == 0
    assert cli.main(["status", str(run), "--page", str(out / "page.html"), "--anonymous"]) == 0
    page = re.sub(r'base64,[^"]*', "", (out / "page.html").read_text())
    told_by_them = page + (out / "stokes.json").read_text() + capsys.readouterr().out
    assert [secret for secret in _SECRETS if secret in told_by_them] == []
    assert json.loads((out / "stokes.json").read_text())


def _error_of(capsys, *arguments):
    code = cli.main([*arguments, "--json"])
    error = json.loads(capsys.readouterr().out)["error"]
    assert set(error) == {"code", "kind", "message", "key", "next"}
    assert error["code"] == code
    return error


def test_a_wrong_file_is_json_for_programs(tmp_path, capsys):
    path = tmp_path / "scene.toml"
    path.write_text((EXAMPLES / "scene-panels.toml").read_text().replace("f_number = 2.0", "f_number = -2.0"))
    error = _error_of(capsys, "predict", str(path))
    assert (error["kind"], error["key"]) == ("usage", "sensor.f_number")
    assert "rigctl predict --help" in error["next"]


def test_a_wrong_option_is_json_for_programs(capsys):
    error = _error_of(capsys, "predict", "scene.toml", "--tolernce", "1")
    assert (error["code"], error["key"]) == (2, "--tolernce")


def test_missing_data_are_json_for_programs(tmp_path, capsys):
    assert _error_of(capsys, "status", "--contents", str(tmp_path / "none"))["kind"] == "data"


def test_an_answer_stays_as_it_was(capsys):
    assert cli.main(["predict", str(EXAMPLES / "scene-panels.toml"), "--json"]) == 0
    assert "error" not in json.loads(capsys.readouterr().out)


@pytest.mark.parametrize(
    ("message", "key"),
    [
        ("rig.toml: 2 problems\n  stage.port: is missing\n  x: is missing", "stage.port"),
        ("s.toml: 1 problem\n  second [[take]], kind: is missing", "second [[take]], kind"),
        ("--alpha: is 2; allowed is above 0", "--alpha"),
        ("nothere.toml: cannot be read", None),
        ("give a scene file, or --regions FILE", "--regions"),
    ],
)
def test_the_key_is_the_first_that_the_message_names(message, key):
    assert json.loads(failure_json(2, message, verb="compare"))["error"]["key"] == key


@pytest.mark.parametrize(("name", "driver"), [("ELL14", "ellx"), ("KDC101", "apt"), ("zabre", "zaber")])
def test_the_name_of_a_model_leads_to_its_driver(name, driver):
    with pytest.raises(ConfigError, match=f"did you mean {driver}"):
        find_driver("rigctl.stages", name, key="stage.driver")


def test_a_simulated_camera_that_there_is_not_is_refused():
    require_known_camera("sim:gc780?truth=x")
    require_known_camera("gige:192.168.0.5")
    with pytest.raises(ConfigError, match="there are sim:gc780, sim:gige"):
        require_known_camera("sim:gc781")
    with pytest.raises(ConfigError, match="'speed=2' is no key of sim:gc780: allowed is truth=FILE"):
        require_known_camera("sim:gc780?speed=2")
