import json
import os

import cv2
import numpy as np
import pytest
from astropy.io import fits

from rigctl import cli
from rigctl.runs.check import verify_run
from rigctl.runs.folder import read_run
from tests.rigctl.run_samples import noisy_counts, write_run

COUNTS = [noisy_counts(i, (6, 8)) for i in range(4)]
SAID = ["--exposure-s", "0.01", "--black-level-dn", "15", "--bit-depth", "12"]


@pytest.fixture
def pngs(tmp_path):
    paths = [tmp_path / f"image{i}.png" for i in range(4)]
    for path, counts in zip(paths, COUNTS, strict=True):
        cv2.imwrite(str(path), counts)
    return [str(path) for path in paths]


@pytest.fixture
def run_path(tmp_path):
    return tmp_path / "run"


def write_fits(path, counts, **header):
    unit = fits.PrimaryHDU(counts)
    unit.header.update(header)
    unit.writeto(path)
    return str(path)


def import_into(run_path, *words):
    return cli.main(["import", str(run_path), *map(str, words)])


def angles_of(run_path):
    return [record.polarizer_angle_deg for record in read_run(run_path).frames]


def test_images_become_frames_with_their_angles(run_path, pngs):
    assert import_into(run_path, *pngs, "--angles", "0,45,90,135", *SAID) == 0
    run = read_run(run_path)
    assert angles_of(run_path) == [0.0, 45.0, 90.0, 135.0]
    for record, counts in zip(run.frames, COUNTS, strict=True):
        np.testing.assert_array_equal(run.counts(record), counts)
    assert run.frames[2].source_file == pngs[2]
    assert (run.frames[0].exposure_s, run.frames[0].black_level_dn, run.frames[0].bit_depth) == (0.01, 15.0, 12)
    assert run.session.origin == "import"
    check = verify_run(run_path)
    assert (check.ok, check.leftovers) == (True, ())


@pytest.mark.parametrize("words", [["--angles", "-60,0,60"], ["--angles=-60,0,60"]])
def test_list_of_angles_may_begin_with_a_minus(run_path, pngs, words):
    assert import_into(run_path, *pngs[:3], *words, *SAID) == 0
    assert angles_of(run_path) == [-60.0, 0.0, 60.0]


def test_header_tells_angle_exposure_black_level_and_time(run_path, tmp_path):
    facts = [("-60 Deg", 100.0, 582.1), ("0 Deg", 99.5, 582.2), (60.5, 100.5, 582.3)]
    files = [
        write_fits(
            tmp_path / f"{i}.fits",
            noisy_counts(i).astype(np.int32),
            **{"POLAR": polar, "EXPTIME": exposure, "OFFSET": offset, "DATE-OBS": "2026-05-04T10:00:00.5"},
        )
        for i, (polar, exposure, offset) in enumerate(facts)
    ]
    words = ["--angle-key", "polar", "--exposure-key", "EXPTIME", "--black-level-key", "OFFSET", "--bit-depth", "12"]
    assert import_into(run_path, *files, *words) == 0
    frames = read_run(run_path).frames
    assert angles_of(run_path) == [-60.0, 0.0, 60.5]
    assert [record.exposure_s for record in frames] == [100.0, 99.5, 100.5]
    assert [record.black_level_dn for record in frames] == [582.1, 582.2, 582.3]
    assert frames[0].start_utc == "2026-05-04T10:00:00.5Z"


def test_mosaic_gives_four_frames_of_one_shot(run_path, pngs):
    words = ["--mosaic", "90,45,135,0", "--black-level-dn", "0", "--bit-depth", "12"]
    assert import_into(run_path, pngs[0], *words) == 0
    run = read_run(run_path)
    assert angles_of(run_path) == [90.0, 45.0, 135.0, 0.0]
    planes = [COUNTS[0][0::2, 0::2], COUNTS[0][0::2, 1::2], COUNTS[0][1::2, 0::2], COUNTS[0][1::2, 1::2]]
    for record, plane in zip(run.frames, planes, strict=True):
        np.testing.assert_array_equal(run.counts(record), plane)
        assert record.exposure_s is None


def test_row_order_of_a_file_cannot_be_contradicted(run_path, tmp_path, capsys):
    file = write_fits(tmp_path / "image.fits", COUNTS[0], ROWORDER="TOP-DOWN")
    assert import_into(run_path, file, "--angles", "0", *SAID, "--first-row", "bottom") == 2
    assert "--first-row bottom: the file itself says top" in capsys.readouterr().err


def test_left_justified_counts_are_shifted_and_that_is_said_and_noted(run_path, tmp_path, capsys):
    counts = noisy_counts(5, (60, 80))
    cv2.imwrite(str(tmp_path / "left.png"), counts << 4)
    words = ["--angles", "0", "--black-level-dn", "240", "--bit-depth", "12"]
    assert import_into(run_path, tmp_path / "left.png", *words) == 0
    assert "left-justified" in capsys.readouterr().out
    run = read_run(run_path)
    np.testing.assert_array_equal(run.counts(run.frames[0]), counts)
    assert run.frames[0].black_level_dn == 15.0
    assert any("left-justified" in remark for remark in run.frames[0].remarks)


def test_repeated_axes_are_counted_as_cycles(run_path, pngs):
    import_into(run_path, *pngs, "--angles", "0,90,180,-90", *SAID)
    assert [record.cycle for record in read_run(run_path).frames] == [0, 0, 1, 1]


def test_darks_can_be_added_and_then_tell_the_black_level(run_path, pngs):
    words = ["--same-exposure", "--bit-depth", "12"]
    assert import_into(run_path, *pngs[:3], "--angles", "0,60,120", *words, "--black-level-from-darks") == 0
    assert import_into(run_path, pngs[3], "--kind", "dark") == 0
    frames = read_run(run_path).frames
    assert [(record.sequence, record.kind) for record in frames] == [
        (0, "scene"),
        (1, "scene"),
        (2, "scene"),
        (3, "dark"),
    ]
    assert frames[3].polarizer_angle_deg is None
    assert (frames[3].bit_depth, frames[3].remarks) == (12, ("12 bits, as the other frames of this run",))
    assert import_into(run_path, pngs[3], "--angles", "30") == 0


def test_frames_of_another_size_are_not_added(run_path, pngs, tmp_path, capsys):
    import_into(run_path, *pngs[:3], "--angles", "0,60,120", *SAID)
    before = {file: file.read_bytes() for file in run_path.rglob("*") if file.is_file()}
    cv2.imwrite(str(tmp_path / "dark.png"), noisy_counts(9, (4, 4)))
    assert import_into(run_path, tmp_path / "dark.png", "--kind", "dark") == 4
    assert "frames of 4 x 4 pixels do not fit" in capsys.readouterr().err
    assert {file: file.read_bytes() for file in run_path.rglob("*") if file.is_file()} == before


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--angles", "0,45"], "2 angles for 4 files"),
        (["--angles", "0,x,90,135"], "--angles: 'x' is not a number of degrees"),
        (["--angles", "0,nan,90,135"], "finite"),
        (["--angles", "0,45,90,135", "--mosaic", "0,45,90,135"], "give one of them"),
        (["--mosaic", "0,45,90"], "3 angles"),
        (["--angles", "0,45,90,135", "--kind", "sky"], 'for --kind. Choose from: "scene", "dark", "flat"'),
        (["--angles", "0,45,90,135", "--missing-dn", "1,2"], "Invalid value for --missing-dn"),
        (["--angles", "0,45,90,135", "--saturation-dn", "5e9"], "between 0 and 4.29497e+09"),
        (["--angles", "0,45,90,135", "--same-exposure"], "--same-exposure: give one of them"),
        (["--angle-key", "POL"], "--angle-key POL: not in this file"),
    ],
)
def test_command_line_that_is_wrong_ends_with_2(run_path, pngs, capsys, words, text):
    assert import_into(run_path, *pngs, *SAID, *words) == 2
    assert text in capsys.readouterr().err
    assert not run_path.exists()


def test_every_problem_is_named_in_one_message(run_path, pngs, tmp_path, capsys):
    (tmp_path / "notes.txt").write_text("sunny")
    cv2.imwrite(str(tmp_path / "small.png"), noisy_counts(9, (4, 4)))
    files = [*pngs[:1], tmp_path / "notes.txt", tmp_path / "small.png", tmp_path / "none.png"]
    assert import_into(run_path, *files, "--angles", "0,60", "--bit-depth", "12") == 2
    message = capsys.readouterr().err
    for text in (
        "2 angles for 4 files",
        "--exposure-s",
        "--black-level-dn",
        "notes.txt: is not a FITS",
        "small.png: 4 x 4 pixels",
        "none.png: cannot be read",
    ):
        assert text in message


def test_unfit_files_end_with_4_and_leave_nothing(run_path, pngs, tmp_path):
    (tmp_path / "notes.txt").write_text("sunny")
    before = sorted(tmp_path.iterdir())
    assert import_into(run_path, pngs[0], tmp_path / "notes.txt", "--angles", "0,60", *SAID) == 4
    assert sorted(tmp_path.iterdir()) == before


def test_full_disk_leaves_nothing(run_path, pngs, tmp_path, monkeypatch, capsys):
    before = sorted(tmp_path.iterdir())
    flushes = iter(range(12))  # enough for the folder and a frame or two
    flush = os.fsync

    def failing(descriptor):
        if next(flushes, None) is None:
            raise OSError(28, "No space left on device")
        flush(descriptor)

    monkeypatch.setattr(os, "fsync", failing)
    assert import_into(run_path, *pngs, "--angles", "0,45,90,135", *SAID) == 4
    assert "No space left" in capsys.readouterr().err
    assert sorted(tmp_path.iterdir()) == before


def test_too_few_axes_are_said(run_path, pngs, capsys):
    assert import_into(run_path, *pngs[:3], "--angles", "0,90,180", *SAID, "--json") == 0
    assert "2 different axes only" in json.loads(capsys.readouterr().out)["remarks"][0]


MOSAIC = ["--mosaic", "0,45,90,135", "--black-level-dn", "0", "--bit-depth", "12"]


@pytest.mark.parametrize(
    ("suffix", "words", "seen"),
    [
        ("fits", ["--angles", "0", *SAID], COUNTS[0][::-1]),
        ("fits", MOSAIC, COUNTS[0][::-1][0::2, 0::2]),  # the cell is that of the picture as shown
        ("png", ["--angles", "0", *SAID], COUNTS[0]),
        ("png", ["--angles", "0", *SAID, "--first-row", "bottom"], COUNTS[0][::-1]),
    ],
)
def test_pictures_are_turned_upright_and_that_is_noted(run_path, pngs, tmp_path, suffix, words, seen):
    # A time that is none leaves it unknown.
    file = (
        pngs[0]
        if suffix == "png"
        else write_fits(tmp_path / "a.fits", COUNTS[0], **{"DATE-OBS": "2026-13-04T10:00:00"})
    )
    assert import_into(run_path, file, *words) == 0
    run = read_run(run_path)
    np.testing.assert_array_equal(run.counts(run.frames[0]), seen)
    assert any("turned" in remark for remark in run.frames[0].remarks) is (suffix == "fits" or "--first-row" in words)
    assert run.frames[0].start_utc is None


def test_what_does_not_fit_is_refused(run_path, pngs, tmp_path, capsys):
    cv2.imwrite(str(tmp_path / "odd.png"), noisy_counts(0, (5, 8)))
    clear = write_fits(tmp_path / "clear.fits", COUNTS[0], POLAR="Clear")
    taken = write_run(tmp_path / "taken")
    for target, file, words, code, said in (
        (run_path, tmp_path / "odd.png", MOSAIC, 4, "cannot be cut into cells"),
        (run_path, clear, ["--angle-key", "POLAR", *SAID], 2, "'Clear' is not an angle"),
        (taken, pngs[0], ["--kind", "dark", *SAID], 4, "not imported"),
    ):
        assert import_into(target, file, *words) == code
        assert said in capsys.readouterr().err


def test_the_limit_is_an_option(tmp_path, capsys):
    cv2.imwrite(str(tmp_path / "a.png"), np.ones((1000, 1000), dtype=np.uint16))
    words = ["--angles", "0", "--same-exposure", "--black-level-dn", "0", "--bit-depth", "12"]
    run, image = str(tmp_path / "run"), str(tmp_path / "a.png")
    assert cli.main(["import", run, image, *words, "--max-frame-mb", "1"]) == 4
    assert "would take 2 MB by its header" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
    assert cli.main(["import", run, image, *words, "--max-frame-mb", "2"]) == 0
