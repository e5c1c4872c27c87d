"""How a flat panel of known size stands before the camera, by the four corners of its outline."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from calibration.errors import CalibrationError
from calibration.pointing.camera_pose import CameraPose, camera_axes, wrapped_rad
from calibration.pointing.lens import Lens

FloatArray = NDArray[np.float64]

# Two stands of a small or distant panel show nearly the same outline: chi-squares nearer than this do not decide.
_DECIDES = 16.0
_WORST_CHI_SQUARE = 30.0
_STEP = 1e-6
# Corners are those of a panel where they stand apart, and off the lines between others, by so many of their errors.
_CLEAR = 3.0


@dataclass(frozen=True, kw_only=True, eq=False)
class PanelStand:
    """A panel in the camera's axes: right, down, forward.

    Attributes
    ----------
    normal : (3,) array
        Unit vector out of its face, toward the camera's side.
    covariance : (3, 3) array
        Of its error by those of the corners.
    by_lens : (3, 8) array
        Its change by each number of the lens.
    centre_m : (3,) array
        Its middle [m].
    chi_square : float
        Of the corners about the outline, two degrees of freedom.
    """

    normal: FloatArray
    covariance: FloatArray
    by_lens: FloatArray
    centre_m: FloatArray
    chi_square: float


@dataclass(frozen=True, kw_only=True, eq=False)
class PanelTilt:
    """A panel in the world: how far it is tilted, whereto, and how well that is known [rad].

    Attributes
    ----------
    tilt_rad, azimuth_rad : float
        Both of them.
    tilt_std_rad, azimuth_std_rad : float
        Their standard uncertainties.
    by_corners : (2, 2) array
        Covariance of both by the errors of the corners alone.
    by_angles, by_lens : (2, 3) array, (2, 8) array
        Change of both by the camera's angles alone, and by each number of the lens, through those angles too.
    """

    tilt_rad: float
    tilt_std_rad: float
    azimuth_rad: float
    azimuth_std_rad: float
    by_corners: FloatArray
    by_angles: FloatArray
    by_lens: FloatArray


def panel_stands(
    corners: FloatArray, width_m: float, height_m: float, corner_std: float, lens: Lens
) -> tuple[PanelStand, ...]:
    """Return how a panel can stand, the likeliest first; two where the outline does not tell them apart.

    Parameters
    ----------
    corners : (4, 2) array
        Of the outline in order, the first side `width_m` long [pixel].
    width_m, height_m : float
        Its sides [m].
    corner_std : float
        Standard uncertainty of each coordinate of a corner [pixel].
    lens : Lens
        Of the camera.

    Raises
    ------
    CalibrationError
        No panel of this size has such an outline.
    """
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
    """Refuse corners that go round no panel: seen from before it, its outline is convex."""
    sides = np.roll(corners, -1, axis=0) - corners
    after = np.roll(sides, -1, axis=0)
    lengths = np.hypot(*sides.T)
    if float(lengths.min()) <= _CLEAR * corner_std:
        raise CalibrationError(f"two corners of the outline lie {lengths.min():.2g} pixels apart, which is no side")
    turns = sides[:, 0] * after[:, 1] - sides[:, 1] * after[:, 0]
    # How far a corner lies off the line through its neighbours.
    off = turns / np.hypot(*(sides + after).T)
    if not (np.all(off > _CLEAR * corner_std) or np.all(off < -_CLEAR * corner_std)):
        raise CalibrationError(
            "the outline is not convex: give the corners in order round the panel, none of them between two others"
        )


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
    normal, out = _normal(turn, shift)
    by_turn = np.column_stack([(out * _axis(turn.ravel() + _STEP * one) - normal) / _STEP for one in np.eye(3)])
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


def _normal(turn: FloatArray, shift: FloatArray) -> tuple[FloatArray, float]:
    axis = _axis(turn.ravel())
    out = -1.0 if float(axis @ shift.ravel()) > 0.0 else 1.0
    return out * axis, out


def _axis(turn: FloatArray) -> FloatArray:
    return _floats(cv2.Rodrigues(turn)[0])[:, 2]


def panel_tilt(stand: PanelStand, pose: CameraPose) -> PanelTilt:
    """Return how a panel stands in the world, by the direction of the camera and the covariance of its errors.

    Parameters
    ----------
    stand
        Normal of the panel in the camera's frame, with its errors.
    pose
        Where the camera looks.

    References
    ----------
    Definition; first-order propagation, JCGM 100:2008 (GUM), section 5.2.
    """

    def tilted(normal: FloatArray, angles: FloatArray) -> FloatArray:
        east, north, up = camera_axes(angles).T @ normal
        return np.array([np.arctan2(np.hypot(east, north), up), np.arctan2(east, north)])

    angles = pose.angles_rad
    base = tilted(stand.normal, angles)
    columns = [tilted(stand.normal + _STEP * one, angles) for one in np.eye(3)]
    columns += [tilted(stand.normal, angles + _STEP * one) for one in np.eye(3)]
    slope = np.column_stack([wrapped_rad(column - base) for column in columns]) / _STEP
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
        # On a level panel every direction is as good as another.
        azimuth_std_rad=float(min(std[1], np.pi / np.sqrt(3.0))),
        by_corners=by_corners,
        by_angles=slope[:, 3:],
        by_lens=by_lens,
    )


def joint_covariance(pose: CameraPose, tilts: Sequence[PanelTilt]) -> FloatArray:
    """Return the covariance of the camera's angles and of tilt and azimuth of each panel, in this order [rad^2].

    A panel's tilt is found by the camera's direction, and both by one lens: their errors go together.

    Parameters
    ----------
    pose
        Where the camera looks.
    tilts
        Of each panel.
    """
    by_angles = np.concatenate([np.eye(3), *(one.by_angles for one in tilts)])
    by_lens = np.concatenate([pose.by_lens, *(one.by_lens for one in tilts)])
    own = block_diag(np.zeros((3, 3)), *(one.by_corners for one in tilts))
    return np.asarray(own + by_angles @ pose.own_covariance @ by_angles.T + by_lens @ pose.lens_covariance @ by_lens.T)
