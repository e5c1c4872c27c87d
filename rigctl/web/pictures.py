"""Frames and maps of polarization as JPEG files for a page: small, with fixed colour scales, fast to make."""

from dataclasses import dataclass

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from model.processing.maps import PolarizationMaps, polarization_maps
from model.processing.reconstruction import design

FloatArray = NDArray[np.float64]
_DARKEST, _BRIGHTEST = 0.005, 0.995
_QUALITY = (cv2.IMWRITE_JPEG_QUALITY, 80)
_STRIPE_PIXELS = 6
_SPECK = np.ones((5, 5), np.uint8)
_ZEBRA_BGR = ((60, 60, 255), (0, 0, 130))
_GREY = 128.0
_BINS = 64
_STEP, _MANY_ROWS = 6, 64
# AoLP fades out where it is known to less than this.
_FAINT_RAD = np.deg2rad(10.0)
# Median absolute deviation of a second difference a - 2b + c of normal noise, over its standard deviation.
_MAD_OF_SECOND_DIFFERENCE = 0.6745 * 6.0**0.5
_LEAST_WIDTH = 3
_LEAST_NOISE_DN = 1e-3


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A picture to look at: nothing is measured with it.

    Attributes
    ----------
    jpeg : bytes
        The file.
    histogram : tuple of int
        Pixels in 64 steps of equal width over the range of counts, of the whole frame; empty for a map.
    clipped : float
        Share of saturated pixels, 0 to 1.
    """

    jpeg: bytes
    histogram: tuple[int, ...] = ()
    clipped: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class CyclePictures:
    """The frames of one cycle, made smaller, and what is known of them.

    Attributes
    ----------
    frames : (N, H, W) array of float32
        Counts [DN].
    angles_rad : (N,) array
        Of the transmission axis [rad].
    dark_dn : (N,) array
        Level without light [DN].
    extinction_ratio : float
        Of the polarizer; infinite for an ideal one.
    """

    frames: NDArray[np.float32]
    angles_rad: FloatArray
    dark_dn: FloatArray
    extinction_ratio: float


def picture_of(counts: NDArray[np.uint16], *, saturation_dn: float, most_width: int, zebra: bool) -> Picture:
    """Return a frame, stretched for the eye; where `zebra` is set, saturated pixels are striped.

    Parameters
    ----------
    counts : (H, W) array of uint16
        [DN].
    saturation_dn : float
        A pixel at or above is saturated [DN].
    most_width : int
        Wider ones are made smaller; a single saturated pixel still shows.
    zebra : bool
        Whether to stripe.
    """
    clipped = counts >= saturation_dn
    small = smaller(counts, most_width=most_width)
    quantiles = np.quantile(_sampled(small), [_DARKEST, _BRIGHTEST])
    low, high = float(quantiles[0]), float(quantiles[1])
    grey = cv2.convertScaleAbs(small - np.float32(low), alpha=255.0 / max(high - low, 1.0))
    grey[small <= low] = 0
    shown = grey
    if zebra and clipped.any():
        # Wider than one pixel, or JPEG would take its colour away.
        seen = smaller(clipped.astype(np.uint8) * np.uint8(255), most_width=most_width) > 0.0
        striped = cv2.dilate(seen.astype(np.uint8), _SPECK) > 0
        rows, columns = np.ogrid[: len(striped), : len(striped[0])]
        shown = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
        bright = (rows + columns) // _STRIPE_PIXELS % 2 == 0
        shown[striped & bright], shown[striped & ~bright] = _ZEBRA_BGR
    return Picture(
        jpeg=_jpeg(shown),
        histogram=_histogram(counts, saturation_dn=saturation_dn),
        clipped=float(np.mean(clipped)),
    )


def smaller(picture: NDArray[np.uint16] | NDArray[np.uint8], *, most_width: int) -> NDArray[np.float32]:
    """Return a picture of `most_width` columns at most, each pixel the mean of those that it stands for."""
    height, width = len(picture), len(picture[0])
    if width <= most_width:
        return picture.astype(np.float32)
    size = (most_width, max(1, round(height * most_width / width)))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def map_pictures(cycle: CyclePictures, *, dolp_top: float) -> dict[str, Picture]:
    """Return S0, DoLP and AoLP of a cycle, by the names ``s0``, ``dolp`` and ``aolp``.

    Parameters
    ----------
    cycle : CyclePictures
        Three different angles at least.
    dolp_top : float
        DoLP at the upper end of the colours, which begin at 0.

    Raises
    ------
    ValueError
        The angles do not determine the Stokes parameters.
    """
    plan = design(cycle.angles_rad, cycle.extinction_ratio)
    maps = polarization_maps(cycle.frames, plan, dark_dn=cycle.dark_dn)
    to_s1_s2 = plan.inverse[1:] * [_noise_dn(frame) for frame in cycle.frames]
    # The larger axis of the error ellipse of (S1, S2).
    noise_dn = float(np.linalg.norm(to_s1_s2, ord=2))
    return {"s0": _s0(maps), "dolp": _dolp(maps, top=dolp_top), "aolp": _aolp(maps, noise_dn=noise_dn)}


def colour_bar(name: str) -> bytes:
    """Return the colours of a map from its lower to its upper end, as a JPEG of one row of 256."""
    steps = np.arange(256, dtype=np.uint8)[None, :].repeat(8, axis=0)
    return _jpeg(cv2.applyColorMap(steps, _COLOURS[name]) if name in _COLOURS else steps)


_COLOURS = {"dolp": cv2.COLORMAP_VIRIDIS, "aolp": cv2.COLORMAP_TWILIGHT_SHIFTED}


def _s0(maps: PolarizationMaps) -> Picture:
    total = maps.stokes[0]
    top = float(np.quantile(_sampled(total), _BRIGHTEST))
    return Picture(jpeg=_jpeg(np.clip(total * (255.0 / max(top, 1e-9)), 0.0, 255.0).astype(np.uint8)))


def _dolp(maps: PolarizationMaps, *, top: float) -> Picture:
    share = np.clip(np.nan_to_num(maps.dolp, nan=0.0) / top, 0.0, 1.0)
    coloured = cv2.applyColorMap((share * 255.0).astype(np.uint8), _COLOURS["dolp"])
    coloured[~maps.valid] = _GREY
    return Picture(jpeg=_jpeg(coloured))


def _aolp(maps: PolarizationMaps, *, noise_dn: float) -> Picture:
    """Return the angle in colours that meet at 0 and 180 deg, grey where it is not known.

    Its deviation is half that of (S1, S2) across their direction over their length, at most `noise_dn` [DN].
    """
    turn = np.nan_to_num(maps.aolp_rad, nan=0.0) * np.float32(255.0 / np.pi)
    coloured = cv2.applyColorMap(turn.astype(np.uint8), _COLOURS["aolp"]).astype(np.float32)
    length = np.nan_to_num(maps.dolp * maps.stokes[0], nan=0.0)
    std_rad = np.float32(0.5 * noise_dn) / np.maximum(length, np.float32(_LEAST_NOISE_DN))
    known = np.clip(2.0 - std_rad * np.float32(2.0 / _FAINT_RAD), 0.0, 1.0)[..., None]
    return Picture(jpeg=_jpeg((_GREY + (coloured - _GREY) * known).astype(np.uint8)))


def _sampled(picture: NDArray[np.float32], *, columns: int = _STEP) -> NDArray[np.float32]:
    """Return some of the pixels, enough for quantiles that the eye sees; small pictures whole."""
    return picture[:: _STEP if len(picture) > _MANY_ROWS else 1, :: columns if len(picture) > _MANY_ROWS else 1]


def _noise_dn(frame: NDArray[np.float32]) -> float:
    """Return the deviation from pixel to pixel [DN] by second differences along rows; texture makes it larger."""
    if frame.shape[1] < _LEAST_WIDTH:
        return 1.0
    rows = _sampled(frame, columns=1)
    bend = rows[:, :-2] - 2.0 * rows[:, 1:-1] + rows[:, 2:]
    return max(float(np.median(np.abs(bend))) / _MAD_OF_SECOND_DIFFERENCE, _LEAST_NOISE_DN)


def _histogram(counts: NDArray[np.uint16], *, saturation_dn: float) -> tuple[int, ...]:
    # The last step holds what is saturated.
    top = max(float(saturation_dn), 1.0) * _BINS / (_BINS - 1)
    found = cv2.calcHist([np.minimum(counts, np.uint16(top - 1.0))], [0], None, [_BINS], [0.0, top])
    return tuple(int(n) for n in found.ravel())


def _jpeg(picture: MatLike) -> bytes:
    return cv2.imencode(".jpg", picture, _QUALITY)[1].tobytes()
