import pytest

from rigctl.errors import ConfigError
from rigctl.files.regions import load_regions
from rigctl.files.rig_file import load_rig
from rigctl.files.scene_file import load_scene
from rigctl.files.session_file import load_session
from rigctl.files.toml import place_text
from tests.rigctl.example_files import EXAMPLES


def _changed(tmp_path, example, old, new):
    text = (EXAMPLES / example).read_text()
    assert old in text
    path = tmp_path / example
    path.write_text(text.replace(old, new))
    return path


def test_a_key_that_is_nearly_right_is_named(tmp_path):
    path = _changed(tmp_path, "rig-sim.toml", "tolerance_deg", "tolerance")
    with pytest.raises(ConfigError, match=r"stage.tolerance: is no known key .*; did you mean tolerance_deg"):
        load_rig(path)


def test_a_key_in_the_wrong_table_is_led_to_its_own(tmp_path):
    path = _changed(tmp_path, "scene-panels.toml", "[sensor]\n", "[sensor]\nread_noise_e = 3.0\n")
    with pytest.raises(ConfigError, match=r"did you mean noise.read_noise_e\?"):
        load_scene(path)


def test_tables_of_an_array_are_counted_as_people_count(tmp_path):
    path = _changed(tmp_path, "session.toml", "cycles = 8", "cycels = 8")
    with pytest.raises(ConfigError, match=r"second \[\[take\]\], cycels: is no known key .*did you mean cycles"):
        load_session(path)
    assert place_text(("take", 11, "kind")) == "12th [[take]], kind"
    assert place_text(("stage", "port")) == "stage.port"


@pytest.mark.parametrize(
    ("example", "loader", "words"),
    [
        ("rig-sim.toml", load_scene, "this is a rig file, a scene file is wanted"),
        ("scene-panels.toml", load_rig, "this is a scene file, a rig file is wanted"),
        ("session.toml", load_rig, "this is a session file, a rig file is wanted"),
        ("rig-sim.toml", load_session, "this is a rig file, a session file is wanted"),
        ("scene-panels.toml", load_regions, "this is a scene file, a regions file is wanted"),
        ("regions.toml", load_scene, "this is a regions file, a scene file is wanted"),
        ("rig-sim.toml", load_regions, "this is a rig file, a regions file is wanted"),
    ],
)
def test_a_file_of_another_kind_is_called_by_its_kind(example, loader, words):
    with pytest.raises(ConfigError) as caught:
        loader(EXAMPLES / example)
    assert str(caught.value) == f"{EXAMPLES / example}: {words}"


def test_a_table_is_not_repeated_in_a_message(tmp_path):
    path = _changed(tmp_path, "scene-panels.toml", "[sensor]", "[senser]")
    with pytest.raises(ConfigError, match=r"senser: is no known key \(found a table\); did you mean sensor"):
        load_scene(path)


def test_names_may_have_umlauts_and_no_regular_expression_is_shown(tmp_path):
    green = _changed(tmp_path, "scene-panels.toml", "black_panel", "grüne_Wand")
    assert load_scene(green).regions[0].name == "grüne_Wand"
    with pytest.raises(ConfigError, match=r"is 'black panel'; a name has letters, digits") as caught:
        load_scene(_changed(tmp_path, "scene-panels.toml", "black_panel", "black panel"))
    assert "^[" not in str(caught.value)
