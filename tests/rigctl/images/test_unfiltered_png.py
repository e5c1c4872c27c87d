"""Grey PNG files without filters, against OpenCV's reading of the same bytes."""

import struct
import zlib

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from rigctl.images import unfiltered_png


def chunk(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


def png(
    samples: NDArray[np.uint16] | NDArray[np.uint8], *, filters: int = 0, extra: bytes = b"", pieces: int = 3
) -> bytes:
    rows = samples.astype(samples.dtype.newbyteorder(">")).view(np.uint8).reshape(samples.shape[0], -1)
    packed = zlib.compress(np.column_stack([np.full(len(rows), filters, np.uint8), rows]).tobytes())
    size = -(-len(packed) // pieces)
    body = b"".join(chunk(b"IDAT", packed[start : start + size]) for start in range(0, len(packed), size))
    header = struct.pack(">IIBBBBB", samples.shape[1], samples.shape[0], 8 * samples.dtype.itemsize, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + extra + body + chunk(b"IEND", b"")


def picture(dtype: type) -> NDArray[np.uint16]:
    drawn: NDArray[np.uint16] = np.random.default_rng(1).integers(0, np.iinfo(dtype).max + 1, (5, 7)).astype(dtype)
    return drawn


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_reads_what_opencv_reads(dtype: type) -> None:
    data = png(picture(dtype))
    found = unfiltered_png(data)
    assert found is not None
    np.testing.assert_array_equal(found, picture(dtype))
    np.testing.assert_array_equal(found, cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED))


@pytest.mark.parametrize(
    "data",
    [
        pytest.param(png(picture(np.uint16), filters=2), id="filtered"),
        pytest.param(png(picture(np.uint8), extra=chunk(b"tRNS", b"\0\0")), id="transparent"),
        pytest.param(cv2.imencode(".png", np.zeros((4, 4, 3), np.uint8))[1].tobytes(), id="colour"),
        pytest.param(png(picture(np.uint16))[:-40], id="cut short"),
        pytest.param(png(picture(np.uint16))[:60] + b"x" + png(picture(np.uint16))[61:], id="a byte changed"),
        pytest.param(png(picture(np.uint16)).replace(chunk(b"IEND", b""), chunk(b"IDAT", b"more")), id="too much"),
        pytest.param(b"\x89PNG\r\n\x1a\n", id="nothing"),
    ],
)
def test_leaves_all_others_to_a_general_reader(data: bytes) -> None:
    assert unfiltered_png(data) is None
