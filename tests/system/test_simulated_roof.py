"""A simulated roof, from rig file to comparison: a part of the trial `benchmarks.trials.roof`."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.trials.roof import one_run, roof_comparison
from rigctl.cli import main
from rigctl.session import preparation

# Of some hundred rows: as one in a thousand seeds has it.
_LARGEST = 4.5


@pytest.mark.slow
@pytest.mark.parametrize("hour", ["noon", "morning"])
def test_a_run_agrees_with_the_scene_that_made_it(hour):
    outcome = one_run(hour, 3, perturb=None)
    z = np.array(list(outcome.z.values()))
    assert outcome.agrees
    assert np.max(np.abs(z)) < _LARGEST
    # Rows share pixels: their spread scatters more than that of so many independent ones.
    assert 0.6 < np.std(z) < 1.4


def test_every_report_says_which_sun_and_what_it_proves(tmp_path):
    found = roof_comparison(tmp_path, hour="morning", seed=3, perturb="drift", uncertain=False)
    assert any(remark.startswith("sun used: zenith 42.9") for remark in found.remarks)
    assert any("by the run's simulated clock" in remark for remark in found.remarks)
    assert any("computed by the same model" in text for text in found.not_tested)
    assert any("changed on purpose: drift" in text for text in found.not_tested)
    assert "drift of the light" in [check.name for check in found.flags]
    session = json.loads((tmp_path / "run" / "session.json").read_text())["session"]
    assert session["simulated_light"]["is_clocked"] is True
    assert session["rig"]["simulation"]["perturb"] == "drift"


def dry_run(tmp_path: Path, *options: str) -> int:
    examples = Path(__file__).parents[2] / "examples"
    arguments = ["acquire", str(examples / "rig-roof.toml"), str(examples / "session-roof.toml"), "--dry-run"]
    return main([*arguments, "--out", str(tmp_path / "run"), *options])


def test_a_dry_run_refuses_the_night(tmp_path, capsys):
    assert dry_run(tmp_path, "--clock", "2010-05-25T04:00Z") == 2
    assert "no light" in capsys.readouterr().err


def test_a_dry_run_refuses_a_folder_that_holds_something(tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "note.txt").write_text("mine")
    assert dry_run(tmp_path, "--clock", "2010-05-25T17:07Z") == 4


_REAL_STAGE, _REAL_CAMERA = ("sim:ellx?speed=20", "/dev/ttyUSB0"), ("sim:gc780", "gige:192.168.0.5")


@pytest.mark.parametrize("others", [("--dry-run",), ()], ids=["rehearsed", "taken"])
# A real stage before a simulated camera is refused where the rig file is read.
@pytest.mark.parametrize("changes", [(_REAL_STAGE, _REAL_CAMERA), (_REAL_CAMERA,)])
def test_a_real_rig_has_no_clock_to_choose(tmp_path, capsys, monkeypatch, changes, others):
    monkeypatch.setattr(preparation, "open_rig", lambda *_, **__: pytest.fail("devices were opened"))
    examples = Path(__file__).parents[2] / "examples"
    text = (examples / "rig-sim.toml").read_text()
    text = text.partition("\n[simulation]")[0] if len(changes) > 1 else text
    for simulated, real in changes:
        text = text.replace(simulated, real)
    rig = tmp_path / "rig.toml"
    rig.write_text(text)
    out = tmp_path / "run"
    arguments = ["acquire", str(rig), str(examples / "session.toml"), "--out", str(out), *others]
    assert main([*arguments, "--clock", "2010-05-25T17:07Z"]) == 2
    said = capsys.readouterr().err
    assert "--clock" in said
    assert all(real in said for _, real in changes)
    assert not out.exists()
