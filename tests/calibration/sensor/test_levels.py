"""Statistics of a level against draws with known truth and a slow literal oracle."""

import tracemalloc
import weakref
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.results import CalibrationError
from calibration.sensor.levels import LevelStatistics, level_statistics

SHAPE = (64, 80)
N_PIXELS = SHAPE[0] * SHAPE[1]


def noisy(n: int, *, sigma_dn: float, seed: int, pattern: object = 0.0) -> list[NDArray[np.uint16]]:
    draws = np.random.default_rng(seed)
    return [
        np.rint(1000.0 + np.asarray(pattern) + sigma_dn * draws.standard_normal(SHAPE)).astype(np.uint16)
        for _ in range(n)
    ]


def statistics(frames: list[NDArray[np.uint16]]) -> LevelStatistics:
    return level_statistics(frames, kind="flat", exposure_s=0.01)


def test_agrees_with_the_definitions_pixel_by_pixel() -> None:
    frames = [frame[:7, :9] for frame in noisy(5, sigma_dn=8.0, seed=1)]
    n_pixels, temporal = 63, []
    for y in range(7):
        for x in range(9):
            squares = [(float(b[y, x]) - float(a[y, x]) - (b.mean() - a.mean())) ** 2 for a, b in pairwise(frames)]
            temporal.append(sum(squares) / (2 * 4) * n_pixels / (n_pixels - 1))
    mean_picture = np.mean(frames, axis=0)
    got = statistics(frames)
    # Squares are in single precision: 6e-8 of the difference, twice that of its square. Sums of samples are exact.
    assert got.temporal_variance_dn2 == pytest.approx(np.mean(temporal), rel=3e-7)
    assert got.spatial_variance_dn2 == pytest.approx(mean_picture.var(ddof=1) - np.mean(temporal) / 5, rel=3e-6)
    assert got.mean_dn == pytest.approx(mean_picture.mean(), rel=1e-12)


def test_temporal_variance_of_a_pair_and_its_error() -> None:
    got = statistics(noisy(2, sigma_dn=10.0, seed=2))
    truth_dn2 = 100.0 + 1.0 / 12.0
    assert abs(got.temporal_variance_dn2 - truth_dn2) < 5.0 * got.temporal_std_error_dn2
    # Normal noise: sqrt(2 / N). The estimate of it has a relative error of sqrt((kappa - 1) / N) / 2 with kappa = 15
    # for squares of squares: 2.6 %; 4 sigma.
    assert got.temporal_std_error_dn2 == pytest.approx(truth_dn2 * np.sqrt(2.0 / N_PIXELS), rel=0.11)


@pytest.mark.parametrize(
    "added",
    [
        np.array([0, 50, 7, 90])[:, None, None],
        np.random.default_rng(5).integers(0, 500, SHAPE)[None],
    ],
    ids=["flicker of whole frames", "fixed pattern"],
)
def test_flicker_and_fixed_pattern_leave_the_temporal_variance_unchanged(added: NDArray[np.int64]) -> None:
    frames = noisy(4, sigma_dn=10.0, seed=3)
    changed = list((np.array(frames) + added).astype(np.uint16))
    # Equal but for the rounding of a subtraction in single precision.
    assert statistics(changed).temporal_variance_dn2 == pytest.approx(
        statistics(frames).temporal_variance_dn2, rel=3e-7
    )


@pytest.mark.parametrize("n_frames", [2, 16])
@pytest.mark.parametrize("pattern_dn", [0.0, 6.0])
def test_the_spatial_variance_is_that_of_the_fixed_pattern(n_frames: int, pattern_dn: float) -> None:
    pattern = pattern_dn * np.random.default_rng(7).standard_normal(SHAPE)
    got = statistics(noisy(n_frames, sigma_dn=10.0, seed=8, pattern=pattern))
    # With temporal noise in it, it would be 50 and more standard errors too large.
    assert abs(got.spatial_variance_dn2 - pattern_dn**2) < 5.0 * got.spatial_std_error_dn2
    # For normal noise: sqrt(2 / N) of the variance of the mean picture, and the error of the temporal noise.
    expected = np.sqrt(2.0 / N_PIXELS) * (pattern_dn**2 + 100.0 / n_frames)
    assert 0.7 * expected < got.spatial_std_error_dn2 < (1.3 if pattern_dn else 2.0) * expected


def test_a_cosmic_hit_is_left_out() -> None:
    frames = noisy(3, sigma_dn=5.0, seed=9)
    clean = statistics(frames)
    frames[1][10, 20] = 4000
    hit = statistics(frames)
    assert hit.n_pixels == N_PIXELS - 1
    # One pixel of 5120 less changes the mean of squares by less than its largest square over N: 36 / N.
    assert hit.temporal_variance_dn2 == pytest.approx(clean.temporal_variance_dn2, rel=36.0 / N_PIXELS)


def test_noise_has_no_outliers() -> None:
    # 6 sigma: 2e-9 a difference, 3e5 differences.
    assert statistics(noisy(64, sigma_dn=5.0, seed=10)).n_pixels == N_PIXELS


def test_small_scale_variance_is_without_light_that_falls_off_and_with_all_of_a_pixel_pattern() -> None:
    slope = np.broadcast_to(np.linspace(-30.0, 30.0, SHAPE[1]), SHAPE)
    smooth = statistics(noisy(8, sigma_dn=3.0, seed=11, pattern=slope))
    # A slope of 60 / 79 DN a pixel has (4^2 - 1) / 12 of its square within blocks of 4; rounding of samples in a slope
    # adds up to 1/12 DN^2.
    expected = (60.0 / 79.0) ** 2 * 15.0 / 12.0
    assert smooth.small_scale_variance_dn2 == pytest.approx(expected, abs=1.0 / 12.0 + 0.2)
    assert smooth.spatial_variance_dn2 > 280.0
    pattern = 20.0 * np.random.default_rng(12).standard_normal(SHAPE)
    pixels = statistics(noisy(8, sigma_dn=3.0, seed=13, pattern=pattern))
    # 320 block means of 16 pixels: 400 / 16 times sqrt(2 / 320), 5 sigma = 10 DN^2 of 400.
    assert pixels.small_scale_variance_dn2 == pytest.approx(pixels.spatial_variance_dn2, rel=0.025)


def test_frames_are_not_kept() -> None:
    alive: list[weakref.ref[NDArray[np.uint16]]] = []

    def source() -> Iterator[NDArray[np.uint16]]:
        for seed in range(12):
            frame = noisy(1, sigma_dn=3.0, seed=seed)[0]
            alive.append(weakref.ref(frame))
            # This one, and the one before it in the difference.
            assert sum(reference() is not None for reference in alive) <= 3
            yield frame

    assert level_statistics(source(), kind="dark", exposure_s=None).n_frames == 12


def test_memory_does_not_grow_with_the_number_of_frames() -> None:
    def peak_bytes(n_frames: int) -> int:
        draws = np.random.default_rng(1)
        frames = (draws.integers(1000, 1100, (256, 256), dtype=np.uint16) for _ in range(n_frames))
        tracemalloc.start()
        level_statistics(frames, kind="flat", exposure_s=None)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peak

    # What grows is a mean, a sum and a checksum a frame: a hundred bytes or two. A frame has 131 072.
    assert peak_bytes(48) - peak_bytes(6) < 42 * 400


@pytest.mark.parametrize(
    ("shapes", "problem"),
    [
        ([], "at least two frames"),
        ([SHAPE], "at least two frames"),
        ([SHAPE, (63, 80)], r"\(64, 80\) and \(63, 80\)"),
        ([(1, 3)] * 2, r"\(rows, columns\)"),
        ([(2, 2, 3)] * 2, r"\(rows, columns\)"),
    ],
)
def test_frames_that_make_no_level_are_refused(shapes: list[tuple[int, ...]], problem: str) -> None:
    with pytest.raises(CalibrationError, match=problem):
        statistics([np.zeros(shape, dtype=np.uint16) for shape in shapes])


def test_samples_are_tallied_as_integers() -> None:
    first = np.array([[0, 4, 8], [12, 12, 12]], dtype=np.uint16)
    second = np.array([[0, 0, 8], [4, 4, 12]], dtype=np.uint16)
    samples = statistics([first, second]).samples
    assert (samples.max_dn, samples.used_bits) == (12, 0b1100)
    assert samples.zero_fraction == 3 / 12
    assert samples.max_fraction == 4 / 12


def test_equal_frames_have_equal_digests_and_uniform_ones_none() -> None:
    frame = noisy(1, sigma_dn=3.0, seed=16)[0]
    samples = statistics([frame, frame.copy(), np.full(SHAPE, 4095, dtype=np.uint16)]).samples
    assert len(samples.digests) == 2
    assert len(set(samples.digests)) == 1
