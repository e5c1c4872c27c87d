"""Tests of pictures that declare more than they hold: refused by their headers, in little memory."""

import gzip
import resource
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rigctl import cli
from rigctl.errors import DataError
from rigctl.images import read_image

_MB = 1_000_000


def _chunk(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


def _png(width: int, height: int) -> bytes:
    header = struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0)
    packed = zlib.compress(b"\0" * 1000)
    return b"\x89PNG\r\n\x1a\n" + _chunk(b"IHDR", header) + _chunk(b"IDAT", packed) + _chunk(b"IEND", b"")


def _tiff(width: int, height: int, *, following: int = 0) -> bytes:
    entries = [(256, 4, 1, width), (257, 4, 1, height), (258, 3, 1, 16)]
    directory = struct.pack("<H", len(entries)) + b"".join(struct.pack("<HHII", *entry) for entry in entries)
    return b"II*\0" + struct.pack("<I", 8) + directory + struct.pack("<I", following)


def _fits(*cards: str) -> bytes:
    return "".join(card.ljust(80) for card in (*cards, "END")).encode("latin-1").ljust(2880)


_SIMPLE = "SIMPLE  =                    T"
_BOMBS = {
    "25 bytes.png": _png(4, 4)[:25],
    "24 bytes.png": _png(4, 4)[:24],
    "wide.png": _png(60_000, 60_000),
    "no pixels.png": _png(0, 5),
    "wide.tif": _tiff(60_000, 60_000),
    "circle.tif": _tiff(4, 4, following=8),
    "cut.tif": _tiff(4, 4)[:20],
    "far.tif": b"II*\0\xff\xff\xff\xff",
    "huge.fits": _fits(_SIMPLE, "BITPIX  = 16", "NAXIS   = 2", "NAXIS1  = 2000000000", "NAXIS2  = 2000000000"),
    "negative.fits": _fits(_SIMPLE, "BITPIX  = 16", "NAXIS   = 2", "NAXIS1  = -5", "NAXIS2  = 5"),
    "not ascii.fits": _fits(_SIMPLE, "BITPIX  = 16", "NAXIS   = 2", "NAXIS1  = \xe9", "OBJECT  = '\xb5m'"),
    "zeros.fits.gz": gzip.compress(b"\0" * 4 * _MB) * 100,
}


@pytest.mark.parametrize("name", _BOMBS)
def test_a_bomb_is_refused_before_memory_is_taken(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(_BOMBS[name])
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(DataError):
        read_image(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb < 700_000


def test_a_sparse_file_is_judged_by_its_size(tmp_path):
    with (tmp_path / "sparse.fits").open("wb") as file:
        file.truncate(8 * 2**30)
    with pytest.raises(DataError, match="--max-frame-mb"):
        read_image(tmp_path / "sparse.fits")


def test_the_limit_is_an_option(tmp_path, capsys):
    import cv2

    cv2.imwrite(str(tmp_path / "a.png"), np.ones((1000, 1000), dtype=np.uint16))
    words = ["--angles", "0", "--same-exposure", "--black-level-dn", "0", "--bit-depth", "12"]
    run, image = str(tmp_path / "run"), str(tmp_path / "a.png")
    assert cli.main(["import", run, image, *words, "--max-frame-mb", "1"]) == 4
    assert "would take 2 MB by its header" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
    assert cli.main(["import", run, image, *words, "--max-frame-mb", "2"]) == 0


@pytest.mark.parametrize("make", [lambda folder: folder.parent / "secret.png", lambda _: Path("/etc/hostname")])
def test_a_descriptor_does_not_point_outside_of_its_folder(tmp_path, capsys, make: Callable[[Path], Path]):
    (tmp_path / "set").mkdir()
    (tmp_path / "secret.png").write_bytes(_png(4, 4))
    (tmp_path / "set" / "link.png").symlink_to(tmp_path / "secret.png")
    text = f"v 3.0\nn 12 4 4\nb 1000 10\ni {make(tmp_path / 'set')}\ni ../secret.png\ni link.png\nd 1000\ni none.png\n"
    (tmp_path / "set" / "data.txt").write_text(text)
    arguments = ["calibrate", "noise", "--emva", str(tmp_path / "set" / "data.txt"), "--out", str(tmp_path / "n.json")]
    assert cli.main(arguments) == 2
    assert capsys.readouterr().err.count("lies outside of the descriptor's folder") == 3
