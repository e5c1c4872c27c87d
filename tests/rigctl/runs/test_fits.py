import io
from dataclasses import replace

import numpy as np
import pytest
from astropy.io import fits
from astropy.time import Time
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from rigctl.errors import DataError
from rigctl.runs.fits import (
    decode_frame,
    decode_record,
    encode_frame,
    header_cards,
    make_card,
    read_cards,
)
from tests.rigctl.run_samples import FULL_RECORD, make_record, noisy_counts

FRAMES = hnp.arrays(np.uint16, st.tuples(st.integers(1, 9), st.integers(1, 9)), elements=st.integers(0, 65535))
SAMPLE = encode_frame(noisy_counts(), header_cards(FULL_RECORD))


@settings(deadline=None, max_examples=60)
@given(counts=FRAMES)
def test_astropy_gives_back_every_count_and_finds_the_checksums_right(counts):
    with fits.open(io.BytesIO(encode_frame(counts, {})), checksum=True) as units:
        assert units[0].verify_datasum() == 1
        assert units[0].verify_checksum() == 1
        np.testing.assert_array_equal(units[0].data, counts)


def test_all_65536_counts_survive():
    counts = np.arange(65536, dtype=np.uint16).reshape(128, 512)
    data = encode_frame(counts, {})
    np.testing.assert_array_equal(decode_frame(data)[1], counts)
    np.testing.assert_array_equal(fits.getdata(io.BytesIO(data)), counts)


def test_view_with_strides_is_stored_as_it_looks():
    counts = noisy_counts(shape=(8, 6))[::-1, 1::2]
    np.testing.assert_array_equal(decode_frame(encode_frame(counts, {}))[1], counts)


@settings(deadline=None, max_examples=300)
@given(bit=st.integers(0, 8 * len(SAMPLE) - 1))
def test_one_flipped_bit_anywhere_is_found(bit):
    damaged = bytearray(SAMPLE)
    damaged[bit // 8] ^= 1 << bit % 8
    with pytest.raises(DataError):
        decode_frame(bytes(damaged))


def test_damage_of_header_and_samples_is_distinguished():
    samples, header = bytearray(SAMPLE), bytearray(SAMPLE)
    samples[-2880] ^= 4
    header[SAMPLE.index(b"45.0023")] ^= 1
    with pytest.raises(DataError, match="samples are damaged"):
        decode_frame(bytes(samples))
    with pytest.raises(DataError, match="header is damaged"):
        decode_frame(bytes(header))


@settings(deadline=None, max_examples=60)
@given(length=st.integers(0, len(SAMPLE) - 1))
def test_cut_off_file_is_refused(length):
    with pytest.raises(DataError):
        decode_frame(SAMPLE[:length])


def test_file_without_its_last_block_is_refused_though_zeros_do_not_change_a_sum():
    data = encode_frame(np.full((60, 60), 32768, dtype=np.uint16), {})
    with pytest.raises(DataError, match="bytes do not fit"):
        decode_frame(data[:-2880])


def test_another_programs_fits_is_refused():
    file = io.BytesIO()
    fits.PrimaryHDU(np.zeros((3, 4), dtype=np.float32)).writeto(file, checksum=True)
    with pytest.raises(DataError, match="not a frame of this program"):
        decode_frame(file.getvalue())


@settings(deadline=None, max_examples=300)
@given(value=st.text())
def test_any_text_survives_a_header(value):
    card = make_card("REMARK1", value, "a comment")
    assert len(card) % 80 == 0
    assert read_cards(card.encode("ascii")) == {"REMARK1": value}


def test_text_that_only_looks_like_an_escape_stays():
    assert read_cards("PATH    = 'C:\\yes\\x5g'".ljust(80).encode("ascii")) == {"PATH": "C:\\yes\\x5g"}


PRINTABLE = st.text(st.characters(min_codepoint=32, max_codepoint=126, exclude_characters="\\"), max_size=300)


@settings(deadline=None, max_examples=200)
@given(value=PRINTABLE)
def test_astropy_reads_the_same_text(value):
    # What a reader might take for syntax is escaped as in Python source.
    header = fits.getheader(io.BytesIO(encode_frame(noisy_counts(), {"REMARK1": (value, "")})))
    assert header["REMARK1"].encode("ascii").decode("unicode_escape") == value


@settings(deadline=None, max_examples=200)
@given(value=st.floats(allow_nan=False, allow_infinity=False))
def test_every_digit_of_a_number_survives_in_both_readers(value):
    data = encode_frame(noisy_counts(), {"EXPTIME": (value, "[s] exposure")})
    assert float(decode_frame(data)[0]["EXPTIME"]) == value
    assert fits.getheader(io.BytesIO(data))["EXPTIME"] == value


def test_header_tells_the_whole_record():
    record, _ = decode_record(encode_frame(noisy_counts(), header_cards(FULL_RECORD)), file="", checksum="")
    height, width = noisy_counts().shape
    assert record == replace(FULL_RECORD, height=height, width=width)


def test_unknown_values_are_left_out_of_the_header():
    header = fits.getheader(io.BytesIO(encode_frame(noisy_counts(), header_cards(make_record()))))
    assert "EXPTIME" not in header
    assert "BLKLEVEL" not in header


def test_header_follows_the_conventions():
    with fits.open(io.BytesIO(SAMPLE)) as units:
        units.verify("exception")
        header = units[0].header
    assert header["ROWORDER"] == "TOP-DOWN"
    assert header["DATE-OBS"] == "2026-05-04T10:00:00.000000001"
    assert header["TIMESYS"] == "UTC"
    assert (header["GAINDB"], header["EGAIN"]) == (0.1, 3.7)
    assert "GAIN" not in header


def test_siril_and_ds9_find_what_they_look_for():
    with fits.open(io.BytesIO(SAMPLE), do_not_scale_image_data=True) as units:
        header, stored = units[0].header, units[0].data
    # Unsigned 16 bits as the standard has them, which both undo; no blanks, no mosaic that nobody has.
    assert (header["BITPIX"], header["NAXIS"], header["BZERO"], header["BSCALE"]) == (16, 2, 32768, 1)
    assert stored.dtype == np.dtype(">i2")
    assert "BLANK" not in header
    assert "BAYERPAT" not in header
    # Siril: which row is first, the exposure in seconds, and a time without a zone.
    assert header["ROWORDER"] == "TOP-DOWN"
    assert header["EXPTIME"] == FULL_RECORD.exposure_s
    assert Time(header["DATE-OBS"], format="isot", scale="utc").isot.startswith("2026-05-04T10:00:00")
    assert isinstance(header["CCD-TEMP"], float)
