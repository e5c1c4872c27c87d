"""The number of cycles that a target asks for, on a simulated rig."""

import numpy as np
import pytest

from rigctl.cli import main
from rigctl.errors import ConfigError
from rigctl.files.regions import masks
from rigctl.files.scene_file import load_scene
from rigctl.measure.measure import measure, signal_of_cycle
from rigctl.runs.folder import read_run
from rigctl.session.preparation import with_target
from rigctl.session.take import take_session
from tests.rigctl.example_files import EXAMPLES, SMALL_SCENE, small_rig, small_session

TARGET = 0.008


def dolp(channels, plan):
    s0, s1, s2 = np.einsum("ij,jhw->ihw", plan.inverse, channels)
    return np.hypot(s1, s2) / s0


def test_frames_of_the_cycles_chosen_have_the_noise_that_was_asked_for(tmp_path):
    rig_file = small_rig(tmp_path)
    scene = load_scene(tmp_path / "scene.toml")
    chosen, _ = with_target(small_session(), None, scene=tmp_path / "scene.toml", target_dolp_sigma=TARGET)
    cycles = chosen.take[1].cycles
    assert cycles > 2
    # Twice the cycles: what differs between the two halves is noise, and neither texture nor fixed pattern.
    take_session(rig_file, small_session(cycles=2 * cycles), tmp_path / "run", files={})
    measured = measure(read_run(tmp_path / "run"), regions=list(scene.regions))
    signals = [signal_of_cycle(measured, cycle) for cycle in range(2 * cycles)]
    halves = [dolp(np.mean(half, axis=0), measured.plan) for half in (signals[:cycles], signals[cycles:])]
    inside = masks(list(scene.regions), width=96, height=48)
    noise = {name: np.std((halves[0] - halves[1])[mask]) / np.sqrt(2.0) for name, mask in inside.items()}
    # 1600 pixels know their deviation to 1 / sqrt(2 * 1600) = 1.8 %; five of them. One cycle fewer is not enough.
    assert max(noise.values()) < TARGET * (1.0 + 5 * 0.018)
    assert max(noise.values()) > TARGET * np.sqrt((cycles - 1) / cycles) * (1.0 - 5 * 0.018)


def test_one_option_without_the_other_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="give both, or neither"):
        with_target(small_session(), None, scene=None, target_dolp_sigma=TARGET)


def test_without_a_target_the_session_stays_as_it_is():
    session = small_session()
    assert with_target(session, None, scene=None, target_dolp_sigma=None) == (session, ())


def test_a_dry_run_says_how_many_cycles_it_would_take(capsys):
    files = [str(EXAMPLES / name) for name in ("rig-sim.toml", "session.toml")]
    options = ["--out", "run", "--dry-run", "--scene", str(EXAMPLES / "scene-panels.toml")]
    assert main(["acquire", *files, *options, "--target-dolp-sigma", "0.01"]) == 0
    assert "4 cycles of 4 angles" in capsys.readouterr().err


def test_the_verb_proposes_a_session(tmp_path, capsys):
    (tmp_path / "scene.toml").write_text(SMALL_SCENE)
    out = tmp_path / "out"
    words = ["tradeoff", str(tmp_path / "scene.toml"), "--acquisition", "--region", "left", "--out", str(out)]
    assert main([*words, "--target-dolp-sigma", str(TARGET)]) == 0
    assert "shortest: " in capsys.readouterr().out
    assert (out / "acquisition.csv").exists()
