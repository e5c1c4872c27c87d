"""Pictures for a page: frames and maps of polarization as small JPEG files; sharpness and brightness of a frame."""

import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from model.processing.maps import PolarizationMaps, polarization_maps
from model.processing.reconstruction import design
from rigctl.errors import DataError
from rigctl.report.drawing import colour_table
from rigctl.runs.folder import Run
from rigctl.runs.records import FrameRecord

FloatArray = NDArray[np.float64]
# Largest width of a frame and of a map: a telephone has fewer pixels, and arctangents take time.
MOST_WIDTH, MAP_WIDTH = 800, 480
_DARKEST, _BRIGHTEST = 0.005, 0.995
_SMOOTHING_PIXELS = 1.0
_SOBEL_SUM = 8.0
_MOST_DN = 65535
# Sharpness of a uniform picture, such as a saturated one, from rounding in single precision.
_ROUNDING = 1e-12
_QUALITY = (cv2.IMWRITE_JPEG_QUALITY, 80)
_STRIPE_PIXELS = 6
_SPECK = np.ones((5, 5), np.uint8)
_ZEBRA_BGR = ((60, 60, 255), (0, 0, 130))
_GREY = 128.0
_BINS = 64
# Factor of the width by which pixels are averaged at most.
_LARGE = 3
_ABOVE_ROUNDING = 1e-6
_STEP, _MANY_ROWS = 6, 64
_COLUMN_STEP = 4
# AoLP fades out where its standard deviation is above this.
_FAINT_RAD = np.deg2rad(10.0)
# Median absolute deviation of a second difference a - 2b + c of normal noise, over its standard deviation.
_MAD_OF_SECOND_DIFFERENCE = 0.6745 * 6.0**0.5
_LEAST_WIDTH = 3
_LEAST_NOISE_DN = 1e-3


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A picture to look at, not for measurements."""

    jpeg: bytes  #: The JPEG file.
    #: Histogram of the whole frame in 64 equal steps over the range of counts; empty for a map.
    histogram: tuple[int, ...] = ()
    clipped: float = 0.0  #: Share of saturated pixels, 0 to 1.


@dataclass(frozen=True, kw_only=True, eq=False)
class CyclePictures:
    """The frames of one cycle, reduced in size."""

    frames: NDArray[np.float32]  #: Counts [DN].
    angles_rad: FloatArray  #: Angles of the transmission axis [rad].
    dark_dn: FloatArray  #: Level without light [DN].
    extinction_ratio: float  #: Extinction ratio of the polarizer; infinite for an ideal one.


T = TypeVar("T")


class Shelf(Generic[T]):
    """The latest results, shared by all pages. Thread-safe; one result is made at a time."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._making = threading.Lock()
        self._made: OrderedDict[tuple[object, ...], T] = OrderedDict()

    def kept(self, key: tuple[object, ...], make: Callable[[], T]) -> T:
        """Return the result of a key, making it if necessary."""
        with self._making:
            if key not in self._made:
                self._made[key] = make()
            self._made.move_to_end(key)
            while len(self._made) > self._most:
                self._made.popitem(last=False)
            return self._made[key]


def picture_of(counts: NDArray[np.uint16], *, saturation_dn: float, most_width: int, zebra: bool) -> Picture:
    """Return a frame with stretched contrast; with `zebra`, saturated pixels are striped."""
    histogram = _histogram(counts, saturation_dn=saturation_dn)
    small = smaller(counts, most_width=most_width)
    quantiles = np.quantile(_sampled(small), [_DARKEST, _BRIGHTEST])
    low, high = float(quantiles[0]), float(quantiles[1])
    grey = cv2.convertScaleAbs(small - np.float32(low), alpha=255.0 / max(high - low, 1.0))
    grey[small <= low] = 0
    shown = grey
    if zebra and histogram[-1]:
        # Wider than one pixel, because JPEG would lose the colour.
        clipped = (counts >= saturation_dn).astype(np.uint8) * np.uint8(255)
        seen = smaller(clipped, most_width=most_width) > 0.0
        striped = cv2.dilate(seen.astype(np.uint8), _SPECK) > 0
        rows, columns = np.ogrid[: len(striped), : len(striped[0])]
        shown = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
        bright = (rows + columns) // _STRIPE_PIXELS % 2 == 0
        shown[striped & bright], shown[striped & ~bright] = _ZEBRA_BGR
    return Picture(jpeg=_jpeg(shown), histogram=histogram, clipped=histogram[-1] / counts.size)


def middle(counts: NDArray[np.uint16], *, zoom: int) -> NDArray[np.uint16]:
    """Return the middle of a picture, `zoom` times smaller in each direction, at least 2 x 2 pixels."""
    height, width = (max(2, length // zoom) for length in counts.shape)
    top, left = (counts.shape[0] - height) // 2, (counts.shape[1] - width) // 2
    return counts[top : top + height, left : left + width]


def brightness_of(counts: NDArray[np.uint16], *, bit_depth: int) -> tuple[float, float]:
    """Return the 99.5 % quantile of a picture as a share of the range, and the share of saturated pixels."""
    full_dn = 2**bit_depth - 1
    saturated = cv2.countNonZero(cv2.inRange(counts, full_dn, _MOST_DN))
    return _quantile(counts, _BRIGHTEST) / full_dn, saturated / counts.size


def sharpness_of(counts: NDArray[np.uint16]) -> float:
    """Return the mean square slope of the counts over their mean square, after smoothing by a pixel against noise.

    It does not depend on the exposure, but on the scene, so values can be compared only while the lens is turned. It is
    0 for a uniform picture.
    """
    smooth = cv2.GaussianBlur(counts.astype(np.float32), (0, 0), _SMOOTHING_PIXELS)
    along, down = (cv2.Sobel(smooth, cv2.CV_32F, *way) for way in ((1, 0), (0, 1)))
    # Sums of squares need double precision.
    power, slopes, more = (cv2.norm(picture, cv2.NORM_L2SQR) for picture in (smooth, along, down))
    sharpness = (slopes + more) / _SOBEL_SUM**2 / power if power > 0.0 else 0.0
    return sharpness if sharpness > _ROUNDING else 0.0


def _quantile(counts: NDArray[np.uint16], share: float) -> float:
    """Return the same quantile as numpy by counting, in a fortieth of the time of sorting."""
    levels = int(counts.max()) + 1
    below = np.cumsum(cv2.calcHist([counts], [0], None, [levels], [0.0, float(levels)]).ravel(), dtype=np.float64)
    place = share * (counts.size - 1)
    low, high = (int(np.searchsorted(below, rank, side="right")) for rank in (np.floor(place), np.ceil(place)))
    return float(low + (high - low) * (place - np.floor(place)))


def smaller(picture: NDArray[np.uint16] | NDArray[np.uint8], *, most_width: int) -> NDArray[np.float32]:
    """Return a picture of at most `most_width` columns by averaging pixels."""
    height, width = len(picture), len(picture[0])
    if width <= most_width:
        return picture.astype(np.float32)
    size = (most_width, max(1, round(height * most_width / width)))
    large: MatLike = picture
    if width >= _LARGE * most_width and width % 2 == 0 and height % 2 == 0:
        # Averaging pairs of pixels first halves the time.
        large = cv2.resize(picture, (width // 2, height // 2), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.resize(large, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def map_pictures(cycle: CyclePictures, *, dolp_top: float) -> dict[str, Picture]:
    """Return S0, DoLP and AoLP of a cycle, by the names ``s0``, ``dolp`` and ``aolp``."""
    plan = design(cycle.angles_rad, cycle.extinction_ratio)
    maps = polarization_maps(cycle.frames, plan, dark_dn=cycle.dark_dn)
    to_s1_s2 = plan.inverse[1:] * [_noise_dn(frame) for frame in cycle.frames]
    # The larger axis of the error ellipse of (S1, S2).
    noise_dn = float(np.linalg.norm(to_s1_s2, ord=2))
    return {"s0": _s0(maps), "dolp": _dolp(maps, top=dolp_top), "aolp": _aolp(maps, noise_dn=noise_dn)}


def _s0(maps: PolarizationMaps) -> Picture:
    total = np.maximum(maps.stokes[0], np.float32(0.0))
    top = float(np.quantile(_sampled(total), _BRIGHTEST))
    return Picture(jpeg=_jpeg(cv2.convertScaleAbs(total, alpha=255.0 / max(top, 1e-9))))


def _dolp(maps: PolarizationMaps, *, top: float) -> Picture:
    share = cv2.convertScaleAbs(_numbers(maps.dolp, maps.valid), alpha=255.0 / top)
    coloured = cv2.applyColorMap(share, cv2.COLORMAP_VIRIDIS)
    if not maps.valid.all():
        coloured[~maps.valid] = _GREY
    return Picture(jpeg=_jpeg(coloured))


def _aolp(maps: PolarizationMaps, *, noise_dn: float) -> Picture:
    """Return the angle in cyclic colours, grey where it is not known.

    Its standard deviation is half that of (S1, S2) across their direction (at most `noise_dn` [DN]) over their length.
    """
    turn = cv2.convertScaleAbs(_numbers(maps.aolp_rad, maps.valid), alpha=255.0 / np.pi)
    coloured = cv2.applyColorMap(turn, colour_table("aolp")[:, None])
    length = np.maximum(cv2.magnitude(maps.stokes[1], maps.stokes[2]), np.float32(_LEAST_NOISE_DN))
    # Full colour up to half of the limit, grey beyond the limit.
    known = np.clip(510.0 - np.float32(255.0 * noise_dn / _FAINT_RAD) / length, 0.0, 255.0).astype(np.uint8)
    known[~maps.valid] = 0
    grey = cv2.convertScaleAbs(cv2.bitwise_not(known), alpha=_GREY / 255.0)
    seen = cv2.multiply(coloured, cv2.merge([known] * 3), scale=1.0 / 255.0)
    return Picture(jpeg=_jpeg(cv2.add(seen, cv2.merge([grey] * 3))))


def _numbers(plane: NDArray[np.float32], valid: NDArray[np.bool_]) -> NDArray[np.float32]:
    return plane if valid.all() else np.where(valid, plane, np.float32(0.0))


def _sampled(picture: NDArray[np.float32], *, columns: int = _STEP) -> NDArray[np.float32]:
    """Return a sample of the pixels that is large enough for quantiles of contrast."""
    return picture[:: _STEP if len(picture) > _MANY_ROWS else 1, :: columns if len(picture) > _MANY_ROWS else 1]


def _noise_dn(frame: NDArray[np.float32]) -> float:
    """Return the noise of a pixel [DN] from second differences along rows; texture makes it larger."""
    if frame.shape[1] < _LEAST_WIDTH:
        return 1.0
    rows = _sampled(frame, columns=1)
    step = _COLUMN_STEP if len(frame) > _MANY_ROWS else 1
    bend = rows[:, :-2:step] - 2.0 * rows[:, 1:-1:step] + rows[:, 2::step]
    return max(float(np.median(np.abs(bend))) / _MAD_OF_SECOND_DIFFERENCE, _LEAST_NOISE_DN)


def _histogram(counts: NDArray[np.uint16], *, saturation_dn: float) -> tuple[int, ...]:
    # The last step holds what is saturated. Eight bits are counted at once; half a step down, rounding is cutting off.
    scale = (_BINS - 1) / max(float(saturation_dn), 1.0) * (1.0 + _ABOVE_ROUNDING)
    steps = cv2.convertScaleAbs(counts, alpha=scale, beta=-0.5)
    found = cv2.calcHist([steps], [0], None, [256], [0.0, 256.0]).ravel()
    return (*(int(n) for n in found[: _BINS - 1]), int(found[_BINS - 1 :].sum()))


def _jpeg(picture: MatLike) -> bytes:
    return cv2.imencode(".jpg", picture, _QUALITY)[1].tobytes()


MAPS = ("s0", "dolp", "aolp")
THUMB = "thumb"
_THUMB_WIDTH = 160
# An angle that is not among this many latest frames is of an earlier take.
_RECENT = 64
_KEPT, _KEPT_CYCLES = 24, 2
_LEAST_ANGLES = 3


class RunPictures:
    """The newest pictures of a run, drawn once and kept."""

    def __init__(self) -> None:
        self._drawn: Shelf[dict[str, Picture]] = Shelf(_KEPT)
        self._cycles: Shelf[CyclePictures] = Shelf(_KEPT_CYCLES)

    def newest_sequence(self, run: Run, name: str) -> int | None:
        """Return the number of the newest picture of a name; None if there is none."""
        if name in MAPS:
            cycle = last_cycle(run.frames)
            return cycle[-1].sequence if cycle else None
        found = _named(run.frames, name)
        return None if found is None else found.sequence

    def picture(self, run: Run, name: str, *, zebra: bool, dolp_top: float) -> Picture | None:
        """Return the newest picture of an angle or a map; None if there is none."""
        if name in MAPS:
            cycle = last_cycle(run.frames)
            return self._maps(run, cycle, dolp_top=dolp_top)[name] if cycle else None
        record = _named(run.frames, name)
        if record is None:
            return None
        width = _THUMB_WIDTH if name == THUMB else MOST_WIDTH
        key = ("frame", record.sequence, zebra, width)
        return self._drawn.kept(key, lambda: {"": _frame(run, record, zebra=zebra, most_width=width)})[""]

    def _maps(self, run: Run, cycle: Sequence[FrameRecord], *, dolp_top: float) -> dict[str, Picture]:
        sequences = tuple(record.sequence for record in cycle)
        frames = self._cycles.kept(sequences, lambda: _cycle(run, cycle))
        try:
            return self._drawn.kept(("maps", sequences, dolp_top), lambda: map_pictures(frames, dolp_top=dolp_top))
        except ValueError as error:
            raise DataError(f"{run.path}: no maps: {error}") from error


def last_cycle(frames: Sequence[FrameRecord]) -> tuple[FrameRecord, ...]:
    """Return the frames of the newest complete cycle, one for each angle; empty if there is none.

    A cycle is complete once the next one has begun, or once it has as many angles as the previous one. If frames are
    grouped by angle, the newest frame of each angle is returned.
    """
    scenes = [frame for frame in frames if frame.kind == "scene" and frame.polarizer_angle_deg is not None]
    cycles: dict[tuple[int | None, int | None], dict[str, FrameRecord]] = {}
    for frame in scenes:
        cycles.setdefault((frame.round, frame.cycle), {})[_angle_name(frame)] = frame
    most = max(map(len, cycles.values()), default=0)
    whole = [cycle for cycle in cycles.values() if len(cycle) == most]
    if most < _LEAST_ANGLES:
        return ()
    newest = max(whole, key=lambda cycle: max(frame.sequence for frame in cycle.values()))
    return tuple(sorted(newest.values(), key=lambda frame: frame.sequence))


def newest_by_name(frames: Sequence[FrameRecord]) -> dict[str, FrameRecord]:
    """Return the newest frame of each angle, and the newest dark and flat, by name."""
    found = {frame.kind: frame for frame in frames if frame.kind != "scene"}
    scenes = [frame for frame in frames if frame.kind == "scene"][-_RECENT:]
    return found | {_angle_name(frame): frame for frame in scenes}


def _named(frames: Sequence[FrameRecord], name: str) -> FrameRecord | None:
    newest = newest_by_name(frames)
    return next(iter(reversed(newest.values())), None) if name == THUMB else newest.get(name)


def _angle_name(frame: FrameRecord) -> str:
    angle_deg = frame.polarizer_angle_target_deg
    angle_deg = frame.polarizer_angle_deg if angle_deg is None else angle_deg
    return "scene" if angle_deg is None else f"{angle_deg:g}"


def _frame(run: Run, record: FrameRecord, *, zebra: bool, most_width: int) -> Picture:
    return picture_of(run.counts(record), saturation_dn=record.saturation_dn, most_width=most_width, zebra=zebra)


def _cycle(run: Run, cycle: Sequence[FrameRecord]) -> CyclePictures:
    ratio = run.session.polarizer.extinction_ratio
    return CyclePictures(
        frames=np.stack([smaller(run.counts(record), most_width=MAP_WIDTH) for record in cycle]),
        angles_rad=np.deg2rad([record.polarizer_angle_deg or 0.0 for record in cycle]),
        dark_dn=np.array([_dark_dn(run, record) for record in cycle]),
        extinction_ratio=np.inf if ratio is None else ratio,
    )


def _dark_dn(run: Run, record: FrameRecord) -> float:
    """Return the dark level: of the newest dark frame of that exposure, otherwise the camera's black level."""
    darks = [frame for frame in run.frames if frame.kind == "dark" and frame.exposure_s == record.exposure_s]
    if darks:
        return float(run.counts(darks[-1]).mean())
    return record.black_level_dn or 0.0
