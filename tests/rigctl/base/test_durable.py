"""Files that were found may be anything: a folder, a pipe, a link to nowhere, six gigabytes of nothing."""

import ast
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from urllib.request import HTTPCookieProcessor, build_opener

import pytest

import rigctl
from rigctl.base.durable import read_bounded
from tests.rigctl.example_files import EXAMPLES

_ROOT = Path(rigctl.__file__).parent
# Where a file is of this program or of the system, and not found: its place in the tree, what is read.
_OF_OURS = {
    "base/durable.py": "path.open",
    "mapped.py": "source.read_bytes",
    "paper/statements.py": "(files('rigctl') / 'data' / 'paper.toml').read_text",
    "report/files.py": "(files('rigctl') / 'data' / 'report.html.j2').read_text",
    "scene/light.py": "source.read_bytes",
    "scene/sun.py": "(files('rigctl') / 'data' / 'astm-g173-extraterrestrial.csv').read_text",
    "verbs/new.py": "(files('rigctl') / 'data' / 'examples' / name).read_text",
    "web/page.py": "files('rigctl').joinpath('data', 'web', name).read_bytes",
}
_READS = {"read_bytes", "read_text", "fromfile", "imread", "loadtxt", "genfromtxt", "memmap"}


def _reads(file: Path) -> list[str]:
    """Return the calls of a module that read a file by its path."""
    found = []
    for call in (node for node in ast.walk(ast.parse(file.read_text())) if isinstance(node, ast.Call)):
        name = ast.unparse(call.func)
        last = name.rpartition(".")[2]
        said = [ast.unparse(one) for one in (*call.args, *(keyword.value for keyword in call.keywords))]
        is_written = any(one.strip("'").rstrip("b+t") in ("w", "a", "x") for one in said)
        if last in _READS or (last == "open" and not is_written):
            found.append(name)
    return found


def test_files_that_were_found_are_read_through_the_bounded_reader_alone():
    others = {"os.open", "webbrowser.open", "fits.open", "archive.open", "np.loadtxt"}
    wrong = {}
    for file in sorted(_ROOT.rglob("*.py")):
        place = file.relative_to(_ROOT).as_posix()
        found = [name for name in _reads(file) if name not in others and name != _OF_OURS.get(place)]
        if found:
            wrong[place] = found
    assert not wrong, "read them with rigctl.base.durable.read_bounded or open_plain"


def test_a_file_is_judged_before_it_is_read(tmp_path):
    with (tmp_path / "sparse").open("wb") as file:
        file.truncate(2**33)
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    said = {"sparse": "8590 MB", "pipe": "not a plain file", "folder": "is a folder", "link": "No such file"}
    for name, words in said.items():
        with pytest.raises(OSError, match=words):
            read_bounded(tmp_path / name, 1_000_000)


def test_a_page_of_a_rig_passes_over_what_is_no_session_and_no_run(tmp_path: Path) -> None:
    for odd in ("one.toml", "two.json"):
        (tmp_path / f".#{odd}").symlink_to(tmp_path / "nowhere")
        (tmp_path / f"folder-{odd}").mkdir()
        os.mkfifo(tmp_path / f"pipe-{odd}")
        with (tmp_path / f"sparse-{odd}").open("wb") as file:
            file.truncate(6 * 2**30)
    for name in ("session.json", "manifest.jsonl"):
        (tmp_path / f"of-{name}").mkdir()
        os.mkfifo(tmp_path / f"of-{name}" / name)
    (tmp_path / "session.toml").write_text("[[take]]")
    shutil.copy(EXAMPLES / "rig-sim.toml", tmp_path)
    with subprocess.Popen(
        [sys.executable, "-m", "rigctl", "serve", "rig-sim.toml", "--json"], cwd=tmp_path, stdout=subprocess.PIPE
    ) as page:
        try:
            address = json.loads(page.stdout.readline())["act_url"].replace("?", "api/state?")
            opener = build_opener(HTTPCookieProcessor())
            # The token becomes a cookie, and the way back to the state stays.
            told = json.loads(opener.open(address, timeout=60).read())
        finally:
            page.terminate()
    assert told["sessions"] == ["session.toml"]
    assert told["runs"] == []
