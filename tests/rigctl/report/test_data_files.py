"""Tests of reports without absolute paths, and of those that are given to others."""

import json
from pathlib import Path

from rigctl import cli
from rigctl.report.data_files import told_places
from tests.monkey.workspace import make_workspace


def test_absolute_paths_are_relative_to_the_working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert told_places({"run": f"{tmp_path}/runs/a", "n": 2}, anonymous=False) == {"run": "runs/a", "n": 2}


def test_an_anonymous_report_names_no_folder_serial_number_or_site():
    told = told_places({"path": "/home/ann/a.toml", "camera_serial": "11", "rig": {"site": {"x": 1}}}, anonymous=True)
    assert told == {"path": "a.toml", "camera_serial": "left out", "rig": {"site": "left out"}}


def test_a_comparison_can_be_anonymous(tmp_path, capsys):
    folder = make_workspace(tmp_path / "ann")
    words = [str(folder / "run"), "--scene", str(folder / "scene.toml"), "--out", str(tmp_path / "out")]
    assert cli.main(["compare", *words, "--json", "--anonymous"]) in (0, 5)
    provenance = json.loads(capsys.readouterr().out)["provenance"]
    assert str(tmp_path) not in json.dumps(provenance)
    assert provenance["run"]["path"] == "run"
    assert str(Path(tmp_path)) not in next((tmp_path / "out").glob("*.html")).read_text()
