"""RAW files of still cameras (DNG, NEF, CR2, ...): the samples of the sensor, and their description."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.cameras import samples as bayer
from drivers.cameras.raw_planes import PLANES, Plane
from drivers.errors import LimitError, ProtocolError

RAW_SUFFIXES = frozenset(
    (".dng", ".nef", ".cr2", ".cr3", ".arw", ".kdc", ".raf", ".orf", ".rw2", ".pef", ".srw", ".raw", ".3fr", ".iiq")
)

_COLOURS = b"RGBG"
_LINEAR_MONO = 6  # LibRaw's pattern of a picture without a colour mosaic


@dataclass(frozen=True, kw_only=True)
class RawPicture:
    """One RAW file.

    Attributes
    ----------
    counts : (H, W) array of uint16
        Samples as stored, with the black level; of one colour every second pixel of every second row. For sums, and for
        colours of different black levels, see `read_raw`.
    black_level_dn : float
        Of these counts, by the file.
    white_level_dn : int
        Largest count of the format, by the file; of a sum, that of all its samples. Pixels may saturate below.
    exposure_s : float or None
        None if the file does not state it.
    iso : float or None
        Setting of the gain; None if the file does not state it.
    flip : int
        Orientation of the camera, LibRaw's number; 0 is upright. Rows and columns are the sensor's, not turned.
    """

    counts: NDArray[np.uint16]
    black_level_dn: float
    white_level_dn: int
    exposure_s: float | None
    iso: float | None
    flip: int

    @property
    def bit_depth(self) -> int:
        """Bits that hold the white level."""
        return self.white_level_dn.bit_length()


def read_raw(path: Path, *, plane: Plane | None) -> RawPicture:
    """Return the samples of one colour of a RAW file, or of all pixels.

    Parameters
    ----------
    path : Path
        The file.
    plane : str or None
        "red", "green-1" (in the rows of red), "green-2", "blue"; "green" (the sum of both) or "sum" (of all four):
        see `drivers.cameras.samples.take_plane` for what a sum loses; or "all": the whole mosaic. None is for a camera
        without a mosaic.

    Raises
    ------
    LimitError
        The colour is missing or does not exist, or the black levels of the colours do not differ by whole counts, so
        the mosaic cannot have a single one.
    ProtocolError
        The file is empty, damaged, or no RAW file; or its pattern of colours is unusual.

    Notes
    -----
    If the colours of "all" have different black levels, lower ones are raised to the highest; counts are limited to the
    white level.
    """
    import rawpy  # needed for RAW files only

    if not path.is_file() or path.stat().st_size == 0:
        raise ProtocolError(f"{path}: there is no such file, or nothing is in it")
    try:
        with rawpy.imread(str(path)) as raw:
            return _picture(path, raw, plane)
    except rawpy.LibRawError as error:
        raise ProtocolError(f"{path}: is damaged, truncated, or not a RAW file known to LibRaw ({error})") from error


def _picture(path: Path, raw: Any, plane: Plane | None) -> RawPicture:
    pattern = _pattern(path, raw)
    counts = raw.raw_image_visible
    blacks = [float(level) for level in raw.black_level_per_channel]
    samples = 1
    if pattern is None:
        if plane not in (None, "all"):
            raise LimitError(f"{path}: has no colours, so there is no plane {plane!r}")
        black_level_dn = blacks[0]
    elif plane is None:
        raise LimitError(f"{path}: has a mosaic of colours; choose a plane: {', '.join(PLANES)}")
    elif plane == "all":
        black_level_dn = max(blacks)
        counts = _levelled(path, counts, pattern, blacks, white=int(raw.white_level))
    else:
        counts, black_level_dn, samples = _plane(raw, pattern, plane, blacks)
    return RawPicture(
        counts=np.array(counts, dtype=np.uint16, order="C"),  # the file's own memory goes with it
        black_level_dn=black_level_dn,
        white_level_dn=samples * int(raw.white_level),
        exposure_s=_stated(raw.other.shutter_speed),
        iso=_stated(raw.other.iso_speed),
        flip=int(raw.sizes.flip),
    )


def _pattern(path: Path, raw: Any) -> NDArray[np.uint8] | None:
    """Return the mosaic's 2 x 2 cell by number of colour; None for a camera without one."""
    pattern = raw.raw_pattern
    if raw.raw_image_visible.ndim != 2:
        raise ProtocolError(f"{path}: has several samples per pixel: it is a finished picture, not a RAW file")
    if pattern is not None and pattern.size == 1 and pattern[0, 0] in (0, _LINEAR_MONO):
        return None
    usual = pattern is not None and pattern.shape == (2, 2) and sorted(pattern.ravel()) == [0, 1, 2, 3]
    if not usual or raw.color_desc != _COLOURS:
        shown = None if pattern is None else pattern.tolist()
        raise ProtocolError(
            f"{path}: its pattern of colours is {shown} of {raw.color_desc!r}, and only 2 x 2 cells of red, green, "
            "blue, green can be read"
        )
    return np.asarray(pattern, dtype=np.uint8)


def _levelled(
    path: Path, counts: NDArray[np.uint16], pattern: NDArray[np.uint8], blacks: list[float], *, white: int
) -> NDArray[np.uint16]:
    """Return the mosaic with the black level of every colour raised to the highest."""
    lift = max(blacks) - np.array(blacks)[pattern]
    if not lift.any():
        return counts
    if (lift != np.round(lift)).any():
        raise LimitError(f"{path}: its colours have the black levels {blacks}; take one colour at a time")
    height, width = counts.shape
    lifts = np.tile(lift.astype(np.uint32), (height // 2 + 1, width // 2 + 1))[:height, :width]
    # Saturated samples stay unchanged.
    return np.where(counts >= white, counts, np.minimum(counts + lifts, white)).astype(np.uint16)


def _plane(
    raw: Any, pattern: NDArray[np.uint8], plane: bayer.Plane, blacks: list[float]
) -> tuple[NDArray[np.uint16], float, int]:
    """Return counts of a plane, its black level, and the number of samples summed in each count."""
    cell = "".join("RGBG"[index] for index in pattern.ravel())
    places, white = bayer.places_of(plane, cell=cell), int(raw.white_level)
    counts = bayer.take_plane(
        raw.raw_image_visible,
        cell=cell,
        plane=plane,
        saturation_dn=white,
        saturated_as_dn=len(places) * white,
    )
    # By number of colour, not by place in the mosaic: the two differ.
    return counts, sum(blacks[pattern[place]] for place in places), len(places)


def _stated(value: float) -> float | None:
    """Return a value of the file; None for 0, LibRaw's value for missing ones."""
    return float(value) if value > 0 else None
