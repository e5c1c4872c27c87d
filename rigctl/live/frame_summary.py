"""A frame in a few numbers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from model.processing.mosaic import coarse_pictures

if TYPE_CHECKING:
    from rigctl.live.region_means import PixelMean
    from rigctl.runs.frame_record import FrameRecord

# More than this and the means of a frame say little.
_MOST_SATURATED = 0.01
# Squares that a whole cycle is diagnosed from while the session runs.
_COARSE_PIXELS = 20_000


@dataclass(frozen=True, kw_only=True, eq=False)
class CoarsePicture:
    """Mean counts of squares of pixels, NaN where one of them is saturated or missing; side of a square [pixel]."""

    counts_dn: NDArray[np.float64]
    side_pixels: int


@dataclass(frozen=True, kw_only=True)
class FrameSummary:
    """A frame in a few numbers.

    Attributes
    ----------
    kind : str
        "scene", "dark" or "flat".
    round, cycle : int or None
        Where in the session.
    angle_deg : float or None
        The polarizer angle that was asked for, in [0, 180).
    measured_deg : float or None
        The same by the stage's readback.
    exposure_s : float
        Integration time.
    time_s : float
        When its exposure began, by one clock for all that are set against each other.
    saturated_fraction : float
        Share of saturated pixels.
    means : mapping
        Mean counts of the picture and of its regions, by name.
    coarse : CoarsePicture or None
        The picture in some 20000 squares.
    """

    kind: str
    round: int | None
    cycle: int | None
    angle_deg: float | None
    measured_deg: float | None
    exposure_s: float
    time_s: float
    saturated_fraction: float
    means: Mapping[str, "PixelMean"]
    coarse: CoarsePicture | None = None


def frame_summary(
    record: "FrameRecord",
    means: Mapping[str, "PixelMean"],
    *,
    time_s: float,
    saturated_fraction: float,
    coarse: CoarsePicture | None = None,
) -> FrameSummary:
    """Return what a frame shows, by its record and the means of its counts."""
    target_deg = record.polarizer_angle_target_deg
    return FrameSummary(
        kind=record.kind,
        round=record.round,
        cycle=record.cycle,
        angle_deg=None if target_deg is None else target_deg % 180.0,
        measured_deg=record.polarizer_angle_deg,
        exposure_s=record.exposure_s or 0.0,
        time_s=time_s,
        saturated_fraction=saturated_fraction,
        means=means,
        coarse=coarse,
    )


def coarse_picture(counts: NDArray[np.uint16], record: "FrameRecord") -> CoarsePicture:
    """Return the mean counts of squares of the pixels of a frame, some 20000 of them."""
    bad = counts >= record.saturation_dn
    if record.missing_dn is not None:
        bad |= counts == record.missing_dn
    means, good, side = coarse_pictures(counts[None].astype(np.float64), ~bad, most_pixels=_COARSE_PIXELS)
    return CoarsePicture(counts_dn=np.where(good, means[0], np.nan), side_pixels=side)


def of_one_exposure(frames: Sequence[FrameSummary]) -> tuple[FrameSummary, ...]:
    """Return the frames of the longest exposure at which none is saturated; of the shortest if all are."""
    exposures_s = sorted({frame.exposure_s for frame in frames}, reverse=True)
    for exposure_s in exposures_s:
        alike = tuple(frame for frame in frames if frame.exposure_s == exposure_s)
        if all(frame.saturated_fraction <= _MOST_SATURATED for frame in alike) or exposure_s == exposures_s[-1]:
            return alike
    return ()
