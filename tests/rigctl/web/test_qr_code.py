"""Addresses as QR codes, read back by a reader of codes."""

import cv2
import numpy as np
import pytest

from rigctl.web.server import qr_text


def read_back(text: str) -> str:
    """Return what a camera would read off a terminal that is light on dark."""
    rows = [[c in halves for c in line] for line in text.split("\n") for halves in ("▀█", "▄█")]
    picture = np.pad((np.array(rows) * 255).astype(np.uint8), 4, constant_values=255)
    return cv2.QRCodeDetector().detectAndDecode(np.kron(picture, np.ones((8, 8), np.uint8)))[0]


@pytest.mark.parametrize(
    "address", ["http://10.0.0.7:8765/?token=zwabWfcelqs1POFMsnTPwADs", "https://[fd00::1]:1/?token=a"]
)
def test_a_telephone_reads_the_address(address: str) -> None:
    assert read_back(qr_text(address)) == address


def test_what_is_too_long_is_refused() -> None:
    with pytest.raises(ValueError, match="too many"):
        qr_text("x" * 5000)
