"""Pictures of other programs: FITS, PNG, TIFF, arrays of HDF5 and netCDF."""

import gzip
import io
import resource
import struct
import zlib
from pathlib import Path

import cv2
import h5py
import numpy as np
import PIL.Image
import pytest
import tifffile
from astropy.io import fits
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.io import netcdf_file

from rigctl.errors import ConfigError, DataError
from rigctl.images import ImageFile, image_files, read_image, read_images, unfiltered_png
from rigctl.runs.fits import encode_frame
from tests.rigctl.run_samples import noisy_counts

COUNTS = noisy_counts(shape=(6, 9))


def write_fits(path, pixels, **header):
    unit = fits.PrimaryHDU(pixels)
    unit.header.update(header)
    unit.writeto(path)
    return path


def fits_bytes(pixels):
    file = io.BytesIO()
    fits.PrimaryHDU(pixels).writeto(file)
    return file.getvalue()


@pytest.mark.parametrize("name", ["image.png", "image.tif"])
@pytest.mark.parametrize(("dtype", "bits"), [(np.uint8, 8), (np.uint16, 16)])
def test_png_and_tiff_come_as_they_are_top_first(tmp_path, name, dtype, bits):
    pixels = (COUNTS & 255).astype(dtype)
    cv2.imwrite(str(tmp_path / name), pixels)
    image = read_image(tmp_path / name)
    np.testing.assert_array_equal(image.counts, pixels)
    assert (image.sample_bits, image.first_row) == (bits, "top")


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.uint16, np.int32, np.int64, np.float32, np.float64])
def test_fits_of_whole_numbers_is_accepted(tmp_path, dtype):
    pixels = (COUNTS & 255).astype(dtype)
    image = read_image(write_fits(tmp_path / "image.fits", pixels))
    np.testing.assert_array_equal(image.counts, pixels)
    assert image.sample_bits == (8 if dtype is np.uint8 else 16)


def test_fits_without_row_order_is_bottom_first(tmp_path):
    image = read_image(write_fits(tmp_path / "image.fits", COUNTS))
    assert (image.first_row, image.first_row_stated) == ("bottom", False)


@pytest.mark.parametrize(("order", "row"), [("TOP-DOWN", "top"), ("BOTTOM-UP", "bottom")])
def test_row_order_of_a_fits_file_is_honoured(tmp_path, order, row):
    image = read_image(write_fits(tmp_path / "image.fits", COUNTS, ROWORDER=order))
    assert (image.first_row, image.first_row_stated) == (row, True)


def test_frame_of_ours_can_be_read_as_an_image(tmp_path):
    (tmp_path / "frame.fits").write_bytes(encode_frame(COUNTS, {"EXPTIME": (0.5, "")}))
    image = read_image(tmp_path / "frame.fits")
    np.testing.assert_array_equal(image.counts, COUNTS)
    assert (image.first_row, image.header["EXPTIME"]) == ("top", 0.5)


def test_compressed_fits_files_are_read(tmp_path):
    (tmp_path / "image.fits.gz").write_bytes(gzip.compress(fits_bytes(COUNTS)))
    fits.CompImageHDU(COUNTS).writeto(tmp_path / "image.fits.fz")
    for path in image_files([tmp_path]):
        np.testing.assert_array_equal(read_image(path).counts, COUNTS)


def test_first_image_of_a_fits_file_is_taken_and_that_is_said(tmp_path):
    units = [fits.PrimaryHDU(), fits.ImageHDU(COUNTS), fits.ImageHDU(COUNTS + 1)]
    units[0].header["EXPTIME"], units[0].header["FILTER"], units[1].header["FILTER"] = 0.5, "B", "V"
    fits.HDUList(units).writeto(tmp_path / "two.fits")
    image = read_image(tmp_path / "two.fits")
    np.testing.assert_array_equal(image.counts, COUNTS)
    assert (image.header["EXPTIME"], image.header["FILTER"]) == (0.5, "V")
    assert image.remarks == ("the first of 2 images of its file",)


def test_samples_that_are_no_numbers_are_marked_and_are_no_raw_image(tmp_path):
    image = read_image(write_fits(tmp_path / "image.fits", np.where(np.eye(6, 9) > 0, np.nan, COUNTS)))
    np.testing.assert_array_equal(image.unset, np.eye(6, 9) > 0)
    np.testing.assert_array_equal(image.counts[~image.unset], COUNTS[~image.unset])
    with pytest.raises(DataError, match="6 samples are NaN or infinite"):
        _ = image.raw_counts


@pytest.mark.parametrize(
    ("pixels", "reason"),
    [
        (COUNTS + 0.5, "not whole numbers"),
        (COUNTS.astype(np.int32) - 5000, "samples run from"),
        (COUNTS.astype(np.uint32) + 65536, "samples run from"),
    ],
)
def test_sums_means_and_counts_below_0_are_kept_and_are_no_raw_image(tmp_path, pixels, reason):
    image = read_image(write_fits(tmp_path / "image.fits", pixels))
    np.testing.assert_array_equal(image.counts, pixels)
    with pytest.raises(DataError, match=reason):
        _ = image.raw_counts


@pytest.mark.parametrize("dtype", ["u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8"])
def test_tiff_of_every_kind_of_sample_by_tifffile(tmp_path, dtype):
    limits = np.finfo(dtype) if dtype[0] == "f" else np.iinfo(dtype)
    pixels = np.array([[0, 1, 2, 100], [limits.min, limits.max, 7, 8]], dtype)
    tifffile.imwrite(tmp_path / "image.tif", pixels)
    np.testing.assert_array_equal(read_image(tmp_path / "image.tif").counts, pixels)


@pytest.mark.parametrize("name", ["image.png", "image.tif", "planes.tif", "cube.fits"])
@pytest.mark.parametrize(("plane", "place"), [("red", 0), ("green", 1), ("blue", 2)])
def test_a_colour_of_an_image_is_read(tmp_path, name, plane, place):
    colours = np.random.default_rng(1).integers(0, 256, (5, 7, 3)).astype(np.uint8)
    if name.endswith("fits"):
        write_fits(tmp_path / name, np.moveaxis(colours, 2, 0))
    elif name == "planes.tif":
        colours = colours.astype(np.uint16) * 200
        planes = np.moveaxis(colours, 2, 0)
        tifffile.imwrite(tmp_path / name, planes, photometric="rgb", planarconfig="separate")
    elif name.endswith("tif"):
        tifffile.imwrite(tmp_path / name, colours, photometric="rgb")
    else:
        PIL.Image.fromarray(colours).save(tmp_path / name)
    np.testing.assert_array_equal(read_image(tmp_path / name, plane=plane).counts, colours[..., place])


def test_a_grey_picture_that_is_stored_as_colours_is_grey(tmp_path):
    grey = np.random.default_rng(1).integers(0, 256, (5, 7)).astype(np.uint8)
    PIL.Image.fromarray(grey).convert("RGB").save(tmp_path / "grey.png")
    np.testing.assert_array_equal(read_image(tmp_path / "grey.png").counts, grey)


STACK = np.arange(24, dtype=np.int32).reshape(2, 3, 4) * 40000 - 5


def write_h5(path):
    with h5py.File(path, "w") as file:
        file["entry/data"], file["entry/angle"] = STACK, [0.0, 45.5]
        file["entry/data"].attrs["exposure"] = 0.5
    return "/entry/data"


def write_netcdf(path):
    netcdf = pytest.importorskip("netCDF4")
    with netcdf.Dataset(path, "w") as file:
        for name, length in zip("tyx", STACK.shape, strict=True):
            file.createDimension(name, length)
        data, angle = file.createVariable("data", "i4", tuple("tyx")), file.createVariable("angle", "f8", ("t",))
        data[:], angle[:] = STACK, [0.0, 45.5]
        data.exposure = 0.5
    return "/data"


def write_classic_netcdf(path):
    with netcdf_file(path, "w") as file:
        for name, length in zip("tyx", STACK.shape, strict=True):
            file.createDimension(name, length)
        data, angle = file.createVariable("data", "i4", tuple("tyx")), file.createVariable("angle", "f8", ("t",))
        data[:], angle[:] = STACK, [0.0, 45.5]
        data.exposure = 0.5
    return "/data"


@pytest.mark.parametrize(
    ("name", "write"), [("a.h5", write_h5), ("a.nc", write_netcdf), ("b.nc", write_classic_netcdf)]
)
def test_a_stack_in_an_array_of_a_file_is_pictures_with_their_own_facts(tmp_path, name, write):
    inside = write(tmp_path / name)
    images = list(read_images(Path(f"{tmp_path / name}:{inside}")))
    assert str(images[1].path) == f"{tmp_path / name}:{inside}[1]"
    np.testing.assert_array_equal(read_image(images[1].path).counts, STACK[1])
    np.testing.assert_array_equal([image.counts for image in images], STACK)
    assert [image.header["ANGLE"] for image in images] == [0.0, 45.5]
    assert images[0].header["EXPOSURE"] == 0.5
    with pytest.raises(ConfigError, match=f"{inside} \\(2 x 3 x 4\\)"):
        read_image(Path(f"{tmp_path / name}:/none"))
    with pytest.raises(DataError, match="holds 2 pictures"):
        read_image(Path(f"{tmp_path / name}:{inside}[2]"))


def separate_planes(path):
    tifffile.imwrite(path, STACK, photometric="minisblack", planarconfig="separate", compression="zlib")


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("cube.fits", lambda path: fits.PrimaryHDU(STACK).writeto(path)),
        ("extension.fits", lambda path: fits.HDUList([fits.PrimaryHDU(), fits.ImageHDU(STACK[None])]).writeto(path)),
        ("cube.fits.fz", lambda path: fits.CompImageHDU(STACK).writeto(path)),
        ("pages.tif", lambda path: tifffile.imwrite(path, STACK, photometric="minisblack")),
        ("big.tif", lambda path: tifffile.imwrite(path, STACK, photometric="minisblack", bigtiff=True)),
        ("planes.tif", separate_planes),
        ("mimwrite.tif", lambda path: pytest.importorskip("imageio").mimwrite(path, list(STACK))),
    ],
)
def test_a_stack_is_its_pictures_in_order(tmp_path, name, write):
    write(tmp_path / name)
    images = list(read_images(tmp_path / name))
    np.testing.assert_array_equal([image.counts for image in images], STACK)
    assert [image.path.name for image in images] == [f"{name}[0]", f"{name}[1]"]
    with pytest.raises(DataError, match="holds several pictures"):
        read_image(tmp_path / name)


def test_only_the_first_picture_of_a_cube_has_the_time_of_its_header(tmp_path):
    header = {"DATE-OBS": "2026-05-04T10:00:00", "EXPTIME": 0.5}
    first, second = read_images(write_fits(tmp_path / "cube.fits", STACK, **header))
    assert header.items() <= first.header.items()
    assert (second.header["EXPTIME"], "DATE-OBS" in second.header) == (0.5, False)


def test_a_jpeg_picture_can_be_looked_at_and_is_no_raw_image(tmp_path):
    grey = np.full((16, 24), 100, np.uint8)
    PIL.Image.fromarray(grey).save(tmp_path / "a.jpg")
    np.testing.assert_allclose(read_image(tmp_path / "a.jpg").counts, grey, atol=1)
    with pytest.raises(DataError, match="compressed with loss"):
        _ = read_image(tmp_path / "a.jpg").raw_counts


def test_packed_numbers_of_netcdf_are_unpacked(tmp_path):
    with h5py.File(tmp_path / "a.nc", "w") as file:
        file["data"] = np.array([[0, 10], [20, 30]], np.int16)
        file["data"].attrs.update(scale_factor=0.5, add_offset=100.0)
    np.testing.assert_array_equal(read_image(Path(f"{tmp_path}/a.nc:/data")).counts, [[100, 105], [110, 115]])


def checksum_off(path):
    fits.PrimaryHDU(COUNTS).writeto(path, checksum=True)
    data = bytearray(path.read_bytes())
    data[-2880] ^= 1
    path.write_bytes(data)


def cut_off(path):
    pixels = noisy_counts(shape=(60, 90))
    write_fits(path, pixels) if path.suffix == ".fits" else cv2.imwrite(str(path), pixels)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def colour_picture(path):
    cv2.imwrite(str(path), np.arange(48, dtype=np.uint8).reshape(4, 4, 3))


def one_bit(path):
    cv2.imwrite(str(path), np.eye(8, dtype=np.uint8) * 255, [cv2.IMWRITE_PNG_BILEVEL, 1])


@pytest.mark.parametrize(
    ("name", "write", "reason"),
    [
        ("all nan.fits", lambda path: write_fits(path, np.full((6, 9), np.nan)), "NaN or infinite"),
        ("cube.fits", lambda path: write_fits(path, np.zeros((2, 2, 3, 4), np.int16)), "has axes of 2 x 2 x 3 x 4"),
        ("empty.fits", lambda path: fits.PrimaryHDU().writeto(path), "without an image"),
        ("checksum.fits", checksum_off, "is damaged"),
        ("cut.png", cut_off, "."),
        ("cut.tif", cut_off, "."),
        ("cut.fits", cut_off, "."),
        ("mask.png", one_bit, "1 bits per sample"),
        ("notes.txt", lambda path: path.write_text("sunny"), "not a FITS, PNG, TIFF, JPEG or RAW"),
        ("none.png", lambda path: None, "cannot be read"),
        ("colour.png", colour_picture, "--plane red, green or blue"),
        ("colour.tif", colour_picture, "--plane red, green or blue"),
    ],
)
def test_a_file_that_is_no_picture_of_counts_is_refused_with_the_reason(tmp_path, name, write, reason):
    write(tmp_path / name)
    with pytest.raises(ConfigError if name.startswith("colour") else DataError, match=reason):
        read_image(tmp_path / name)


@pytest.mark.parametrize("content", [b"", b"no HDF5 file", b"\x89HDF\r\n\x1a\n" + bytes(100), b"CDF\x01" + bytes(9)])
def test_a_file_of_arrays_that_is_spoilt_is_refused(tmp_path, content):
    (tmp_path / "a.h5").write_bytes(content)
    with pytest.raises(DataError):
        read_image(Path(f"{tmp_path}/a.h5:/data"))


@settings(deadline=None, max_examples=100)
@given(place=st.integers(0, 2879), value=st.integers(0, 255))
def test_spoilt_fits_header_is_read_or_refused_but_never_a_fault(tmp_path_factory, place, value):
    data = bytearray(fits_bytes(COUNTS))
    data[place] = value
    file = tmp_path_factory.mktemp("spoilt") / "image.fits"
    file.write_bytes(data)
    try:
        image = read_image(file)
    except DataError:
        return
    assert isinstance(image, ImageFile)


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


def empty_png(width, height):
    header = struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0)
    idat = chunk(b"IDAT", zlib.compress(b"\0" * 1000))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + idat + chunk(b"IEND", b"")


def empty_tiff(width: int, height: int, *, following: int = 0) -> bytes:
    entries = [(256, 4, 1, width), (257, 4, 1, height), (258, 3, 1, 16)]
    directory = struct.pack("<H", len(entries)) + b"".join(struct.pack("<HHII", *entry) for entry in entries)
    return b"II*\0" + struct.pack("<I", 8) + directory + struct.pack("<I", following)


def fits_cards(*cards: str) -> bytes:
    return "".join(card.ljust(80) for card in (*cards, "END")).encode("latin-1").ljust(2880)


SIMPLE = "SIMPLE  =                    T"
BOMBS = {
    "25 bytes.png": empty_png(4, 4)[:25],
    "24 bytes.png": empty_png(4, 4)[:24],
    "wide.png": empty_png(60_000, 60_000),
    "no pixels.png": empty_png(0, 5),
    "wide.tif": empty_tiff(60_000, 60_000),
    "circle.tif": empty_tiff(4, 4, following=8),
    "cut.tif": empty_tiff(4, 4)[:20],
    "far.tif": b"II*\0\xff\xff\xff\xff",
    "huge.fits": fits_cards(SIMPLE, "BITPIX  = 16", "NAXIS   = 2", "NAXIS1  = 2000000000", "NAXIS2  = 2000000000"),
    "negative.fits": fits_cards(SIMPLE, "BITPIX  = 16", "NAXIS   = 2", "NAXIS1  = -5", "NAXIS2  = 5"),
    "not ascii.fits": fits_cards(SIMPLE, "BITPIX  = 16", "NAXIS   = 2", "NAXIS1  = \xe9", "OBJECT  = '\xb5m'"),
    "zeros.fits.gz": gzip.compress(b"\0" * 4_000_000) * 100,
}


@pytest.mark.parametrize("name", BOMBS)
def test_a_header_that_declares_more_than_the_file_holds_is_refused_before_memory_is_taken(tmp_path, name):
    (tmp_path / name).write_bytes(BOMBS[name])
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(DataError):
        read_image(tmp_path / name)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb < 700_000


def test_a_sparse_file_is_judged_by_its_size(tmp_path):
    with (tmp_path / "sparse.fits").open("wb") as file:
        file.truncate(8 * 2**30)
    with pytest.raises(DataError, match="--max-frame-mb"):
        read_image(tmp_path / "sparse.fits")
