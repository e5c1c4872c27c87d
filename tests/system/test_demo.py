"""The whole program as a newcomer runs it."""

import json
import os
import re
import subprocess
from pathlib import Path

import cv2
import pytest

from rigctl.cli import main
from rigctl.runs.folder import read_run
from rigctl.runs.records import read_events
from rigctl.verbs import demo
from sim_devices.camera import SimCamera
from tests.rigctl.example_files import SHORT_SESSION, SMALL_SCENE
from tests.sim_devices.cameras.gige_port import gige_port
from tests.system.programs import rigctl

_SHORT_NOISE = """
name = "noise"
[[take]]
kind = "dark"
exposure_ms = [0.002, 0.010, 0.022, 0.034, 0.060, 20, 60]
cycles = 2
[[take]]
kind = "flat"
exposure_ms = [0.002, 0.006, 0.010, 0.014, 0.018, 0.022, 0.026, 0.030, 0.034, 0.040, 0.046, 0.052, 0.060]
cycles = 2
"""
ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"


@pytest.fixture
def in_process(tmp_path, monkeypatch, capsys):
    """Gives what runs a command without an interpreter of its own, for what has none to prove: code, answer, errors."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        code = main([str(argument) for argument in arguments])
        streams = capsys.readouterr()
        return subprocess.CompletedProcess(arguments, code, streams.out, streams.err)

    return run


@pytest.fixture
def small_demo(monkeypatch):
    """Make the demo one of small pictures and few of them."""
    copy = demo.copy_examples

    def copy_small(out):
        copy(out)
        rig = (out / "rig-sim.toml").read_text()
        rig = rig.replace("width = 782", "width = 192").replace("height = 582", "height = 96")
        (out / "rig-sim.toml").write_text(rig.replace("?speed=20", "?speed=400"))
        scene = re.sub(r"(x|y|width|height) = (\d+)", lambda found: f"{found[1]} = {2 * int(found[2])}", SMALL_SCENE)
        (out / "scene-panels.toml").write_text(scene)
        (out / "session-noise.toml").write_text(_SHORT_NOISE)
        (out / "session.toml").write_text(SHORT_SESSION.replace("cycles = 1", "cycles = 6"))

    monkeypatch.setattr(demo, "copy_examples", copy_small)


@pytest.mark.timeout(400)
def test_demo_does_the_whole_job_and_both_sides_agree(tmp_path):
    result = rigctl("demo", "--out", "demo", "--seed", "3", "--json", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout)["agrees"] is True
    made = {path.name for path in (tmp_path / "demo").iterdir()}
    assert made >= {"run", "noise.json", "prediction.json", "comparison.json", "report.html"}
    assert rigctl("verify", "demo/run", cwd=tmp_path).returncode == 0
    gain = json.loads((tmp_path / "demo" / "noise.json").read_text())["gain_dn_per_e"]
    assert abs(gain["value"] - 0.24) < 5 * gain["std_error"]


@pytest.mark.slow
def test_a_perturbed_demo_disagrees_with_exit_code_5(in_process, small_demo):
    result = in_process("demo", "--out", "demo", "--perturb", "extinction")
    assert result.returncode == 5, result.stderr
    assert "The degree of polarization is off" in result.stdout


def test_demo_does_not_write_over_a_folder(tmp_path):
    (tmp_path / "mine.txt").write_text("precious")
    result = rigctl("demo", "--out", tmp_path, cwd=tmp_path)
    assert result.returncode == 2
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_a_stage_that_stalls_ends_with_exit_code_3_and_keeps_what_was_taken(tmp_path, in_process):
    rig = (EXAMPLES / "rig-sim.toml").read_text().replace("sim:ellx?speed=20", "sim:ellx?speed=20&stall=2")
    (tmp_path / "rig.toml").write_text(rig)
    (tmp_path / "scene-panels.toml").write_text((EXAMPLES / "scene-panels.toml").read_text())
    result = rigctl("acquire", "rig.toml", EXAMPLES / "session.toml", "--out", "run", cwd=tmp_path)
    assert result.returncode == 3
    assert "mechanical" in result.stderr
    info = json.loads(in_process("status", "run", "--contents", "--json").stdout)
    assert json.loads(in_process("verify", "run", "--json").stdout)["ok"] is True
    assert info["frames"] == 17


def test_a_damaged_frame_is_found_and_refused_with_exit_code_4(tmp_path, in_process):
    session = tmp_path / "session.toml"
    session.write_text('name = "short"\n[[take]]\nkind = "dark"\nexposure_ms = 1\ncycles = 2\n')
    assert in_process("acquire", EXAMPLES / "rig-sim.toml", session, "--out", "run").returncode == 0
    frame = next((tmp_path / "run" / "frames").glob("*.fits"))
    data = bytearray(frame.read_bytes())
    data[20_000] ^= 1
    frame.write_bytes(data)
    result = in_process("verify", "run", "--json")
    assert result.returncode == 4
    assert frame.name in json.loads(result.stdout)["bad"][0]["file"]


def test_examples_in_the_package_are_those_in_the_examples_folder():
    packaged = ROOT / "rigctl" / "data" / "examples"
    names = sorted(path.name for path in EXAMPLES.glob("*.*") if path.is_file())
    assert names == sorted(path.name for path in packaged.glob("*.*") if path.is_file())
    assert all((EXAMPLES / name).read_bytes() == (packaged / name).read_bytes() for name in names)


REAL_DATA = os.environ.get("RIGCTL_REAL_DATA")


def _real_file(folder: Path, name: str, file: str) -> str:
    """Return the path of a real picture; of a mosaic of five million pixels a part, a twentieth of the time."""
    path = Path(REAL_DATA) / name / file
    if path.suffix != ".png":
        return str(path)
    cv2.imwrite(str(folder / file), cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[1000:2200, 1200:2400])
    return str(folder / file)


@pytest.mark.skipif(REAL_DATA is None, reason="set RIGCTL_REAL_DATA to the folder of real frames")
@pytest.mark.parametrize(
    ("name", "arguments", "region"),
    [
        ("imx250_fruits", ["fruits_IMX250MZR.png", "--mosaic", "90,45,135,0", "--black-level-dn", "0"], (250, 200)),
        (
            "lasco_c2_triplet",
            ["lasco_0.fts", "lasco_+60.fts", "lasco_-60.fts", "--angles", "0,60,-60", "--exposure-key", "EXPTIME",
             "--black-level-key", "OFFSET", "--bit-depth", "16"],
            (60, 230),
        ),
    ],
)  # fmt: skip
def test_real_frames_become_a_run_images_and_a_closed_loop_report(tmp_path, in_process, name, arguments, region):
    files = [_real_file(tmp_path, name, a) if a.endswith((".png", ".fts")) else a for a in arguments]
    assert in_process("import", "run", *files).returncode == 0
    (tmp_path / "regions.toml").write_text(
        f'[[regions]]\nname = "part"\nrectangle = {{ x = {region[0]}, y = {region[1]}, width = 40, height = 40 }}\n'
    )
    assert in_process("stokes", "run", "--out", "stokes").returncode == 0
    result = in_process("compare", "run", "--regions", "regions.toml", "--out", "compared", "--json")
    # 0 or 5: whether a texture of the real world is Gaussian is for the report to say.
    assert result.returncode in (0, 5), result.stderr
    content = json.loads(result.stdout)
    assert content["kind"] == "closed loop"
    assert 0 < content["regions"]["part"]["dolp_pixels"]["mean"]["measured"] < 1
    assert (tmp_path / "compared" / "report.html").stat().st_size > 50_000


@pytest.mark.slow
def test_the_demo_over_a_network_that_loses_packets_agrees_and_every_frame_is_bit_exact(
    tmp_path, monkeypatch, capsys, small_demo
):
    """The command `rigctl demo --gige --lost 0.01`, with small pictures and few of them."""
    take_frame, rendered = SimCamera.take_frame, set()

    def noted(camera, *, timeout_s):
        frame = take_frame(camera, timeout_s=timeout_s)
        rendered.add(frame.counts.tobytes())
        return frame

    monkeypatch.setattr(SimCamera, "take_frame", noted)
    out = tmp_path / "demo"
    with gige_port():
        assert main(["demo", "--gige", "--lost", "0.01", "--out", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["agrees"] is True
    lost = 0
    for name in ("noise-run", "run"):
        run = read_run(out / name)
        assert {run.counts(record).tobytes() for record in run.frames} <= rendered
        tallies = [event.facts for event in read_events(out / name) if event.event == "camera tally"]
        lost += sum(tally["packets_lost"] for tally in tallies)
    assert lost > 0
