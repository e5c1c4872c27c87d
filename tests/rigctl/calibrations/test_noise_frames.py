"""Frames for a calibration, out of run folders, EMVA 1288 data sets, folders of images and tables."""

import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from astropy.io import fits
from numpy.typing import NDArray

from calibration.results import RefusedFramesError
from rigctl.calibrations.noise import QUANTITIES, read_noise_file
from rigctl.calibrations.noise_calibration import calibrate_frames
from rigctl.calibrations.noise_frames import (
    FrameSet,
    Loader,
    emva_frames,
    folder_frames,
    read_emva_descriptor,
    record_flags,
    run_frames,
    table_frames,
)
from rigctl.cli import main
from rigctl.console import EXIT_DATA, EXIT_USAGE
from rigctl.errors import ConfigError, DataError
from rigctl.runs.writer import RunWriter
from tests.rigctl.noise_sessions import SHAPE, SIGNALS_E, frames, write_emva_set, write_noise_run
from tests.rigctl.run_samples import make_record, noisy_counts, write_run


def test_a_run_is_grouped_by_kind_and_exposure_in_the_order_of_its_frames(tmp_path: Path) -> None:
    found = run_frames(write_noise_run(tmp_path / "run"))
    sizes = {(group.kind, group.exposure_s): len(group.loaders) for group in found.groups}
    assert sizes == {
        (kind, light_e / 1e6): 8 if light_e == 6000.0 else 2 for kind in ("dark", "flat") for light_e in SIGNALS_E
    }
    expected = [counts for kind, exposure_s, counts in frames() if (kind, exposure_s) == ("dark", 0.0006)]
    for load, counts in zip(found.groups[0].loaders, expected, strict=True):
        np.testing.assert_array_equal(load(), counts)
    assert (found.made_for.camera_serial, found.made_for.gain_db, found.bit_depth) == ("42", 0.0, 12)


def test_exposures_that_differ_in_the_last_digits_are_one(tmp_path: Path) -> None:
    with RunWriter.create(tmp_path / "run", {"origin": "simulated"}) as writer:
        for i in range(3):
            writer.write_frame(make_record(i, kind="dark", exposure_s=0.01 * (1.0 + 1e-9 * i)), noisy_counts(i))
    assert [len(group.loaders) for group in run_frames(tmp_path / "run").groups] == [3]


def test_flats_at_another_polarizer_angle_are_another_level(tmp_path: Path) -> None:
    with RunWriter.create(tmp_path / "run", {"origin": "simulated"}) as writer:
        for i in range(4):
            record = make_record(i, kind="flat", exposure_s=0.01, polarizer_angle_target_deg=45.0 * (i % 2))
            writer.write_frame(record, noisy_counts(i))
    assert [len(group.loaders) for group in run_frames(tmp_path / "run").groups] == [2, 2]


def test_a_run_of_scene_frames_only_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no dark and no flat frames"):
        run_frames(write_run(tmp_path / "run"))


def test_frames_of_mixed_gain_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"gain_db: 0\.0, 6\.0"):
        run_frames(write_noise_run(tmp_path / "run", gain_db=(0.0, 6.0)))


def counted(found: FrameSet) -> tuple[FrameSet, list[int]]:
    """Return the frames with loaders that note when they are asked."""
    loads: list[int] = []

    def load(loader: Loader, number: int) -> NDArray[np.uint16]:
        loads.append(number)
        return loader()

    groups, number = [], 0
    for group in found.groups:
        loaders = tuple(partial(load, loader, number + place) for place, loader in enumerate(group.loaders))
        number += len(loaders)
        groups.append(replace(group, loaders=loaders))
    return replace(found, groups=tuple(groups)), loads


def test_each_frame_is_read_once_and_the_first_again_for_its_size(tmp_path: Path) -> None:
    found, loads = counted(run_frames(write_noise_run(tmp_path / "run")))
    calibrate_frames(found)
    assert sorted(loads) == [0, *range(sum(len(group.loaders) for group in found.groups))]


def test_without_a_longest_stack_two_levels_are_read_again(tmp_path: Path) -> None:
    found, loads = counted(run_frames(write_noise_run(tmp_path / "run")))
    pairs = replace(found, groups=tuple(replace(group, loaders=group.loaders[:2]) for group in found.groups))
    assert calibrate_frames(pairs).pattern is not None
    assert len(loads) == 1 + 2 * len(pairs.groups) + 4


def test_an_emva_set_holds_sixteen_bits(tmp_path: Path) -> None:
    found = emva_frames(write_emva_set(tmp_path))
    expected = [counts for kind, exposure_s, counts in frames() if (kind, exposure_s) == ("flat", 0.006)]
    group = next(g for g in found.groups if g.kind == "flat" and len(g.loaders) == 8)
    for load, counts in zip(group.loaders, expected, strict=True):
        np.testing.assert_array_equal(load(), counts)


@pytest.mark.parametrize(
    ("spoil", "problem"),
    [
        (lambda folder: None, r"frame_0\.png: has \(48, 64\) .* says \(480, 640\)"),
        (lambda folder: (folder / "frame_0.png").write_text("no picture"), r"frame_0\.png: is not a FITS, PNG"),
    ],
)
def test_a_file_that_is_not_the_stated_image_is_refused(
    tmp_path: Path, spoil: Callable[[Path], object], problem: str
) -> None:
    descriptor = write_emva_set(tmp_path)
    descriptor.write_text(descriptor.read_text().replace(f"n 12 {SHAPE[1]} {SHAPE[0]}", "n 12 640 480"))
    spoil(tmp_path)
    with pytest.raises(DataError, match=problem):
        emva_frames(descriptor).groups[0].loaders[0]()


def test_another_pixel_is_another_hash_of_the_frames(tmp_path: Path) -> None:
    descriptor = write_emva_set(tmp_path)
    before = emva_frames(descriptor).source
    (tmp_path / "frame_0.png").write_bytes((tmp_path / "frame_1.png").read_bytes())
    after = emva_frames(descriptor).source
    assert before.sha256 == after.sha256
    assert before.frames_sha256 != after.frames_sha256


@pytest.mark.parametrize(
    ("exposure_s", "spacing_s", "spread_c", "names"),
    [
        (0.1, 0.12, 0.0, []),
        # 10 ms that were read as 10 s.
        (10.0, 0.05, 0.0, ["wrong_time_unit"]),
        (0.1, 0.12, 1.0, []),
        (0.1, 0.12, 6.0, ["temperature_drift"]),
    ],
)
def test_flags_of_how_frames_were_taken(exposure_s: float, spacing_s: float, spread_c: float, names: list[str]) -> None:
    records = [
        make_record(
            number,
            kind="dark",
            exposure_s=exposure_s,
            start_monotonic_ns=round(1e9 * spacing_s * number),
            camera_temperature_c=30.0 + 0.5 * spread_c * number,
        )
        for number in range(3)
    ]
    flags = record_flags(records)
    assert [flag.name for flag in flags] == names
    assert [flag.refuses for flag in flags] == [name == "wrong_time_unit" for name in names]


GOOD = r"""# a comment
v 3.0
n 12 640 480

b 40000.0 120.0
i images\b_1.png
i images/b_2.png
d 40000.0
i d_1.png
i d 2.png
"""


def write_descriptor(folder: Path, text: str) -> Path:
    (folder / "images").mkdir()
    for name in ("images/b_1.png", "images/b_2.png", "d_1.png", "d 2.png"):
        (folder / name).touch()
    path = folder / "EMVA1288_Data.txt"
    path.write_text(text, encoding="utf-8")
    return path


def problems(folder: Path, text: str) -> str:
    with pytest.raises(ConfigError) as caught:
        read_emva_descriptor(write_descriptor(folder, text))
    return str(caught.value)


def test_a_descriptor_lists_its_images_by_level(tmp_path: Path) -> None:
    bits, shape, images = read_emva_descriptor(write_descriptor(tmp_path, GOOD))
    assert (bits, shape) == (12, (480, 640))
    # Backslashes, slashes and blanks in the names of files; exposures in nanoseconds.
    names = [one.path.relative_to(tmp_path).as_posix() for one in images]
    assert names == ["images/b_1.png", "images/b_2.png", "d_1.png", "d 2.png"]
    assert [(one.kind, one.photons, one.level) for one in images[1:3]] == [("flat", 120.0, "5"), ("dark", None, "8")]
    assert {one.exposure_s for one in images} == {40e-6}


def test_lines_may_end_as_in_windows(tmp_path: Path) -> None:
    assert len(read_emva_descriptor(write_descriptor(tmp_path, GOOD.replace("\n", "\r\n")))[2]) == 4


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("v 3.0", "w 3.0", "line 2: 'w 3.0' begins with 'w'; allowed are v, n, b, d, i and #"),
        ("n 12 640 480\n", "", "there is no line `n BITS WIDTH HEIGHT`"),
        ("n 12 640 480", "n 12 640", "line 3: '12 640' has to be 3 numbers"),
        ("n 12 640 480", "n 17 640 480", "line 3: n 17 640 480 is not 1 to 16 bits"),
        ("n 12 640 480", "n 12 640 480.5", "all whole numbers"),
        ("n 12 640 480", "n 12 640 480\nn 12 640 480", "line 4: n stands a second time"),
        ("b 40000.0 120.0", "b 40000.0", "line 5: '40000.0' has to be 2 numbers"),
        ("d 40000.0", "d -1", "line 8: '-1' has to be 1 numbers, none below 0"),
        ("d 40000.0", "d inf", "line 8: 'inf' has to be 1 numbers"),
        ("d 40000.0", "d 4 ms", "line 8: '4 ms' has to be 1 numbers"),
        ("i d 2.png", "i d_3.png", "line 10: image 'd_3.png': there is no such file"),
        ("i d 2.png", r"i images\b_1.png", "is listed a second time (first in line 6)"),
        ("d 40000.0", "d 40000.0\nd 50000.0", "line 8: no image follows"),
        ("b 40000.0 120.0\n", "", "line 5: image 'images\\\\b_1.png' stands before any b or d line"),
        ("d 40000.0\n", "", "there is no dark group"),
    ],
)
def test_a_problem_is_named_with_its_line(tmp_path: Path, old: str, new: str, problem: str) -> None:
    assert problem in problems(tmp_path, GOOD.replace(old, new))


def test_all_problems_are_named_at_once(tmp_path: Path) -> None:
    text = problems(tmp_path, "n 12 640\nx\nb 1\ni gone.png\n")
    assert "5 problems" in text
    for line in ("line 1:", "line 2:", "line 3:", "line 4:", "dark group"):
        assert line in text


def test_a_descriptor_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        read_emva_descriptor(tmp_path / "gone.txt")


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


def test_folders_and_images_that_are_no_frames_are_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no such folder"):
        folder_frames(tmp_path / "nowhere", bit_depth=12)
    with pytest.raises(ConfigError, match="has no PNG"):
        folder_frames(tmp_path, bit_depth=12)
    write_png(tmp_path / "one.png")
    write_png(tmp_path / "dark_flat.png")
    with pytest.raises(ConfigError, match=r"dark_flat\.png: is it dark or flat\?(.|\n)*one\.png: is it"):
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


@pytest.mark.parametrize(
    ("text", "problems"),
    [
        (
            "file,kind,exposure_ms\na.png,grey,1\nb.png,dark,1\na.png,flat,long\n",
            r"line 2: kind is 'grey'(.|\n)*line 3: there is no file(.|\n)*line 4: exp",
        ),
        ("file,sort\na.png,dark\n", r"'kind' is missing(.|\n)*'sort' is not one of"),
    ],
)
def test_every_problem_of_a_table_is_named(tmp_path: Path, text: str, problems: str) -> None:
    write_png(tmp_path / "a.png")
    (tmp_path / "table.csv").write_text(text)
    with pytest.raises(ConfigError, match=problems):
        table_frames(tmp_path / "table.csv", bit_depth=12)


def test_exposures_of_a_table_in_another_unit(tmp_path: Path) -> None:
    write_png(tmp_path / "one.png")
    table = tmp_path / "frames.csv"
    table.write_text("file,kind,exposure_ms\none.png,flat,522\n")
    (group,) = table_frames(table, bit_depth=12, exposure_unit="us").groups
    assert group.exposure_s == pytest.approx(522e-6)


def test_a_table_gives_photons_and_levels(tmp_path: Path) -> None:
    for name in ("a.png", "b.png", "c.png"):
        write_png(tmp_path / name)
    table = tmp_path / "table.csv"
    table.write_text("file,kind,exposure_ms,photons,level\na.png,flat,10,500,1\nb.png,flat,10,900,2\nc.png,dark,10,,\n")
    found = table_frames(table, bit_depth=12).groups
    assert [(group.kind, group.photons) for group in found] == [("flat", 500.0), ("flat", 900.0), ("dark", None)]
    np.testing.assert_array_equal(found[0].loaders[0](), np.full((4, 5), 7))
