"""Options of a video device, as its address gives them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from drivers.cameras.bayer import PLANES, Plane
from drivers.cameras.camera_place import one_of, positive, split_place, whole
from drivers.cameras.known_formats import V4L2
from drivers.cameras.pixel_format import Justified, PixelFormat
from drivers.errors import LimitError


@dataclass(frozen=True, kw_only=True)
class V4l2Options:
    """Content of an address ``/dev/video0?key=value``.

    Attributes
    ----------
    path : str
        The device file.
    pixel_format : str
        Its four letters, without the space at the end that some have.
    width, height : int or None
        Size of a picture; None: as the device has it.
    plane : str or None
        What is taken of a Bayer format: see `drivers.cameras.bayer`.
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
    plane: Plane | None = None
    bit_depth: int | None = None
    justified: Justified = "right"
    exposure_control: str = "device"
    gain_step_db: float | None = None
    retakes: int = 20


_READERS: dict[str, Callable[[str], Any]] = {
    "pixel_format": one_of(*(name.strip() for name in V4L2)),
    "width": whole(1, 65535),
    "height": whole(1, 65535),
    "plane": one_of(*PLANES),
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
    if (_known(options).cell is None) != (options.plane is None):
        raise LimitError(f"camera address {text!r}: plane={'|'.join(PLANES)} goes with a Bayer format, and only there")
    return options


def sample_format(options: V4l2Options) -> PixelFormat:
    """Return how samples stand in a picture of the device."""
    known = _known(options)
    depth = options.bit_depth or known.bit_depth
    if depth != known.bit_depth and known.bit_depth != 16:
        raise LimitError(f"{options.path}: bit_depth {depth}: samples of {known.name} have {known.bit_depth}")
    return replace(known, bit_depth=depth, justified=options.justified)


def _known(options: V4l2Options) -> PixelFormat:
    return V4L2[options.pixel_format.ljust(4)]
