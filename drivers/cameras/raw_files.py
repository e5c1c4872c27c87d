"""RAW files of still cameras (DNG, NEF, CR2, ...): the samples as they left the sensor, and what is said of them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from drivers.errors import LimitError, ProtocolError

Plane = Literal["red", "green-1", "green-2", "blue", "all"]
PLANES: tuple[Plane, ...] = get_args(Plane)
RAW_SUFFIXES = frozenset(
    (".dng", ".nef", ".cr2", ".cr3", ".arw", ".kdc", ".raf", ".orf", ".rw2", ".pef", ".srw", ".raw", ".3fr", ".iiq")
)

_COLOURS = b"RGBG"
_INDEX: dict[str, int] = {"red": 0, "green-1": 1, "blue": 2, "green-2": 3}
_LINEAR_MONO = 6  # what LibRaw has for the pattern of a picture without a colour mosaic


@dataclass(frozen=True, kw_only=True)
class RawPicture:
    """One RAW file.

    Attributes
    ----------
    counts : (H, W) array of uint16
        Samples as stored, black level and all; of one colour every second pixel of every second row.
    black_level_dn : float
        Of that colour, by the file.
    white_level_dn : int
        Largest count of the format, by the file. Pixels may saturate below.
    exposure_s : float or None
        None where the file does not tell.
    iso : float or None
        Setting of the gain; None where the file does not tell.
    flip : int
        How the camera was held, by LibRaw's number; 0 is upright. Rows and columns are the sensor's, not turned.
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
        "red", "green-1" (in the rows of red), "green-2", "blue", or "all": the whole mosaic. None is for a camera
        without a mosaic.

    Raises
    ------
    LimitError
        The colour is not said, or not there, or the colours of the whole mosaic have different black levels.
    ProtocolError
        The file is empty, damaged, or no RAW file; or its pattern of colours is not the usual one.
    """
    import rawpy  # only whoever has RAW files needs it

    if not path.is_file() or path.stat().st_size == 0:
        raise ProtocolError(f"{path}: there is no such file, or nothing is in it")
    try:
        with rawpy.imread(str(path)) as raw:
            return _picture(path, raw, plane)
    except rawpy.LibRawError as error:
        raise ProtocolError(f"{path}: is damaged, cut short, or no RAW file that LibRaw knows ({error})") from error


def _picture(path: Path, raw: Any, plane: Plane | None) -> RawPicture:
    pattern = _pattern(path, raw)
    counts = raw.raw_image_visible
    blacks = [float(level) for level in raw.black_level_per_channel]
    if pattern is None:
        if plane not in (None, "all"):
            raise LimitError(f"{path}: has no colours, so there is no plane {plane!r}")
        black_level_dn = blacks[0]
    elif plane is None:
        raise LimitError(f"{path}: has a mosaic of colours; say which plane: {', '.join(PLANES)}")
    elif plane == "all":
        black_level_dn = _one_black_level(path, blacks)
    else:
        row, column = (int(place[0]) for place in np.nonzero(pattern == _INDEX[plane]))
        counts = counts[row::2, column::2]
        # By number of colour, not by place in the mosaic: the two differ.
        black_level_dn = blacks[_INDEX[plane]]
    return RawPicture(
        counts=np.array(counts, dtype=np.uint16, order="C"),  # the file's own memory goes with it
        black_level_dn=black_level_dn,
        white_level_dn=int(raw.white_level),
        exposure_s=_stated(raw.other.shutter_speed),
        iso=_stated(raw.other.iso_speed),
        flip=int(raw.sizes.flip),
    )


def _pattern(path: Path, raw: Any) -> NDArray[np.uint8] | None:
    """Return the mosaic's 2 x 2 cell by number of colour; None for a camera without one."""
    pattern = raw.raw_pattern
    if raw.raw_image_visible.ndim != 2:
        raise ProtocolError(f"{path}: has several samples a pixel: it is no RAW file but a finished picture")
    if pattern is not None and pattern.size == 1 and pattern[0, 0] in (0, _LINEAR_MONO):
        return None
    usual = pattern is not None and pattern.shape == (2, 2) and sorted(pattern.ravel()) == [0, 1, 2, 3]
    if not usual or raw.color_desc != _COLOURS:
        shown = None if pattern is None else pattern.tolist()
        raise ProtocolError(
            f"{path}: its pattern of colours is {shown} of {raw.color_desc!r}, and only 2 x 2 of red, green, blue, "
            "green is read"
        )
    return np.asarray(pattern, dtype=np.uint8)


def _one_black_level(path: Path, blacks: list[float]) -> float:
    if len(set(blacks)) > 1:
        raise LimitError(f"{path}: its colours have the black levels {blacks}; take one colour at a time")
    return blacks[0]


def _stated(value: float) -> float | None:
    """Return a value that the file has; LibRaw has 0 for one that is missing."""
    return float(value) if value > 0 else None
