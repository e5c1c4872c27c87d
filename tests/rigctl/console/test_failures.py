import json

import pytest

from rigctl import cli
from rigctl.console.failures import failure_json
from rigctl.errors import ConfigError
from rigctl.rig.rig import find_driver
from rigctl.rig.simulated_parts import require_known_camera
from tests.rigctl.example_files import EXAMPLES


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


def test_an_unknown_verb_leads_to_the_one_that_was_meant(capsys):
    assert cli.main(["predcit"]) == 2
    assert 'Did you mean "predict"' in capsys.readouterr().err


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
