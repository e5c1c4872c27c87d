"""Every problem of a file is reported at once, with its key, the value found and what is allowed."""

from typing import Annotated, Literal

import pytest
from pydantic import Field

from rigctl.base.durable import sha256_of
from rigctl.errors import ConfigError
from rigctl.files.regions import load_regions
from rigctl.files.rig_file import load_rig
from rigctl.files.scene_file import load_scene
from rigctl.files.session_file import load_session
from rigctl.files.toml import Section, Uncertain, load, place_text
from tests.rigctl.example_files import EXAMPLES


class Example(Section):
    size: int
    width: Uncertain


def _written(tmp_path, text):
    path = tmp_path / "example.toml"
    path.write_text(text)
    return path


def test_a_plain_number_has_no_uncertainty(tmp_path):
    assert load(_written(tmp_path, "size = 3\nwidth = 2.5"), Example).width == Uncertain(value=2.5, std=0.0)


def test_a_number_with_its_uncertainty(tmp_path):
    found = load(_written(tmp_path, "size = 3\nwidth = { value = 2.5, std = 0.1 }"), Example)
    assert found.width == Uncertain(value=2.5, std=0.1)


def test_every_problem_is_named_at_once(tmp_path):
    path = _written(tmp_path, "size = 'big'\ncolour = 1\n[width]\nvalue = 1.0\nstd = -1.0\nfoo = 2")
    with pytest.raises(ConfigError) as caught:
        load(path, Example)
    text = str(caught.value)
    assert str(path) in text
    assert "4 problems" in text
    assert "size: " in text
    assert "found 'big'" in text
    assert "colour: is no known key" in text
    assert "width.std: " in text
    assert "width.foo: is no known key" in text


@pytest.mark.parametrize("number", ["nan", "inf"])
def test_numbers_that_are_not_finite_are_refused(tmp_path, number):
    with pytest.raises(ConfigError, match="width"):
        load(_written(tmp_path, f"size = 3\nwidth = {number}"), Example)


def test_no_toml_is_said_with_its_place(tmp_path):
    with pytest.raises(ConfigError, match=r"line 2 is not valid TOML"):
        load(_written(tmp_path, "size = 3\nwidth = = 4"), Example)


def test_a_file_that_is_no_text_is_said(tmp_path):
    path = tmp_path / "picture.toml"
    path.write_bytes(b"\x89PNG\xff\xfe\x00")
    with pytest.raises(ConfigError, match="not a text file"):
        load(path, Example)


def test_sha256_of_a_known_text(tmp_path):
    # The digest of "abc" in FIPS 180-2, appendix B.1.
    assert sha256_of(_written(tmp_path, "abc")) == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"


class Exposed(Section):
    exposure_ms: Annotated[float, Field(gt=0)] | Literal["auto"] | list[Annotated[float, Field(gt=0)]]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("-3", "exposure_ms: must be above 0, or 'auto', or a list (found -3)"),
        ("[1, -2]", "second of exposure_ms: must be above 0 (found -2)"),
        ("'0.03'", "exposure_ms: must be a number, or 'auto', or a list (found '0.03')"),
        ("['2']", "first of exposure_ms: must be a number (found '2')"),
    ],
)
def test_a_value_of_several_kinds_is_one_problem_with_its_own_key_and_a_number_in_quotes_is_text(tmp_path, text, said):
    with pytest.raises(ConfigError) as caught:
        load(_written(tmp_path, f"exposure_ms = {text}"), Exposed)
    assert str(caught.value).splitlines()[1:] == [f"  {said}"]
    assert "1 problem" in str(caught.value)


def _changed(tmp_path, example, old, new):
    text = (EXAMPLES / example).read_text()
    assert old in text
    path = tmp_path / example
    path.write_text(text.replace(old, new))
    return path


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
        ("rig-sim.toml", load_scene, "this is a rig file; give a scene file"),
        ("scene-panels.toml", load_rig, "this is a scene file; give a rig file"),
        ("session.toml", load_rig, "this is a session file; give a rig file"),
        ("rig-sim.toml", load_session, "this is a rig file; give a session file"),
        ("scene-panels.toml", load_regions, "this is a scene file; give a regions file"),
        ("regions.toml", load_scene, "this is a regions file; give a scene file"),
        ("rig-sim.toml", load_regions, "this is a rig file; give a regions file"),
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
