"""The documented example of a plug-in keeps the promises that its documentation repeats."""

import importlib.util
import io
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from drivers.errors import DeviceTimeoutError, LimitError, NotConnectedError, ProtocolError
from drivers.interfaces import RotationStage
from drivers.serial_port import UDEV_RULE

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "examples" / "plugin-stage"


@pytest.fixture(scope="module")
def module() -> ModuleType:
    name, _, _ = entry_point().partition(":")
    spec = importlib.util.spec_from_file_location(name, FOLDER / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


def entry_point() -> str:
    content = tomllib.loads((FOLDER / "pyproject.toml").read_text())
    text: str = content["project"]["entry-points"]["rigctl.stages"]["hand"]
    return text


Answer = Callable[[str], RotationStage]


@pytest.fixture
def answering(module: ModuleType) -> Answer:
    """A mount whose person gives these answers."""

    def make(answers: str) -> RotationStage:
        stage: RotationStage = module.HandStage(
            io.StringIO(), io.StringIO(answers), tolerance_deg=0.05, now_s=lambda: 0.0
        )
        return stage

    return make


def test_the_entry_point_names_a_function_that_is_there(module: ModuleType) -> None:
    assert callable(getattr(module, entry_point().partition(":")[2]))


def test_moves_and_reads_back(answering: Answer) -> None:
    stage = answering("\n0\n\n45\n")
    stage.home()
    move = stage.move_to(45.0)
    assert (move.position.angle_deg, move.tries) == (45.0, 1)


def test_a_scale_that_is_off_is_asked_for_again_and_then_refused(answering: Answer) -> None:
    stage = answering("\n0\n" + "\n44\n" * 3)
    stage.home()
    with pytest.raises(LimitError, match="scale says 44"):
        stage.move_to(45.0)


def test_refuses_to_move_before_it_is_homed(answering: Answer) -> None:
    with pytest.raises(LimitError, match="Home it first"):
        answering("").move_to(45.0)


def test_an_answer_that_is_no_angle(answering: Answer) -> None:
    with pytest.raises(ProtocolError, match="'forty'"):
        answering("forty\n").position()


def test_nobody_answers(answering: Answer) -> None:
    with pytest.raises(DeviceTimeoutError):
        answering("").position()


def test_a_closed_one_says_so(answering: Answer) -> None:
    stage = answering("0\n")
    stage.close()
    stage.close()
    with pytest.raises(NotConnectedError, match="closed"):
        stage.position()


def test_a_terminal_that_is_not_there(module: ModuleType) -> None:
    with pytest.raises(NotConnectedError, match="cannot be opened"):
        module.open_hand("/nowhere/tty")


def test_the_documentation_prints_the_rule_that_the_program_prints() -> None:
    assert UDEV_RULE in (ROOT / "docs" / "plug-ins.md").read_text()


def test_every_method_of_the_interface_is_in_the_documentation() -> None:
    text = (ROOT / "docs" / "plug-ins.md").read_text()
    methods = [name for name in vars(RotationStage) if not name.startswith("_")]
    assert [name for name in methods if not re.search(rf"`{name}\(", text)] == []
