"""Regions found again by ArUco markers on the panels, after the camera has moved.

Each region moves by the affine map that fits the corners of its markers; `edge_px` grows by its uncertainty.
"""

from dataclasses import dataclass
from math import ceil

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.polarimeter.pictures import AffineMap, fit_affine
from rigctl.errors import DataError
from rigctl.files.choices import Dictionary
from rigctl.files.regions import Marker, Markers, Region, RegionsFile
from rigctl.measure.measure import measure
from rigctl.runs.folder import Run

FloatArray = NDArray[np.float64]

# Shares of pixels below black and above white.
_DARKEST, _LIGHTEST = 0.1, 99.9


def search_markers(picture: NDArray[np.uint8], dictionary: Dictionary) -> list[Marker]:
    """Return the markers of a dictionary that a picture shows, by their number."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    family = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{dictionary.upper()}"))
    corners, ids, _ = cv2.aruco.ArucoDetector(family, parameters).detectMarkers(picture)
    numbers = [] if ids is None else [int(number) for number in np.ravel(ids)]
    return sorted(
        (
            Marker(id=number, corners=[(float(x), float(y)) for x, y in np.reshape(four, (4, 2))])
            for number, four in zip(numbers, corners, strict=True)
            if numbers.count(number) == 1
        ),
        key=lambda marker: marker.id,
    )


def grey_picture(run: Run) -> NDArray[np.uint8]:
    """Return the mean of a run over all angles, shape (H, W), stretched to 0..255."""
    return stretched(measure(run, regions=[]).channels.mean(axis=0))


def stretched(picture: NDArray[np.float64] | NDArray[np.uint16]) -> NDArray[np.uint8]:
    """Return a picture in greys from black to white, shape (H, W)."""
    low, high = np.percentile(picture, (_DARKEST, _LIGHTEST))
    if not high > low:
        return np.zeros(picture.shape, dtype=np.uint8)
    return np.asarray(255.0 * np.clip((picture - low) / (high - low), 0.0, 1.0)).astype(np.uint8)


# Largest residual: printed markers give some tenths of a pixel, perspective or a moved panel more.
MOST_RESIDUAL_PX = 1.0
# Standard errors of a moved outline that are left out along its border.
_SAFE_DEVIATIONS = 2.0


@dataclass(frozen=True, kw_only=True)
class FollowedRegion:
    """A region where it is now."""

    region: Region  #: Its outline in the new picture; `edge_px` has grown by the uncertainty of the outline.
    shift_px: float  #: Distance moved by its centre, and largest standard error of a corner [pixel].
    std_error_px: float
    markers: tuple[int, ...]  #: Which ones led it.


def follow_markers(drawn: RegionsFile, now: list[Marker]) -> list[FollowedRegion]:
    """Return the regions of a file at their present places by the markers.

    Each region moves by the affine map that fits the corners of its markers best. It does not include the perspective
    of a far move, which the residual shows.
    """
    if drawn.markers is None:
        raise DataError(
            "the regions file has no [markers] with their places when the regions were drawn. `rigctl regions mark` "
            "adds them"
        )
    found: list[FollowedRegion] = []
    problems: list[str] = []
    for region in drawn.regions:
        pairs = _pairs(region, drawn.markers, now)
        if not pairs:
            problems.append(f"region {region.name}: none of its markers is visible ({_leaders(region, drawn.markers)})")
            continue
        fitted = fit_affine(*_corners(pairs))
        if fitted.residual_rms_px > MOST_RESIDUAL_PX:
            problems.append(
                f"region {region.name}: its markers did not move as a plane (residual {fitted.residual_rms_px:.1f} "
                f"pixel, allowed {MOST_RESIDUAL_PX:g}): name the regions that each marker leads, or draw the regions "
                "again"
            )
            continue
        found.append(_moved(region, fitted, tuple(old.id for old, _ in pairs)))
    if problems:
        raise DataError("\n  ".join(["regions are not found again:", *problems]))
    return found


def moved_markers(drawn: RegionsFile, now: list[Marker]) -> Markers | None:
    """Return the markers of a file at their present places, each with its regions."""
    if drawn.markers is None:
        return None
    led = {marker.id: marker.regions for marker in drawn.markers.seen}
    seen = [marker.model_copy(update={"regions": led[marker.id]}) for marker in now if marker.id in led]
    return Markers(dictionary=drawn.markers.dictionary, seen=seen)


def _pairs(region: Region, markers: Markers, now: list[Marker]) -> list[tuple[Marker, Marker]]:
    seen = {marker.id: marker for marker in now}
    return [(old, seen[old.id]) for old in markers.seen if old.id in seen and _leads(old, region)]


def _leads(marker: Marker, region: Region) -> bool:
    return not marker.regions or region.name in marker.regions


def _leaders(region: Region, markers: Markers) -> str:
    ids = [str(marker.id) for marker in markers.seen if _leads(marker, region)]
    return f"number {', '.join(ids)} of {markers.dictionary}" if ids else "no marker leads it"


def _corners(pairs: list[tuple[Marker, Marker]]) -> tuple[FloatArray, FloatArray]:
    before, after = (np.array([corner for pair in pairs for corner in pair[which].corners]) for which in (0, 1))
    return before, after


def _moved(region: Region, fitted: AffineMap, markers: tuple[int, ...]) -> FollowedRegion:
    outline = np.array(region.outline())
    moved = fitted.apply(outline)
    error = float(np.max(fitted.std_error_px(outline)))
    return FollowedRegion(
        region=Region(
            name=region.name,
            polygon=[(round(float(x), 2), round(float(y), 2)) for x, y in moved],
            edge_px=region.edge_px + ceil(_SAFE_DEVIATIONS * error),
        ),
        shift_px=float(np.hypot(*(moved.mean(axis=0) - outline.mean(axis=0)))),
        std_error_px=error,
        markers=markers,
    )
