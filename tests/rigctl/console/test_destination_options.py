"""Places of results: tried before the work, and what a person made is never replaced."""

import hashlib
import json

import numpy as np
import pytest

from rigctl import cli
from tests.rigctl.made_runs import at, make_run


@pytest.fixture(autouse=True)
def notes_of_their_own(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


def _write(path, *, level_dn):
    counts = np.full((6, 8), level_dn) + np.arange(8)
    make_run(path, [(at(angle_deg), counts + angle_deg) for angle_deg in (0, 45, 90, 135)])


@pytest.fixture
def desk(tmp_path, monkeypatch):
    """Return a folder with a run, and a file that a person made."""
    folder = tmp_path / "desk"
    folder.mkdir()
    _write(folder / "run", level_dn=100)
    (folder / "session.toml").write_text("# mine\n")
    monkeypatch.chdir(folder)
    return folder


def _tree(folder):
    return {str(f): hashlib.sha256(f.read_bytes()).hexdigest() for f in sorted(folder.rglob("*")) if f.is_file()}


_FILES = {
    "summary": ["summary", "run"],
    "noise": ["calibrate", "noise", "--run", "run"],
    "flat": ["calibrate", "flat", "run"],
    "axis": ["calibrate", "axis", "run", "--reference-deg", "0"],
    "registration": ["calibrate", "registration", "run"],
    "radiometric": ["calibrate", "radiometric", "run", "--panel", "white", "--scene", "no.toml"],
    "fit": ["fit", "surface", "no.toml"],
    "draw": ["regions", "draw", "run"],
    "stage": ["stage", "characterise", "no.toml"],
}
_FOLDERS = {
    "stokes": ["stokes", "run"],
    "detect": ["detect", "run", "--background", "a", "--target", "b"],
    "compare": ["compare", "run", "no.toml"],
    "sky": ["sky", "no.toml"],
    "surface": ["surface", "black-paint", "--sun-zenith-deg", "50"],
    "fig5": ["dolp", "fig5"],
    "tradeoff": ["tradeoff", "no.toml"],
    "predict": ["predict", "no.toml", "--sweep", "sun.zenith_deg=10:20:2"],
}
_NEW = {"export": ["export", "run", "--to", "tiff"], "acquire": ["acquire", "no.toml", "no.toml"]}


def _refused(words, out, said, desk, capsys):
    before = _tree(desk)
    assert cli.main([*words, "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert "--out" in error
    assert said in error
    assert _tree(desk) == before


@pytest.mark.parametrize("verb", _FILES)
@pytest.mark.parametrize(
    ("out", "said"),
    [
        ("session.toml", "not written by rigctl"),
        (".", "is a folder"),
        ("none/x.json", "does not exist"),
        ("run/x.json", "takes no results"),
        ("session.toml/x", "folder"),
        ("/proc/x.json", "cannot be written"),
        ("n" * 300, "File name too long"),
    ],
)
def test_a_file_that_cannot_be_made_is_refused_at_once(verb, out, said, desk, capsys):
    _refused(_FILES[verb], out, said, desk, capsys)


@pytest.mark.parametrize("verb", _FOLDERS)
@pytest.mark.parametrize(
    ("out", "said"),
    [
        ("session.toml", "is a file"),
        ("run", "takes no results"),
        ("run/x", "takes no results"),
        ("session.toml/x", "that is a file"),
        ("/proc/x", "cannot be written"),
        ("n" * 300, "File name too long"),
    ],
)
def test_a_folder_that_cannot_be_made_is_refused_at_once(verb, out, said, desk, capsys):
    _refused(_FOLDERS[verb], out, said, desk, capsys)


@pytest.mark.parametrize("verb", _NEW)
@pytest.mark.parametrize("out", ["session.toml", "session.toml/x", "/proc/x", "n" * 300])
def test_what_must_be_new_is_refused_at_once(verb, out, desk, capsys):
    _refused(_NEW[verb], out, "", desk, capsys)


def test_the_same_command_on_the_same_inputs_writes_again_and_another_needs_force(desk, capsys):
    words = ["stokes", "run", "--out", "images"]
    assert cli.main(words) == 0
    assert cli.main(words) == 0
    _write(desk / "other", level_dn=200)
    assert cli.main(["stokes", "other", "--out", "images"]) == 2
    assert "--force replaces it" in capsys.readouterr().err
    assert cli.main(["stokes", "other", "--out", "images", "--force"]) == 0


def test_a_result_that_a_person_has_changed_is_not_replaced_even_by_force(desk, capsys):
    assert cli.main(["stokes", "run", "--out", "images"]) == 0
    (desk / "images" / "stokes.json").write_text(json.dumps({"mine": 1}))
    assert cli.main(["stokes", "run", "--out", "images", "--force"]) == 2
    assert "was changed since rigctl wrote it" in capsys.readouterr().err


def test_a_file_of_a_person_in_the_folder_is_not_replaced_even_by_force(desk, capsys):
    (desk / "images").mkdir()
    (desk / "images" / "stokes.json").write_text("[]")
    assert cli.main(["stokes", "run", "--out", "images", "--force"]) == 2
    assert "was not written by rigctl" in capsys.readouterr().err
    assert (desk / "images" / "stokes.json").read_text() == "[]"


def test_a_summary_stands_beside_its_run(desk):
    assert cli.main(["summary", "run"]) == 0
    assert (desk / "run-summary.html").is_file()
    assert not (desk / "run" / "summary.html").exists()


def test_two_results_in_one_file_are_refused(desk, capsys):
    assert cli.main(["calibrate", "noise", "--run", "run", "--out", "x", "--plot", "x"]) == 2
    assert "another result goes there too" in capsys.readouterr().err
