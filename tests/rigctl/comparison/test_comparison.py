import numpy as np
import pytest

from rigctl.comparison.compare import compare_with_scene
from rigctl.errors import ConfigError, DataError
from rigctl.files.scene_file import load_scene
from rigctl.measure.diagnose import measure_run
from rigctl.rig.roof import PERTURBATIONS, perturbed
from rigctl.runs.folder import read_run
from rigctl.scene.scene import scene_of_file
from rigctl.session.take import take_session
from tests.rigctl.example_files import small_rig, small_session
from tests.rigctl.made_runs import at, make_run

POINTS_TO = {
    "gain": ("scale",),
    "angle-offset": ("axis-offset",),
    "angle-sense": ("axis-sense",),
    "extinction": ("polarization",),
}


def _compared(folder, *, seed=1, perturbation=None, alpha=1e-3):
    rig = small_rig(folder, seed=seed)
    rig = rig if perturbation is None else perturbed(rig, perturbation)
    take_session(rig, small_session(cycles=4), folder / "run", files={})
    scene = load_scene(folder / "scene.toml")
    measured = measure_run(read_run(folder / "run"), list(scene.regions))
    return compare_with_scene(measured, scene_of_file(scene), alpha=alpha)


def test_an_undisturbed_rig_agrees(tmp_path):
    found = _compared(tmp_path)
    assert found.agrees
    assert found.points_to == ()


@pytest.mark.parametrize("what", PERTURBATIONS)
def test_each_perturbation_points_where_it_belongs(tmp_path, what):
    assert _compared(tmp_path, perturbation=what).points_to == POINTS_TO[what]


@pytest.mark.slow
def test_scores_are_standard_normal_over_seeds(tmp_path):
    scores = {}
    seeds = 12
    for seed in range(1, seeds + 1):
        folder = tmp_path / str(seed)
        folder.mkdir()
        for row in _compared(folder, seed=seed).rows:
            scores.setdefault((row.region, row.quantity, row.statistic), []).append(row.z)
    # Each of some 70 rows on its own: a mean of 12 scores has the standard error 0.29, of which the largest of 70 stays
    # below 4; 11 times a variance follows chi-square with 11 degrees of freedom, of which 70 stay between 0.9 and 43
    # but for one time in a thousand.
    for row, z in scores.items():
        assert abs(np.mean(z)) < 4 * 0.29, row
        assert 0.9 / 11 < np.var(z, ddof=1) < 43 / 11, row


def test_what_the_run_overrules_is_said(tmp_path):
    assert any("cycles: 4 of the run, not 2" in remark for remark in _compared(tmp_path).remarks)


def test_it_says_what_it_does_not_test(tmp_path):
    text = " ".join(_compared(tmp_path).not_tested)
    assert "radiance of the scene" in text
    assert "simulated" in text


def test_an_unknown_exposure_is_refused(tmp_path):
    small_rig(tmp_path)
    scene = load_scene(tmp_path / "scene.toml")
    run = make_run(tmp_path / "run", [(at(a), np.random.default_rng(a).normal(500, 9, (48, 96))) for a in (0, 60, 120)])
    with pytest.raises(DataError, match="exposure is not known"):
        compare_with_scene(measure_run(run, list(scene.regions)), scene_of_file(scene), alpha=1e-3)


def test_a_region_that_was_not_measured_is_refused(tmp_path):
    take_session(small_rig(tmp_path), small_session(), tmp_path / "run", files={})
    scene = load_scene(tmp_path / "scene.toml")
    left = next(region for region in scene.regions if region.name == "left")
    less = measure_run(read_run(tmp_path / "run"), [left])
    with pytest.raises(ConfigError, match="region right"):
        compare_with_scene(less, scene_of_file(scene), alpha=1e-3)
