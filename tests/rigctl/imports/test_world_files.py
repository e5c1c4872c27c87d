"""Files as people have them: resampled, with borders, coded, clipped, with stale checksums."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from astropy.io import fits
from numpy.typing import NDArray

from rigctl.cli import main
from rigctl.console import EXIT_DATA, EXIT_USAGE
from rigctl.imports.images import constant_border
from rigctl.runs.folder import read_run
from tests.worldlike import Faults, World, expose

ANGLES = "0,45,90,135"


def frames(faults: Faults, seed: int = 3) -> NDArray[np.uint16]:
    return expose(World(texture=0.1), faults, np.random.default_rng(seed))


def imported(folder: Path, pictures: NDArray[np.uint16], *words: str) -> int:
    paths = []
    for index, picture in enumerate(pictures):
        paths.append(str(folder / f"{index}.png"))
        cv2.imwrite(paths[-1], picture)
    given = ["--angles", ANGLES, "--same-exposure", "--black-level-dn", "0", *words]
    return main(["import", str(folder / "run"), *paths, *given])


def said(capsys: pytest.CaptureFixture[str]) -> str:
    return " ".join(capsys.readouterr().out.split())


def test_a_constant_border_is_missing_and_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert imported(tmp_path, frames(Faults(border_pixels=3)), "--bit-depth", "12") == 0
    assert "a constant border of 0" in said(capsys)
    assert read_run(tmp_path / "run").frames[0].missing_dn == 0.0


def test_a_border_is_left_where_nobody_wants_it_searched(tmp_path: Path) -> None:
    words = ["--bit-depth", "12", "--no-border-search", "--missing-dn", "none"]
    assert imported(tmp_path, frames(Faults(border_pixels=3)), *words) == 0
    assert read_run(tmp_path / "run").frames[0].missing_dn is None


def test_only_the_piece_that_is_a_border_is_missing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pictures = frames(Faults(border_pixels=3))
    pictures[:, 50:54, 60:64] = 0  # black within the picture is of the picture
    assert imported(tmp_path, pictures, "--bit-depth", "12") == 0
    share = 1.0 - (pictures.shape[1] - 6) * (pictures.shape[2] - 6) / pictures[0].size
    shown = said(capsys)
    assert shown.count("a constant border") == 1
    assert f"takes up to {share:.2%} of a file" in shown
    run = read_run(tmp_path / "run")
    for record, picture in zip(run.frames, pictures, strict=True):
        is_border = np.ones(picture.shape, dtype=bool)
        is_border[3:-3, 3:-3] = False
        counts = run.counts(record)
        np.testing.assert_array_equal(counts == record.missing_dn, is_border)
        np.testing.assert_array_equal(counts[~is_border], picture[~is_border])


def test_dark_pictures_and_dark_areas_that_touch_an_edge_are_no_border() -> None:
    assert constant_border(np.random.default_rng(1).poisson(0.3, (80, 90)).astype(np.uint16)) is None
    picture = frames(Faults())[0]
    picture[30:60, :40] = 0
    assert constant_border(picture) is None


def test_an_import_begins_with_the_share_of_clipped_pixels(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pictures = frames(Faults())
    pictures[:, :16, :32], pictures[:, 16:32, :16] = 4095, 0
    assert imported(tmp_path, pictures, "--bit-depth", "12", "--no-border-search") == 0
    high, low = (100.0 * pixels / pictures[0].size for pixels in (512, 256))
    first = capsys.readouterr().out.splitlines()[0]
    assert first == f"clipped: {high:.1f} % of the pixels at the upper end (4095 DN), {low:.2f} % at 0"


def resampled(pictures: NDArray[np.uint16]) -> NDArray[np.uint16]:
    motion = np.array([[1.0, 0.0, 0.4], [0.0, 1.0, 0.3]])
    moved = [cv2.warpAffine(one, motion, one.shape[::-1], borderMode=cv2.BORDER_REFLECT) for one in pictures[1:]]
    return np.array([pictures[0], *moved])


def test_resampled_neighbours_of_a_left_justified_picture_are_taken_as_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pictures = resampled(frames(Faults(left_shift=4)))
    assert imported(tmp_path, pictures, "--bit-depth", "12", "--justified", "left") == 0
    assert "1 of 4 files show it" in said(capsys)
    run = read_run(tmp_path / "run")
    np.testing.assert_array_equal(run.counts(run.frames[0]), pictures[0] >> 4)
    np.testing.assert_allclose(run.counts(run.frames[1]), pictures[1] / 16.0, atol=0.5)


def test_one_picture_with_unused_bits_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pictures = resampled(frames(Faults(left_shift=4)))
    assert imported(tmp_path, pictures) == EXIT_USAGE
    assert "say --bit-depth 12 --justified left" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("faults", "text"),
    [
        (Faults(jpeg_quality=80), "JPEG was at work"),
        (Faults(clipped_share=0.1), "saturated pixels, where nothing is measured"),
        (Faults(), ""),
    ],
)
def test_what_is_odd_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str], faults: Faults, text: str) -> None:
    assert imported(tmp_path, frames(faults), "--bit-depth", "12") == 0
    shown = said(capsys)
    assert (text in shown) if text else ("note:" not in shown)


def fits_files(folder: Path, *, spoilt: bool) -> list[str]:
    paths = []
    for index, picture in enumerate(frames(Faults())):
        path = folder / f"{index}.fits"
        fits.PrimaryHDU(picture.astype(np.int32)).writeto(path, checksum=True)
        data = bytearray(path.read_bytes())
        # A keyword changed by an editor that knows nothing of checksums; or a sample.
        place = 2 * 2880 + 41 if spoilt else data.index(b"DATASUM") + 50
        data[place] = data[place] ^ 1 if spoilt else ord("x")
        path.write_bytes(bytes(data))
        paths.append(str(path))
    return paths


@pytest.mark.parametrize(("spoilt", "code"), [(False, 0), (True, EXIT_DATA)])
def test_a_stale_header_checksum_is_read_with_a_remark_and_spoilt_samples_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], spoilt: bool, code: int
) -> None:
    words = ["--angles", ANGLES, "--same-exposure", "--black-level-dn", "0", "--bit-depth", "12"]
    assert main(["import", str(tmp_path / "run"), *fits_files(tmp_path, spoilt=spoilt), *words]) == code
    assert ("its CHECKSUM is stale" in said(capsys)) is not spoilt
