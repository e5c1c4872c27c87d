import json

import numpy as np
import pytest

from rigctl import cli
from rigctl.comparison.detect import detect
from rigctl.errors import DataError
from rigctl.files.regions import Rectangle, Region
from rigctl.measure.measure import measure, signal_of_cycle
from tests.rigctl.example_files import small_rig, small_session
from tests.rigctl.made_runs import at, make_run

SIZE = (60, 130)
REGIONS = [
    Region(name="ground", rectangle=Rectangle(x=2, y=2, width=60, height=55)),
    Region(name="object", rectangle=Rectangle(x=66, y=2, width=60, height=55)),
]


def _stokes_run(tmp_path, *, target_shift, seed=1):
    """Frames whose Stokes parameters are Gaussian with known moments, drawn here with numpy alone."""
    rng = np.random.default_rng(seed)
    mean = np.broadcast_to(np.array([1600.0, 200.0, 100.0])[:, None, None], (3, *SIZE)).copy()
    mean[:, :, 65:] += np.asarray(target_shift)[:, None, None]
    frames = []
    for angle in (0.0, 45.0, 90.0, 135.0):
        twice = 2 * np.deg2rad(angle)
        light = 0.5 * (mean[0] + np.cos(twice) * mean[1] + np.sin(twice) * mean[2])
        frames.append((at(angle), np.round(light + rng.normal(0.0, 8.0, SIZE))))
    return make_run(tmp_path / "run", frames)


def _found(run, **options):
    measurement = measure(run, regions=REGIONS)
    stokes = np.einsum("kn,nij->kij", measurement.plan.inverse, signal_of_cycle(measurement, 0))
    return detect(measurement, stokes, background="ground", target="object", **options)


def test_measured_curve_lies_around_the_predicted_one(tmp_path):
    found = _found(_stokes_run(tmp_path, target_shift=(10.0, 12.0, -8.0)))
    # A 95 % band at each of 200 points that are strongly correlated: all outside of it are few.
    inside = (found.band_low <= found.predicted_p_detection) & (found.predicted_p_detection <= found.band_high)
    assert np.mean(inside) > 0.8
    assert 0.1 < np.median(found.empirical_p_detection) < 0.99


def test_false_alarms_come_at_the_rate_that_the_threshold_promises(tmp_path):
    found = _found(_stokes_run(tmp_path, target_shift=(0.0, 0.0, 0.0)))
    for p, share in zip(found.p_false_alarm, found.empirical_p_false_alarm, strict=True):
        # 3300 pixels of the sample: binomial error, five of them.
        assert abs(share - p) < 5 * np.sqrt(p * (1 - p) / found.n_background)


def test_a_target_like_its_background_is_found_at_the_rate_of_false_alarms(tmp_path):
    found = _found(_stokes_run(tmp_path, target_shift=(0.0, 0.0, 0.0)))
    error = np.sqrt(found.p_false_alarm * (1 - found.p_false_alarm) / found.n_target)
    # Target and background are two samples of 3300 pixels: their moments add as much again.
    assert np.all(np.abs(found.empirical_p_detection - found.p_false_alarm) < 5 * np.sqrt(2) * error)
    assert found.auc == pytest.approx(0.5, abs=0.03)


def test_the_map_has_the_statistic_of_the_background_where_that_is(tmp_path):
    found = _found(_stokes_run(tmp_path, target_shift=(40.0, 50.0, -60.0)))
    ground, target = found.statistic[2:57, 2:62], found.statistic[2:57, 66:126]
    # Mean of D over the pixels that gave the moments is (n - 1) / n times 3, exactly.
    assert ground.mean() == pytest.approx(3 * (ground.size - 1) / ground.size, rel=1e-9)
    assert np.median(target) > 20


def test_a_region_that_is_not_there_is_named_with_those_that_are(tmp_path):
    measurement = measure(_stokes_run(tmp_path, target_shift=(0.0, 0.0, 0.0)), regions=REGIONS)
    with pytest.raises(DataError, match=r"'sea'.*ground, object"):
        detect(measurement, np.zeros((3, *SIZE)), background="sea", target="object")


def test_the_command_writes_map_curves_and_numbers(tmp_path, capsys):
    from rigctl.session.take import take_session

    take_session(small_rig(tmp_path), small_session(), tmp_path / "run", files={})
    arguments = [
        "detect",
        str(tmp_path / "run"),
        "--background",
        "left",
        "--target",
        "right",
        "--out",
        str(tmp_path / "rx"),
    ]
    assert cli.main([*arguments, "--scene", str(tmp_path / "scene.toml"), "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["predicted_from"] == "the scene file"
    assert [point["p_false_alarm"] for point in content["points"]] == [0.01, 0.1]
    assert {path.name for path in (tmp_path / "rx").iterdir()} == {
        "rx.fits", "rx.png", "roc.csv", "roc.png", "detection.json",
    }  # fmt: skip


def test_the_command_asks_for_regions(tmp_path, capsys):
    assert cli.main(["detect", str(tmp_path), "--background", "a", "--target", "b", "--out", str(tmp_path / "x")]) == 2
    assert "--regions" in capsys.readouterr().err
