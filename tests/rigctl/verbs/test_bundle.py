"""A bundle of a run tells what is needed to find a fault, and no secrets."""

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
from astropy.io import fits

from rigctl.errors import RunFolderError
from rigctl.files.rig_file import load_rig
from rigctl.runs.folder import read_run
from rigctl.runs.writer import RunWriter
from rigctl.session.take import take_session
from rigctl.verbs.bundle import Scrubber, bundle
from tests.rigctl.example_files import small_rig_text, small_session

# Planted below; none may be found in what is passed on.
SECRETS = (
    "hooks.example.org",
    "T0P-SECRET",
    "hunter2",
    "sesame",
    "s3cr3t",
    "jane.doe",
    "janedoe",
    "lab-machine-7",
    "eyJhbGciOi",
    "opensaysme",
)
SCRUBBER = Scrubber(names=(("janedoe", "USER"), ("lab-machine-7", "MACHINE")))


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a run with secrets in its files, its events and its frames."""
    monkeypatch.setattr("rigctl.verbs.bundle.getpass.getuser", lambda: "janedoe")
    monkeypatch.setattr("rigctl.verbs.bundle.platform.node", lambda: "lab-machine-7.example.org")
    text = small_rig_text(tmp_path)
    text += """
[notify]
webhook = "https://hooks.example.org/services/T0P-SECRET"
command = [
    "curl", "-u", "janedoe:hunter2",
    "sesame",
]
[[monitors]]
name = "air"
driver = "command"
options = { command = ["weather", "--password", "opensaysme"], unit = "K" }
# asked by jane.doe@example.org; token: s3cr3t
"""
    (tmp_path / "rig.toml").write_text(text)
    path = tmp_path / "run"
    take_session(load_rig(tmp_path / "rig.toml"), small_session(), path, files={"rig": tmp_path / "rig.toml"})
    with RunWriter.append(path) as writer:
        writer.event("failed", message="ftp://janedoe:hunter2@lab-machine-7/x", file="/home/janedoe/rigs/rig.toml")
        writer.event("noted", text="Authorization: Bearer eyJhbGciOi.abc", password="s3cr3t", host="lab-machine-7")
        record = read_run(path).frames[0]
        writer.write_frame(
            type(record)(
                kind="scene",
                sequence=writer.next_sequence,
                bit_depth=12,
                saturation_dn=4095.0,
                source_file="/home/janedoe/a.fits",
                remarks=("seen by jane.doe@example.org", "api_key=s3cr3t"),
            ),
            np.zeros((4, 4), dtype=np.uint16),
        )
    return path


def contents(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        return {name: archive.read(name) for name in archive.namelist()}


def test_nothing_secret_is_in_it(run: Path, tmp_path: Path) -> None:
    found = bundle(run, out=tmp_path / "fault.zip", frames=11)
    assert found.frames == 11
    for name, content in contents(tmp_path / "fault.zip").items():
        text = name + content.decode("latin-1")
        leaked = [secret for secret in SECRETS if secret.lower() in text.lower()]
        assert leaked == [], name


def test_a_bundle_contains_the_files_of_a_fault_report(run: Path, tmp_path: Path) -> None:
    bundle(run, out=tmp_path / "fault.zip", frames=2)
    found = contents(tmp_path / "fault.zip")
    assert {"session.json", "events.jsonl", "manifest.jsonl", "versions.json", "verify.txt", "doctor.txt"} <= set(found)
    session = json.loads(found["session.json"])["session"]
    assert session["rig"]["notify"] is None  # a run never keeps where notices go
    assert session["rig"]["stage"]["driver"] == "ellx"
    assert session["rig"]["monitors"][0]["options"]["unit"] == "K"
    events = [json.loads(line) for line in found["events.jsonl"].splitlines()]
    assert [event["event"] for event in events].count("homed") == 1
    assert b"sense = -1" in found["inputs/rig.toml"]
    assert b"rigctl" in found["versions.json"]
    assert b"11 frames" in found["verify.txt"]
    assert b"left out" in found["README.txt"].lower()
    frames = sorted(name for name in found if name.startswith("frames/"))
    assert frames == ["frames/000000_dark.fits", "frames/000010_scene.fits"]
    (tmp_path / "first.fits").write_bytes(found[frames[0]])
    record = read_run(run).frames[0]
    with fits.open(tmp_path / "first.fits", checksum=True) as opened:
        np.testing.assert_array_equal(opened[0].data, read_run(run).counts(record))


def test_a_damaged_run_can_be_bundled(run: Path, tmp_path: Path) -> None:
    with (run / "manifest.jsonl").open("a") as file:
        file.write("hunter2 janedoe {\n")
    found = bundle(run, out=tmp_path / "fault.zip", frames=3)
    assert found.frames == 0
    packed = contents(tmp_path / "fault.zip")
    assert b"janedoe" not in packed["manifest.jsonl"]
    assert b"manifest.jsonl" in packed["verify.txt"]


def test_a_folder_that_is_no_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RunFolderError, match="not a run folder"):
        bundle(tmp_path, out=tmp_path / "fault.zip", frames=1)
    assert not (tmp_path / "fault.zip").exists()


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("https://example.org/x?token=abc end", "left out end"),
        ("/home/janedoe/runs/a", "/home/USER/runs/a"),
        ("janedoe-laptop on lab-machine-7", "USER-laptop on MACHINE"),
        ("janedoes", "janedoes"),
        ('{"api_token": "abc def", "n": 3}', '{"api_token": left out, "n": 3}'),
        ("password=abc;next", "password=left out;next"),
        ("exposure 3 ms, gain 0 dB", "exposure 3 ms, gain 0 dB"),
        ("sha256 " + "ab" * 32, "sha256 " + "ab" * 32),
    ],
)
def test_words_that_are_taken_out_and_words_that_stay(text: str, told: str) -> None:
    assert SCRUBBER.text(text) == told
