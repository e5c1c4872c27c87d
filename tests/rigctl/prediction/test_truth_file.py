"""The light of a scene as plain radiances: a scene file that a simulated rig paints."""

import numpy as np
import pytest

from rigctl.files.scene_file import load_scene
from rigctl.prediction.truth_file import write_truth
from rigctl.scene.light import build_scenario, readout_of
from rigctl.scene.scene import scene_of_file
from tests.rigctl.example_files import EXAMPLES


def test_the_truth_is_a_scene_file_of_the_same_light(tmp_path):
    write_truth(EXAMPLES / "scene-roof.toml", tmp_path / "truth.toml")
    truth = load_scene(tmp_path / "truth.toml")
    assert not truth.has_materials
    scenes = [scene_of_file(file) for file in (load_scene(EXAMPLES / "scene-roof.toml"), truth)]
    computed, stated = (build_scenario(scene, readout=readout_of(scene), exposure_s=1e-5) for scene in scenes)
    assert [region.name for region in stated.regions] == ["black_panel", "white_panel", "asphalt"]
    for one, other in zip(computed.regions, stated.regions, strict=True):
        assert other.stokes_radiance == pytest.approx(one.stokes_radiance, rel=1e-14)
        assert np.allclose(other.aperture_moments().cov, one.aperture_moments().cov, rtol=1e-12, atol=0.0)
    assert "# Sun: zenith 22.07 deg" in (tmp_path / "truth.toml").read_text()
