import numpy as np
import pytest

from rigctl.files.scene_file import load_scene
from rigctl.scene.light import build_scenario, readout_of
from rigctl.scene.reading import scene_of_file
from rigctl.scene.scene import gather, with_value
from tests.rigctl.example_files import EXAMPLES
from tests.rigctl.noise_records import noise_parameters

NOISE = noise_parameters(
    {
        "gain_dn_per_e": {"value": 0.25, "std_error": 0.001, "n": 10},
        "read_noise_e": {"value": 9.0, "std_error": 0.05, "n": 10},
        "dark_current_e_per_s": {"value": -3.0, "std_error": 5.0, "n": 10},
        "black_level_dn": {"value": 60.0, "std_error": 0.01, "n": 10},
        "saturation_e": None,
        "prnu": {"value": 0.004, "std_error": 1e-5, "n": 10},
        "dsnu_e": None,
        "covariance": {"names": ["read_noise_e", "gain_dn_per_e"], "matrix": [[0.0025, -2e-5], [-2e-5, 1e-6]]},
    }
)


@pytest.fixture
def scene():
    return load_scene(EXAMPLES / "scene-panels.toml")


def _value(inputs, name):
    return inputs.values[inputs.names.index(name)]


def test_a_calibration_takes_the_place_of_the_assumed_noise(scene):
    inputs = gather(scene_of_file(scene, NOISE))
    assert _value(inputs, "noise.gain_dn_per_e") == 0.25
    assert _value(inputs, "noise.prnu") == 0.004


def test_what_the_calibration_cannot_give_stays_assumed_and_is_called_so(scene):
    inputs = gather(scene_of_file(scene, NOISE))
    assert _value(inputs, "noise.dsnu_e") == 1.0
    assert any("assumed" in remark and "noise.dsnu_e = 1" in remark for remark in inputs.remarks)


def test_without_a_calibration_all_noise_is_called_assumed(scene):
    assert any("noise.gain_dn_per_e = 0.24" in remark for remark in gather(scene_of_file(scene)).remarks)


def test_an_estimate_below_zero_is_used_as_zero_and_said(scene):
    inputs = gather(scene_of_file(scene, NOISE))
    assert _value(inputs, "noise.dark_current_e_per_s") == 0.0
    assert any("dark_current" in remark and "-3" in remark for remark in inputs.remarks)


def test_errors_of_one_calibration_keep_their_covariance(scene):
    inputs = gather(scene_of_file(scene, NOISE))
    gain, read = (inputs.names.index(f"noise.{name}") for name in ("gain_dn_per_e", "read_noise_e"))
    assert inputs.cov[gain, read] == inputs.cov[read, gain] == -2e-5
    assert inputs.cov[gain, gain] == 1e-6
    assert inputs.cov[read, read] == 0.0025


def test_a_stated_uncertainty_stands_on_the_diagonal(tmp_path):
    text = (EXAMPLES / "scene-panels.toml").read_text()
    path = tmp_path / "scene.toml"
    path.write_text(text.replace("f_number = 2.0", "f_number = { value = 2.0, std = 0.02 }"))
    inputs = gather(scene_of_file(load_scene(path)))
    place = inputs.names.index("sensor.f_number")
    assert inputs.cov[place, place] == pytest.approx(4e-4)
    assert np.count_nonzero(inputs.cov) == 1


def test_units_of_the_file_become_si(scene):
    record = scene_of_file(scene)
    scenario = build_scenario(record, readout=readout_of(record), exposure_s=3e-5)
    assert scenario.sensor.pixel_pitch_m == pytest.approx(8.3e-6)
    assert scenario.sensor.wavelength_m == pytest.approx(550e-9)
    assert scenario.sensor.tau_perpendicular == pytest.approx(0.8 / 500)
    assert scenario.readout.angles_rad == pytest.approx(np.deg2rad([0, 45, 90, 135]))
    assert scenario.readout.channel_names == ("dn_0", "dn_45", "dn_90", "dn_135")


def test_a_changed_value_reaches_the_scenario(scene):
    record = with_value(scene_of_file(scene), "regions.asphalt.stokes_radiance.1", 0.5)
    scenario = build_scenario(record, readout=readout_of(record), exposure_s=3e-5)
    assert scenario.regions[2].stokes_radiance[1] == 0.5
