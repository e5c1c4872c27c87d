from types import SimpleNamespace

import pytest

from rigctl.calibrations.polarizer import write_into_rig
from rigctl.errors import ConfigError
from rigctl.files.regions import load_regions
from rigctl.files.rig_file import load_rig, placeholder_doubt
from rigctl.files.scene_file import load_scene
from rigctl.files.session_file import load_session
from rigctl.verbs.new import new


def test_a_simulated_folder_holds_files_that_are_right(tmp_path):
    folder = tmp_path / "rig"
    written = new(folder, simulated=True, latitude_deg=43.1, longitude_deg=-77.7).files
    assert sorted(written) == sorted(path.name for path in folder.iterdir())
    rig = load_rig(folder / "rig.toml")
    assert rig.is_simulated
    assert rig.site is not None
    assert rig.site.latitude_deg == 43.1
    for name in written:
        if name.startswith("session"):
            load_session(folder / name)
        if name.startswith(("scene", "sheet")):
            load_scene(folder / name)
    load_regions(folder / "regions.toml")
    assert load_rig(folder / "rig-sheet-30.toml").simulation.scene == folder / "sheet-30.toml"


def test_a_real_rig_has_its_addresses_and_no_simulation(tmp_path):
    new(tmp_path, stage="zaber:/dev/ttyUSB1", camera="gige:192.168.0.5")
    rig = load_rig(tmp_path / "rig.toml")
    assert (rig.stage.driver, rig.stage.port, rig.camera.address) == ("zaber", "/dev/ttyUSB1", "gige:192.168.0.5")
    assert rig.simulation is None
    assert "rig-sheet" not in (tmp_path / "README.md").read_text()


_FOUND = SimpleNamespace(
    axis=SimpleNamespace(best=SimpleNamespace(sense=-1)),
    offset_deg=SimpleNamespace(value=31.7012, std_error=0.021),
    extinction=SimpleNamespace(ratio=498.7),
)


def test_comments_after_a_number_stay_and_the_change_is_reported(tmp_path):
    new(tmp_path, simulated=True)
    path = tmp_path / "rig.toml"
    text = path.read_text().replace(
        "offset_deg = 0.0                # a placeholder", "offset_deg = 0.0 # by eye, Monday"
    )
    path.write_bytes(text.replace("\n", "\r\n").encode())
    changes = write_into_rig(path, _FOUND)
    assert b"offset_deg = { value = 31.7012, std = 0.0210 } # by eye, Monday\r\n" in path.read_bytes()
    assert b"a placeholder" not in path.read_bytes()
    assert "- offset_deg = 0.0 # by eye, Monday" in changes
    assert "+ sense = -1    # rigctl calibrate axis" in changes


def test_placeholders_give_a_warning_until_a_calibration_is_written(tmp_path):
    new(tmp_path, simulated=True)
    path = tmp_path / "rig.toml"
    assert "placeholders" in placeholder_doubt(load_rig(path))
    write_into_rig(path, _FOUND)
    rig = load_rig(path)
    assert (rig.polarizer.sense, rig.polarizer.offset_deg, rig.polarizer.offset_std_deg) == (-1, 31.7012, 0.021)
    assert rig.polarizer.extinction_ratio == 498.7
    assert rig.simulation.polarizer.offset_deg == 31.7
    assert placeholder_doubt(rig) is None
    assert "# polarizer angle = sense" in path.read_text()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"stage": "/dev/ttyUSB0"}, "--stage, --camera: give both"),
        ({"simulated": True, "latitude_deg": 1.0}, "give both, or neither"),
        ({"stage": "/dev/ttyUSB0", "camera": "nonsense"}, "gige:192.168.0.5"),
    ],
)
def test_half_an_answer_is_refused(tmp_path, changes, words):
    with pytest.raises(ConfigError, match=words):
        new(tmp_path, **changes)
    assert not list(tmp_path.iterdir())
