"""The analyzer over the picture: an axis that differs from place to place, uneven light, saturated and dark corners."""

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.polarimeter.analyzer import block_means
from calibration.results import CalibrationError
from rigctl.calibrations import polarizer_scan as polarimeter_maps_module
from rigctl.calibrations.polarizer_scan import PolarimeterMaps, polarimeter_maps
from rigctl.cli import main
from rigctl.console import EXIT_USAGE
from rigctl.runs.folder import Run, read_run
from rigctl.runs.records import FrameRecord
from rigctl.runs.writer import RunWriter
from tests.rigctl.calibrations.polarizer_runs import (
    BLACK_DN,
    DIATTENUATION,
    DOLP,
    GENERATOR_DEG,
    OFFSET_DEG,
    SENSE,
    write_reference_run,
)
from tests.rigctl.run_samples import make_record

FloatArray = NDArray[np.float64]

SHAPE, SIDE = (32, 64), 8
STAGE_DEG = (0.0, 60.0, 120.0)
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
            for stage, passed in zip(STAGE_DEG, PASSED, strict=True):
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
    truth = np.radians(SENSE * np.array(STAGE_DEG)[:, None] + OFFSET_DEG + np.tile(columns, 4)[None, maps.lit.ravel()])
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
        assert kept["stage_angle_deg"].tolist() == pytest.approx(STAGE_DEG)
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
