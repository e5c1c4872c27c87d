"""Runs with a known fault: what they say of themselves, and what correcting by it does."""

import json
from pathlib import Path

import numpy as np
import pytest

from rigctl.cli import EXIT_DATA, EXIT_USAGE, main
from rigctl.runs.run_folder import Run
from tests.rigctl.made_runs import at, make_run
from tests.worldlike import Faults, World, expose

REGIONS = """
[[regions]]
name = "whole"
rectangle = { x = 20, y = 20, width = 120, height = 100 }
[[regions]]
name = "pixel"
rectangle = { x = 5, y = 5, width = 1, height = 1 }
"""


def run_with(folder: Path, faults: Faults) -> Run:
    world = World(black_dn=0.0, texture=0.1)
    frames = expose(world, faults, np.random.default_rng(12))
    (folder / "regions.toml").write_text(REGIONS)
    return make_run(folder / "run", [(at(angle), f) for angle, f in zip(world.angles_deg, frames, strict=True)])


def stokes(folder: Path, *words: str) -> tuple[int, dict[str, object]]:
    given = ["stokes", str(folder / "run"), "--regions", str(folder / "regions.toml"), "--out", str(folder / "out")]
    code = main([*given, *words, "--force"])
    return code, json.loads((folder / "out" / "stokes.json").read_text())


def test_a_throughput_that_is_off_is_named_and_corrected(tmp_path: Path) -> None:
    run_with(tmp_path, Faults(throughput={1: 0.03}))
    code, found = stokes(tmp_path)
    assert code == 0
    assert found["diagnosis"]["first"] == "throughput"
    term = found["diagnosis"]["terms"][0]
    assert term["angle_deg"] == 45.0
    assert term["value"] == pytest.approx(0.03, abs=5.0 * term["std_error"])
    assert abs(term["dolp_shift"]) > 1e-4
    _, corrected = stokes(tmp_path, "--correct", "throughput")
    assert corrected["diagnosis"]["first"] is None


def test_a_shift_is_corrected(tmp_path: Path) -> None:
    run_with(tmp_path, Faults(shift_pixels={2: (0.8, -0.6)}))
    _, found = stokes(tmp_path)
    assert found["diagnosis"]["first"] == "shift"
    _, corrected = stokes(tmp_path, "--correct", "shift")
    shifts = [term for term in corrected["diagnosis"]["terms"] if term["name"] == "shift" and term["named"]]
    assert all(abs(term["value"]) < 0.1 for term in shifts)


def test_an_unsound_run_gives_its_numbers_and_the_exit_code_of_unfit_data(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run_with(tmp_path, Faults(tone=0.8))
    code, found = stokes(tmp_path)
    assert code == EXIT_DATA
    assert found["sound"] is False
    assert found["diagnosis"]["first"].startswith("response")
    assert "UNSOUND" in capsys.readouterr().out


def test_a_region_of_one_pixel_is_said_and_ends_nothing(tmp_path: Path) -> None:
    run_with(tmp_path, Faults())
    code, found = stokes(tmp_path)
    assert code == 0
    assert set(found["regions"]) == {"whole"}
    assert "1 pixels are left" in found["unmeasured"]["pixel"]


def test_what_cannot_be_corrected_is_refused(tmp_path: Path) -> None:
    run_with(tmp_path, Faults())
    assert main(["stokes", str(tmp_path / "run"), "--out", str(tmp_path / "o"), "--correct", "gamma"]) == EXIT_USAGE


def test_a_comparison_names_its_reservations(tmp_path: Path) -> None:
    run_with(tmp_path, Faults(throughput={0: 0.03, 2: 0.03}))
    words = ["--regions", str(tmp_path / "regions.toml"), "--out", str(tmp_path / "out")]
    main(["compare", str(tmp_path / "run"), *words])
    found = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert found["verdict"] in ("agrees_with_reservations", "disagrees")
    assert "pair sums of whole" in found["flags"]
    assert found["regions"]["pixel"]["verdict"] == "cannot_be_judged"
    assert "1 pixels are left" in found["regions"]["pixel"]["reason"]
    assert found["diagnosis"]["first"] == "throughput of pairs"


def test_an_unsound_run_is_compared_with_its_report_all_the_same(tmp_path: Path) -> None:
    run_with(tmp_path, Faults(tone=0.8))
    words = ["--regions", str(tmp_path / "regions.toml"), "--out", str(tmp_path / "out")]
    assert main(["compare", str(tmp_path / "run"), *words]) == EXIT_DATA
    found = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert (found["agrees"], found["verdict"]) == (None, "cannot_be_judged")
    assert (tmp_path / "out" / "report.html").exists()
