"""Pictures behind polarizers on the pixels: against loops over pixels, drawn noise, and real frames."""

import os
from itertools import permutations
from pathlib import Path

import cv2
import numpy as np
import pytest

from model.processing.mosaic import (
    crossed_pairs,
    deviation_inflation,
    mean_inflation,
    mosaic,
    pair_by_light,
    planes,
    variance_factor,
)

REAL_DATA = os.environ.get("RIGCTL_REAL_DATA")
CELL = (90.0, 45.0, 135.0, 0.0)


def near(counts: np.ndarray, place: int, row: int, column: int) -> float:
    """Return the mean of the nearest samples of a place, one to four of them, the rim repeated."""
    height, width = counts.shape
    rows = [row] if row % 2 == place // 2 else [row - 1, row + 1]
    columns = [column] if column % 2 == place % 2 else [column - 1, column + 1]
    inside = [
        (min(max(r, place // 2), height - 2 + place // 2), min(max(c, place % 2), width - 2 + place % 2))
        for r in rows
        for c in columns
    ]
    return float(np.mean([counts[at] for at in inside]))


def test_interpolated_pictures_are_means_of_the_nearest_samples() -> None:
    counts = np.random.default_rng(1).integers(0, 4000, (8, 12)).astype(np.uint16)
    found = planes(counts, interpolation="bilinear", saturation_dn=4095.0)
    wanted = [[[near(counts, place, r, c) for c in range(12)] for r in range(8)] for place in range(4)]
    np.testing.assert_array_equal(np.stack(found), np.rint(wanted))


def test_the_samples_themselves_go_back_to_where_they_were() -> None:
    counts = np.random.default_rng(2).integers(0, 4000, (7, 11)).astype(np.uint16)
    parts = planes(counts, interpolation="none", saturation_dn=4095.0)
    assert [part.shape for part in parts] == [(3, 5)] * 4
    np.testing.assert_array_equal(mosaic(parts), counts[:6, :10])


def test_what_a_saturated_sample_is_part_of_is_saturated() -> None:
    counts = np.full((8, 8), 100, dtype=np.uint16)
    counts[2, 2] = 255
    first, *others = planes(counts, interpolation="bilinear", saturation_dn=255.0)
    assert np.argwhere(first == 255).tolist() == [[r, c] for r in (1, 2, 3) for c in (1, 2, 3)]
    assert all((other == 100).all() for other in others)


def test_noise_of_interpolated_pictures_is_as_stated() -> None:
    rng = np.random.default_rng(3)
    drawn = [
        planes((1000.0 + rng.normal(0.0, 40.0, (32, 32))).round().astype(np.uint16), interpolation="bilinear",
               saturation_dn=65535.0)[1][4:-4, 4:-4].astype(float) - 1000.0
        for _ in range(1500)
    ]  # fmt: skip
    pictures = np.stack(drawn)
    variances, pixels = np.mean(pictures**2, axis=(1, 2)), pictures[0].size
    assert variances.mean() / 1600.0 == pytest.approx(variance_factor("bilinear"), rel=0.01)
    of_means = np.var(pictures.mean(axis=(1, 2))) * pixels / variances.mean()
    # The rim of 24 x 24 pixels takes some samples from beyond it; 1500 draws give 4 % of a variance.
    assert of_means == pytest.approx(mean_inflation("bilinear"), rel=0.15)
    of_variances = np.var(variances) * pixels / (2.0 * variances.mean() ** 2)
    assert of_variances == pytest.approx(deviation_inflation("bilinear"), rel=0.15)


def test_nothing_is_inflated_where_nothing_is_interpolated() -> None:
    assert (variance_factor("none"), mean_inflation("none"), deviation_inflation("none")) == (1.0, 1.0, 1.0)


def lit_cell(s1: np.ndarray, s2: np.ndarray, *, noise: float = 0.01) -> np.ndarray:
    """Return a mosaic of the cell of light with these S1 and S2 over S0, noise of a share of it."""
    picture = np.empty((2 * s1.shape[0], 2 * s1.shape[1]))
    for place, angle in enumerate(np.deg2rad(CELL)):
        picture[place // 2 :: 2, place % 2 :: 2] = 1.0 + s1 * np.cos(2 * angle) + s2 * np.sin(2 * angle)
    noisy = picture * (1.0 + np.random.default_rng(5).normal(0.0, noise, picture.shape))
    return (1000.0 * noisy).astype(np.uint16)


@pytest.mark.parametrize("cell", list(permutations(CELL)))
def test_a_cell_with_other_pairs_is_told_by_the_sums_of_polarized_light(cell: tuple[float, ...]) -> None:
    ramp = np.linspace(-0.3, 0.3, 64)
    counts = lit_cell(*np.meshgrid(ramp, ramp))
    has_same_pairs = set(crossed_pairs(cell) or ()) == {(0, 3), (1, 2)}
    assert pair_by_light(counts, cell, saturation_dn=4095.0) == (None if has_same_pairs else (0, 3))


def test_light_that_is_not_polarized_tells_nothing() -> None:
    counts = lit_cell(np.zeros((64, 64)), np.zeros((64, 64)))
    assert pair_by_light(counts, (90.0, 0.0, 45.0, 135.0), saturation_dn=4095.0) is None


def test_angles_that_do_not_stand_across_one_another_are_not_tested() -> None:
    counts = lit_cell(np.full((64, 64), 0.3), np.zeros((64, 64)))
    assert crossed_pairs((0.0, 30.0, 60.0, 100.0)) is None
    assert pair_by_light(counts, (0.0, 30.0, 60.0, 100.0), saturation_dn=4095.0) is None


@pytest.mark.skipif(REAL_DATA is None, reason="set RIGCTL_REAL_DATA to the folder of real frames (imx250_fruits, ...)")
@pytest.mark.parametrize("name", ["fruits", "carps", "polarizer"])
def test_real_sensors_have_the_cell_that_is_stated(name: str) -> None:
    file = Path(REAL_DATA or "") / f"imx250_{name}" / f"{name}_IMX250MZR.png"
    counts = np.asarray(cv2.imread(str(file), cv2.IMREAD_UNCHANGED)).astype(np.uint16)
    assert pair_by_light(counts, CELL, saturation_dn=255.0) is None
    assert pair_by_light(counts, (0.0, 90.0, 45.0, 135.0), saturation_dn=255.0) == (0, 3)
    # Begun one row further down the cell is another.
    assert pair_by_light(counts[1:], (90.0, 0.0, 45.0, 135.0), saturation_dn=255.0) is not None
