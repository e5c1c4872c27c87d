"""How a flat panel of known size stands before the camera, by the four corners of its outline."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.pointing.camera_pose import camera_axes
from calibration.pointing.lens import Lens

FloatArray = NDArray[np.float64]

# Two stands of a small or distant panel show nearly the same outline: chi-squares nearer than this do not decide.
_DECIDES = 16.0
_WORST_CHI_SQUARE = 30.0
_STEP = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class PanelStand:
    """A panel in the camera's axes: right, down, forward.

    Attributes
    ----------
    normal : (3,) array
        Unit vector out of its face, toward the camera's side.
    covariance : (3, 3) array
        Of its error.
    centre_m : (3,) array
        Its middle [m].
    chi_square : float
        Of the corners about the outline, two degrees of freedom.
    """

    normal: FloatArray
    covariance: FloatArray
    centre_m: FloatArray
    chi_square: float


@dataclass(frozen=True, kw_only=True)
class PanelTilt:
    """A panel in the world: how far it is tilted, whereto, and how well that is known [rad]."""

    tilt_rad: float
    tilt_std_rad: float
    azimuth_rad: float
    azimuth_std_rad: float


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
    # Columns 6 to 9 are fx, fy, cx, cy, then k1, k2, p1, p2.
    of_lens = slope[:, 6:14] @ lens.covariance @ slope[:, 6:14].T
    pose_cov = gain @ (corner_std**2 * np.eye(len(of_pose)) + of_lens) @ gain.T
    normal, out = _normal(turn, shift)
    spread = np.column_stack([(out * _axis(turn.ravel() + _STEP * one) - normal) / _STEP for one in np.eye(3)])
    return PanelStand(
        normal=normal, covariance=spread @ pose_cov[:3, :3] @ spread.T, centre_m=shift.ravel(), chi_square=chi_square
    )


def _floats(values: object) -> FloatArray:
    return np.asarray(values, dtype=np.float64)


def _normal(turn: FloatArray, shift: FloatArray) -> tuple[FloatArray, float]:
    axis = _axis(turn.ravel())
    out = -1.0 if float(axis @ shift.ravel()) > 0.0 else 1.0
    return out * axis, out


def _axis(turn: FloatArray) -> FloatArray:
    return _floats(cv2.Rodrigues(turn)[0])[:, 2]


def panel_tilt(stand: PanelStand, angles_rad: FloatArray, covariance: FloatArray) -> PanelTilt:
    """Return how a panel stands in the world, by the direction of the camera and the covariance of its errors."""

    def tilted(normal: FloatArray, angles: FloatArray) -> FloatArray:
        east, north, up = camera_axes(angles).T @ normal
        return np.array([np.arctan2(np.hypot(east, north), up), np.arctan2(east, north)])

    base = tilted(stand.normal, angles_rad)
    columns = [tilted(stand.normal + _STEP * one, angles_rad) for one in np.eye(3)]
    columns += [tilted(stand.normal, angles_rad + _STEP * one) for one in np.eye(3)]
    slope = np.column_stack([(column - base + np.pi) % (2.0 * np.pi) - np.pi for column in columns]) / _STEP
    joint = np.zeros((6, 6))
    joint[:3, :3], joint[3:, 3:] = stand.covariance, covariance
    std = np.sqrt(np.diag(slope @ joint @ slope.T))
    return PanelTilt(
        tilt_rad=float(base[0]),
        tilt_std_rad=float(std[0]),
        azimuth_rad=float(base[1] % (2.0 * np.pi)),
        # On a level panel every direction is as good as another.
        azimuth_std_rad=float(min(std[1], np.pi / np.sqrt(3.0))),
    )
