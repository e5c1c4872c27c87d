import json

import pytest

from rigctl.errors import ConfigError, DataError
from rigctl.jobs.compare import CompareRequest, compare_run
from rigctl.measurement.run_calibrations import CalibrationPaths
from rigctl.session.take_session import take_session
from tests.rigctl.comparison.test_closed_loop import NOISE
from tests.rigctl.example_files import small_rig, small_session


def _noise_file(folder, **camera):
    content = {
        **NOISE, "schema_version": 1, "prnu": None, "dsnu_e": None, "flags": [],
        "saturation_e": None, "camera": {"model": "x", "serial": None, "gain_db": None, "bit_depth": None} | camera,
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
    return compare_run(folder / "run", CompareRequest(**given))


@pytest.mark.parametrize(
    ("camera", "named"),
    [({"serial": "other"}, "serial"), ({"gain_db": 6.0}, "gain setting"), ({"bit_depth": 10}, "bit depth")],
)
def test_a_calibration_of_another_camera_or_setting_is_refused(folder, camera, named):
    with pytest.raises(DataError, match=named):
        _compare(folder, calibrations=CalibrationPaths(noise=_noise_file(folder, **camera)))


def test_a_calibration_that_does_not_say_of_which_camera_is_taken(folder):
    found = _compare(folder, calibrations=CalibrationPaths(noise=_noise_file(folder)))
    assert "noise" in found.provenance.files


@pytest.mark.parametrize("alpha", [0.0, 1.0])
def test_alpha_out_of_range_is_refused(folder, alpha):
    with pytest.raises(ConfigError, match="--alpha"):
        _compare(folder, alpha=alpha)


def test_scene_and_regions_together_are_refused(folder):
    with pytest.raises(ConfigError, match="--regions"):
        _compare(folder, regions=folder / "regions.toml")


def test_a_file_that_is_no_calibration_is_refused(folder):
    (folder / "bad.json").write_text("{}")
    with pytest.raises(DataError, match="rigctl calibrate noise"):
        _compare(folder, calibrations=CalibrationPaths(noise=folder / "bad.json"))
