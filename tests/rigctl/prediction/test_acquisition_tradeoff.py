import csv
import io
import json

import numpy as np
import pytest

from model.acquisition import Disturbances, Wanted
from rigctl import cli
from rigctl.console import EXIT_USAGE
from rigctl.errors import ConfigError
from rigctl.files.scene_file import load_scene
from rigctl.files.session_file import SessionFile
from rigctl.prediction.predict import ScenePredictor
from rigctl.prediction.sessions import SceneSessions, TradeoffRequest, acquisition_tradeoff
from rigctl.report.tradeoff import proposal, reached_table, tradeoff_csv, tradeoff_json, tradeoff_picture, ways_table
from rigctl.session.forecast import with_cycles_for
from tests.rigctl.example_files import SMALL_SCENE

TARGET = 0.004


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "scene.toml"
    path.write_text(SMALL_SCENE)
    return load_scene(path)


@pytest.fixture(scope="module")
def found(scene):
    request = TradeoffRequest(
        wanted=Wanted(dolp_total=TARGET, p_detection=0.9),
        pair=("left", "right"),
        exposures_s=(3e-5, 1.0),
        disturbances=Disturbances(drift_per_s=1e-4, settling_time_s=0.02),
    )
    return acquisition_tradeoff(scene, None, request)


def session(**take):
    return SessionFile.model_validate(
        {"name": "s", "take": [{"kind": "dark", "exposure_ms": 1}, {"kind": "scene", "exposure_ms": 0.03} | take]}
    )


def test_the_shortest_of_all_ways_is_proposed(found):
    durations = [reached.session.duration_s for _, reached in found.reached if reached.session is not None]
    assert found.best.session.duration_s == min(durations)
    assert all(budget.total <= TARGET for budget in found.best.budgets.values())
    assert f"cycles = {found.best.session.cycles}" in proposal(found)
    # The exposure that saturates is never chosen; settling is waited for where it costs less than it saves.
    assert {point.session.exposure_s for point in found.points} == {3e-5}
    assert found.best.session.settle_s > 0.0
    ways = {(point.session.angles_rad, point.session.pattern) for point in found.points}
    assert len(ways_table(found).rows) == len(ways)
    assert len(reached_table(found).rows) == len(found.reached) == len(ways) * 2 // 3  # grouped ones are not tried


def test_noise_is_that_of_the_prediction(scene, found):
    predicted = ScenePredictor(scene, None).predictions()
    first = next(point for point in found.points if point.session.exposure_s == 3e-5)
    assert len(first.session.angles_rad) == 4
    s0, s1, s2 = predicted["left"].stokes_dn.mean
    noise = predicted["left"].stokes_noise_dn2
    gradient = np.array([-np.hypot(s1, s2) / s0, s1 / np.hypot(s1, s2), s2 / np.hypot(s1, s2)]) / s0
    # First order: DoLP of "left" is some ten deviations from 0, so that it is right to a percent.
    assert first.budgets["left"].sigma == pytest.approx(np.sqrt(gradient @ noise @ gradient), rel=0.02)


def test_grouped_frames_show_the_largest_drift(found):
    last = [point for point in found.points if point.session.cycles == 1024 and len(point.session.angles_rad) == 4]
    drift = {point.session.pattern: point.worst.drift_error for point in last}
    assert drift["palindrome"] == 0.0
    assert drift["grouped"] == pytest.approx(1024 * drift["cycles"], rel=0.5)


def test_files_hold_every_point(found):
    rows = list(csv.DictReader(io.StringIO(tradeoff_csv(found).decode())))
    assert len(rows) == 2 * len(found.points)
    assert float(rows[0]["total"]) == next(iter(found.points[0].budgets.values())).total
    content = json.loads(json.dumps(tradeoff_json(found), allow_nan=False))
    assert len(content["points"]) == len(found.points)
    assert content["shortest"]["cycles"] == found.best.session.cycles
    assert tradeoff_picture(found).startswith(b"\x89PNG")


def test_nothing_wanted_nothing_proposed(scene):
    found = acquisition_tradeoff(scene, None, TradeoffRequest(region="left", exposures_s=(3e-5,)))
    assert (found.reached, found.best, proposal(found)) == ((), None, None)
    assert found.regions == ("left",)


@pytest.mark.parametrize(
    ("request_", "problem"),
    [
        (TradeoffRequest(region="roof"), "no region roof; the scene has left, right"),
        (TradeoffRequest(pair=("left", "left")), "target and background are both left"),
        (TradeoffRequest(wanted=Wanted(p_detection=0.5)), "name target and background"),
        (TradeoffRequest(exposures_s=(1.0,)), "every exposure that was tried saturates"),
    ],
)
def test_requests_that_cannot_be_met_are_refused(scene, request_, problem):
    with pytest.raises(ConfigError, match=problem):
        acquisition_tradeoff(scene, None, request_)


def test_the_filling_exposure_fills_the_sensor(scene):
    sessions = SceneSessions(scene, None)
    predicted = ScenePredictor(scene, None).predictions(
        {"acquisition.exposure_ms": sessions.filling_exposure_s(share=0.5) * 1e3}
    )
    brightest = max(float(one.channels.mean_dn.max()) for one in predicted.values())
    # The brightest of eight angles is within cos(11.25 deg)^2 of the brightest of all.
    assert brightest == pytest.approx(0.5 * 4095, rel=0.04)


@pytest.mark.parametrize("take", [{}, {"order": "palindrome"}, {"exposure_ms": "auto"}, {"bracket": [1, 2]}])
def test_a_session_is_given_the_cycles_that_reach_a_target(scene, take):
    chosen, lines = with_cycles_for(session(**take), scene, None, target_dolp_sigma=TARGET)
    dark, frames = chosen.take
    assert dark.cycles == 1
    assert frames.cycles > 1
    assert len(lines) == 1
    assert lines[0].startswith(f"{frames.cycles} cycles of 4 angles")


@pytest.mark.parametrize(
    ("take", "target", "problem"),
    [
        ({"order": "grouped"}, TARGET, "grouped"),
        ({"exposure_ms": 1000.0}, TARGET, "saturated"),
        ({}, 1e-6, "not within 100000 cycles"),
        ({}, -1.0, "above 0"),
    ],
)
def test_a_target_that_cannot_be_met_is_refused(scene, take, target, problem):
    with pytest.raises(ConfigError, match=rf"--target-dolp-sigma: .*{problem}"):
        with_cycles_for(session(**take), scene, None, target_dolp_sigma=target)


def test_a_session_without_scene_frames_has_no_target(scene):
    darks = SessionFile.model_validate({"name": "s", "take": [{"kind": "dark", "exposure_ms": 1}]})
    with pytest.raises(ConfigError, match="takes no scene frames"):
        with_cycles_for(darks, scene, None, target_dolp_sigma=TARGET)


@pytest.fixture
def scene_path(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(SMALL_SCENE)
    return path


def test_the_command_prints_tables_and_writes_files(scene_path, tmp_path, capsys):
    words = ["tradeoff", str(scene_path), "--acquisition", "--target-dolp-sigma", str(TARGET), "--pair", "left,right"]
    assert cli.main([*words, "--out", str(tmp_path / "out")]) == 0
    shown = capsys.readouterr().out
    assert "total error of DoLP after n cycles" in shown
    assert 'order = "' in shown
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        f"acquisition.{end}" for end in ("csv", "json", "png")
    }


@pytest.mark.parametrize("option", [("--pair", "left"), ("--pixels", "0"), ("--settling-time-ms", "-1")])
def test_options_out_of_range_are_refused(scene_path, capsys, option):
    assert cli.main(["tradeoff", str(scene_path), "--acquisition", *option]) == EXIT_USAGE
    assert "--" in capsys.readouterr().err
    with pytest.raises(ValueError, match="overhead"):
        acquisition_tradeoff(load_scene(scene_path), None, TradeoffRequest(overhead_s=-1e-3))
