"""What people see while a sky is solved."""

import io
import threading

import pytest
from rich.console import Console

from rigctl.cli import main
from rigctl.console import terminal
from tests.hard_cases.cases import HARD_CASES


@pytest.fixture
def scene(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    # As if the air of a plain day were deep: truly deep air takes half a minute.
    monkeypatch.setattr(terminal, "_DEEP", 0.1)
    (tmp_path / "scene.toml").write_text(next(one.text for one in HARD_CASES if one.name == "plain: a material"))
    return str(tmp_path / "scene.toml")


@pytest.mark.parametrize(
    "words",
    [
        ("predict",),
        ("predict", "--tolerance", "0.1"),
        ("sweep", "sensor.f_number=2:2.5:2"),
        ("sky",),
    ],
    ids=" ".join,
)
def test_deep_air_is_not_solved_in_silence(scene, capsys, words):
    assert main([words[0], scene, *words[1:], "--json"]) == 0
    assert capsys.readouterr().err.count("each wavelength takes seconds to minutes") == 1


def test_on_a_terminal_a_bar_says_what_is_solved(monkeypatch):
    shown = io.StringIO()
    monkeypatch.setattr(terminal, "progress", lambda: Console(file=shown, force_terminal=True, width=100))
    with terminal.solving_shown() as tell:
        assert shown.getvalue() == ""
        tell(50.1)
    assert "sky 1, of optical depth 50.1" in shown.getvalue()
    assert "takes seconds" not in shown.getvalue()


def test_on_a_terminal_a_bar_is_shown_after_a_second_without_a_sky(monkeypatch):
    shown, waits = io.StringIO(), []

    class AtOnce(threading.Timer):
        def __init__(self, seconds, call):
            waits.append(seconds)
            super().__init__(0.0, call)

        def start(self):
            super().start()
            self.join()

    monkeypatch.setattr(terminal, "Timer", AtOnce)
    monkeypatch.setattr(terminal, "progress", lambda: Console(file=shown, force_terminal=True, width=100))
    with terminal.solving_shown():
        pass
    assert waits == [1.0]
    assert "computing" in shown.getvalue()
