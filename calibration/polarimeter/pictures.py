"""Pictures behind a turning polarizer: registration, wander, flat fields and affine maps."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.results import CalibrationError

# Image registration: shift of the picture from one polarizer angle to the next

FloatArray = NDArray[np.float64]
_Picture = NDArray[np.float32]

# Smoothing before the gradient [pixel]: less passes noise, more blurs the edges.
_SMOOTHING_PIXELS = 2.0
_CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-6)
# Change of the shifts at which the passes end: an eightieth of the error of a step [pixel].
_PASSES, _SETTLED_PIXELS = 4, 1e-4
_TILES_ACROSS = 3
_LEAST_TILE_PIXELS = 48
# Least correlation of the edges of two pictures in every direction. Noise alone reaches it once in a million: smoothing
# leaves one independent value in 25 pixels.
_LEAST_IN_COMMON = 0.05
_NOISE_IN_COMMON = 5.0 * 25.0**0.5
# OpenCV moves pictures in steps of a thirty-second of a pixel.
_STEP_ERROR_PIXELS = 1.0 / 32.0 / 12.0**0.5
_DIRECTIONS = 12
# Shifts below this count as none [pixel].
_TOO_SMALL_PIXELS = 0.05
# If the ninths of a picture scatter by more than this, and by more than this share of the shift, it has no one shift.
_LARGE_SCATTER_PIXELS, _LARGE_SCATTER_SHARE = 0.4, 0.5
# Distance within which unusable pixels are filled from others [pixel].
_REACHES_PIXELS = (2.0, 8.0, 32.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Registration:
    """Shifts of pictures against the first."""

    #: (N, 2): x to the right, y down: a point at (x, y) in the first picture is at (x, y) + shift in the other
    shift_pixels: FloatArray
    std_error_pixels: FloatArray  #: (N, 2): from the differences between ninths of the picture
    #: (N, 2): of the edges, as a share of them, before and after the picture is moved back by what one half of the
    #: ninths says, in the other half; both halves in turn
    edge_residual: FloatArray = field(default_factory=lambda: np.empty((0, 2)))

    @property
    def scatter_pixels(self) -> FloatArray:
        """Standard deviation of the shifts of ninths of each picture, shape (N,)."""
        return np.asarray(np.linalg.norm(self.std_error_pixels, axis=1) * _TILES_ACROSS)

    def is_plain(self, index: int) -> bool:
        """Return whether tiles agree on the shift, and it improves the edges of tiles that it was not fitted to."""
        size = float(np.linalg.norm(self.shift_pixels[index]))
        if self.scatter_pixels[index] > max(_LARGE_SCATTER_PIXELS, _LARGE_SCATTER_SHARE * size):
            return False
        if index >= len(self.edge_residual) or size < _TOO_SMALL_PIXELS:
            return True
        before, after = self.edge_residual[index]
        return bool(after < before)


def register(pictures: FloatArray, usable: NDArray[np.bool_] | None = None) -> Registration:
    """Return the shift of each picture of a set against the first.

    Parameters
    ----------
    pictures : (N, H, W) array
        One scene at two or more polarizer angles, dark taken off, no saturated pixels; both sides 144 pixels or more.
    usable : (H, W) array or None
        Pixels that are neither missing nor saturated nor a border in any picture; None is all.

    Raises
    ------
    CalibrationError
        Pictures are too small or too few, or lack edges.

    Notes
    -----
    Polarized light makes pictures of one scene differ, which methods that compare intensities mistake for a shift
    (0.2 pixel on a natural scene with DoLP up to 0.4). Here the magnitude of the smoothed gradient is compared,
    by OpenCV's enhanced correlation coefficient, with that of the mean of all pictures, moved back by the shifts
    found so far. The remaining error is below 0.05 pixel on such a scene; the standard errors include the part that
    varies over the picture. Translation only. Shifts of several pixels need a scene with large shapes.

    References
    ----------
    Evangelidis and Psarakis, IEEE TPAMI 30, 1858 (2008), doi:10.1109/TPAMI.2008.113.
    """
    if len(pictures) < 2 or min(pictures.shape[1:]) < _TILES_ACROSS * _LEAST_TILE_PIXELS:
        raise CalibrationError(
            f"pictures {pictures.shape} are too few or too small to register: at least two are needed, "
            f"with sides of at least {_TILES_ACROSS * _LEAST_TILE_PIXELS} pixels"
        )
    frames = [_filled(picture, usable) for picture in pictures]
    edges = [_edges(frame) for frame in frames]
    shifts = np.array([_ecc(edges[0], moved, np.zeros(2)) for moved in edges])
    for _ in range(_PASSES):
        reference = _edges(_mean_moved_back(frames, shifts))
        before = shifts - shifts[0]
        shifts = np.array([_ecc(reference, moved, shift) for moved, shift in zip(edges, shifts, strict=True)])
        shifts -= shifts[0]
        if np.abs(shifts - before).max() < _SETTLED_PIXELS:
            break
    _require_edges_in_common(frames, shifts)
    found = _tile_shifts(reference, edges, shifts)
    errors = np.hypot(found.std(axis=1, ddof=1) / _TILES_ACROSS, _STEP_ERROR_PIXELS)
    errors[0] = 0.0
    residuals = np.array([_edge_residual(reference, *of_one) for of_one in zip(frames, edges, found, strict=True)])
    return Registration(shift_pixels=shifts, std_error_pixels=errors, edge_residual=residuals)


def _filled(picture: FloatArray, usable: NDArray[np.bool_] | None) -> _Picture:
    """Return a picture with unusable pixels filled from their neighbours, so that they make no edges."""
    if usable is None or usable.all():
        return np.asarray(picture, dtype=np.float32)
    if not usable.any():
        raise CalibrationError("pictures cannot be registered: no pixel is usable in all of them")
    known = np.where(usable, picture, 0.0)
    filled = np.asarray(picture, dtype=np.float64)
    left = ~usable
    for reach in _REACHES_PIXELS:
        weights = cv2.GaussianBlur(usable.astype(np.float64), (0, 0), reach)
        smooth = cv2.GaussianBlur(known, (0, 0), reach) / np.maximum(weights, 1e-12)
        near = left & (weights > 1e-3)
        filled = np.where(near, smooth, filled)
        left &= ~near
    return np.asarray(np.where(left, known.sum() / usable.sum(), filled), dtype=np.float32)


def _edges(picture: _Picture) -> _Picture:
    smooth = cv2.GaussianBlur(picture, (0, 0), _SMOOTHING_PIXELS)
    edges = cv2.magnitude(cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1))
    return np.asarray(edges, dtype=np.float32)


def _ecc(reference: _Picture, moved: _Picture, start: FloatArray) -> FloatArray:
    motion = np.array([[1.0, 0.0, start[0]], [0.0, 1.0, start[1]]], dtype=np.float32)
    everywhere = np.ones(moved.shape, dtype=np.uint8)
    try:
        _, found = cv2.findTransformECC(reference, moved, motion, cv2.MOTION_TRANSLATION, _CRITERIA, everywhere, 1)
    except cv2.error as error:
        raise CalibrationError("pictures cannot be registered: they have no edges in common") from error
    return np.asarray(found, dtype=np.float64)[:, 2]


def _mean_moved_back(frames: list[_Picture], shifts: FloatArray) -> _Picture:
    moved = [_warped(frame, shift) for frame, shift in zip(frames, shifts, strict=True)]
    mean: _Picture = np.mean(moved, axis=0, dtype=np.float32)
    return mean


def _warped(picture: _Picture, shift: FloatArray) -> _Picture:
    motion = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]])
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    warped = cv2.warpAffine(picture, motion, picture.shape[::-1], flags=flags, borderMode=cv2.BORDER_REFLECT)
    return np.asarray(warped, dtype=np.float32)


def _require_edges_in_common(frames: list[_Picture], shifts: FloatArray) -> None:
    """Refuse pictures whose edges leave a shift in some direction undetermined, such as along parallel lines."""
    first = _slopes(_edges(frames[0]))
    least = max(_LEAST_IN_COMMON, _NOISE_IN_COMMON / first.shape[1] ** 0.5)
    directions_rad = np.arange(_DIRECTIONS) * np.pi / _DIRECTIONS
    along = np.column_stack([np.cos(directions_rad), np.sin(directions_rad)])
    for index, (frame, shift) in enumerate(zip(frames[1:], shifts[1:], strict=True), start=1):
        other = _slopes(_edges(_warped(frame, shift)))
        own = [np.einsum("di,ij,dj->d", along, one @ one.T, along) for one in (first, other)]
        common = np.einsum("di,ij,dj->d", along, first @ other.T, along) / np.sqrt(own[0] * own[1])
        weakest = int(np.argmin(common))
        if common[weakest] < least:
            across_deg = float(np.degrees(directions_rad[weakest]))
            raise CalibrationError(
                f"pictures cannot be registered: the edges of picture {index} and of the first have too little in "
                f"common along {across_deg:.0f} deg (clockwise from the rows; {common[weakest]:.2f}, at least "
                f"{least:.2f} is needed), so this shift is not determined: use a scene with edges in every "
                f"direction, in focus, such as a printed pattern"
            )


def _slopes(edges: _Picture) -> FloatArray:
    """Return the gradient of a picture across and down, less its mean, shape (2, pixels)."""
    slopes = np.array([cv2.Sobel(edges, cv2.CV_64F, *order).ravel() for order in ((1, 0), (0, 1))])
    centred: FloatArray = slopes - slopes.mean(axis=1, keepdims=True)
    return centred


def _tiles(shape: tuple[int, ...]) -> list[tuple[slice, slice]]:
    height, width = (side // _TILES_ACROSS for side in shape)
    return [
        (slice(row * height, (row + 1) * height), slice(column * width, (column + 1) * width))
        for row in range(_TILES_ACROSS)
        for column in range(_TILES_ACROSS)
    ]


def _tile_shifts(reference: _Picture, edges: list[_Picture], shifts: FloatArray) -> FloatArray:
    """Return the shifts of ninths of the edges, shape (N, 9, 2); zero for the first picture."""
    tiles = _tiles(reference.shape)
    found = np.zeros((len(edges), len(tiles), 2))
    for index, (moved, shift) in enumerate(zip(edges[1:], shifts[1:], strict=True), start=1):
        found[index] = [_ecc(reference[tile], moved[tile], shift) for tile in tiles]
    return found


def edges_left(pictures: FloatArray, shifts: FloatArray, usable: NDArray[np.bool_] | None = None) -> FloatArray:
    """Return the residual of the edges of each picture against those of the mean, before and after it is moved back."""
    frames = [_filled(picture, usable) for picture in pictures]
    reference = _edges(_mean_moved_back(frames, shifts))
    plain = _edges(_mean_moved_back(frames, np.zeros_like(shifts)))
    pairs = [
        (_left(plain, _edges(frame)), _left(reference, _edges(_warped(frame, shift))))
        for frame, shift in zip(frames, shifts, strict=True)
    ]
    return np.array(pairs)


def _edge_residual(reference: _Picture, frame: _Picture, plain: _Picture, found: FloatArray) -> tuple[float, float]:
    """Return the residual of the edges before and after each half of the ninths is moved by that of the other."""
    tiles, before, after = _tiles(reference.shape), 0.0, 0.0
    for half in (0, 1):
        fitted, held = found[half::2].mean(axis=0), tiles[1 - half :: 2]
        moved = _edges(_warped(frame, fitted))
        before += sum(_left(reference[tile], plain[tile]) for tile in held)
        after += sum(_left(reference[tile], moved[tile]) for tile in held)
    return before / len(tiles), after / len(tiles)


def _left(reference: _Picture, edges: _Picture) -> float:
    """Return the share of edges that are not those of the reference, whatever their contrast."""
    own, other = reference.astype(np.float64).ravel(), edges.astype(np.float64).ravel()
    power = float(own @ own) * float(other @ other)
    return 1.0 - float(own @ other) ** 2 / power if power > 0.0 else 1.0


# Shift of the picture as the polarizer turns, and noise of pictures that are shifted back


@dataclass(frozen=True, kw_only=True, eq=False)
class Wander:
    """The shifts as a function of the stage angle: centre + turning vector."""

    #: shift = centre + turning * exp(i sense stage angle), x in the real part, y (down) in the imaginary
    centre_pixels: complex
    turning_pixels: complex
    sense: int  #: sense of rotation on the circle
    residual_pixels: float  #: rms residual per axis; 0 without degrees of freedom

    def shift_pixels(self, stage_rad: float, *, against_rad: float) -> FloatArray:
        """Return the shift (x, y) of the picture at one stage angle against that at another."""
        ends = np.exp(1j * self.sense * np.array([stage_rad, against_rad]))
        moved = self.turning_pixels * (ends[0] - ends[1])
        return np.array([moved.real, moved.imag])


def fit_wander(stage_rad: FloatArray, shift_pixels: FloatArray, *, sense: int = 1) -> Wander:
    """Return the circle of the shifts while a wedge turns with the polarizer.

    The wrong sense makes the residual large.
    """
    design = np.column_stack([np.ones(len(stage_rad)), np.exp(1j * sense * stage_rad)])
    if np.linalg.matrix_rank(design) < 2:
        raise CalibrationError("all stage angles are the same; the circle of shifts needs at least two")
    shifts = shift_pixels[:, 0] + 1j * shift_pixels[:, 1]
    terms = np.linalg.pinv(design) @ shifts
    freedom = 2 * (len(shifts) - 2)
    residual = shifts - design @ terms
    square = float(np.sum(np.abs(residual) ** 2)) / freedom if freedom else 0.0
    return Wander(
        centre_pixels=complex(terms[0]), turning_pixels=complex(terms[1]), sense=sense, residual_pixels=square**0.5
    )


def moved_back(picture: FloatArray, shift_pixels: FloatArray) -> tuple[FloatArray, float]:
    """Return a picture shifted back, and the factor by which that lowers the variance of its pixels.

    Bilinear: each new pixel is a mean of up to four, so white noise falls (to a quarter at half a pixel both ways) and
    neighbours share it. The picture is mirrored at the border; mask as many pixels as the shift.
    """
    part_x, part_y = shift_pixels - np.floor(shift_pixels)
    factor = ((1.0 - part_x) ** 2 + part_x**2) * ((1.0 - part_y) ** 2 + part_y**2)
    height, width = picture.shape
    rows, columns = np.arange(height) + shift_pixels[1], np.arange(width) + shift_pixels[0]
    return _bilinear(picture, rows, columns), float(factor)


def _bilinear(picture: FloatArray, rows: FloatArray, columns: FloatArray) -> FloatArray:
    # OpenCV rounds a shift to 1/32 pixel when it interpolates; this does not.
    moved = picture
    for axis, places in ((0, rows), (1, columns)):
        lower = np.floor(places).astype(np.int64)
        part = (places - lower).reshape((-1, 1) if axis == 0 else (1, -1))
        size = picture.shape[axis]
        below, above = (np.take(moved, _mirrored(lower + step, size), axis=axis) for step in (0, 1))
        moved = (1.0 - part) * below + part * above
    return moved


def _mirrored(index: NDArray[np.int64], size: int) -> NDArray[np.int64]:
    folded = np.abs(index) % (2 * size - 2)
    mirrored: NDArray[np.int64] = np.minimum(folded, 2 * size - 2 - folded)
    return mirrored


# The response of each pixel behind the polarizer at one angle, from even light


_LEAST_FRAMES = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class FlatField:
    """A picture of even light, over its mean."""

    response: FloatArray  #: (H, W): of each pixel, mean 1
    std_error: FloatArray  #: (H, W): its error, from the scatter of the frames
    mean_dn: float  #: the light, dark taken off, and its standard error [DN]
    mean_error_dn: float
    frames: int  #: how many frames

    @property
    def pattern_rms(self) -> float:
        """Relative standard deviation from pixel to pixel, without the noise of the flat."""
        return float(np.sqrt(max(0.0, float(np.var(self.response)) - self.noise_rms**2)))

    @property
    def noise_rms(self) -> float:
        """Noise of the flat itself, relative: dividing by it adds this as a pattern."""
        return float(np.sqrt(np.mean(np.square(self.std_error))))


def flat_field(frames: Iterable[NDArray[np.uint16]], dark_dn: FloatArray) -> FlatField:
    """Return the flat field of frames of even light.

    Parameters
    ----------
    frames : iterable of (H, W) arrays
        Two or more, taken one after the other with one setting; read one at a time.
    dark_dn : (H, W) array
        Counts of each pixel without light at their exposure [DN].

    Raises
    ------
    CalibrationError
        There are fewer than two frames, or no light.

    Notes
    -----
    Each pixel's error is from its own scatter over the frames, without the noise of the dark: take as many darks as
    flats, and the flats near saturation. The error of the mean is from the scatter of frame means.
    """
    total, squares, means = np.zeros_like(dark_dn), np.zeros_like(dark_dn), []
    for frame in frames:
        signal = frame - dark_dn
        total += signal
        squares += np.square(signal)
        means.append(float(signal.mean()))
    count = len(means)
    if count < _LEAST_FRAMES:
        raise CalibrationError(f"flat frames at each angle must be two or more, to know their noise; given: {count}")
    mean_dn = float(np.mean(means))
    if mean_dn <= 0.0:
        raise CalibrationError("flat frames are not brighter than dark frames: check the lamp and the exposures")
    variance = np.maximum(squares - np.square(total) / count, 0.0) / (count - 1)
    return FlatField(
        response=total / count / mean_dn,
        std_error=np.sqrt(variance / count) / mean_dn,
        mean_dn=mean_dn,
        mean_error_dn=float(np.std(means, ddof=1) / np.sqrt(count)),
        frames=count,
    )


# The affine map between two pictures of the same points, with its error


_LEAST_POINTS = 4
_COEFFICIENTS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class AffineMap:
    """Where points of one picture lie in another."""

    matrix: FloatArray  #: shape (2, 3): (x', y') = matrix @ (x, y, 1) [pixel]
    #: of the points about the map, per coordinate, corrected for the fitted coefficients [pixel]
    residual_rms_px: float
    unit_cov: FloatArray  #: covariance of each row of the matrix over the square of that rms, shape (3, 3)

    def apply(self, points: FloatArray) -> FloatArray:
        """Return the places of points (n, 2) in the other picture [pixel]."""
        return np.asarray(_with_ones(points) @ self.matrix.T)

    def std_error_px(self, points: FloatArray) -> FloatArray:
        """Return the standard error of each mapped coordinate of points (n, 2), shape (n,) [pixel].

        Far from the points of the fit it grows in proportion to the distance.
        """
        extended = _with_ones(points)
        return np.asarray(self.residual_rms_px * np.sqrt(np.einsum("ni,ij,nj->n", extended, self.unit_cov, extended)))


def fit_affine(before: FloatArray, after: FloatArray) -> AffineMap:
    """Return the least-squares affine map from points to points.

    Definition: ordinary least squares, one row of the map for each coordinate.
    """
    if len(before) < _LEAST_POINTS:
        raise CalibrationError(f"an affine map needs {_LEAST_POINTS} points, {len(before)} were given")
    extended = _with_ones(before)
    if np.linalg.matrix_rank(extended - extended.mean(axis=0)) < _COEFFICIENTS - 1:
        raise CalibrationError("an affine map needs points that are not all on a line")
    solution, *_ = np.linalg.lstsq(extended, after, rcond=None)
    freedom = 2 * (len(before) - _COEFFICIENTS)
    rms = float(np.sqrt(np.sum((after - extended @ solution) ** 2) / freedom))
    return AffineMap(
        matrix=np.asarray(solution.T),
        residual_rms_px=rms,
        unit_cov=np.asarray(np.linalg.inv(extended.T @ extended), dtype=np.float64),
    )


def _with_ones(points: FloatArray) -> FloatArray:
    return np.column_stack([np.asarray(points, dtype=np.float64), np.ones(len(points))])
