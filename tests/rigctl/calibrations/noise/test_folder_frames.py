"""Frames out of folders of images and out of tables."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from astropy.io import fits

from calibration.results import RefusedFramesError
from rigctl.calibrations.noise import QUANTITIES, read_noise_file
from rigctl.calibrations.noise_frames import folder_frames, table_frames
from rigctl.cli import main
from rigctl.console.failures import EXIT_DATA, EXIT_USAGE
from rigctl.errors import ConfigError
from tests.rigctl.noise_sessions import frames, write_noise_run


def write_png(path: Path, counts: object = None) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((4, 5), 7, np.uint16) if counts is None else np.asarray(counts))


def session_in_folder(folder: Path) -> Path:
    for number, (kind, exposure_s, counts) in enumerate(frames()):
        write_png(folder / f"{kind}_{exposure_s * 1e6:g}us_{number:03}.png", counts)
    return folder


def session_in_table(folder: Path) -> Path:
    session_in_folder(folder)
    rows = [
        f"{path.name},{path.stem.split('_')[0]},{float(path.stem.split('_')[1].removesuffix('us')) / 1e3}"
        for path in sorted(folder.glob("*.png"))
    ]
    (folder / "table.csv").write_text("\n".join(["file,kind,exposure_ms", *rows]) + "\n")
    return folder / "table.csv"


@pytest.mark.parametrize(("option", "write"), [("--folder", session_in_folder), ("--table", session_in_table)])
def test_gives_what_a_run_of_the_same_frames_gives(tmp_path: Path, option: str, write: Callable[[Path], Path]) -> None:
    run, source = write_noise_run(tmp_path / "run"), write(tmp_path / "images")
    arguments = [option, str(source), "--bit-depth", "12", "--out", str(tmp_path / "images.json")]
    assert main(["calibrate", "noise", *arguments]) == 0
    assert main(["calibrate", "noise", "--run", str(run), "--out", str(tmp_path / "run.json")]) == 0
    by_images, by_run = read_noise_file(tmp_path / "images.json"), read_noise_file(tmp_path / "run.json")
    for name in QUANTITIES:
        # The same frames in the same order; exposures are products of decimal fractions.
        assert by_images.known[name].value == pytest.approx(by_run.known[name].value, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "kind", "exposure_s"),
    [
        ("dark_10ms_1.png", "dark", 0.01),
        ("flats/0.5s/1.png", "flat", 0.5),
        ("bias/250us-01.tif", "dark", 250e-6),
        ("Light 2p5ms.png", "flat", 2.5e-3),
        ("bright_1S_x.png", "flat", 1.0),
        ("dark_frames2.png", "dark", None),
        ("flat_exp000000522us_3.png", "flat", 522e-6),
        ("dark/exposure=2p5ms.png", "dark", 2.5e-3),
        ("flat-exp000522.png", "flat", None),
    ],
)
def test_kind_and_exposure_of_a_name(tmp_path: Path, name: str, kind: str, exposure_s: float | None) -> None:
    write_png(tmp_path / name)
    (group,) = folder_frames(tmp_path, bit_depth=12).groups
    assert group.kind == kind
    assert group.exposure_s == (None if exposure_s is None else pytest.approx(exposure_s))


@pytest.mark.parametrize("name", ["flat_exp000522.png", "flat_exp_522.png", "flat_texp=522.png"])
def test_a_number_without_a_unit_has_the_one_that_is_stated(tmp_path: Path, name: str) -> None:
    write_png(tmp_path / name)
    (group,) = folder_frames(tmp_path, bit_depth=12, exposure_unit="us").groups
    assert group.exposure_s == pytest.approx(522e-6)


def test_many_images_of_which_the_same_is_to_be_said_take_few_lines(tmp_path: Path) -> None:
    for number in range(84):
        write_png(tmp_path / f"raw_{number:02}.png")
    with pytest.raises(ConfigError) as caught:
        folder_frames(tmp_path, bit_depth=12)
    assert len(str(caught.value).splitlines()) == 5
    assert "and 81 more files" in str(caught.value)


def test_exposures_that_are_not_recognised_are_told_as_such(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for number, (kind, exposure_s, counts) in enumerate(frames()):
        write_png(tmp_path / f"{kind}_{exposure_s * 1e6:g}_{number:03}.png", counts)
    arguments = ["--folder", str(tmp_path), "--bit-depth", "12", "--out", str(tmp_path / "noise.json")]
    assert main(["calibrate", "noise", *arguments]) == EXIT_DATA
    error = " ".join(capsys.readouterr().err.split())
    assert "no exposure was recognised" in error
    assert "--table" in error
    assert "keep automatic exposure" not in error


def test_kind_and_exposure_of_a_header(tmp_path: Path) -> None:
    header = fits.Header({"IMAGETYP": "Flat Field", "EXPTIME": 0.02})
    fits.PrimaryHDU(np.full((4, 5), 7, np.uint16), header).writeto(tmp_path / "a.fits")
    (group,) = folder_frames(tmp_path, bit_depth=12).groups
    assert (group.kind, group.exposure_s) == ("flat", 0.02)


def test_flats_of_one_exposure_in_two_folders_are_two_levels(tmp_path: Path) -> None:
    for lamp in ("lamp1", "lamp2"):
        for number in range(2):
            write_png(tmp_path / "flat" / lamp / f"10ms_{number}.png")
            write_png(tmp_path / "dark" / lamp / f"10ms_{number}.png")
    sizes = {(group.kind, len(group.loaders)) for group in folder_frames(tmp_path, bit_depth=12).groups}
    assert sizes == {("flat", 2), ("dark", 4)}


def test_an_image_that_is_neither_is_named(tmp_path: Path) -> None:
    write_png(tmp_path / "one.png")
    write_png(tmp_path / "dark_flat.png")
    with pytest.raises(ConfigError, match=r"dark_flat\.png: is it dark or flat\?(.|\n)*one\.png: is it"):
        folder_frames(tmp_path, bit_depth=12)


def test_an_empty_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="holds no PNG"):
        folder_frames(tmp_path, bit_depth=12)


def test_files_that_lost_their_noise_are_refused_by_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_png(tmp_path / "flat_10ms.jpg", np.zeros((4, 4), np.uint8))
    with pytest.raises(RefusedFramesError, match="lossy_compression"):
        folder_frames(tmp_path, bit_depth=8)
    arguments = ["--folder", str(tmp_path), "--bit-depth", "8", "--out", str(tmp_path / "n.json"), "--json"]
    assert main(["calibrate", "noise", *arguments]) == EXIT_DATA
    shown = capsys.readouterr()
    assert "lossy_compression" in shown.err
    assert [flag["name"] for flag in json.loads(shown.out)["flags"]] == ["lossy_compression"]


def test_images_want_a_bit_depth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_png(tmp_path / "dark_10ms.png")
    arguments = ["calibrate", "noise", "--folder", str(tmp_path), "--out", str(tmp_path / "n.json")]
    assert main(arguments) == EXIT_USAGE
    assert "--bit-depth" in capsys.readouterr().err


def test_every_problem_of_a_table_is_named(tmp_path: Path) -> None:
    write_png(tmp_path / "a.png")
    table = tmp_path / "table.csv"
    table.write_text("file,kind,exposure_ms\na.png,grey,1\nb.png,dark,1\na.png,flat,long\n")
    with pytest.raises(ConfigError, match=r"line 2: kind is 'grey'(.|\n)*line 3: there is no file(.|\n)*line 4: exp"):
        table_frames(table, bit_depth=12)


def test_exposures_of_a_table_in_another_unit(tmp_path: Path) -> None:
    write_png(tmp_path / "one.png")
    table = tmp_path / "frames.csv"
    table.write_text("file,kind,exposure_ms\none.png,flat,522\n")
    (group,) = table_frames(table, bit_depth=12, exposure_unit="us").groups
    assert group.exposure_s == pytest.approx(522e-6)


def test_columns_that_are_not_known_are_named(tmp_path: Path) -> None:
    table = tmp_path / "table.csv"
    table.write_text("file,sort\na.png,dark\n")
    with pytest.raises(ConfigError, match=r"'kind' is missing(.|\n)*'sort' is none of"):
        table_frames(table, bit_depth=12)


def test_a_table_gives_photons_and_levels(tmp_path: Path) -> None:
    for name in ("a.png", "b.png", "c.png"):
        write_png(tmp_path / name)
    table = tmp_path / "table.csv"
    table.write_text("file,kind,exposure_ms,photons,level\na.png,flat,10,500,1\nb.png,flat,10,900,2\nc.png,dark,10,,\n")
    found = table_frames(table, bit_depth=12).groups
    assert [(group.kind, group.photons) for group in found] == [("flat", 500.0), ("flat", 900.0), ("dark", None)]
    np.testing.assert_array_equal(found[0].loaders[0](), np.full((4, 5), 7))


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no such folder"):
        folder_frames(tmp_path / "nowhere", bit_depth=12)
