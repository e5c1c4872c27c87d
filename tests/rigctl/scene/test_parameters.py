"""The table of a scene's parameters: every number is found by its key, and set by it alone."""

import re

import numpy as np
import pytest

from rigctl.errors import ConfigError
from rigctl.files.scene_file import load_scene
from rigctl.scene.reading import scene_of_file
from rigctl.scene.scene import cycle_of_file, describe, gather, get, parameters, with_rig, with_value, with_values
from tests.rigctl.example_files import EXAMPLES
from tests.rigctl.scene_texts import SCENE, written

SCENES = sorted(path.name for path in EXAMPLES.glob("scene-*.toml"))
FULL = SCENE.replace("[[regions]]", "[errors]\nsurround_albedo = 0.2\n[rig]\nangle_std_deg = 0.1\n[[regions]]", 1)


def record(path):
    file = load_scene(path)
    return with_rig(scene_of_file(file), file.rig, cycle_of_file(file))


@pytest.mark.parametrize("name", SCENES)
def test_every_parameter_is_set_by_its_key_and_no_other_moves(name):
    scene = record(EXAMPLES / name)
    before = parameters(scene)
    for parameter in before:
        moved = 0.5 * parameter.value + 0.25
        after = {one.key: one for one in parameters(with_value(scene, parameter.key, moved))}
        assert after[parameter.key].value == pytest.approx(moved, rel=1e-14)
        assert after[parameter.key].std == parameter.std
        assert [one for one in before if one.key != parameter.key] == [
            one for key, one in after.items() if key != parameter.key
        ]


@pytest.mark.parametrize("name", SCENES)
def test_a_parameter_lies_within_its_range_and_has_a_meaning(name):
    for parameter in parameters(record(EXAMPLES / name)):
        assert parameter.least <= parameter.value <= parameter.most, parameter.key
        assert parameter.meaning
        assert parameter.unit or not re.search(r"_(deg|nm|um|mm|m|km|e|dn|px|du|hpa|ms)$", parameter.key)


@pytest.mark.parametrize("name", SCENES)
def test_what_is_described_is_all_that_a_scene_has(name):
    scene = record(EXAMPLES / name)
    shown = {row.key for row in describe()}
    regions = "|".join(re.escape(region.name) for region in scene.regions)
    for parameter in parameters(scene):
        key = re.sub(rf"^regions\.({regions})\.", "regions.NAME.", parameter.key)
        assert re.sub(r"^rig\.angle_deg\..*", "rig.angle_deg.ANGLE", key) in shown


def test_keys_are_described_once():
    keys = [row.key for row in describe()]
    assert len(keys) == len(set(keys))


def test_several_are_set_at_once_and_the_scene_stays_as_it_was(tmp_path):
    scene = record(written(tmp_path, FULL))
    changed = with_values(scene, {"sun.zenith_deg": 30.0, "regions.paint.n": 1.6, "rig.angle_deg.45": 0.5})
    assert [get(changed, key).value for key in ("sun.zenith_deg", "regions.paint.n", "rig.angle_deg.45")] == [
        30.0,
        1.6,
        0.5,
    ]
    assert get(scene, "sun.zenith_deg").value == 50.0


def test_a_region_of_a_material_has_no_radiance_and_one_of_a_radiance_no_tilt(tmp_path):
    keys = {parameter.key for parameter in parameters(record(written(tmp_path, FULL)))}
    assert "regions.paint.tilt_deg" in keys
    assert "regions.paint.stokes_radiance.0" not in keys
    keys = {parameter.key for parameter in parameters(record(EXAMPLES / "scene-panels.toml"))}
    assert "regions.black_panel.stokes_radiance.0" in keys
    assert "regions.black_panel.tilt_deg" not in keys


def test_a_number_that_is_not_there_says_which_are_alike():
    scene = record(EXAMPLES / "scene-panels.toml")
    with pytest.raises(ConfigError, match=r"no number 'noise.read_noise'; did you mean noise.read_noise_e"):
        with_value(scene, "noise.read_noise", 1.0)
    with pytest.raises(ConfigError, match=r"no number 'q'; there are sensor\.pixel_pitch_um, "):
        get(scene, "q")


def test_inputs_put_into_the_scene_are_the_scene(tmp_path):
    inputs = gather(record(written(tmp_path, FULL)))
    assert parameters(inputs.at(inputs.values)) == parameters(inputs.scene)
    moved = gather(inputs.at(inputs.values * 1.5))
    np.testing.assert_allclose(moved.values, inputs.values * 1.5, rtol=1e-14)


def test_the_drift_of_the_light_is_known_by_its_old_key_too(tmp_path):
    old = written(tmp_path, SCENE + "[rig]\nlight_drift = { value = 0.01, std = 0.002 }\n")
    scene = scene_of_file(load_scene(old))
    for key in ("errors.illumination_drift", "rig.light_drift"):
        assert (get(scene, key).value, get(scene, key).std) == (0.01, 0.002)
    assert any("rig.light_drift: is called errors.illumination_drift now" in remark for remark in scene.remarks)
    assert get(with_value(scene, "rig.light_drift", 0.03), "errors.illumination_drift").value == 0.03


def test_a_drift_under_both_keys_is_refused(tmp_path):
    both = SCENE + "[rig]\nlight_drift = 0.01\n[errors]\nillumination_drift = 0.01\n"
    with pytest.raises(ConfigError, match=r"rig\.light_drift and errors.illumination_drift are one number"):
        load_scene(written(tmp_path, both))
