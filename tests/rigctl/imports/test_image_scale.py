from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.errors import ConfigError, DataError
from rigctl.imports.images import ImportRequest, find_scale
from rigctl.imports.levels import common_zero_bits, histogram
from tests.rigctl.run_samples import noisy_counts

NOISY = noisy_counts(shape=(60, 80))  # all of 0..4095 that 4800 draws hit, odd counts among them


def scale_of(counts, *, sample_bits=16, black_level_dn=None, **said):
    request = ImportRequest(run=Path("run"), files=(), kind="scene", **said)
    levels = histogram(np.asarray(counts, dtype=np.uint16))
    return find_scale(request, levels, sample_bits=sample_bits, black_level_dn=black_level_dn)


@settings(deadline=None, max_examples=50)
@given(counts=st.lists(st.integers(0, 65535), min_size=1, max_size=20))
def test_common_zero_bits_against_the_definition(counts):
    expected = next((k for k in range(16, 0, -1) if all(c % 2**k == 0 for c in counts)), 0) if any(counts) else 0
    assert common_zero_bits(histogram(np.array(counts, dtype=np.uint16))) == expected


def test_eight_bit_files_have_eight_bits():
    scale = scale_of(NOISY >> 4, sample_bits=8)
    assert (scale.bit_depth, scale.saturation_dn, scale.remarks) == (8, 255.0, ())


def test_bits_of_a_camera_in_larger_samples_are_asked_for():
    with pytest.raises(ConfigError, match="--bit-depth"):
        scale_of(NOISY)


def test_counts_that_need_sixteen_bits_tell_so():
    scale = scale_of(NOISY.astype(np.int64) * 9)
    assert scale.bit_depth == 16
    assert "16 bits" in scale.remarks[0]


def test_right_justified_bits_stay_as_they_are():
    scale = scale_of(NOISY, bit_depth=12)
    assert (scale.shift_bits, scale.saturation_dn, scale.remarks) == (0, 4095.0, ())


@pytest.mark.parametrize("depth", [10, 12, 14])
def test_left_justified_bits_are_recognised_shifted_and_said(depth):
    counts = np.arange(2**depth, dtype=np.uint16) << (16 - depth)
    scale = scale_of(counts, bit_depth=depth)
    assert (scale.shift_bits, scale.saturation_dn) == (16 - depth, 2**depth - 1)
    assert "left-justified" in scale.remarks[0]


def test_left_justified_bits_without_a_depth_are_asked_for_with_the_likely_one():
    with pytest.raises(ConfigError, match=r"multiples of 16, as 12 bits left-justified.*--bit-depth"):
        scale_of(NOISY << 4)


def test_dim_left_justified_counts_could_be_either_and_are_asked_for():
    dim = np.random.default_rng(1).integers(10, 40, 5000) << 4
    with pytest.raises(ConfigError, match="--justified"):
        scale_of(dim, bit_depth=12)
    assert scale_of(dim, bit_depth=12, justified="left").shift_bits == 4
    assert scale_of(dim, bit_depth=12, justified="right").shift_bits == 0


def test_a_few_round_counts_are_no_sign_of_left_justification():
    scale = scale_of([1600, 1200, 800, 400], bit_depth=12)
    assert scale.shift_bits == 0
    assert "multiples of 16" in scale.remarks[0]


def test_left_justified_counts_called_sixteen_bits_are_said():
    assert "12 bits left-justified" in scale_of(NOISY << 4, bit_depth=16).remarks[0]


@pytest.mark.parametrize(
    ("said", "sample_bits"),
    [({"bit_depth": 10}, 16), ({"bit_depth": 12}, 8), ({"bit_depth": 12, "justified": "left"}, 16)],
    ids=["counts too large", "samples too small", "low bits in use"],
)
def test_counts_that_contradict_the_bit_depth_are_refused(said, sample_bits):
    with pytest.raises(DataError, match="--bit-depth"):
        scale_of(NOISY, sample_bits=sample_bits, **said)


def saturated(value_dn, share=0.02):
    counts = np.random.default_rng(2).integers(500, 60000, 10000)
    counts[: int(share * counts.size)] = value_dn
    return counts


def test_plateau_below_full_scale_is_recognised_and_said():
    scale = scale_of(saturated(65532), bit_depth=16)
    assert scale.saturation_dn == 65532.0
    assert "65532" in scale.remarks[0]


def test_what_the_user_says_of_saturation_goes_before_what_is_seen():
    scale = scale_of(saturated(65532), bit_depth=16, saturation_dn=60000.0)
    assert (scale.saturation_dn, scale.remarks) == (60000.0, ())


def test_plateau_far_below_full_scale_is_said_but_not_taken():
    scale = scale_of(np.minimum(NOISY, 3000), bit_depth=12)
    assert scale.saturation_dn == 4095.0
    assert "--saturation-dn 3000" in scale.remarks[0]


@pytest.mark.parametrize("counts", [[4000] * 5000 + [100] * 5000, [4000] * 19 + list(range(500, 1500))])
def test_drawn_picture_and_a_few_bright_pixels_are_no_plateau(counts):
    assert scale_of(counts, bit_depth=12).saturation_dn == 4095.0


def test_pixels_at_full_scale_are_no_news():
    assert scale_of(saturated(65535), bit_depth=16).remarks == ()


def missing(lowest_dn):
    counts = np.random.default_rng(3).integers(lowest_dn, 4000, 10000)
    counts[:300] = 0
    counts[300] = lowest_dn | 1
    return counts


def test_zeros_far_below_the_black_level_are_taken_as_missing_and_said():
    scale = scale_of(missing(580), bit_depth=12, black_level_dn=582.1)
    assert scale.missing_dn == 0.0
    assert "3.0%" in scale.remarks[0]


def test_zeros_of_a_black_that_is_clipped_are_not_missing():
    counts = np.clip(np.random.default_rng(4).normal(8.0, 4.0, 10000), 0, None).astype(int)
    assert scale_of(counts, bit_depth=12, black_level_dn=8.0).missing_dn is None


def test_zeros_below_an_unknown_black_level_are_said_but_not_taken():
    scale = scale_of(missing(100), bit_depth=12)
    assert scale.missing_dn is None
    assert "--missing-dn 0" in scale.remarks[0]


def test_user_may_say_that_none_is_missing():
    scale = scale_of(missing(580), bit_depth=12, black_level_dn=582.1, none_missing=True)
    assert (scale.missing_dn, scale.remarks) == (None, ())


def test_levels_said_by_the_user_are_shifted_with_the_counts():
    scale = scale_of(NOISY << 4, bit_depth=12, saturation_dn=64000.0, missing_dn=32.0)
    assert (scale.saturation_dn, scale.missing_dn) == (4000.0, 2.0)
