"""What counts of imported images mean: bits, their place in a sample, saturation, missing pixels."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.errors import ConfigError, DataError
from rigctl.images import ImageFile
from rigctl.imports.images import SurveyedImage, find_scale
from rigctl.imports.levels import common_zero_bits, histogram, odd_pattern
from tests.rigctl.run_samples import noisy_counts

NOISY = noisy_counts(shape=(60, 80))  # all of 0..4095 that 4800 draws hit, odd counts among them
DIM = np.random.default_rng(1).integers(10, 40, 5000) << 4


def scale_of(counts, *, sample_bits=16, black_level_dn=None, **said):
    image = SurveyedImage(
        file=ImageFile(counts=np.empty(0), sample_bits=sample_bits, first_row="top", first_row_stated=False, header={}),
        shape=(1, 1),
        kind="scene",
        black_level_dn=black_level_dn,
        levels=histogram(np.asarray(counts, dtype=np.uint16)),
    )
    return find_scale(said, [image])


def saturated(value_dn, share=0.02):
    counts = np.random.default_rng(2).integers(500, 60000, 10000)
    counts[: int(share * counts.size)] = value_dn
    return counts


def missing(lowest_dn):
    counts = np.random.default_rng(3).integers(lowest_dn, 4000, 10000)
    counts[:300] = 0
    counts[300] = lowest_dn | 1
    return counts


@settings(deadline=None, max_examples=50)
@given(counts=st.lists(st.integers(0, 65535), min_size=1, max_size=20))
def test_common_zero_bits_against_the_definition(counts):
    expected = next((k for k in range(16, 0, -1) if all(c % 2**k == 0 for c in counts)), 0) if any(counts) else 0
    assert common_zero_bits(histogram(np.array(counts, dtype=np.uint16))) == expected


@pytest.mark.parametrize(
    ("counts", "said", "depth", "shift", "saturation_dn", "remark"),
    [
        pytest.param(NOISY >> 4, {"sample_bits": 8}, 8, 0, 255.0, "", id="8 bits"),
        pytest.param(NOISY.astype(np.int64) * 9, {}, 16, 0, 65535.0, "16 bits", id="counts that need 16 bits"),
        pytest.param(NOISY, {"bit_depth": 12}, 12, 0, 4095.0, "", id="right-justified"),
        *(
            pytest.param(
                np.arange(2**depth) << (16 - depth),
                {"bit_depth": depth},
                depth,
                16 - depth,
                2**depth - 1,
                "left-justified",
                id=f"left-justified {depth}",
            )
            for depth in (10, 12, 14)
        ),
        pytest.param(DIM, {"bit_depth": 12, "justified": "left"}, 12, 4, 4095.0, "left", id="dim, said to be left"),
        pytest.param(
            DIM, {"bit_depth": 12, "justified": "right"}, 12, 0, 4095.0, "multiples of 16", id="dim, said to be right"
        ),
        pytest.param([1600, 1200, 800], {"bit_depth": 12}, 12, 0, 4095.0, "multiples of 16", id="few round counts"),
        pytest.param(NOISY << 4, {"bit_depth": 16}, 16, 0, 65535.0, "12 bits left-justified", id="called 16 bits"),
        pytest.param(saturated(65532), {"bit_depth": 16}, 16, 0, 65532.0, "65532", id="plateau below full scale"),
        pytest.param(
            saturated(65532), {"bit_depth": 16, "saturation_dn": 60000.0}, 16, 0, 60000.0, "", id="saturation said"
        ),
        pytest.param(
            np.minimum(NOISY, 3000), {"bit_depth": 12}, 12, 0, 4095.0, "--saturation-dn 3000", id="plateau far below"
        ),
        pytest.param([4000] * 5000 + [100] * 5000, {"bit_depth": 12}, 12, 0, 4095.0, None, id="drawn picture"),
        pytest.param(
            [4000] * 19 + list(range(500, 1500)), {"bit_depth": 12}, 12, 0, 4095.0, None, id="few bright pixels"
        ),
        pytest.param(saturated(65535), {"bit_depth": 16}, 16, 0, 65535.0, "", id="pixels at full scale"),
    ],
)
def test_bits_and_saturation_are_recognised_and_said(counts, said, depth, shift, saturation_dn, remark):
    found = scale_of(counts, **said)
    assert (found.bit_depth, found.shift_bits, found.saturation_dn) == (depth, shift, saturation_dn)
    if remark is not None:
        assert remark in found.remarks[0] if remark else found.remarks == ()


@pytest.mark.parametrize(
    ("counts", "said", "error", "match"),
    [
        (NOISY, {}, ConfigError, "--bit-depth"),
        (NOISY << 4, {}, ConfigError, r"multiples of 16, as 12 bits left-justified.*--bit-depth"),
        (DIM, {"bit_depth": 12}, ConfigError, "--justified"),
        (NOISY, {"bit_depth": 10}, DataError, "--bit-depth"),
        (NOISY, {"bit_depth": 12, "sample_bits": 8}, DataError, "--bit-depth"),
        (NOISY, {"bit_depth": 12, "justified": "left"}, DataError, "--bit-depth"),
    ],
)
def test_what_is_not_known_is_asked_for_and_what_contradicts_is_refused(counts, said, error, match):
    with pytest.raises(error, match=match):
        scale_of(counts, **said)


@pytest.mark.parametrize(
    ("counts", "said", "missing_dn", "remark"),
    [
        (missing(580), {"black_level_dn": 582.1}, 0.0, "3.0%"),
        (missing(100), {}, None, "--missing-dn 0"),
        (missing(580), {"black_level_dn": 582.1, "missing_dn": "none"}, None, ""),
        # A black that is clipped.
        (np.clip(np.random.default_rng(4).normal(8.0, 4.0, 10000), 0, None), {"black_level_dn": 8.0}, None, ""),
    ],
)
def test_zeros_that_cannot_be_dark_are_missing(counts, said, missing_dn, remark):
    found = scale_of(counts, bit_depth=12, **said)
    assert found.missing_dn == missing_dn
    assert remark in found.remarks[0] if remark else found.remarks == ()


def test_levels_said_by_the_user_are_shifted_with_the_counts():
    scale = scale_of(NOISY << 4, bit_depth=12, saturation_dn=64000.0, missing_dn=32.0)
    assert (scale.saturation_dn, scale.missing_dn) == (4000.0, 2.0)


@pytest.mark.parametrize(
    ("odd", "text"),
    [
        (lambda counts: counts, ""),
        (lambda counts: np.where(np.arange(200)[:, None] < 20, 0, counts), ""),
        # A narrow border is an end of its own where the light keeps away from nothing.
        (lambda counts: np.where(np.arange(200)[:, None] < 7, 0, counts // 4 + 60), ""),
        (lambda counts: counts | 4, "bit 2 is 1"),
        (lambda counts: counts & ~np.uint16(8), "bit 3 is 0"),
        (lambda counts: np.round(counts * 1.25), "never occur"),
        (lambda counts: np.where(counts % 8 == 5, counts + 1, counts), "never occur"),
        (lambda counts: counts * 16, ""),
    ],
)
def test_bits_that_are_no_cameras_own_are_named(odd, text):
    counts = np.random.default_rng(4).normal(120.0, 30.0, (200, 200)).clip(0, 255).astype(np.uint16)
    found = odd_pattern(histogram(odd(counts).astype(np.uint16)))
    assert (text in found) if text else (found == "")
