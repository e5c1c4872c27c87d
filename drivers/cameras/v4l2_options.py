"""How a video device is to be used, as its address says."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from drivers.cameras.pixel_format import V4L2, Justified, PixelFormat
from drivers.cameras.place import one_of, positive, split_place, whole
from drivers.errors import LimitError

COLOURS = ("red", "green-1", "green-2", "blue")
# Format -> bits and cell, row by row.
_BAYER = {
    "BA81": (8, "BGGR"),
    "GBRG": (8, "GBRG"),
    "GRBG": (8, "GRBG"),
    "RGGB": (8, "RGGB"),
    "BG10": (10, "BGGR"),
    "GB10": (10, "GBRG"),
    "BA10": (10, "GRBG"),
    "RG10": (10, "RGGB"),
    "BG12": (12, "BGGR"),
    "GB12": (12, "GBRG"),
    "BA12": (12, "GRBG"),
    "RG12": (12, "RGGB"),
    "BYR2": (16, "BGGR"),
    "GB16": (16, "GBRG"),
    "GR16": (16, "GRBG"),
    "RG16": (16, "RGGB"),
}


@dataclass(frozen=True, kw_only=True)
class V4l2Options:
    """What an address ``/dev/video0?key=value`` says.

    Attributes
    ----------
    path : str
        The device file.
    pixel_format : str
        Its four letters, without the space at the end that some have.
    width, height : int or None
        Size of a picture; None: as the device has it.
    plane : str or None
        Colour of a Bayer format; green-1 stands in the rows of red.
    bit_depth : int or None
        True bits, where a format of 16 has fewer.
    justified : str
        Where these stand.
    exposure_control : {"device", "none"}
        "none": the device has none, and what the caller configures is what somebody has set by other means.
    gain_step_db : float or None
        What a step of the gain is [dB]. None: nobody knows; then the gain is the smallest, which is called 0 dB.
    retakes : int
        How many damaged pictures in a row are an error.
    """

    path: str
    pixel_format: str = "Y12"
    width: int | None = None
    height: int | None = None
    plane: str | None = None
    bit_depth: int | None = None
    justified: Justified = "right"
    exposure_control: str = "device"
    gain_step_db: float | None = None
    retakes: int = 20


_READERS: dict[str, Callable[[str], Any]] = {
    "pixel_format": one_of(*(name.strip() for name in (*V4L2, *_BAYER))),
    "width": whole(1, 65535),
    "height": whole(1, 65535),
    "plane": one_of(*COLOURS),
    "bit_depth": whole(8, 16),
    "justified": one_of("right", "left"),
    "exposure_control": one_of("device", "none"),
    "gain_step_db": positive,
    "retakes": whole(0, 1000),
}


def read_v4l2_place(text: str) -> V4l2Options:
    """Return what an address says; see `V4l2Options` for its keys.

    Raises
    ------
    LimitError
        A key or value is not allowed, or a colour is missing or has no place; all are named.
    """
    path, values = split_place(text, _READERS)
    options = V4l2Options(path=path, **values)
    if (options.pixel_format in _BAYER) != (options.plane is not None):
        raise LimitError(f"camera address {text!r}: plane={'|'.join(COLOURS)} goes with a Bayer format, and only there")
    return options


def sample_format(options: V4l2Options) -> PixelFormat:
    """Return how samples stand in a picture of the device, whatever their colours."""
    letters = options.pixel_format.ljust(4)
    if letters in V4L2:
        known = V4L2[letters]
    else:
        bits = _BAYER[options.pixel_format][0]
        known = PixelFormat(name=options.pixel_format, bit_depth=bits, sample_bytes=1 if bits == 8 else 2)
    depth = options.bit_depth or known.bit_depth
    if depth != known.bit_depth and known.bit_depth != 16:
        raise LimitError(f"{options.path}: bit_depth {depth}: samples of {known.name} have {known.bit_depth}")
    return PixelFormat(
        name=known.name,
        bit_depth=depth,
        sample_bytes=known.sample_bytes,
        justified=options.justified,
        packing=known.packing,
    )


def place_in_cell(options: V4l2Options) -> tuple[int, int] | None:
    """Return row and column of the wanted colour within the cell of 2 x 2 pixels; None for grey."""
    if options.plane is None:
        return None
    cell = _BAYER[options.pixel_format][1]
    red, blue = divmod(cell.index("R"), 2), divmod(cell.index("B"), 2)
    places = {
        "red": red,
        "blue": blue,
        "green-1": (red[0], 1 - red[1]),
        "green-2": (blue[0], 1 - blue[1]),
    }
    return places[options.plane]
