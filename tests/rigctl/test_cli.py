from pathlib import Path

import pytest

from drivers.errors import DeviceTimeoutError
from rigctl import cli
from rigctl.cli import HEADINGS, VERBS
from rigctl.errors import ConfigError, DataError
from tests.rigctl.example_files import EXAMPLES

GROUPS = [verb for verbs in HEADINGS.values() for verb, (target, _) in verbs.items() if target is None]


def _outcome_of(monkeypatch, error):
    """Run `rigctl stokes` where reading the command line raises."""

    def raising(called):
        raise error

    monkeypatch.setattr(cli, "make_app", raising)
    return cli.main(["stokes", "x"])


@pytest.mark.parametrize(
    ("error", "code"),
    [(ConfigError("key"), 2), (DeviceTimeoutError("stage"), 3), (DataError("damaged"), 4)],
)
def test_each_kind_of_failure_has_its_exit_code_and_its_words(monkeypatch, capsys, error, code):
    assert _outcome_of(monkeypatch, error) == code
    assert capsys.readouterr().err == f"rigctl: {error}\n"


def test_a_fault_of_our_own_is_one_line_and_a_log(monkeypatch, capsys):
    assert _outcome_of(monkeypatch, ZeroDivisionError("oops")) == 70
    text = capsys.readouterr().err
    assert text.count("\n") == 1
    assert "ZeroDivisionError: oops" in text
    log = Path(text.strip().rpartition(" ")[2])
    assert "Traceback" in log.read_text()
    log.unlink()


def test_an_interrupt_ends_with_130(monkeypatch):
    assert _outcome_of(monkeypatch, KeyboardInterrupt()) == 130


def test_help_names_every_verb(capsys):
    assert cli.main(["--help"]) == 0
    text = capsys.readouterr().out
    assert all(f"│ {verb} " in text for verb in VERBS if " " not in verb)


@pytest.mark.parametrize("verb", [verb for verb in VERBS if verb not in GROUPS])
def test_help_of_every_verb_has_an_example_and_a_line_for_each_option(capsys, verb):
    assert cli.main([*verb.split(), "--help"]) == 0
    text = capsys.readouterr().out
    assert "Example" in text
    assert f"rigctl {verb}" in text
    assert "default: False" not in text
    assert "default: ()" not in text
    app = cli.make_app(verb)
    for word in verb.split():
        app = app[word]
    found = app.assemble_argument_collection(parse_docstring=True)
    assert [argument.name for argument in found if argument.show and not argument.parameter.help] == []


def test_version_is_that_of_the_package(capsys):
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("rigctl 0.")


def test_wrong_files_are_one_message_with_all_problems_and_exit_2(tmp_path, capsys):
    (tmp_path / "rig.toml").write_text('name = "x"\n[stage]\ndriver = "ellx"\n[polarizer]\nsense = 2\n')
    code = cli.main(
        ["acquire", str(tmp_path / "rig.toml"), str(EXAMPLES / "session.toml"), "--out", str(tmp_path / "run")]
    )
    text = capsys.readouterr().err
    assert code == 2
    for problem in (
        "stage.port: is missing",
        "polarizer.sense",
        "polarizer.offset_deg: is missing",
        "camera: is missing",
    ):
        assert problem in text
    assert not (tmp_path / "run").exists()


def test_dry_run_prints_steps_time_and_disk_and_touches_nothing(tmp_path, capsys):
    out = tmp_path / "run"
    rig, session = EXAMPLES / "rig-sim.toml", EXAMPLES / "session.toml"
    assert cli.main(["acquire", str(rig), str(session), "--out", str(out), "--dry-run"]) == 0
    text = capsys.readouterr().out
    assert text.startswith("48 frames from ")
    assert ", about 0 min" in text
    assert "disk 44 MB" in text
    assert not out.exists()


def test_compare_wants_a_scene_or_regions(tmp_path, capsys):
    assert cli.main(["compare", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    assert "--regions" in capsys.readouterr().err
