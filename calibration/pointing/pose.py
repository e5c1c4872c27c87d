"""Direction of a camera, fused from several sources with their errors.

Axes of the world are east, north, up; those of the camera right, down, forward. The camera looks toward `azimuth_rad`,
clockwise from north, `elevation_rad` above the horizon, rolled by `roll_rad` counter-clockwise as it sees the scene.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.special import gammaincc

from calibration.results import CalibrationError

# A lens by its focal length, principal point and distortion; calibrated from pictures of a chessboard

FloatArray = NDArray[np.float64]

NAMES = ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2")
_LEAST_PICTURES = 3
# Step of numerical derivatives, in standard errors.
_STEP = 0.1
_TO_EIGHT_BITS = 255.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Lens:
    """A lens."""

    #: (8,): as `NAMES` says: focal lengths, principal point, radial and tangential distortion [pixel, 1]
    parameters: FloatArray
    covariance: FloatArray  #: (8, 8): of their errors

    @property
    def matrix(self) -> FloatArray:
        """The camera matrix."""
        fx, fy, cx, cy = self.parameters[:4]
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @property
    def distortion(self) -> FloatArray:
        """Distortion, as in OpenCV."""
        return np.asarray(self.parameters[4:])

    def moved(self) -> Iterator[tuple[int, "Lens", float]]:
        """Yield for each uncertain number its index, the lens with this number changed, and the change."""
        for place in np.flatnonzero(np.diag(self.covariance) > 0.0).tolist():
            step = _STEP * float(np.sqrt(self.covariance[place, place]))
            yield place, replace(self, parameters=self.parameters + step * np.eye(len(NAMES))[place]), step


def plain_lens(focal_px: float, focal_std_px: float, width: int, height: int) -> Lens:
    """Return a lens of a stated focal length, with its axis within 1 % of the middle of the picture."""
    centre_std = 0.01 * max(width, height)
    stds = np.array([focal_std_px, focal_std_px, centre_std, centre_std, 0.0, 0.0, 0.0, 0.0])
    covariance = np.diag(stds**2)
    covariance[0, 1] = covariance[1, 0] = focal_std_px**2  # one number
    middle = (0.5 * (width - 1), 0.5 * (height - 1))
    return Lens(parameters=np.array([focal_px, focal_px, *middle, 0.0, 0.0, 0.0, 0.0]), covariance=covariance)


def rays(pixels: FloatArray, lens: Lens) -> FloatArray:
    """Return the unit vectors, right, down, forward, along which pixels look; shape (n, 3)."""
    flat = cv2.undistortPoints(pixels.reshape(-1, 1, 2).astype(np.float64), lens.matrix, lens.distortion)[:, 0]
    vectors = np.column_stack((flat, np.ones(len(flat))))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


@dataclass(frozen=True, kw_only=True, eq=False)
class LensCalibration:
    """A lens from a chessboard."""

    lens: Lens  #: with the covariance from OpenCV
    rms_px: float  #: residual of the corners [pixel]
    width: int  #: of the pictures
    height: int
    used: tuple[int, ...]  #: indices of pictures with the whole board, and of the others
    unused: tuple[int, ...]


def calibrate_lens(
    pictures: Sequence[NDArray[np.generic]], *, columns: int, rows: int, square_m: float
) -> LensCalibration:
    """Return the lens that took pictures of a chessboard.

    Parameters
    ----------
    pictures : sequence of (H, W) arrays
        Of one size, of any counts.
    columns, rows : int
        Inner corners of the board along its sides, 3 or more.
    square_m : float
        Side of a square [m]; the lens does not depend on it.

    Raises
    ------
    CalibrationError
        Fewer than three pictures show the board, or they differ in size.

    References
    ----------
    Zhang, "A flexible new technique for camera calibration", PAMI 2000; as in OpenCV.
    """
    sizes = {picture.shape for picture in pictures}
    if len(sizes) != 1:
        raise CalibrationError(f"all pictures must have one size; found {sorted(sizes) or 'none'}")
    found = [_corners(picture, columns, rows) for picture in pictures]
    seen = {place: corners for place, corners in enumerate(found) if corners is not None}
    used = tuple(seen)
    if len(used) < _LEAST_PICTURES:
        raise CalibrationError(
            f"{len(used)} of {len(pictures)} pictures show a board of {columns} x {rows} inner corners; "
            f"{_LEAST_PICTURES} or more are needed, the board tilted differently in each"
        )
    board = np.zeros((columns * rows, 3), np.float32)
    board[:, :2] = square_m * np.mgrid[0:columns, 0:rows].T.reshape(-1, 2)
    height, width = sizes.pop()
    start, flat = np.eye(3), np.zeros(5)
    rms, matrix, distortion, *_, stds, _, _ = cv2.calibrateCameraExtended(
        [board] * len(used), list(seen.values()), (width, height), start, flat, flags=cv2.CALIB_FIX_K3
    )
    intrinsic = np.asarray(matrix)[[0, 1, 0, 1], [0, 1, 2, 2]]
    parameters = np.concatenate((intrinsic, np.ravel(np.asarray(distortion))[:4])).astype(np.float64)
    return LensCalibration(
        lens=Lens(parameters=parameters, covariance=np.diag(np.ravel(np.asarray(stds))[:8].astype(np.float64) ** 2)),
        rms_px=float(rms),
        width=int(width),
        height=int(height),
        used=used,
        unused=tuple(place for place in range(len(pictures)) if place not in used),
    )


def _corners(picture: NDArray[np.generic], columns: int, rows: int) -> NDArray[np.float32] | None:
    counts = picture.astype(np.float64)
    low, high = np.percentile(counts, (1.0, 99.0))
    shown = np.clip(_TO_EIGHT_BITS * (counts - low) / max(high - low, 1e-9), 0.0, _TO_EIGHT_BITS).astype(np.uint8)
    is_there, corners = cv2.findChessboardCornersSB(shown, (columns, rows), flags=cv2.CALIB_CB_ACCURACY)
    return np.asarray(corners, dtype=np.float32) if is_there else None


# Direction in which a camera looks, from several sources at once


# Prior standard deviations of azimuth, elevation and roll, for those without a source.
_PRIOR_STD_RAD = np.radians([3600.0, 60.0, 60.0])
# Focal lengths, axis and distortion of a lens.
_LENS_NUMBERS = 8
# A direction with a larger error is not determined.
UNKNOWN_STD_RAD = float(np.radians(20.0))
_STEP_RAD, _ITERATIONS, _STARTS = 1e-6, 60, 8
_SMALL_RAD, _MOST_DAMPING, _DESCENTS = 1e-7, 1e6, 3
# Probability below which a source contradicts the others (a choice).
_RARE = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class PoseSource:
    """A source of the camera's direction."""

    name: str  #: for messages
    #: from azimuth, elevation and roll [rad] to measured less expected, shape (k,)
    residual: Callable[[FloatArray], FloatArray]
    #: from the same to the covariance of that, (k, k), errors of the lens apart
    covariance: Callable[[FloatArray], FloatArray]
    #: from the same to the change of the residual by each number of the lens, (k, 8); None where no lens is needed
    by_lens: Callable[[FloatArray], FloatArray] | None = None


@dataclass(frozen=True, kw_only=True)
class Contradiction:
    """A source that the errors exclude, or all sources if none can be singled out."""

    name: str
    chi_square: float
    p_value: float


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraPose:
    """Direction of a camera."""

    angles_rad: FloatArray  #: (3,): azimuth, elevation, roll [rad]
    covariance: FloatArray  #: (3, 3): of their errors, widened where the sources contradict one another [rad^2]
    #: (3, 8): their change by each number of the lens, whose errors panels in the same picture share
    by_lens: FloatArray
    lens_covariance: FloatArray  #: (8, 8): of those numbers
    chi_square: float  #: of the sources about it
    freedom: int
    contradictions: tuple[Contradiction, ...]  #: sources that the others exclude

    @property
    def own_covariance(self) -> FloatArray:
        """Covariance of their errors, those by the lens apart [rad^2]."""
        return np.asarray(self.covariance - self.by_lens @ self.lens_covariance @ self.by_lens.T)

    @property
    def std_rad(self) -> FloatArray:
        """Standard uncertainties of azimuth, elevation and roll [rad]."""
        return np.sqrt(np.diag(self.covariance))


def camera_axes(angles_rad: FloatArray) -> FloatArray:
    """Return right, down and forward of a camera as rows, in east, north, up: turns world into camera."""
    (sin_a, sin_e, sin_r), (cos_a, cos_e, cos_r) = np.sin(angles_rad).tolist(), np.cos(angles_rad).tolist()
    level, down = np.array([cos_a, -sin_a, 0.0]), np.array([sin_e * sin_a, sin_e * cos_a, -cos_e])
    forward = (sin_a * cos_e, cos_a * cos_e, sin_e)
    return np.array([cos_r * level - sin_r * down, sin_r * level + cos_r * down, forward])


def direction(azimuth_rad: float, elevation_rad: float) -> FloatArray:
    """Return the unit vector of a direction in east, north, up."""
    level = np.cos(elevation_rad)
    return np.array([np.sin(azimuth_rad) * level, np.cos(azimuth_rad) * level, np.sin(elevation_rad)])


def wrapped_rad(angle_rad: FloatArray) -> FloatArray:
    """Return angles on the turn about 0."""
    return np.asarray((angle_rad + np.pi) % (2.0 * np.pi) - np.pi)


def refraction_rad(elevation_rad: float) -> float:
    """Return the refraction of the sun at a geometric elevation, standard pressure [rad].

    Saemundsson, Sky and Telescope 72 (1986) 70.
    """
    degrees = max(np.degrees(elevation_rad), -0.5)
    return float(np.radians(1.02 / 60.0 / np.tan(np.radians(degrees + 10.3 / (degrees + 5.11)))))


def fuse(sources: Sequence[PoseSource], lens_covariance: FloatArray | None = None) -> CameraPose:
    """Return the direction that fits all sources best, by weighted least squares.

    Each source is also compared with the others alone: a distance that is as rare as once in a thousand times is a
    contradiction. If no source can be singled out, all may contradict one another together. The covariance is then
    widened by chi-square over its degrees of freedom.
    """
    lens = np.zeros((_LENS_NUMBERS, _LENS_NUMBERS)) if lens_covariance is None else lens_covariance
    fit = _fit(_Together(sources, lens))
    freedom = max(sum(len(one.residual(fit.angles)) for one in sources) - _determined(fit.covariance), 0)
    found = (_contradiction(one, sources, lens, fit.angles) for one in sources)
    contradictions = tuple(one for one in found if one is not None) or _all_of_them(sources, fit.chi_square, freedom)
    wider = max(1.0, fit.chi_square / freedom) if contradictions and freedom else 1.0
    return CameraPose(
        angles_rad=fit.angles,
        covariance=wider * fit.covariance,
        by_lens=fit.by_lens,
        lens_covariance=lens,
        chi_square=fit.chi_square,
        freedom=freedom,
        contradictions=contradictions,
    )


class _Together:
    """All sources together: residuals stacked, with one covariance because they share the lens."""

    def __init__(self, sources: Sequence[PoseSource], lens_covariance: FloatArray) -> None:
        self._sources, self.lens_covariance = sources, lens_covariance

    def residual(self, angles: FloatArray) -> FloatArray:
        return np.concatenate([one.residual(angles) for one in self._sources])

    def own_covariance(self, angles: FloatArray) -> FloatArray:
        return np.asarray(block_diag(*(one.covariance(angles) for one in self._sources)))

    def by_lens(self, angles: FloatArray) -> FloatArray:
        none = np.zeros(_LENS_NUMBERS)
        parts = (
            np.tile(none, (len(one.residual(angles)), 1)) if one.by_lens is None else one.by_lens(angles)
            for one in self._sources
        )
        return np.concatenate(list(parts))

    def covariance(self, angles: FloatArray) -> FloatArray:
        by_lens = self.by_lens(angles)
        return np.asarray(self.own_covariance(angles) + by_lens @ self.lens_covariance @ by_lens.T)

    def slope(self, angles: FloatArray) -> FloatArray:
        steps = _STEP_RAD * np.eye(3)
        sides = [(self.residual(angles + step), self.residual(angles - step)) for step in steps]
        return np.column_stack([(above - below) / (2.0 * _STEP_RAD) for above, below in sides])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Fit:
    """Angles that fit, the covariance of their errors, their change by the lens, and chi-square."""

    angles: FloatArray
    covariance: FloatArray
    by_lens: FloatArray
    chi_square: float


def _determined(covariance: FloatArray) -> int:
    return int(np.sum(np.sqrt(np.diag(covariance)) < UNKNOWN_STD_RAD))


def _contradiction(
    source: PoseSource, sources: Sequence[PoseSource], lens: FloatArray, near: FloatArray
) -> Contradiction | None:
    others = [one for one in sources if one is not source]
    if not others:
        return None
    fit, alone = _fit(_Together(others, lens), near), _Together([source], lens)
    angles = fit.angles
    residual, slope = alone.residual(angles), alone.slope(angles)
    by_others = slope @ fit.covariance @ slope.T
    if float(np.sqrt(np.diag(by_others).max())) > UNKNOWN_STD_RAD:  # they do not determine it
        return None
    by_lens = alone.by_lens(angles) + slope @ fit.by_lens  # a common shift is no contradiction
    own = fit.covariance - fit.by_lens @ lens @ fit.by_lens.T
    spread = alone.own_covariance(angles) + slope @ own @ slope.T + by_lens @ lens @ by_lens.T
    chi_square = float(residual @ np.linalg.solve(spread, residual))
    p_value = float(gammaincc(0.5 * len(residual), 0.5 * chi_square))
    return Contradiction(name=source.name, chi_square=chi_square, p_value=p_value) if p_value < _RARE else None


def _all_of_them(sources: Sequence[PoseSource], chi_square: float, freedom: int) -> tuple[Contradiction, ...]:
    p_value = float(gammaincc(0.5 * freedom, 0.5 * chi_square)) if freedom else 1.0
    if p_value >= _RARE:
        return ()
    return (Contradiction(name=" and ".join(one.name for one in sources), chi_square=chi_square, p_value=p_value),)


def _fit(together: _Together, near: FloatArray | None = None) -> _Fit:
    grid = [np.array([2.0 * np.pi * k / _STARTS, e, 0.0]) for k in range(_STARTS) for e in (-0.6, 0.3)]
    grid.sort(key=lambda angles: _unlikely(together, angles))
    starts = grid[:_DESCENTS] if near is None else [near, *grid[:1]]
    return min((_descend(together, start) for start in starts), key=lambda found: _unlikely(together, found.angles))


def _unlikely(together: _Together, angles: FloatArray) -> float:
    """Return minus twice the logarithm of the likelihood; its determinant keeps vague sources from losing weight."""
    covariance = together.covariance(angles)
    return _cost(together, angles, _inverse(covariance)) + float(np.linalg.slogdet(covariance)[1])


def _descend(together: _Together, start: FloatArray) -> _Fit:
    """Return the end of damped Gauss-Newton steps from a start, with new weights at each step."""
    angles, damping = start.copy(), 1e-3
    for _ in range(_ITERATIONS):
        weight = _inverse(together.covariance(angles))
        normal, gradient = _normal(together, angles, weight)
        step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient)
        tried = angles - step
        tried[1] = np.clip(tried[1], -0.499 * np.pi, 0.499 * np.pi)
        if _cost(together, tried, weight) <= _cost(together, angles, weight):
            angles, damping = tried, max(0.1 * damping, 1e-12)
            if float(np.abs(step).max()) < _SMALL_RAD:
                break
        elif float(np.abs(step).max()) < _SMALL_RAD or damping > _MOST_DAMPING:
            break
        else:
            damping *= 10.0
    return _at_end(together, np.array([angles[0] % (2.0 * np.pi), angles[1], wrapped_rad(angles[2:])[0]]))


def _at_end(together: _Together, angles: FloatArray) -> _Fit:
    weight, residual = _inverse(together.covariance(angles)), together.residual(angles)
    covariance = _inverse(_normal(together, angles, weight)[0])
    return _Fit(
        angles=angles,
        covariance=covariance,
        by_lens=-covariance @ together.slope(angles).T @ weight @ together.by_lens(angles),
        chi_square=float(residual @ weight @ residual),
    )


def _inverse(matrix: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)


def _prior(angles: FloatArray) -> FloatArray:
    return np.array([0.0, angles[1], wrapped_rad(angles[2:])[0]]) / _PRIOR_STD_RAD


def _cost(together: _Together, angles: FloatArray, weight: FloatArray) -> float:
    residual, prior = together.residual(angles), _prior(angles)
    return float(prior @ prior + residual @ weight @ residual)


def _normal(together: _Together, angles: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    slope = together.slope(angles)
    normal = np.diag(1.0 / _PRIOR_STD_RAD**2) + slope.T @ weight @ slope
    return normal, _prior(angles) / _PRIOR_STD_RAD + slope.T @ weight @ together.residual(angles)


# Orientation of a flat panel of known size, from the four corners of its outline


# Two orientations of a small or distant panel have nearly the same outline: a smaller difference of chi-square does not
# decide between them.
_DECIDES = 16.0
_WORST_CHI_SQUARE = 30.0
_STEP_PANEL_POSE = 1e-6
# Least distance of a corner from the others, and from the lines between them, in its errors.
_CLEAR = 3.0


@dataclass(frozen=True, kw_only=True, eq=False)
class PanelStand:
    """A panel in the camera's axes: right, down, forward."""

    normal: FloatArray  #: (3,): unit vector out of its face, toward the camera's side
    covariance: FloatArray  #: (3, 3): of its error by those of the corners
    by_lens: FloatArray  #: (3, 8): its change by each number of the lens
    centre_m: FloatArray  #: (3,): its middle [m]
    chi_square: float  #: of the corners about the outline, two degrees of freedom


@dataclass(frozen=True, kw_only=True, eq=False)
class PanelTilt:
    """A panel in the world: tilt and azimuth of the tilt, with standard uncertainties [rad]."""

    tilt_rad: float
    tilt_std_rad: float
    azimuth_rad: float
    azimuth_std_rad: float
    by_corners: FloatArray  #: (2, 2): covariance of tilt and azimuth by the errors of the corners alone
    #: (2, 3): change of both by the camera's angles alone, and by each number of the lens, through those angles too
    by_angles: FloatArray
    by_lens: FloatArray


def panel_stands(
    corners: FloatArray, width_m: float, height_m: float, corner_std: float, lens: Lens
) -> tuple[PanelStand, ...]:
    """Return the possible orientations of a panel, the likeliest first; two if the outline fits both."""
    _require_convex(corners, corner_std)
    half = 0.5 * np.array([width_m, height_m])
    board = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=np.float64) * [*half, 1.0]
    if _turns_left(corners):
        board[:, 1] *= -1.0
    count, turns, shifts, _ = cv2.solvePnPGeneric(
        board, corners.reshape(-1, 1, 2), lens.matrix, lens.distortion, flags=cv2.SOLVEPNP_IPPE
    )
    found = [
        stand
        for turn, shift in zip(turns[:count], shifts[:count], strict=True)
        if (stand := _stand(board, corners, _floats(turn), _floats(shift), corner_std, lens)) is not None
    ]
    found.sort(key=lambda stand: stand.chi_square)
    if not found or found[0].chi_square > _WORST_CHI_SQUARE:
        worst = f": its corners lie {np.sqrt(found[0].chi_square) * corner_std:.1f} pixels off" if found else ""
        raise CalibrationError(f"no panel of {width_m:g} x {height_m:g} m has this outline{worst}")
    return tuple(stand for stand in found if stand.chi_square - found[0].chi_square < _DECIDES)


def _require_convex(corners: FloatArray, corner_std: float) -> None:
    """Refuse corners that do not form a convex outline."""
    sides = np.roll(corners, -1, axis=0) - corners
    after = np.roll(sides, -1, axis=0)
    lengths = np.hypot(*sides.T)
    if float(lengths.min()) <= _CLEAR * corner_std:
        raise CalibrationError(f"two corners of the outline lie {lengths.min():.2g} pixels apart; a side is longer")
    turns = sides[:, 0] * after[:, 1] - sides[:, 1] * after[:, 0]
    # How far a corner lies off the line through its neighbours.
    off = turns / np.hypot(*(sides + after).T)
    if not (np.all(off > _CLEAR * corner_std) or np.all(off < -_CLEAR * corner_std)):
        raise CalibrationError("the outline is not convex: give the four corners in order around the panel")


def _turns_left(corners: FloatArray) -> bool:
    """Return whether the corners go round counter-clockwise as the picture shows them (y is down)."""
    after = np.roll(corners, -1, axis=0)
    return float(np.sum(corners[:, 0] * after[:, 1] - after[:, 0] * corners[:, 1])) < 0.0


def _stand(
    board: FloatArray, corners: FloatArray, turn: FloatArray, shift: FloatArray, corner_std: float, lens: Lens
) -> PanelStand | None:
    refined = cv2.solvePnPRefineLM(board, corners.reshape(-1, 1, 2), lens.matrix, lens.distortion, turn, shift)
    turn, shift = map(_floats, refined)
    if shift[2, 0] <= 0.0:
        return None
    seen, slope = map(_floats, cv2.projectPoints(board, turn, shift, lens.matrix, lens.distortion))
    chi_square = float(np.sum((seen[:, 0] - corners) ** 2)) / corner_std**2
    of_pose = slope[:, :6]
    gain = np.linalg.pinv(of_pose)
    normal, out = _normal_panel_pose(turn, shift)
    by_turn = np.column_stack(
        [(out * _axis(turn.ravel() + _STEP_PANEL_POSE * one) - normal) / _STEP_PANEL_POSE for one in np.eye(3)]
    )
    by_corners = by_turn @ gain[:3]
    return PanelStand(
        normal=normal,
        covariance=corner_std**2 * by_corners @ by_corners.T,
        # Columns 6 to 9 are fx, fy, cx, cy, then k1, k2, p1, p2; the pose undoes what they do to the outline.
        by_lens=-by_corners @ slope[:, 6:14],
        centre_m=shift.ravel(),
        chi_square=chi_square,
    )


def _floats(values: object) -> FloatArray:
    return np.asarray(values, dtype=np.float64)


def _normal_panel_pose(turn: FloatArray, shift: FloatArray) -> tuple[FloatArray, float]:
    axis = _axis(turn.ravel())
    out = -1.0 if float(axis @ shift.ravel()) > 0.0 else 1.0
    return out * axis, out


def _axis(turn: FloatArray) -> FloatArray:
    return _floats(cv2.Rodrigues(turn)[0])[:, 2]


def panel_tilt(stand: PanelStand, pose: CameraPose) -> PanelTilt:
    """Return the tilt of a panel in the world, by the direction of the camera and the covariance of its errors.

    Definition; first-order propagation, JCGM 100:2008 (GUM), section 5.2.
    """

    def tilted(normal: FloatArray, angles: FloatArray) -> FloatArray:
        east, north, up = camera_axes(angles).T @ normal
        return np.array([np.arctan2(np.hypot(east, north), up), np.arctan2(east, north)])

    angles = pose.angles_rad
    base = tilted(stand.normal, angles)
    columns = [tilted(stand.normal + _STEP_PANEL_POSE * one, angles) for one in np.eye(3)]
    columns += [tilted(stand.normal, angles + _STEP_PANEL_POSE * one) for one in np.eye(3)]
    slope = np.column_stack([wrapped_rad(column - base) for column in columns]) / _STEP_PANEL_POSE
    by_corners = slope[:, :3] @ stand.covariance @ slope[:, :3].T
    by_lens = slope[:, :3] @ stand.by_lens + slope[:, 3:] @ pose.by_lens
    total = (
        by_corners + slope[:, 3:] @ pose.own_covariance @ slope[:, 3:].T + by_lens @ pose.lens_covariance @ by_lens.T
    )
    std = np.sqrt(np.diag(total))
    return PanelTilt(
        tilt_rad=float(base[0]),
        tilt_std_rad=float(std[0]),
        azimuth_rad=float(base[1] % (2.0 * np.pi)),
        # A level panel has no azimuth.
        azimuth_std_rad=float(min(std[1], np.pi / np.sqrt(3.0))),
        by_corners=by_corners,
        by_angles=slope[:, 3:],
        by_lens=by_lens,
    )


def joint_covariance(pose: CameraPose, tilts: Sequence[PanelTilt]) -> FloatArray:
    """Return the covariance of the camera's angles and of tilt and azimuth of each panel, in this order [rad^2].

    Tilts depend on the camera's direction, and both on one lens, so their errors are correlated.
    """
    by_angles = np.concatenate([np.eye(3), *(one.by_angles for one in tilts)])
    by_lens = np.concatenate([pose.by_lens, *(one.by_lens for one in tilts)])
    own = block_diag(np.zeros((3, 3)), *(one.by_corners for one in tilts))
    return np.asarray(own + by_angles @ pose.own_covariance @ by_angles.T + by_lens @ pose.lens_covariance @ by_lens.T)


# Sources of a camera's direction: compass, level, positions, sun in a picture

_STEP_SOURCES = 1e-3
# Keeps the covariance of an uninformative source invertible.
_LEAST_RAD = 1e-6
# The ellipsoid of WGS 84.
_EQUATOR_M, _ECCENTRICITY_2 = 6_378_137.0, 6.694_379_990_14e-3


@dataclass(frozen=True, kw_only=True)
class SunSeen:
    """The apparent direction of the sun, with refraction, and its standard uncertainty by clock and site [rad]."""

    azimuth_rad: float
    elevation_rad: float
    std_rad: float = 0.0

    @property
    def vector(self) -> FloatArray:
        """In east, north, up."""
        return direction(self.azimuth_rad, self.elevation_rad)


def compass(reading_rad: float, std_rad: float, *, declination_rad: float, declination_std_rad: float) -> PoseSource:
    """Return a compass as a source of the azimuth of the camera; declination is positive to the east."""
    variance = std_rad**2 + declination_std_rad**2
    return PoseSource(
        name="compass",
        residual=lambda angles: wrapped_rad(np.array([reading_rad + declination_rad - angles[0]])),
        covariance=lambda _: np.array([[variance]]),
    )


def level(elevation_rad: float, roll_rad: float, std_rad: float) -> PoseSource:
    """Return a level on the camera as a source of elevation and roll, each with the same standard uncertainty."""
    return PoseSource(
        name="level",
        residual=lambda angles: wrapped_rad(np.array([elevation_rad - angles[1], roll_rad - angles[2]])),
        covariance=lambda _: std_rad**2 * np.eye(2),
    )


def way_between(camera: Sequence[float], target: Sequence[float]) -> FloatArray:
    """Return the way from one place to another nearby: east, north, up [m].

    Radii of curvature of the ellipsoid of WGS 84 (NIMA TR8350.2), at the middle of both; neglected
    terms are of second order in distance over the Earth's radius.
    """
    middle = np.radians(0.5 * (camera[0] + target[0]))
    flattened = 1.0 - _ECCENTRICITY_2 * np.sin(middle) ** 2
    height = 0.5 * (camera[2] + target[2])
    by_meridian = _EQUATOR_M * (1.0 - _ECCENTRICITY_2) / flattened**1.5 + height
    by_parallel = (_EQUATOR_M / np.sqrt(flattened) + height) * np.cos(middle)
    turned = float(wrapped_rad(np.radians([target[1] - camera[1]]))[0])
    north = by_meridian * np.radians(target[0] - camera[0])
    return np.array([by_parallel * turned, north, target[2] - camera[2]])


def positions(camera_to_target_m: FloatArray, std_m: FloatArray) -> PoseSource:
    """Return the places of camera and target as a source of azimuth and elevation; the target is on the axis."""
    east, north, up = camera_to_target_m
    flat = float(np.hypot(east, north))
    far = flat**2 + up**2
    slope = np.array(
        [
            [north / flat**2, -east / flat**2, 0.0],
            [-east * up / (flat * far), -north * up / (flat * far), flat / far],
        ]
    )
    covariance = slope @ np.diag(std_m**2) @ slope.T
    stated = np.array([np.arctan2(east, north), np.arctan2(up, flat)])
    return PoseSource(
        name="positions",
        residual=lambda angles: wrapped_rad(stated - angles[:2]),
        covariance=lambda _: covariance,
    )


def sun_in_picture(pixel: FloatArray, pixel_std: float, sun: SunSeen, lens: Lens) -> PoseSource:
    """Return the place of the sun in a picture as a source: two angles between its ray and its direction."""
    point = _Rays(pixel[None, :], pixel_std, lens)

    def residual(angles: FloatArray) -> FloatArray:
        return _across(point.rays[0], camera_axes(angles) @ sun.vector)

    def covariance(angles: FloatArray) -> FloatArray:
        expected = camera_axes(angles) @ sun.vector
        return point.covariance(lambda moved: _across(moved[0], expected)) + (sun.std_rad**2 + _LEAST_RAD**2) * np.eye(
            2
        )

    def by_lens(angles: FloatArray) -> FloatArray:
        expected = camera_axes(angles) @ sun.vector
        return point.by_lens(lambda moved: _across(moved[0], expected))

    return PoseSource(name="sun in the picture", residual=residual, covariance=covariance, by_lens=by_lens)


class _Rays:
    """Rays through points of a picture, and the same with each pixel and each number of the lens changed slightly."""

    def __init__(self, pixels: FloatArray, pixel_std: float, lens: Lens) -> None:
        self.rays = rays(pixels, lens)
        self._std = pixel_std
        steps = _STEP_SOURCES * np.eye(pixels.size).reshape(-1, *pixels.shape)
        self._by_pixel = [(rays(pixels + step, lens) - self.rays) / _STEP_SOURCES for step in steps]
        self._by_lens = [np.zeros_like(self.rays) for _ in NAMES]
        for place, other, step in lens.moved():
            self._by_lens[place] = (rays(pixels, other) - self.rays) / step

    def covariance(self, of: Callable[[FloatArray], FloatArray]) -> FloatArray:
        """Return the covariance of a function of the rays due to the errors of the pixels."""
        slope = self._slope(of, self._by_pixel)
        return np.asarray(self._std**2 * slope @ slope.T)

    def by_lens(self, of: Callable[[FloatArray], FloatArray]) -> FloatArray:
        """Return the derivative of a function of the rays by each number of the lens."""
        return self._slope(of, self._by_lens)

    def _slope(self, of: Callable[[FloatArray], FloatArray], moves: Sequence[FloatArray]) -> FloatArray:
        base = of(self.rays)
        return np.column_stack(
            [wrapped_rad(of(self.rays + _STEP_SOURCES * move) - base) / _STEP_SOURCES for move in moves]
        )


def _across(ray: FloatArray, expected: FloatArray) -> FloatArray:
    """Return the two angles between a ray and the expected one, across it [rad]."""
    across = _basis(expected) @ ray
    size = float(np.linalg.norm(across))
    # The angle rather than its sine, which falls again beyond a right angle.
    angle = float(np.arctan2(size, float(expected @ ray)))
    return across * (angle / size) if size > 0.0 else np.array([angle, 0.0])


def _basis(vector: FloatArray) -> FloatArray:
    """Return two unit vectors at right angles to one, as rows."""
    x, y, z = vector.tolist()
    # Perpendicular to the two largest components, so the length is never near 0.
    first = np.array([0.0, z, -y]) if abs(x) <= min(abs(y), abs(z)) else np.array([-z, 0.0, x])
    first = np.array([y, -x, 0.0]) if abs(z) < min(abs(x), abs(y)) else first
    first /= float(np.linalg.norm(first))
    a, b, c = first.tolist()
    return np.array([first, [y * c - z * b, z * a - x * c, x * b - y * a]])
