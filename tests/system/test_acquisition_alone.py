"""The installation for acquisition alone: sessions are taken and checked without what only reports need."""

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.rigctl.example_files import EXAMPLES

ROOT = Path(__file__).parents[2]
# Without these, as if they were not installed, some command lines: their exit codes and what they say of failures.
_PROGRAM = """
import contextlib, io, json, sys
left_out, lines = json.loads(sys.argv[1])
class LeftOut:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in left_out:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name.partition(".")[0])
sys.meta_path.insert(0, LeftOut())
from rigctl import cli
found = []
for line in lines:
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as said:
        found.append((cli.main(line), said.getvalue()))
print(json.dumps(found))
"""


def _left_out() -> list[str]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    group = project["dependency-groups"]["acquisition"]
    assert set(group) <= set(project["project"]["dependencies"])
    return sorted(line.split(">=")[0] for line in set(project["project"]["dependencies"]) - set(group))


@pytest.mark.slow
def test_a_session_imports_no_modules_of_reports(tmp_path: Path) -> None:
    rig, session, run = str(EXAMPLES / "rig-sim.toml"), str(EXAMPLES / "session.toml"), str(tmp_path / "run")
    lines = [
        ["doctor", "--help"],
        ["plan", rig, session],
        ["acquire", rig, session, "--out", run],
        ["verify", run],
        ["status", run],
        ["status", run, "--log"],
        ["predict", str(EXAMPLES / "scene-panels.toml")],
        ["status", run, "--page", str(tmp_path / "page.html")],
    ]
    program = [sys.executable, "-c", _PROGRAM, json.dumps([_left_out(), lines])]
    done = subprocess.run(program, capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    assert [code for code, _ in found] == [0] * (len(lines) - 1) + [2]
    assert "needs matplotlib" in found[-1][1]
    assert f"pip install {' '.join(_left_out())}" in found[-1][1]
