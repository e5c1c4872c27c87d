"""``rigctl calibrate axis`` from runs to the lines of the rig file."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from astropy.io import fits

from rigctl.cli import main
from rigctl.console import EXIT_DATA, EXIT_USAGE
from tests.rigctl.calibrations.polarizer_runs import (
    BLACK_DN,
    DIATTENUATION,
    DOLP,
    GENERATOR_DEG,
    OFFSET_DEG,
    SENSE,
    STAGE_DEG,
    transmitted,
    write_generator_run,
    write_reference_run,
    write_scan,
)


def generator_toml(folder: Path) -> Path:
    path = folder / "generator.toml"
    path.write_text(f"angle_deg = {list(GENERATOR_DEG)}\n")
    return path


def generator_csv(folder: Path) -> Path:
    path = folder / "generator.csv"
    rows = [f"{4 * k + j},{angle}" for k, angle in enumerate(GENERATOR_DEG) for j in range(4)]
    path.write_text("\n".join(["sequence,angle_deg", *rows]) + "\n")
    return path


def calibrate(tmp_path: Path, *arguments: str) -> dict[str, Any]:
    out = tmp_path / "polarizer.json"
    assert main(["calibrate", "axis", *arguments, "--out", str(out), "--force"]) == 0
    content: dict[str, Any] = json.loads(out.read_text())
    return content


@pytest.mark.parametrize("listed", [generator_toml, generator_csv])
def test_a_generator_scan_finds_everything(tmp_path: Path, listed: Any) -> None:
    run = write_generator_run(tmp_path / "run")
    content = calibrate(tmp_path, str(run), "--generator", str(listed(tmp_path)), "--dolp", str(DOLP))
    assert content["sense"] == SENSE
    offset = content["offset_deg"]
    # The readback is 0.001 deg off on purpose; the rest is noise.
    assert abs(offset["value"] - OFFSET_DEG - SENSE * -0.001) < 5.0 * offset["std_error"]
    assert offset["std_error"] < 0.02
    ratio = (1.0 + DIATTENUATION) / (1.0 - DIATTENUATION)
    # 95 %: twice the interval's half is 4 sigma.
    low, high = content["extinction_ratio"]["lower"], content["extinction_ratio"]["upper"]
    assert 0.7 * low < ratio < 1.5 * high
    assert [round(channel["stage_angle_deg"]) for channel in content["channels"]] == list(STAGE_DEG)
    truth = np.linalg.pinv(
        [
            [0.5, 0.5 * DIATTENUATION * np.cos(2 * axis), 0.5 * DIATTENUATION * np.sin(2 * axis)]
            for axis in np.radians([SENSE * stage + OFFSET_DEG for stage in STAGE_DEG])
        ]
    )
    error = np.abs(np.array(content["data_reduction"]["matrix"]) - truth)
    assert np.all(error < 5.0 * np.array(content["data_reduction"]["std_error"]) + 1e-4)


def test_two_references_find_sense_and_offset(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runs = [str(write_reference_run(tmp_path / f"run{angle}", angle)) for angle in (0.0, 30.0)]
    content = calibrate(tmp_path, *runs, "--reference-deg", "0", "--reference-deg", "30")
    assert content["sense"] == SENSE
    assert abs(content["offset_deg"]["value"] - OFFSET_DEG) < 5.0 * content["offset_deg"]["std_error"]
    assert content["extinction_ratio"] is None
    shown = capsys.readouterr().out
    assert "[polarizer]\nsense = -1\noffset_deg = 22." in shown


def test_one_reference_and_a_mark_find_sense_and_offset(tmp_path: Path) -> None:
    run = str(write_reference_run(tmp_path / "run", 60.0))
    content = calibrate(tmp_path, run, "--reference-deg", "60", "--expect-offset-deg", "20", "--dolp", str(DOLP))
    assert content["sense"] == SENSE
    assert content["diattenuation"]["value"] == pytest.approx(DIATTENUATION, abs=0.002)


def refusal(tmp_path: Path, capsys: pytest.CaptureFixture[str], *arguments: str, code: int = EXIT_DATA) -> str:
    out = tmp_path / "p.json"
    assert main(["calibrate", "axis", *arguments, "--out", str(out)]) == code
    assert not out.exists()
    return capsys.readouterr().err


@pytest.mark.parametrize(
    ("light", "more", "words"),
    [
        (
            {},
            ["30"],
            ["the sense of rotation cannot be determined", "sense +1 with offset 37.", "sense -1 with offset 22."],
        ),
        # Along the axis of the stage's zero.
        (
            {"deg": OFFSET_DEG},
            [str(OFFSET_DEG), "--expect-offset-deg", "22"],
            ["unless the reference is horizontal or vertical"],
        ),
        ({"peak_dn": 4200.0}, ["30"], ["saturated pixels"]),
        ({"peak_dn": 0.0}, ["30"], ["no light above"]),
    ],
)
def test_a_reference_scan_that_gives_no_axis_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], light: dict[str, float], more: list[str], words: list[str]
) -> None:
    run = write_reference_run(tmp_path / "run", light.pop("deg", 30.0), **light)
    message = refusal(tmp_path, capsys, str(run), "--reference-deg", *more)
    assert all(one in message for one in words)


def test_a_run_without_a_dark_level_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = write_generator_run(tmp_path / "run", dark=False)
    assert "add dark frames" in refusal(tmp_path, capsys, str(run), "--generator", str(generator_toml(tmp_path)))


def test_a_generator_angle_that_is_missing_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run, listed = write_generator_run(tmp_path / "run"), tmp_path / "generator.toml"
    listed.write_text(f"angle_deg = {list(GENERATOR_DEG[:-1])}\n")
    assert "cycle 35" in refusal(tmp_path, capsys, str(run), "--generator", str(listed))


@pytest.mark.parametrize("text", ["sequence,angle\n0,1\n", "angle_deg\n1\n", "cycle,angle_deg\nx,1\n", ""])
def test_a_wrong_csv_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str) -> None:
    listed = tmp_path / "generator.csv"
    listed.write_text(text)
    run = write_reference_run(tmp_path / "run", 30.0)
    refusal(tmp_path, capsys, str(run), "--generator", str(listed), code=EXIT_USAGE)


@pytest.mark.parametrize(
    "more", [[], ["--reference-deg", "1", "--reference-deg", "2"], ["--dolp", "1.2"], ["--reference-deg", "nan"]]
)
def test_options_that_do_not_fit_are_usage_errors(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], more: list[str]
) -> None:
    refusal(tmp_path, capsys, str(write_reference_run(tmp_path / "run", 30.0)), *more, code=EXIT_USAGE)


def generator_pairs(stages_deg: tuple[float, ...], repeats: int = 1) -> list[tuple[float, float, int]]:
    return [(s, light, cycle) for cycle, light in enumerate(GENERATOR_DEG) for _ in range(repeats) for s in stages_deg]


@pytest.mark.parametrize(
    ("stages_deg", "repeats"),
    # The readback of 11.25 deg is 11.2 or 11.3 to one decimal; that of 0 deg is 0.003 or 359.998.
    [((11.25, 56.25, 101.25, 146.25), 1), ((0.0, 45.0, 90.0, 135.0), 3)],
)
def test_a_stage_that_does_not_land_twice_alike(tmp_path: Path, stages_deg: tuple[float, ...], repeats: int) -> None:
    run = write_scan(tmp_path / "run", generator_pairs(stages_deg, repeats), landing_deg=0.004)
    content = calibrate(tmp_path, str(run), "--generator", str(generator_toml(tmp_path)))
    assert content["sense"] == SENSE
    # The mean of 36 landings, and the readback that is 0.001 deg off.
    assert abs(content["offset_deg"]["value"] - OFFSET_DEG) < 5.0 * content["offset_deg"]["std_error"] + 0.001
    found = [channel["stage_angle_deg"] for channel in content["channels"]]
    assert found == pytest.approx(stages_deg, abs=0.005)


def test_a_hot_pixel_is_left_out(tmp_path: Path) -> None:
    run = write_scan(tmp_path / "run", generator_pairs(STAGE_DEG), hot_pixels=1)
    content = calibrate(tmp_path, str(run), "--generator", str(generator_toml(tmp_path)))
    without = write_scan(tmp_path / "without", generator_pairs(STAGE_DEG))
    expected = calibrate(tmp_path, str(without), "--generator", str(generator_toml(tmp_path)))
    # Of 600 pixels one of 4095 would be 6 DN of 1500, and 0.5 % less diattenuation.
    assert content["diattenuation"] == pytest.approx(expected["diattenuation"], abs=1e-4)


def test_references_that_contradict_one_another_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runs = [str(write_reference_run(tmp_path / f"run{angle}", angle)) for angle in (30.0, 77.0)]
    said = refusal(tmp_path, capsys, *runs, "--reference-deg", "30", "--reference-deg", "60")
    assert "contradict one another" in said


def test_a_generator_at_one_axis_of_the_stage_asks_for_another_angle(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = write_scan(tmp_path / "run", generator_pairs((30.0, 120.0)))
    said = refusal(tmp_path, capsys, str(run), "--generator", str(generator_toml(tmp_path)))
    assert "such as 0 and 45 deg" in said


def test_light_that_does_not_change_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # Light that turns with the polarizer: as without one.
    pairs = [(10.0 * step, SENSE * 10.0 * step + OFFSET_DEG, 0) for step in range(36)]
    run = write_scan(tmp_path / "run", pairs)
    assert "in its place?" in refusal(tmp_path, capsys, str(run), "--reference-deg", "30")


@pytest.mark.parametrize("way", ["numbers", "header", "table"])
def test_a_scan_that_another_program_took_is_imported_by_its_stage_angles(tmp_path: Path, way: str) -> None:
    runs = []
    for reference in (0.0, 30.0):
        folder = tmp_path / f"others{reference:.0f}"
        folder.mkdir()
        files = []
        for step in range(36):
            signal = 3000.0 * transmitted(10.0 * step, reference) * np.ones((20, 30))
            counts = np.random.default_rng(step).poisson(signal + BLACK_DN).astype(np.uint16)
            files.append(folder / f"f{step:02d}.fits")
            fits.PrimaryHDU(counts, fits.Header({"ROTANG": 10.0 * step})).writeto(files[-1])
        table = folder / "angles.csv"
        table.write_text("file,stage_angle_deg\n" + "".join(f"{file.name},{10 * k}\n" for k, file in enumerate(files)))
        said = {"numbers": ",".join(str(10 * k) for k in range(36)), "header": "ROTANG", "table": str(table)}[way]
        runs.append(str(tmp_path / f"run{reference:.0f}"))
        words = ["--same-exposure", "--bit-depth", "12", "--black-level-dn", str(BLACK_DN), "--stage-angles", said]
        assert main(["import", runs[-1], *map(str, files), *words]) == 0
    content = calibrate(tmp_path, *runs, "--reference-deg", "0", "--reference-deg", "30")
    assert content["sense"] == SENSE
    assert abs(content["offset_deg"]["value"] - OFFSET_DEG) < 4.0 * content["offset_deg"]["std_error"]


@pytest.mark.parametrize(("stated", "told"), [("0,10", "2 angles for 3"), ("no.csv", "no.csv"), ("ROT", "not in this")])
def test_stage_angles_that_do_not_fit_the_files_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], stated: str, told: str
) -> None:
    files = [tmp_path / f"{k}.fits" for k in range(3)]
    for file in files:
        fits.PrimaryHDU(np.full((8, 8), 500, dtype=np.uint16)).writeto(file)
    words = ["--same-exposure", "--bit-depth", "12", "--black-level-dn", "0", "--stage-angles", stated]
    assert main(["import", str(tmp_path / "run"), *map(str, files), *words]) == EXIT_USAGE
    assert told in capsys.readouterr().err
