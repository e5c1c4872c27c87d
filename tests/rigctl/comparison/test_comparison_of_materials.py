"""Runs that are compared with a scene given by its materials."""

import numpy as np
import pytest

from rigctl.comparison.compare import compare_with_scene
from rigctl.files.scene_file import load_scene
from rigctl.measure.diagnose import measure_run
from rigctl.prediction.predict import ScenePredictor
from rigctl.scene.light import SceneLight, SkyStore
from tests.rigctl.made_runs import at, make_run
from tests.rigctl.scene_texts import SCENE, scene_of, written

ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)
SUN = {"sun_azimuth_deg": 180.0, "sun_elevation_deg": 40.0}


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """A folder in which the skies of these tests are kept: most have the same."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def _own_cache(monkeypatch, cache):
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))


def compared(folder, cache, text=SCENE, sun=SUN, rig=None, told=None):
    """Compare a run, made of what the model predicts for the sun of the frames, with the scene file."""
    scene = load_scene(written(folder, text))
    changed = {"sun.zenith_deg": 90.0 - sun["sun_elevation_deg"], "sun.azimuth_deg": sun["sun_azimuth_deg"]}
    truth = ScenePredictor(scene, None, light=SceneLight(SkyStore(cache / "skies"))).predictions(changed)
    generator = np.random.default_rng(3)
    frames = [
        (at(angle, exposure_s=3e-5, cycle=cycle, **sun), _picture(truth, channel, generator))
        for cycle in range(2)
        for channel, angle in enumerate(ANGLES_DEG)
    ]
    polarizer = {"polarizer": {"extinction_ratio": 500.0}}
    run = make_run(folder / "run", frames, session={"origin": "device", "rig": polarizer | (rig or {})})
    return compare_with_scene(measure_run(run, list(scene.regions)), scene_of(folder, told or text), alpha=1e-3)


@pytest.fixture(scope="module")
def found(tmp_path_factory, cache):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(cache))
        return compared(tmp_path_factory.mktemp("run"), cache)


def _picture(truth, channel, generator):
    counts = np.full((48, 96), 100.0)
    for columns, name in ((slice(4, 44), "paint"), (slice(52, 92), "road")):
        moments = truth[name].channels
        deviation = np.sqrt(moments.temporal_var_dn2[channel])
        counts[4:44, columns] = moments.mean_dn[channel] + generator.normal(0.0, deviation, (40, 40))
    return np.round(counts)


def _rows(found, quantity, statistic):
    return {row.region: row for row in found.rows if (row.quantity, row.statistic) == (quantity, statistic)}


def test_means_agree_and_carry_the_uncertainty_of_the_materials(found):
    rows = _rows(found, "dn_0", "mean")
    assert set(rows) == {"paint", "road"}
    for row in rows.values():
        # The slope and the index of an assumed paint leave its brightness open by tens of per cent.
        assert row.std_error_inputs > 0.05 * row.predicted
        assert abs(row.z_measurement) < 4.5  # of 1600 pixels, some rows


def test_what_the_light_is_made_of_comes_with_it_and_the_remarks_say_what_is_assumed(found):
    assert set(found.lights) == {"paint", "road"}
    parts = [found.lights["paint"].mean(part) for part in ("reflected_sun", "reflected_sky", "path")]
    np.testing.assert_allclose(np.sum(parts, axis=0), found.lights["paint"].mean("total"), rtol=1e-12)
    assert any("optical depth at 550 nm" in text for text in found.remarks)
    assert any("assumed, not measured" in text for text in found.remarks)
    # A computed radiance counts as tested; angles that are the same need no word.
    assert not any("radiance" in text for text in found.not_tested)
    assert not any(remark.startswith("angles:") for remark in found.remarks)


def test_the_sun_of_the_frames_decides_and_the_difference_is_said(tmp_path, cache):
    low = {"sun_azimuth_deg": 200.0, "sun_elevation_deg": 25.0}
    found = compared(tmp_path, cache, sun=low)
    assert "sun.zenith_deg: 65.00 of the run, not 50.00 of the scene file" in found.remarks
    assert "sun.azimuth_deg: 200.00 of the run, not 180.00 of the scene file" in found.remarks
    assert abs(_rows(found, "dn_0", "mean")["paint"].z_measurement) < 4.5


def test_the_cameras_roll_of_the_rig_file_turns_the_prediction_and_other_angles_are_said(tmp_path, cache):
    geometry = {"camera_zenith_deg": 50.0, "camera_azimuth_deg": 0.0, "camera_height_m": 3000.0}
    told = SCENE.replace("exposure_ms = 0.03", "exposure_ms = 0.03\nangles_deg = [0, 60, 120]")
    found = compared(tmp_path, cache, rig={"geometry": geometry | {"camera_roll_deg": 10.0}}, told=told)
    row = _rows(found, "aolp_deg", "mean")["paint"]
    assert (row.measured - row.predicted + 90.0) % 180.0 - 90.0 == pytest.approx(10.0, abs=1.0)
    assert "angles: 0, 45, 90, 135 deg of the run, not 0, 60, 120 deg of the scene file" in found.remarks
