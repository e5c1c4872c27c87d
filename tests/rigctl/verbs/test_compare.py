import json

import pytest

from model.effects.effect import ALL, Effect
from model.effects.planner import LIGHT
from rigctl.errors import ConfigError, DataError
from rigctl.files.scene_file import load_scene
from rigctl.session.take import take_session
from rigctl.verbs.compare import compare_run
from tests.rigctl.comparison.test_closed_loop import NOISE
from tests.rigctl.example_files import small_rig, small_session


def _noise_file(folder, **camera):
    content = {
        **NOISE, "schema_version": 2, "prnu": None, "dsnu_e": None, "flags": [],
        "saturation_e": None, "made_for": camera,
    }  # fmt: skip
    (folder / "noise.json").write_text(json.dumps(content))
    return folder / "noise.json"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("run")
    take_session(small_rig(path), small_session(), path / "run", files={})
    return path


def _compare(folder, **options):
    given = {"scene": folder / "scene.toml"} | options
    return compare_run(folder / "run", **given)


@pytest.mark.parametrize(
    ("camera", "named"),
    [({"camera_serial": "other"}, "serial"), ({"gain_db": 6.0}, "gain setting"), ({"bit_depth": 10}, "bit depth")],
)
def test_a_calibration_of_another_camera_or_setting_is_refused(folder, camera, named):
    with pytest.raises(DataError, match=named):
        _compare(folder, noise=_noise_file(folder, **camera))


def test_a_calibration_that_does_not_say_of_which_camera_is_taken(folder):
    found = _compare(folder, noise=_noise_file(folder))
    assert "noise" in found.files


def _regions_file(folder, *regions):
    texts = (
        f'[[regions]]\nname = "{name}"\npolygon = {[list(corner) for corner in where]}\n' for name, where in regions
    )
    (folder / "regions.toml").write_text("\n".join(texts))
    return folder / "regions.toml"


def test_regions_of_a_scene_are_taken_where_they_were_found_again(folder):
    name, *others = (region.name for region in load_scene(folder / "scene.toml").regions)
    square = [(4.0, 5.0), (14.0, 5.0), (14.0, 15.0), (4.0, 15.0)]
    found = _compare(folder, regions=_regions_file(folder, (name, square)))
    assert [region.name for region in found.run.regions] == [name, *others]
    assert found.run.regions[0].outline() == square
    measured = found.measurement.regions[name]
    assert measured.pixels + measured.excluded == 100
    assert set(found.predictions) == {name, *others}
    assert {"scene", "regions"} <= set(found.files)


def test_effects_of_the_light_are_left_out_by_a_rule_and_any_by_name(folder):
    whole, safe = (_compare(folder, effects=rule).accuracy for rule in ("all", "safe"))
    assert whole.taken == ALL
    assert [one.acts_by_bound for one in safe.effects.decisions] == [
        one.acts_by_bound for one in whole.effects.decisions
    ]
    there = {one.effect for one in safe.effects.decisions if one.bound.largest > 0.0}
    assert safe.taken == ALL - ((there & LIGHT) - safe.effects.active)
    assert Effect.TEXTURE not in _compare(folder, left_out=("texture",)).accuracy.taken
    assert safe.taken <= _compare(folder, effects="safe", switched_on=("dark-current",)).accuracy.taken


@pytest.mark.parametrize(
    ("options", "corners", "error", "said"),
    [
        ({"alpha": 0.0}, None, ConfigError, "--alpha"),
        ({"alpha": 1.0}, None, ConfigError, "--alpha"),
        (
            {},
            ("elsewhere", [(1.0, 1.0), (5.0, 1.0), (5.0, 5.0)]),
            ConfigError,
            r"scene \w+ has no region elsewhere; there",
        ),
        ({"scene": None, "effects": "safe"}, ("a", [(1.0, 1.0), (9.0, 1.0), (9.0, 9.0)]), ConfigError, "--effects"),
        ({"noise": "bad.json"}, None, DataError, "rigctl calibrate noise"),
    ],
)
def test_what_cannot_be_compared_is_refused_by_its_option(folder, options, corners, error, said):
    (folder / "bad.json").write_text("{}")
    given = {name: folder / value if name == "noise" else value for name, value in options.items()}
    with pytest.raises(error, match=said):
        _compare(folder, regions=None if corners is None else _regions_file(folder, corners), **given)
