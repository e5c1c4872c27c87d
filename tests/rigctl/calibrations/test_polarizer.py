"""``rigctl calibrate axis`` from runs to the lines of the rig file."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from astropy.io import fits
from numpy.typing import NDArray
from pydantic import TypeAdapter

from calibration.polarimeter.analyzer import block_means
from calibration.results import CalibrationError
from rigctl.calibrations import polarizer_scan as polarimeter_maps_module
from rigctl.calibrations.kinds import MadeFor
from rigctl.calibrations.polarizer import PolarizerParameters, read_polarizer_file, require_polarizer_fits
from rigctl.calibrations.polarizer_scan import PolarimeterMaps, polarimeter_maps
from rigctl.cli import main
from rigctl.console import EXIT_DATA, EXIT_USAGE
from rigctl.errors import DataError
from rigctl.files.rig_file import PolarizerSection
from rigctl.runs.folder import Run, read_run
from rigctl.runs.records import FrameRecord, PolarizerAsTaken
from rigctl.runs.writer import RunWriter
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
from tests.rigctl.run_samples import make_record


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


FOUND = {"schema_version": 2, "sense": -1, "offset_deg": {"value": 22.5, "std_error": 0.01}}
MADE_FOR = {"camera_serial": "11", "stage_serial": "7", "gain_db": 0.0, "taken_utc": "2026-05-04T10:00:00.000000000Z"}


def parameters(**more: Any) -> PolarizerParameters:
    return TypeAdapter(PolarizerParameters).validate_python(FOUND | more)


def axis(sense: Any = -1, offset_deg: float = 22.5) -> PolarizerSection:
    return PolarizerSection(sense=sense, offset_deg=offset_deg)


def test_what_a_calibration_writes_is_read(tmp_path: Path) -> None:
    runs = [str(write_reference_run(tmp_path / f"run{angle}", angle)) for angle in (0.0, 30.0)]
    out = tmp_path / "polarizer.json"
    more = ["--reference-deg", "0", "--reference-deg", "30", "--valid-days", "20"]
    assert main(["calibrate", "axis", *runs, *more, "--out", str(out)]) == 0
    found = read_polarizer_file(out)
    assert found.sense == SENSE
    assert found.made_for is not None
    assert found.made_for.valid_days == 20.0
    assert found.channels is None
    assert require_polarizer_fits(found, MadeFor(), polarizer=axis(SENSE, OFFSET_DEG)) == ()


@pytest.mark.parametrize("offset_deg", [22.5, 22.5299, 202.5, -157.5])
def test_an_axis_within_its_error_fits(offset_deg: float) -> None:
    assert require_polarizer_fits(parameters(), MadeFor(), polarizer=axis(offset_deg=offset_deg)) == ()


@pytest.mark.parametrize("stated", [axis(sense=1), axis(offset_deg=22.54), axis(offset_deg=-22.5)])
def test_another_axis_in_the_rig_file_is_refused(stated: PolarizerSection) -> None:
    with pytest.raises(DataError, match="put the calibrated ones there"):
        require_polarizer_fits(parameters(), MadeFor(), polarizer=stated)


def test_another_stage_is_refused_and_another_gain_is_not() -> None:
    found = parameters(made_for=MADE_FOR)
    assert require_polarizer_fits(found, MadeFor(gain_db=6.0), polarizer=PolarizerAsTaken()) == ()
    with pytest.raises(DataError, match="stage serial number: calibrated 7, used 8"):
        require_polarizer_fits(found, MadeFor(stage_serial="8"), polarizer=PolarizerAsTaken())


@pytest.mark.parametrize("change", [{"sense": None}, {"schema_version": 3}, {"offset_deg": None}])
def test_a_file_that_cannot_be_used_says_what_makes_one(tmp_path: Path, change: dict[str, Any]) -> None:
    path = tmp_path / "polarizer.json"
    path.write_text(json.dumps(FOUND | change))
    with pytest.raises(DataError, match="rigctl calibrate axis"):
        read_polarizer_file(path)


CHANNEL = {"stage_angle_deg": 0.0, "throughput": {"value": 1.0, "std_error": 0.001}}


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"channels": []}, "channels: has 0 items, must have at least 1"),
        ({"channels": 3}, "channels: "),
        ({"channels": [CHANNEL, CHANNEL | {"throughput": 1.0}]}, "channels.1.throughput: "),
        ({"channels": [CHANNEL | {"throughput": {"value": -1, "std_error": 0}}]}, "channels.0.throughput.value: "),
        ({"channels": [CHANNEL | {"throughput": {"value": 0, "std_error": 0}}]}, "channels.0.throughput.value: "),
        ({"channels": [CHANNEL | {"throughput": {"value": 1e300, "std_error": 0}}]}, "channels.0.throughput.value: "),
        ({"channels": [CHANNEL | {"throughput": {"value": 1, "std_error": -5}}]}, "channels.0.throughput.std_error: "),
        ({"channels": [{"throughput": CHANNEL["throughput"]}]}, "channels.0.stage_angle_deg: is missing"),
        ({"offset_deg": {"value": 1e300, "std_error": 0}}, "offset_deg.value: "),
        ({"made_for": {"taken_utc": "x"}}, "made_for.taken_utc: is 'x', must be a time"),
        ({"created_utc": "x"}, "created_utc: is 'x', must be a time"),
        ({"made_for": {"stage_serial": 7}}, "made_for.stage_serial: "),
    ],
)
def test_whatever_is_used_is_checked(tmp_path: Path, change: dict[str, Any], problem: str) -> None:
    path = tmp_path / "polarizer.json"
    path.write_text(json.dumps(FOUND | change))
    with pytest.raises(DataError, match=f"(?s)1 problem.*{problem}"):
        read_polarizer_file(path)


def test_keys_of_others_are_let_be(tmp_path: Path) -> None:
    path = tmp_path / "polarizer.json"
    path.write_text(json.dumps(FOUND | {"channels": [CHANNEL | {"note": "dusty"}], "operator": "me"}))
    assert read_polarizer_file(path) == parameters(channels=[CHANNEL])


FloatArray = NDArray[np.float64]

SHAPE, SIDE = (32, 64), 8
MAP_STAGE_DEG = (0.0, 60.0, 120.0)
PASSED = (1.0, 0.98, 1.02)
NOISE_DN = 10.0
# Axis at the left and the right border, off that in the middle [deg].
TWIST_DEG = 0.5


def light_dn() -> FloatArray:
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    shading = 1200.0 * (1.0 - 0.3 * ((x - 32.0) / 32.0) ** 2 - 0.2 * ((y - 16.0) / 16.0) ** 2)
    shading[:SIDE, :SIDE] = 1.0
    return shading


def write_twisted_scan(path: Path) -> Path:
    draws, twist = np.random.default_rng(4), TWIST_DEG * (np.arange(SHAPE[1]) - 31.5) / 32.0
    with RunWriter.create(path, {"origin": "simulated"}) as writer:
        for cycle, generator in enumerate(GENERATOR_DEG):
            for stage, passed in zip(MAP_STAGE_DEG, PASSED, strict=True):
                axis = SENSE * stage + OFFSET_DEG + twist
                law = passed * (1.0 + DIATTENUATION * DOLP * np.cos(2.0 * np.radians(axis - generator)))
                counts = BLACK_DN + light_dn() * law + NOISE_DN * draws.standard_normal(SHAPE)
                counts[-1, -1] = 5000.0 if cycle == 3 else counts[-1, -1]
                writer.write_frame(
                    make_record(writer.next_sequence, stage_angle_deg=stage, cycle=cycle, black_level_dn=BLACK_DN),
                    np.clip(np.rint(counts), 0, 4095).astype(np.uint16),
                )
    return path


def generator_deg(record: FrameRecord) -> float:
    return GENERATOR_DEG[record.cycle or 0]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return read_run(write_twisted_scan(tmp_path_factory.mktemp("twisted") / "run"))


@pytest.fixture(scope="module")
def maps(run: Run) -> PolarimeterMaps:
    return polarimeter_maps(run, generator_deg, side_pixels=SIDE, generator_dolp=DOLP)


def test_the_twist_is_found_block_by_block_within_its_errors(maps: PolarimeterMaps) -> None:
    columns = TWIST_DEG * (SIDE * (np.arange(8) + 0.5) - 32.0) / 32.0
    truth = np.radians(
        SENSE * np.array(MAP_STAGE_DEG)[:, None] + OFFSET_DEG + np.tile(columns, 4)[None, maps.lit.ravel()]
    )
    apart = (maps.channels.axis_rad - truth + np.pi / 2) % np.pi - np.pi / 2
    scores = apart / maps.channels.axis_error_rad
    # 90 numbers with 33 degrees of freedom: 5 sigma of their variance.
    assert scores.var() == pytest.approx(1.06, abs=5.0 * np.sqrt(2.0 / scores.size))
    assert abs(scores.mean()) < 5.0 / np.sqrt(scores.size)


def test_uneven_light_is_not_in_the_throughput(maps: PolarimeterMaps) -> None:
    scores = (maps.channels.throughput - np.array(PASSED)[:, None]) / maps.channels.throughput_error
    # The mean over three angles has its own error too: up to 2 / 3 less in the difference.
    assert np.abs(scores).max() < 5.0


def test_dark_and_saturated_blocks_are_left_out_and_marked(maps: PolarimeterMaps) -> None:
    left_out = np.argwhere(~maps.lit).tolist()
    assert left_out == [[0, 0], [3, 7]]
    shown = maps.picture(maps.channels.throughput)
    assert shown.shape == (3, 4, 8)
    assert np.isnan(shown[:, ~maps.lit]).all()
    assert not np.isnan(shown[:, maps.lit]).any()


@pytest.mark.parametrize("side", [1, SIDE])
def test_bands_of_rows_give_the_same_maps(run: Run, side: int, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = polarimeter_maps(run, generator_deg, side_pixels=side, generator_dolp=DOLP).named()
    # Three rows of blocks at once: of 32 and of 4 the last band has fewer.
    monkeypatch.setattr(polarimeter_maps_module, "_BAND_BYTES", 3 * 8 * 3 * len(GENERATOR_DEG) * (SHAPE[1] // side))
    banded = polarimeter_maps(run, generator_deg, side_pixels=side, generator_dolp=DOLP).named()
    for name, values in whole.items():
        # The axis is an angle modulo 180 deg; rounding alone may turn it over.
        apart = (banded[name] - values + 90.0) % 180.0 - 90.0 if name == "axis_deg" else banded[name] - values
        np.testing.assert_allclose(apart, np.where(np.isnan(values), np.nan, 0.0), atol=1e-9)


def test_the_archive_holds_what_was_found(maps: PolarimeterMaps, tmp_path: Path) -> None:
    (tmp_path / "maps.npz").write_bytes(maps.npz())
    with np.load(tmp_path / "maps.npz") as kept:
        assert kept["stage_angle_deg"].tolist() == pytest.approx(MAP_STAGE_DEG)
        assert kept["axis_deg"].shape == (3, 4, 8)
        np.testing.assert_array_equal(kept["diattenuation"], maps.picture(maps.channels.diattenuation))


def test_blocks_are_means() -> None:
    picture = np.arange(30.0).reshape(5, 6)
    assert block_means(picture, 2).tolist() == [[3.5, 5.5, 7.5], [15.5, 17.5, 19.5]]
    assert block_means(picture, 1).tolist() == picture.tolist()


def test_blocks_larger_than_the_picture_are_refused() -> None:
    with pytest.raises(CalibrationError, match="do not fit"):
        block_means(np.ones((5, 6)), 6)


@pytest.fixture
def generator(tmp_path: Path) -> Path:
    path = tmp_path / "generator.toml"
    path.write_text(f"angle_deg = {list(GENERATOR_DEG)}\n")
    return path


REGIONS = """
[[regions]]
name = "left"
rectangle = { x = 0, y = 8, width = 8, height = 16 }
[[regions]]
name = "right"
rectangle = { x = 56, y = 8, width = 8, height = 16 }
"""


def test_each_region_has_its_own_axis_and_the_page_shows_all(run: Run, tmp_path: Path, generator: Path) -> None:
    regions, page, maps = tmp_path / "regions.toml", tmp_path / "page.html", tmp_path / "maps.npz"
    regions.write_text(REGIONS)
    arguments = ["calibrate", "axis", str(run.path), "--generator", str(generator), "--dolp", str(DOLP)]
    arguments += ["--regions", str(regions), "--report", str(page), "--maps", str(maps), "--block", "16"]
    assert main([*arguments, "--out", str(tmp_path / "p.json")]) == 0
    html = page.read_text()
    # Scans, harmonics, channels and maps.
    assert html.count("data:image/png;base64,") == 4
    assert "http" not in html
    for text in (">left</td>", ">right</td>", "Blocks of 16 x 16 pixels", "sense = -1", "S2"):
        assert text in html
    with np.load(maps) as kept:
        assert kept["axis_deg"].shape == (3, 2, 4)
    left, right = json.loads((tmp_path / "p.json").read_text())["regions"]
    twist = right["offset_deg"]["value"] - left["offset_deg"]["value"]
    # From the middle of the first block to that of the last: 56 of 64 columns.
    error = np.hypot(left["offset_deg"]["std_error"], right["offset_deg"]["std_error"])
    assert twist == pytest.approx(2.0 * TWIST_DEG * 56.0 / 64.0, abs=5.0 * error)


def test_maps_need_a_generator(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = write_reference_run(tmp_path / "run", 60.0)
    arguments = ["calibrate", "axis", str(run), "--reference-deg", "60", "--expect-offset-deg", "20"]
    assert main([*arguments, "--maps", str(tmp_path / "m.npz"), "--out", str(tmp_path / "p.json")]) == EXIT_USAGE
    assert "give --generator" in capsys.readouterr().err
