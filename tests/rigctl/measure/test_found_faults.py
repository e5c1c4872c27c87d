"""Runs with a known fault: what they say of themselves, and what correcting by it does."""

import json
import os
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from model.processing.reconstruction import design
from rigctl.cli import main
from rigctl.console import EXIT_DATA, EXIT_USAGE
from rigctl.measure.diagnose import diagnose_pictures
from rigctl.measure.frames import FoundCorrections
from rigctl.runs.folder import Run
from rigctl.session.numbers import LiveNumbers, RegionMeans, coarse_picture, frame_summary
from rigctl.session.status import LiveStatus, live_lines, read_status, write_status
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
    assert found["diagnosis"]["terms"][0]["dolp_shift"] is not None
    _, corrected = stokes(tmp_path, "--correct", "shift")
    shifts = [term for term in corrected["diagnosis"]["terms"] if term["name"] == "shift" and term["named"]]
    assert all(abs(term["value"]) < 0.1 for term in shifts)


def test_a_shift_that_moves_dolp_by_less_than_its_error_is_not_mentioned(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run_with(tmp_path, Faults(shift_pixels={2: (0.3, 0.0)}))
    (tmp_path / "regions.toml").write_text(REGIONS[: REGIONS.rindex("[[regions]]")])
    _, found = stokes(tmp_path)
    assert found["diagnosis"]["first"] == "shift"
    # Edges of the texture make the region's DoLP uncertain by some hundredths.
    assert abs(found["diagnosis"]["terms"][0]["dolp_shift"]) < 0.01
    assert "the run shows shift" not in capsys.readouterr().out


def test_an_unsound_run_gives_its_numbers_and_reports_with_the_exit_code_of_unfit_data(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run_with(tmp_path, Faults(tone=0.8))
    code, found = stokes(tmp_path)
    assert code == EXIT_DATA
    assert found["sound"] is False
    assert found["diagnosis"]["first"].startswith("response")
    assert "UNSOUND" in capsys.readouterr().out
    words = ["--regions", str(tmp_path / "regions.toml"), "--out", str(tmp_path / "compared")]
    assert main(["compare", str(tmp_path / "run"), *words]) == EXIT_DATA
    compared = json.loads((tmp_path / "compared" / "comparison.json").read_text())
    assert (compared["agrees"], compared["verdict"]) == (None, "cannot_be_judged")
    assert (tmp_path / "compared" / "report.html").exists()


def test_a_region_of_one_pixel_is_not_measured(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run_with(tmp_path, Faults())
    code, found = stokes(tmp_path)
    assert code == 0
    assert set(found["regions"]) == {"whole"}
    assert "1 pixels are left" in found["unmeasured"]["pixel"]
    (tmp_path / "regions.toml").write_text(REGIONS[REGIONS.rindex("[[regions]]") :])
    assert stokes(tmp_path)[0] == EXIT_DATA
    assert "no region can be measured" in capsys.readouterr().out


def test_stokes_says_the_share_of_clipped_pixels_after_its_answer(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    counts = np.random.default_rng(1).normal(900.0, 30.0, (4, 100, 100)).round()
    counts[1, :10, :30], counts[2, 10:20, :60] = 4095.0, 0.0
    make_run(tmp_path / "run", [(at(angle), one) for angle, one in zip((0, 45, 90, 135), counts, strict=True)])
    assert main(["stokes", str(tmp_path / "run"), "--out", str(tmp_path / "out")]) == 0
    shown = capsys.readouterr().out
    clipped = " ".join(shown.splitlines()[1:3])
    assert clipped.startswith("clipped in one frame or more: 3.0 % of the pixels at the upper end")
    assert "6.0 % at 0" in clipped
    assert "flagged, pixels at 0" in shown


def test_what_cannot_be_corrected_is_refused(tmp_path: Path) -> None:
    run_with(tmp_path, Faults())
    assert main(["stokes", str(tmp_path / "run"), "--out", str(tmp_path / "o"), "--correct", "gamma"]) == EXIT_USAGE


def test_a_comparison_names_its_flags_and_what_is_unmeasured(tmp_path: Path) -> None:
    run_with(tmp_path, Faults(throughput={0: 0.03, 2: 0.03}))
    words = ["--regions", str(tmp_path / "regions.toml"), "--out", str(tmp_path / "out")]
    main(["compare", str(tmp_path / "run"), *words])
    found = json.loads((tmp_path / "out" / "comparison.json").read_text())
    # Light far above the noise gives the law of DoLP nothing to test.
    assert (found["agrees"], found["verdict"]) == (None, "cannot_be_judged")
    assert "nothing tested" in found["flags"]
    assert "pair sums of whole" in found["flags"]
    assert found["regions"]["pixel"]["verdict"] == "cannot_be_judged"
    assert "1 pixels are left" in found["regions"]["pixel"]["reason"]
    assert found["diagnosis"]["first"] == "throughput of pairs"


def off_at_45() -> list[np.ndarray]:
    world = World(black_dn=0.0, texture=0.1)
    return expose(world, Faults(throughput={1: 0.05}), np.random.default_rng(12))


def test_import_and_summary_say_what_the_frames_show(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = []
    for angle, counts in zip((0, 45, 90, 135), off_at_45(), strict=True):
        files.append(str(tmp_path / f"p{angle}.png"))
        cv2.imwrite(files[-1], counts.astype(np.uint16))
    words = ["--angles", "0,45,90,135", "--same-exposure", "--black-level-dn", "0", "--bit-depth", "12"]
    for command in (
        ["import", str(tmp_path / "run"), *files, *words],
        ["status", str(tmp_path / "run"), "--page", str(tmp_path / "run-summary.html")],
    ):
        assert main([*command, "--json"]) == 0
        told = json.loads(capsys.readouterr().out)["diagnosis"]
        assert told["first"] == "throughput"
        first = told["terms"][0]
        assert (first["angle_deg"], first["testable"]) == (45.0, True)
        assert first["value"] == pytest.approx(0.05, abs=5.0 * first["std_error"])
    page = (tmp_path / "run-summary.html").read_text()
    assert "the run shows throughput at 45 deg" in page


def test_a_session_shows_the_faults_of_its_last_cycle(tmp_path: Path) -> None:
    live = LiveNumbers()
    run = make_run(tmp_path / "run", [(at(a), f) for a, f in zip((0, 45, 90, 135), off_at_45(), strict=True)])
    for place, record in enumerate(run.frames):
        counts = run.counts(record)
        coarse = coarse_picture(counts, record)
        assert coarse[1] == 2
        seen = frame_summary(
            record, RegionMeans().of(counts), time_s=float(place), saturated_fraction=0.0, coarse=coarse
        )
        live.add(replace(seen, exposure_s=0.01), ends_cycle=place == 3)
    found = live.content().diagnosis
    assert found is not None
    assert found.first == "throughput"
    assert found.terms[0].angle_deg == 45.0
    assert any("throughput at 45 deg" in line for line in live_lines(live.content()))
    # Who reads the status file gets it back.
    write_status(tmp_path, LiveStatus(session="s", frames_planned=4, frames=4, numbers=live.content()))
    assert read_status(tmp_path).numbers == live.content()


def test_a_turned_picture_is_no_plain_shift_and_moves_nothing_unless_forced(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    world = World(black_dn=0.0, texture=0.3, texture_pixels=3.0)
    frames = [frame.astype(np.float64) for frame in expose(world, Faults(), np.random.default_rng(3))]
    turn = cv2.getRotationMatrix2D((96.0, 80.0), 1.2, 1.0)
    turn[:, 2] += (0.5, 0.4)
    frames[1] = cv2.warpAffine(frames[1], turn, frames[1].shape[::-1], borderMode=cv2.BORDER_REFLECT)
    make_run(tmp_path / "run", [(at(angle), f) for angle, f in zip(world.angles_deg, frames, strict=True)])
    walk = tmp_path / "walk.json"
    calibrate = ["calibrate", "registration", str(tmp_path / "run"), "--out", str(walk)]
    assert main(calibrate) == EXIT_DATA
    told = capsys.readouterr()
    assert "not a plain shift: at 45.0 deg" in told.err
    assert "ninths of the picture scatter" in told.err
    assert "after" in told.err
    assert not walk.exists()
    assert main([*calibrate, "--force-registration"]) == 0
    # Against the walk: edges lie worse for it.
    content = json.loads(walk.read_text())
    content["wander"] = None
    for row in content["angles"]:
        row["shift_pixels"] = [3.0, -2.0] if row["angle_deg"] == 90.0 else [0.0, 0.0]
    walk.write_text(json.dumps(content))
    moved = ["stokes", str(tmp_path / "run"), "--register", str(walk), "--out", str(tmp_path / "out")]
    assert main(moved) == EXIT_DATA
    assert "does not improve the edges of this run" in capsys.readouterr().err
    assert main([*moved, "--force-registration"]) == 0
    assert "after" in capsys.readouterr().err


def test_a_comparison_without_any_measured_region_has_its_report(tmp_path: Path) -> None:
    run_with(tmp_path, Faults())
    (tmp_path / "regions.toml").write_text(REGIONS[REGIONS.rindex("[[regions]]") :])
    words = [str(tmp_path / "run"), "--regions", str(tmp_path / "regions.toml"), "--out", str(tmp_path / "out")]
    assert main(["compare", *words]) == EXIT_DATA
    page = (tmp_path / "out" / "report.html").read_text()
    assert "cannot be judged: no region gives its numbers" in page
    assert "pixel cannot be judged: region pixel: 1 pixels are left of 1" in page
    found = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert (found["agrees"], found["verdict"]) == (None, "cannot_be_judged")
    assert found["regions"]["pixel"]["verdict"] == "cannot_be_judged"
    assert "at least 16 are needed" in found["regions"]["pixel"]["reason"]


@pytest.mark.parametrize(
    ("shape", "level"),
    [((1, 5), "even"), ((3, 40), "noise"), ((17, 17), "clipped"), ((40, 150), "dark"), ((40, 150), "noise")],
)
def test_frames_that_no_camera_takes_are_no_internal_error(tmp_path: Path, shape: tuple[int, int], level: str) -> None:
    draws = np.random.default_rng(shape)
    made = {"dark": np.zeros(shape), "clipped": np.full(shape, 4095.0), "even": np.full(shape, 900.0)}
    frames = [(at(a), made.get(level, draws.integers(0, 4096, shape))) for a in (0.0, 45.0, 90.0, 135.0)]
    make_run(tmp_path / "run", frames)
    whole = f"[[regions]]\nname = 'whole'\nrectangle = {{ x = 0, y = 0, width = {shape[1]}, height = {shape[0]} }}\n"
    (tmp_path / "regions.toml").write_text(whole)
    words = [str(tmp_path / "run"), "--regions", str(tmp_path / "regions.toml"), "--out", str(tmp_path / "out")]
    assert main(["stokes", *words, "--correct", "throughput,shift"]) in (0, EXIT_DATA)
    assert json.loads((tmp_path / "out" / "stokes.json").read_text())["diagnosis"]["first"] is None or level == "noise"


def test_errors_of_a_dark_level_and_a_shift_are_carried_to_a_region() -> None:
    nothing = np.zeros((4, 2))
    steep = np.broadcast_to(3.0 * np.arange(20.0), (4, 10, 20))
    found = FoundCorrections(
        throughput=None,
        dark=None,
        shifts=None,
        dark_error=np.array([0.0, 4.0, 0.0, 0.0]),
        shift_error=nothing + np.array([1.0, 9.0]),
        remarks=(),
    )
    inside = np.zeros((10, 20), dtype=np.bool_)
    inside[2:8, 3:17] = True
    np.testing.assert_allclose(found.level_error(steep, inside), [3.0, 5.0, 3.0, 3.0])


@pytest.mark.skipif("RIGCTL_REAL_DATA" not in os.environ, reason="set RIGCTL_REAL_DATA to the folder of real frames")
def test_shifts_of_real_frames_of_a_full_turn_are_those_that_half_turns_show() -> None:
    # Dim frames of 8 bits, whose rounding makes edges: the fit alone names a walk of half a pixel.
    folder = Path(os.environ["RIGCTL_REAL_DATA"]) / "mueller_psa/460nm_g0/a0"
    angles_rad = np.radians(np.arange(8) * 45.0)
    files = [folder / f"p{angle:03d}.png" for angle in range(0, 360, 45)]
    frames = np.array([cv2.imread(str(file), cv2.IMREAD_UNCHANGED) for file in files]).astype(float)
    found = diagnose_pictures(
        design(angles_rad),
        frames,
        np.all(frames < 255.0, axis=0),
        angles_rad=angles_rad,
        times=range(8),
        step=1.0,
        means={"all": frames.mean(axis=(1, 2))},
    )
    (walk,) = (term for term in found.named if term.unit == "pixel")
    # Half turns lie 0.2 pixel apart by phase correlation: a circle of 0.1, whose size is sqrt 2 of its radius.
    assert walk.value == pytest.approx(0.1 * np.sqrt(2.0), abs=0.05)
