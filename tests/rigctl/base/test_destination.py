"""Places of results: tried before the work, and what a person made is never replaced."""

import hashlib
import json
import os
import re
from fnmatch import fnmatch
from pathlib import Path

import numpy as np
import pytest

from rigctl import cli
from rigctl.cli import HEADINGS
from rigctl.errors import ConfigError
from rigctl.report.files import write_folder
from tests.rigctl.made_runs import at, make_run


@pytest.fixture(autouse=True)
def notes_of_their_own(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


def _write(path, *, level_dn):
    counts = np.full((6, 8), level_dn) + np.arange(8)
    make_run(path, [(at(angle_deg), counts + angle_deg) for angle_deg in (0, 45, 90, 135)])


@pytest.fixture(scope="module")
def refusing(tmp_path_factory):
    """Return a folder with a run, and things that a person made; nothing in it is ever changed."""
    folder = tmp_path_factory.mktemp("refusing")
    _write(folder / "run", level_dn=100)
    (folder / "session.toml").write_text("# mine\n")
    (folder / "link-to-mine").symlink_to("session.toml")
    (folder / "loop").symlink_to("loop")
    (folder / "broken-run" / "frames").mkdir(parents=True)
    (folder / "broken-run" / "session.json").write_text("{}")
    os.mkfifo(folder / "fifo")
    (folder / "into-run").symlink_to("run/frames")
    (folder / "full" / "stokes.json").mkdir(parents=True)
    return folder


@pytest.fixture
def desk(tmp_path, monkeypatch):
    """Return a folder with a run."""
    folder = tmp_path / "desk"
    folder.mkdir()
    _write(folder / "run", level_dn=100)
    monkeypatch.chdir(folder)
    return folder


def _tree(folder):
    return {
        str(f): hashlib.sha256(f.read_bytes()).hexdigest() if f.is_file() else "" for f in sorted(folder.rglob("*"))
    }


_DETECT = ["detect", "run", "--background", "a", "--target", "b"]
_NOISE = ["calibrate", "noise", "--run", "run"]
_AXIS = ["calibrate", "axis", "run", "--reference-deg", "0"]
# Every destination of every command: the option, and a command line that lacks it; by what it makes.
_FILES = {
    "axis": [*_AXIS, "--out"],
    "axis-maps": [*_AXIS, "--out", "a.json", "--maps"],
    "axis-report": [*_AXIS, "--out", "a.json", "--report"],
    "draw": ["regions", "draw", "run", "--out"],
    "find": ["regions", "find", "run", "no.toml", "--out"],
    "flat": ["calibrate", "flat", "run", "--out"],
    "mark": ["regions", "mark", "run", "no.toml", "--out"],
    "noise": [*_NOISE, "--out"],
    "noise-defects": [*_NOISE, "--out", "n.json", "--defects"],
    "noise-plot": [*_NOISE, "--out", "n.json", "--plot"],
    "noise-report": [*_NOISE, "--out", "n.json", "--report"],
    "picture": ["preview", "sim:gc780", "--frames", "1", "--picture"],
    "radiometric": ["calibrate", "radiometric", "run", "--panel", "white", "--scene", "no.toml", "--out"],
    "registration": ["calibrate", "registration", "run", "--out"],
    "stage": ["calibrate", "stage", "no.toml", "--out"],
    "stage-plot": ["calibrate", "stage", "no.toml", "--plot"],
    "page": ["status", "run", "--page"],
    "truth": ["predict", "no.toml", "--write-truth"],
    "true-angle": ["sim", "stage", "sim:ellx", "--link", "link", "--truth"],
}
_FOLDERS = {
    "compare": ["compare", "run", "no.toml", "--out"],
    "detect": [*_DETECT, "--out"],
    "doctor": ["doctor", "--folder"],
    "estimators": ["paper", "--estimators", "--out"],
    "infer": ["infer", "run", "no.toml", "--out"],
    "paper": ["paper", "--out"],
    "predict": ["sweep", "no.toml", "sun.zenith_deg=10:20:2", "--out"],
    "sky": ["sky", "no.toml", "--out"],
    "stokes": ["stokes", "run", "--out"],
    "surface": ["surface", "black-paint", "--sun-zenith-deg", "50", "--out"],
    "tradeoff": ["tradeoff", "no.toml", "--out"],
}
_NEW = {
    "acquire": ["acquire", "no.toml", "no.toml", "--out"],
    "demo": ["demo", "--out"],
    "new": ["new", "--simulated", "--no-input"],
}
_ABSENT = {
    "export": ["export", "run", "--to", "tiff", "--out"],
    "link": ["sim", "stage", "sim:ellx", "--link"],
}
_RUN = {"import": ["import", "--angles", "0", "--same-exposure", "--", "OUT", "session.toml"]}
_EDITED = {"write": [*_AXIS, "--out", "a.json", "--write"]}
# Of a command's paths, those that it reads.
_READ = {
    "at",
    "trace",
    "calibrations",
    "lens",
    "outlines",
    "root",
    "study",
    "pictures",
    "store",
    "used_by",
    "certificate", "emva", "file", "files", "flat", "generator", "digitised", "key", "materials", "more", "noise",
    "polarizer", "port", "radiometric", "regions", "register", "rig", "run", "runs", "paths", "scene", "session",
    "sessions",
    "start", "table",
}  # fmt: skip


def _rows(commands, mistakes):
    return [
        pytest.param(words, *row, id=f"{verb}-{row[0][:20]}") for verb, words in commands.items() for row in mistakes
    ]


_UNPLACEABLE = [("run/x", "does not accept results"), ("/proc/x", "cannot be written")]
# The same function judges all of a kind: one command of each stands for these.
_RARE = [("session.toml/x", "folder"), ("n" * 300, "File name too long"), ("loop", "Too many levels of symbolic links")]
_RARE_FILES = [
    ("none/x.json", "does not exist"),
    ("link-to-mine", "not written by rigctl"),
    ("fifo", "not a regular file"),
    ("/dev/full", "not a regular file"),
    ("broken-run/x", "does not accept results"),
]


@pytest.mark.parametrize(
    ("words", "out", "said"),
    [
        *_rows(_FILES, [*_UNPLACEABLE, ("session.toml", "not written by rigctl"), (".", "is a folder")]),
        *_rows({"find-rare": _FILES["find"], "noise-rare": _FILES["noise"]}, [*_RARE, *_RARE_FILES]),
        *_rows(_FOLDERS, [*_UNPLACEABLE, ("session.toml", "is a file"), ("run", "does not accept results")]),
        *_rows(
            {"stokes-rare": _FOLDERS["stokes"]},
            [*_RARE, ("into-run/x", "does not accept results"), ("full", "is a folder")],
        ),
        *_rows(_NEW, [*_UNPLACEABLE, ("session.toml", "is not a folder"), (".", "is not empty")]),
        *_rows({"acquire-rare": _NEW["acquire"]}, _RARE),
        *_rows(_ABSENT, [*_UNPLACEABLE, ("session.toml", "exists"), ("none/x", "does not exist")]),
        *_rows(
            _RUN,
            [*_UNPLACEABLE, ("session.toml", "is not a folder"), (".", "is not empty"), ("fifo", "is not a folder")],
        ),
        *_rows(_EDITED, [(".", "is a folder"), ("none.toml", "none.toml"), ("fifo", "not a regular file")]),
    ],
)
def test_a_place_that_does_not_do_is_refused_before_any_work(words, out, said, refusing, monkeypatch, capsys):
    monkeypatch.chdir(refusing)
    before = _tree(refusing)
    line = [out if word == "OUT" else word for word in words] if "OUT" in words else [*words, out]
    assert cli.main(line) == 2
    error = capsys.readouterr().err
    assert said in error
    assert words[-1] in error or not words[-1].startswith("--") or words[-1] in ("--no-input", "--write")
    assert _tree(refusing) == before


def test_every_destination_of_every_command_is_tried():
    paths, written = set(), set()
    for verb, function in functions().items():
        hints = {name: hint for name, hint in cli.hints_of(function).items() if name != "return"}
        paths |= {(verb, name) for name, hint in hints.items() if "Path" in str(hint)}
        written |= {(verb, name) for name in cli.destinations(function)}
    forgotten = {
        (verb, name)
        for verb, name in paths - written
        if name not in _READ and (name, verb.partition(" ")[0]) != ("folder", "calibrate")
    }
    assert forgotten == set()
    assert {name for _, name in paths} >= {"out", "run", "scene"}


def functions():
    """Return the functions of all verbs."""
    targets = {verb: target for verbs in HEADINGS.values() for verb, (target, _) in verbs.items()}
    return {verb: cli.function_of(verb) for verb, target in targets.items() if target is not None}


def test_every_file_of_a_result_folder_is_known_before_the_work():
    patterns = [
        name for one in functions().values() for place in cli.destinations(one).values() for name in place.names
    ]
    rigctl = Path(cli.__file__).parent
    sources = [*rigctl.glob("report/*.py"), rigctl / "archive" / "report.py", rigctl / "study.py"]
    names = {
        name for file in sources for name in re.findall(r'"([\w-]+\.(?:png|csv|json|html|pdf|fits))"', file.read_text())
    }
    assert len(names) > 20
    assert [name for name in sorted(names) if not any(fnmatch(name, one) for one in patterns)] == []


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


def test_a_result_that_no_table_names_is_not_replaced_either(tmp_path):
    (tmp_path / "new.json").write_text("[]")
    with pytest.raises(ConfigError, match=r"new\.json exists and was not written by rigctl"):
        write_folder(tmp_path, {"other.json": b"{}", "new.json": b"{}"})
    assert sorted(file.name for file in tmp_path.iterdir()) == ["new.json"]


def test_the_part_of_an_export_is_no_file_of_a_person(desk):
    (desk / "counts.h5.part").write_text("mine")
    assert cli.main(["export", "run", "--to", "tiff", "--out", "counts.h5"]) == 0
    assert (desk / "counts.h5.part").read_text() == "mine"


def test_a_way_out_of_a_run_is_no_place_within_it(desk):
    assert cli.main(["export", "run", "--to", "tiff", "--out", "run/../beside"]) == 0
    assert (desk / "beside").is_dir()


def test_two_results_in_one_file_are_refused(desk, capsys):
    assert cli.main(["calibrate", "noise", "--run", "run", "--out", "x", "--plot", "x"]) == 2
    assert "another result has the same place" in capsys.readouterr().err
