"""Pictures of what was measured: S0 and DoLP with the regions, angle of polarization, residual of the fit."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rigctl.files.regions import Region
from rigctl.measurement.polarization_images import PolarizationImages
from rigctl.reports.figures.picture_drawing import Picture, pictures_png

FloatArray = NDArray[np.floating]

# An angle that is known worse than this fades.
_WELL_KNOWN_DEG = 10.0
# Pictures show from the 1st to the 99.5th percentile, so that a few bright pixels do not darken the rest.
_SHOWN_PERCENTILES = (1.0, 99.5)
# A grey that the cyclic colours never pass: theirs at 0 degrees is a light one.
_UNKNOWN_GREY = 153
# Of a picture that is the same all over, the bar is so wide for its value.
_LEAST_SPAN = 1e-3


def scene_pictures(images: PolarizationImages, regions: Sequence[Region], *, unit: str) -> bytes:
    """Return the panchromatic and the DoLP image with the regions, as [MK14] Fig. 6."""
    s0 = images.stokes[0]
    s0_low, s0_high = _shown(np.where(images.unusable, np.nan, s0))
    low, high = _shown(images.dolp, most=1.0)
    panchromatic = Picture(
        values=s0, low=s0_low, high=s0_high, colours="gray", title="S0 (panchromatic)", label=f"S0 [{unit}]"
    )
    dolp = Picture(values=images.dolp, low=low, high=high, colours="viridis", title="DoLP", label="DoLP")
    return pictures_png((panchromatic, dolp), regions=regions)


def aolp_picture(images: PolarizationImages) -> bytes:
    """Return the image of the angle of polarization; it fades where it is known to less than 10 degrees."""
    picture = Picture(
        values=np.where(images.unusable, np.nan, images.aolp_deg),
        low=0.0,
        high=180.0,
        colours="twilight",
        title=f"AoLP (grey: not known to {_WELL_KNOWN_DEG:g} deg)",
        label="counter-clockwise from horizontal [deg]",
        opacity=np.clip(_WELL_KNOWN_DEG / np.maximum(images.aolp_error_deg, 1e-9), 0.0, 1.0) ** 2,
        ground=_UNKNOWN_GREY,
    )
    return pictures_png((picture,))


def residual_picture(residual: FloatArray) -> bytes:
    """Return the image of what no light gives, as a share of the light."""
    found = 100.0 * residual
    good = np.abs(found[np.isfinite(found)])
    most = max(float(np.percentile(good, _SHOWN_PERCENTILES[1])), 1e-6) if good.size else 1.0
    picture = Picture(
        values=found,
        low=-most,
        high=most,
        colours="red-blue",
        title="What no light gives",
        label="twice the residual over the light [%]",
    )
    return pictures_png((picture,))


def _shown(image: FloatArray, *, most: float = np.inf) -> tuple[float, float]:
    """Return the values between which a picture is shown."""
    good = image[np.isfinite(image)]
    low, high = np.percentile(good, _SHOWN_PERCENTILES) if good.size else (0.0, 1.0)
    return float(low), float(max(min(high, most), low + _LEAST_SPAN * max(abs(low), _LEAST_SPAN)))
