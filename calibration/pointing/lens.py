"""A lens by its focal length, principal point and distortion; calibrated from pictures of a chessboard."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError

FloatArray = NDArray[np.float64]

NAMES = ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2")
_LEAST_PICTURES = 3
# Steps for slopes, in units of each number's standard error.
_STEP = 0.1
_TO_EIGHT_BITS = 255.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Lens:
    """A lens.

    Attributes
    ----------
    parameters : (8,) array
        As `NAMES` says: focal lengths, principal point, radial and tangential distortion [pixel, 1].
    covariance : (8, 8) array
        Of their errors.
    """

    parameters: FloatArray
    covariance: FloatArray

    @property
    def matrix(self) -> FloatArray:
        """The camera matrix."""
        fx, fy, cx, cy = self.parameters[:4]
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @property
    def distortion(self) -> FloatArray:
        """Distortion, as OpenCV has it."""
        return np.asarray(self.parameters[4:])

    def moved(self) -> Iterator[tuple[int, "Lens", float]]:
        """Give each uncertain number's place, the lens with it moved by a little, and by how much."""
        for place in np.flatnonzero(np.diag(self.covariance) > 0.0).tolist():
            step = _STEP * float(np.sqrt(self.covariance[place, place]))
            yield place, replace(self, parameters=self.parameters + step * np.eye(len(NAMES))[place]), step


def plain_lens(focal_px: float, focal_std_px: float, width: int, height: int) -> Lens:
    """Return a lens of a stated focal length, its axis through the middle of the picture within a hundredth of it.

    Parameters
    ----------
    focal_px, focal_std_px
        Focal length over the pixel pitch, above 0, and its standard uncertainty [px].
    width, height
        Of the picture [px].
    """
    centre_std = 0.01 * max(width, height)
    stds = np.array([focal_std_px, focal_std_px, centre_std, centre_std, 0.0, 0.0, 0.0, 0.0])
    covariance = np.diag(stds**2)
    covariance[0, 1] = covariance[1, 0] = focal_std_px**2  # one number
    middle = (0.5 * (width - 1), 0.5 * (height - 1))
    return Lens(parameters=np.array([focal_px, focal_px, *middle, 0.0, 0.0, 0.0, 0.0]), covariance=covariance)


def rays(pixels: FloatArray, lens: Lens) -> FloatArray:
    """Return the unit vectors, right, down, forward, along which pixels look; shape (n, 3).

    Parameters
    ----------
    pixels
        Places in the picture, right and down, shape (n, 2) [px].
    lens
        Of the camera.
    """
    flat = cv2.undistortPoints(pixels.reshape(-1, 1, 2).astype(np.float64), lens.matrix, lens.distortion)[:, 0]
    vectors = np.column_stack((flat, np.ones(len(flat))))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


@dataclass(frozen=True, kw_only=True, eq=False)
class LensCalibration:
    """A lens from a chessboard.

    Attributes
    ----------
    lens : Lens
        With the covariance that OpenCV gives its numbers.
    rms_px : float
        Of the corners about where they should be [pixel].
    width, height : int
        Of the pictures.
    used, unused : tuple of int
        Which pictures showed the whole board, and which did not.
    """

    lens: Lens
    rms_px: float
    width: int
    height: int
    used: tuple[int, ...]
    unused: tuple[int, ...]


def calibrate_lens(
    pictures: Sequence[NDArray[np.generic]], *, columns: int, rows: int, square_m: float
) -> LensCalibration:
    """Return the lens that pictures of a chessboard were taken with.

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
    Zhang, "A flexible new technique for camera calibration", PAMI 2000; as OpenCV has it.
    """
    sizes = {picture.shape for picture in pictures}
    if len(sizes) != 1:
        raise CalibrationError(f"pictures of one size are wanted; there are {sorted(sizes) or 'none'}")
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
