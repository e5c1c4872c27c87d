"""`rigctl infer`: from runs whose counts were drawn by numpy to the posterior of what they were drawn from."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.trials import uncertain_panels
from rigctl.cli import main
from rigctl.console import EXIT_USAGE

CHOSEN = ("regions.black.stokes_radiance.1", "rig.polarizer_offset_deg", "regions.white.stokes_radiance.0")
WORDS = [word for key in CHOSEN for word in ("--input", key)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("infer")
    (path / "scene.toml").write_text(uncertain_panels.scene_text())
    for seed, name in enumerate(("one", "two")):
        truth = uncertain_panels.drawn_truth(np.random.default_rng(5))
        uncertain_panels.take_run(path / name, truth, np.random.default_rng(seed))
    return path


def inferred(folder: Path, *words: str, capsys: pytest.CaptureFixture[str]) -> dict[str, object]:
    assert main(["infer", *words, str(folder / "scene.toml"), *WORDS, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_the_posterior_holds_what_the_frames_were_drawn_from(folder, capsys):
    found = inferred(folder, str(folder / "one"), capsys=capsys)
    truth = uncertain_panels.drawn_truth(np.random.default_rng(5))
    for row in found["inputs"]:
        assert abs(row["mean"] - truth[row["input"]]) < 3.5 * row["std"]
        assert row["std"] < 0.95 * row["prior_std"]
        assert row["from_95"] < row["mean"] < row["to_95"]
    assert found["convergence"]["r_hat"] < 1.01
    assert found["unexplained"] == []
    assert [one["region"] for one in found["regions"]] == ["black", "white", "grey"]


def test_two_runs_teach_no_less_than_one(folder, capsys):
    one, two = (
        inferred(folder, *(str(folder / name) for name in names), capsys=capsys) for names in (["one"], ["one", "two"])
    )
    for alone, both in zip(one["inputs"], two["inputs"], strict=True):
        assert both["std"] < 1.1 * alone["std"]
    assert two["runs"] == ["one", "two"]


def test_a_free_scale_does_not_rest_on_the_throughput(folder, tmp_path, capsys):
    text = uncertain_panels.scene_text()
    (tmp_path / "scene.toml").write_text(text.replace("value = 0.45", "value = 0.15"))
    found = [
        inferred(place, str(folder / "one"), "--scale", "free", capsys=capsys)["inputs"] for place in (folder, tmp_path)
    ]
    for one, other in zip(*found, strict=True):
        assert one["mean"] == pytest.approx(other["mean"], abs=0.2 * one["std"])
        assert one["std"] == pytest.approx(other["std"], rel=0.15)


def test_files_hold_the_answer_draws_and_pictures(folder, tmp_path, capsys):
    words = ["infer", str(folder / "one"), str(folder / "scene.toml"), *WORDS, "--out", str(tmp_path / "out")]
    assert main(words) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("The run teaches 3 of 3 inputs; most ")
    assert json.loads((tmp_path / "out" / "posterior.json").read_text())["answer"].startswith("The run teaches")
    draws = np.genfromtxt(tmp_path / "out" / "draws.csv", delimiter=",", names=True)
    assert draws.size >= 1000
    for picture in ("corner.png", "check.png"):
        assert (tmp_path / "out" / picture).read_bytes().startswith(b"\x89PNG")
    before = (tmp_path / "out" / "draws.csv").read_bytes()
    (points,) = (tmp_path / "out" / "parts").glob("*-points.npz")
    with np.load(points) as kept:
        assert len(kept["inputs"]) > 20
        np.savez(points, inputs=kept["inputs"][:20], numbers=kept["numbers"][:20])  # as if it had been killed
    assert main([*words, "--force"]) == 0
    assert (tmp_path / "out" / "draws.csv").read_bytes() == before


def test_a_number_without_std_has_no_prior(folder, capsys):
    words = ["infer", str(folder / "one"), str(folder / "scene.toml"), "--input", "sensor.f_number"]
    assert main(words) == EXIT_USAGE
    assert "sensor.f_number has no std in the scene file" in capsys.readouterr().err
