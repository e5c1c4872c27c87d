"""The simulated camera's bytes, by hand from the standard."""

import numpy as np
import pytest

from sim_devices.cameras.gige_server import FORMATS, bytes_of

PAIR = np.array([[0xABC, 0x123]], dtype=np.uint16)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("Mono8", "ab12"),
        ("Mono10", "af024800"),
        ("Mono12", "bc0a2301"),
        ("Mono16", "c0ab3012"),
        ("Mono12Packed", "ab3c12"),
        ("Mono12p", "bc3a12"),
    ],
)
def test_two_samples_of_12_bits(name, expected):
    assert bytes_of(PAIR, bit_depth=12, pixel_format=FORMATS[name]).hex() == expected


@pytest.mark.parametrize(("name", "expected"), [("Mono12Packed", "ab0c"), ("Mono12p", "bc0a")])
def test_the_last_of_an_odd_number_has_two_bytes(name, expected):
    assert bytes_of(PAIR[:, :1], bit_depth=12, pixel_format=FORMATS[name]).hex() == expected


def test_a_format_that_it_does_not_send_is_refused():
    with pytest.raises(ValueError, match="0x02180014"):
        bytes_of(PAIR, bit_depth=12, pixel_format=0x02180014)
