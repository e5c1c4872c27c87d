"""300 cases of the monkey in one process; each case that ever failed is a row of its own."""

import shutil
from pathlib import Path

import pytest

from rigctl.cli import VERBS
from tests.monkey.cases import HEAVY, QUICK, SERVING, SLOW, Case, make_case
from tests.monkey.judge import problems_of
from tests.monkey.workspace import make_workspace

_CASES, _CHUNKS = 300, 12


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_workspace(tmp_path_factory.mktemp("monkey") / "sound")


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("chunk", range(_CHUNKS))
def test_no_input_ends_in_a_fault_of_ours(tmp_path, sound, chunk):
    bad = {}
    for seed in range(chunk, _CASES, _CHUNKS):
        folder = Path(shutil.copytree(sound, tmp_path / str(seed)))
        case = make_case(seed, folder, is_patient=False)
        problems = problems_of(case, folder)
        if problems:
            bad[seed] = (case, problems)
    assert not bad


@pytest.mark.parametrize(
    ("file", "content", "arguments"),
    [
        ("", b"", ["plan", "rig.toml", "session.toml", "--at", "9999-12-31T23:59Z"]),
        ("", b"", ["plan", "rig.toml", "session.toml", "--at", "0001-01-01T00:00+14:00"]),
        ("", b"", ["plan", "rig.toml", "session.toml", "--frame", "9" * 5000 + "x1"]),
        ("", b"", ["tradeoff", "scene.toml", "--acquisition", "--drift-percent-per-min", "1e300"]),
        ("", b"", ["calibrate", "axis", "run", "--reference-deg", "1e300", "--out", "OUT.json"]),
        ("run/status.json", b"1", ["status", "run"]),
        ("run/status.json", b'{"angles": 3}', ["status", "run"]),
        ("run/status.json", b'{"regions": {"a": {}}}', ["status", "run"]),
        ("run/events.jsonl", b'{"event": "x", "utc": 5}\n', ["status", "--log", "run"]),
        ("run/events.jsonl", b'{"event": "x", "utc": "\\u001b[2J"}\n', ["status", "--log", "run"]),
        ("", b"", ["predict", "scene.toml", "--write-truth", "OUT.toml", "--set", "nan"]),
        ("", b"", ["acquire", "rig.toml", "session.toml", "--out", "run"]),
        ("", b"", ["sim", "stage", "sim:ellx", "--link", "link", "--truth", "session.toml"]),
        ("", b"", ["predict", "loop"]),
        ("", b"", ["verify", "loop", "--json"]),
        ("noise.json", b'{"schema_version": 2, "prnu": {"value": 1e40, "std_error": 0}}',
         ["predict", "scene.toml", "--noise", "noise.json"]),
    ],
)  # fmt: skip
def test_what_was_found_once_is_found_no_more(tmp_path, sound, file, content, arguments):
    folder = Path(shutil.copytree(sound, tmp_path / "case"))
    (folder / "loop").symlink_to("loop")
    if file:
        (folder / file).write_bytes(content)
    assert problems_of(Case(arguments=arguments, done=file), folder) == []


@pytest.mark.parametrize("arguments", SERVING, ids=lambda words: " ".join(words)[:60].replace("\0", "0"))
def test_what_serves_refuses_a_mistake_at_once(tmp_path, sound, arguments):
    folder = Path(shutil.copytree(sound, tmp_path / "case"))
    assert problems_of(Case(arguments=arguments, done=""), folder) == []


def test_every_command_is_tried():
    lines = (*QUICK, *SLOW, *HEAVY, *SERVING)
    wanted = [verb.split() for verb in VERBS]
    assert [words for words in wanted if not any(line[: len(words)] == words for line in lines)] == []


def test_the_same_seed_makes_the_same_case(tmp_path, sound):
    cases = [make_case(17, Path(shutil.copytree(sound, tmp_path / name))) for name in ("one", "two")]
    assert cases[0] == cases[1]
