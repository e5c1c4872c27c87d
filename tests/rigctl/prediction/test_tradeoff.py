"""Choices of the paper, and a user's, beside ours."""

import csv
import io
import json
import re

import numpy as np
import pytest

from model.accuracy.chain import evaluate
from model.accuracy.plan import NUMERICAL_SETTINGS, settings_at
from model.acquisition import Disturbances, Wanted
from rigctl import cli
from rigctl.console import EXIT_USAGE
from rigctl.errors import ConfigError
from rigctl.files.scene_file import load_scene
from rigctl.files.session_file import SessionFile
from rigctl.prediction.predict import ScenePredictor
from rigctl.prediction.sessions import SceneSessions, TradeoffRequest, acquisition_tradeoff
from rigctl.prediction.tradeoff import (
    WHOLE_CHAIN,
    CurvePoint,
    Curves,
    NamedChoice,
    faster_and_better,
    named_choices,
    settings_by,
)
from rigctl.report.tradeoff import (
    points_table,
    proposal,
    reached_table,
    tradeoff_json,
    tradeoff_picture,
    ways_table,
)
from rigctl.session.forecast import with_cycles_for
from tests.hard_cases.cases import HARD_CASES
from tests.rigctl.example_files import EXAMPLES, SMALL_SCENE
from tests.rigctl.scene_texts import written

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
    rows = list(csv.DictReader(io.StringIO(points_table(found).csv())))
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
        (TradeoffRequest(wanted=Wanted(p_detection=0.5)), "needs target and background"),
        (TradeoffRequest(exposures_s=(1.0,)), "every tried exposure saturates"),
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


# Every radiance is given: no sky is solved, and the knobs of the light have no error.
PANELS = str(EXAMPLES / "scene-panels.toml")


def test_curves_choices_and_floor_are_written(tmp_path, capsys):
    assert cli.main(["tradeoff", PANELS, "--tolerances", "0.01,0.001", "--out", str(tmp_path)]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith(
        "The inputs have no uncertainty, so every tolerance buys something: --tolerance 0.001 costs"
    )
    assert "worth having" in shown
    assert {"tradeoff.png", "settings.png", "stages.png"} <= {one.name for one in tmp_path.iterdir()}
    rows = list(csv.DictReader((tmp_path / "tradeoff.csv").read_text().splitlines()))
    assert [row["setting"] for row in rows if row["knob"] == "whole chain"] == ["tolerance 0.01", "tolerance 0.001"]
    assert all(float(row["true_error"]) <= 0.001 for row in rows)
    assert (tmp_path / "tradeoff.png").read_bytes().startswith(b"\x89PNG")
    assert len(json.loads((tmp_path / "tradeoff.json").read_text())["choices"]) == 2


def test_wide_shows_each_setting_and_the_floor(capsys):
    assert cli.main(["tradeoff", PANELS, "--tolerances", "0.01", "--wide"]) == 0
    shown = capsys.readouterr().out
    assert "what --tolerance chooses" in shown
    assert "stated without uncertainty: no floor" in shown


def test_uncertain_inputs_say_which_tolerance_is_worth_having(capsys):
    assert cli.main(["tradeoff", str(EXAMPLES / "scene-panels-uncertain.toml"), "--tolerances", "0.1,0.001"]) == 0
    first, _, *rows = capsys.readouterr().out.splitlines()
    floor = float(re.match(r"A tolerance below (\S+) buys nothing for DoLP", first)[1])
    (worth,) = [float(row.split()[1]) for row in rows if "worth having" in row]
    assert worth <= floor
    assert all(len(row.rstrip()) <= 80 for row in rows if row.startswith("--tolerance"))


def test_a_prediction_to_a_tolerance_says_its_error(capsys):
    assert cli.main(["predict", PANELS, "--tolerance", "0.001", "--json"]) == 0
    accuracy = json.loads(capsys.readouterr().out)["accuracy"]
    # Effects that are left out have their share of it.
    assert 0.0005 <= accuracy["tolerance"] <= 0.001
    assert all(one["error"] <= 0.001 for one in accuracy["estimated_errors"])
    assert accuracy["not_promised"] == {}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["tradeoff", "--tolerances", "0.5"], "--tolerances"),
        (["tradeoff", "--tolerances", "1e-9"], "--tolerances"),
        (["tradeoff", "--tolerances", "fine"], "--tolerances"),
        (["tradeoff", "--target-dolp-sigma", "0.002"], "--acquisition"),
        (["predict", "--tolerance", "0.5"], "--tolerance. Must be <= 0.1"),
    ],
)
def test_options_that_cannot_be_are_refused(arguments, words, capsys):
    assert cli.main([arguments[0], PANELS, *arguments[1:]]) == 2
    assert words in capsys.readouterr().err


SETTINGS = settings_at(dict.fromkeys(NUMERICAL_SETTINGS, 1), 0.01)


def test_a_user_states_settings_by_name():
    found = settings_by("tiles_per_side=3, rule=midpoint,streams=6", SETTINGS)
    assert (found.tiles_per_side, found.tile_rule, found.solver.nodes) == (3, "midpoint", 6)
    assert found.wavelengths == SETTINGS.wavelengths


@pytest.mark.parametrize("text", ["tiles=3", "tiles_per_side", "tiles_per_side=0", "rule=simpson", "wavelengths=x"])
def test_what_cannot_be_read_is_refused_with_its_words(text):
    with pytest.raises(ConfigError, match="--also"):
        settings_by(text, SETTINGS)


def test_draws_and_first_order_stand_beside_the_exact_statistics(tmp_path):
    # A target hardly told from its background, where the paper's draws and its first order both show.
    case = next(one for one in HARD_CASES if one.name == "background as the target")
    scene = ScenePredictor(load_scene(written(tmp_path, case.text)), None).lit_scene()
    result = evaluate(scene, SETTINGS)
    truth = result.readings
    found = {one.name: one for one in named_choices(scene, SETTINGS, truth, ("wavelengths=1",))}
    assert found["wavelengths=1"].by_user
    assert found["K = 9 midpoint tiles"].error == 0.0
    first = found["first-order DoLP"]
    assert 1e-5 < first.error < 0.1
    assert first.reading is not None
    assert first.reading.quantity == "dolp_pixels"
    # Standard errors of a share of about 0.1 by so many draws; six of them, and the threshold's own.
    assert found["ROC of 1e6 draws"].error < 10.0 * (0.3 / 1e3)
    assert found["ROC of 1e3 draws"].error < 10.0 * (0.3 / 31.0)


@pytest.mark.parametrize(
    ("seconds", "error", "is_explained"),
    [
        (0.9, 2e-4, True),
        (0.9, 6e-4, False),
        (0.2, 1e-4, True),
        (0.2, 0.1, False),
        (3.0, 1e-5, False),
        (0.5, 0.0, False),
    ],
)
def test_a_choice_below_the_drawn_curve_of_tolerances_is_explained(seconds, error, is_explained):
    points = tuple(
        CurvePoint(varied=WHOLE_CHAIN, level=level, seconds=time_s, true=true, estimated=0.1, whole=true)
        for level, time_s, true in (("tolerance 0.1", 0.4, 1e-2), ("tolerance 0.01", 0.8, 6e-4), ("0.003", 2.0, 1.9e-4))
    )
    curves = Curves(points=points, predictions=(), floor={}, reference_s=9.0)
    choice = NamedChoice(name="sky kept every 10 deg", seconds=seconds, error=error, reading=None)
    assert faster_and_better(choice, curves) is is_explained
