"""Effects of lamp, polarizer and lens, on the expected photo-electrons of a frame."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from sim_devices.detector import Detector, Lens
from sim_devices.random_streams import Stream
from sim_devices.rendering.effect import FloatArray, RenderingEffect, Shot, refuse_outside


def drift(*, rate_per_frame: float, flicker_std: float) -> RenderingEffect:
    """Return an illumination that changes from frame to frame.

    Parameters
    ----------
    rate_per_frame
        Relative change from one sequence number to the next, compounded; 1 at sequence 0.
    flicker_std
        Relative deviation from frame to frame beside that, normal in the logarithm, >= 0.
    """
    refuse_outside("drift.rate_per_frame", rate_per_frame, least=-1.0, most=1.0)
    refuse_outside("drift.flicker_std", flicker_std, least=0.0, most=1.0)

    def act(picture: FloatArray, shot: Shot) -> FloatArray:
        exponent = rate_per_frame * shot.sequence
        if flicker_std > 0.0:
            exponent += flicker_std * shot.draws(Stream.DRIFT).standard_normal()
        picture *= np.exp(exponent)
        return picture

    return RenderingEffect(name="drift", place="light", act=act)


def beam_wander(*, radius_px: float, phase_deg: float) -> RenderingEffect:
    """Return a picture that goes round a circle as the polarizer turns, as behind a wedge.

    Parameters
    ----------
    radius_px
        Of the circle, >= 0.
    phase_deg
        The picture is moved in the direction of the polarizer's axis plus this, counter-clockwise from right.

    Notes
    -----
    Between pixels it is linear interpolation, which makes no light negative but blurs by up to half a pixel. What
    comes in at the rim repeats the rim.
    """
    from scipy import ndimage

    refuse_outside("beam-wander.radius_px", radius_px, least=0.0)

    def act(picture: FloatArray, shot: Shot) -> FloatArray:
        direction_rad = np.deg2rad(shot.axis_deg + phase_deg)
        down, right = -radius_px * np.sin(direction_rad), radius_px * np.cos(direction_rad)
        return np.asarray(ndimage.shift(picture, (down, right), order=1, mode="nearest"))

    return RenderingEffect(name="beam-wander", place="light", act=act)


def point_spread(*, sigma_px: float) -> RenderingEffect:
    """Return a blur by a Gaussian of this deviation, > 0, cut at four; the rim repeats beyond the picture."""
    from scipy import ndimage

    refuse_outside("point-spread.sigma_px", sigma_px, least=0.0)

    def act(picture: FloatArray, _: Shot) -> FloatArray:
        return np.asarray(ndimage.gaussian_filter(picture, sigma_px, mode="nearest"))

    return RenderingEffect(name="point-spread", place="light", act=act)


def defocus(lens: Lens, detector: Detector, *, defocus_m: Callable[[], float]) -> RenderingEffect:
    """Return the blur of a detector that does not stand in the focus: every point becomes an even disk.

    Parameters
    ----------
    lens
        The cone of light behind its aperture has its tip one focal length away.
    detector
        Cuts that cone.
    defocus_m
        Gives, at each frame, how far the detector is from the tip; before or behind it is the same [m].

    Notes
    -----
    Rays alone: no diffraction, which is below a pixel where a lens is wide open. Between pixels it is linear
    interpolation, so that the picture in the focus stays as it is. The rim repeats beyond the picture.
    """
    cone = lens.aperture_diameter_m / lens.focal_length_m

    def act(picture: FloatArray, _: Shot) -> FloatArray:
        radius_px = cone * abs(defocus_m()) / 2.0 / detector.pixel_pitch_m
        return picture if radius_px == 0.0 else _spread(picture, radius_px)

    return RenderingEffect(name="defocus", place="light", act=act)


def _spread(picture: FloatArray, radius_px: float) -> FloatArray:
    import cv2

    spread = cv2.filter2D(picture, cv2.CV_64F, _disk(radius_px), borderType=cv2.BORDER_REPLICATE)
    # Its Fourier transforms leave a rounding below zero, of which no electrons can be drawn.
    return np.maximum(spread, 0.0)


_FINEST, _COARSEST = 512, 32


@lru_cache(maxsize=4)
def _disk(radius_px: float) -> FloatArray:
    """Shares of an even disk's light in the pixels around its middle; they add up to 1."""
    across = int(np.clip(np.ceil(16.0 * radius_px), _COARSEST, _FINEST))
    steps = ((np.arange(across) + 0.5) / across * 2.0 - 1.0) * radius_px
    inside = steps[:, None] ** 2 + steps**2 <= radius_px**2
    half = int(np.ceil(radius_px)) + 1
    right = np.broadcast_to(steps, inside.shape)[inside] + half
    down = np.broadcast_to(steps[:, None], inside.shape)[inside] + half
    left, top = np.floor(right).astype(int), np.floor(down).astype(int)
    shares = np.zeros((2 * half + 1, 2 * half + 1))
    for row, share_row in ((top, 1.0 - (down - top)), (top + 1, down - top)):
        np.add.at(shares, (row, left), share_row * (1.0 - (right - left)))
        np.add.at(shares, (row, left + 1), share_row * (right - left))
    return np.asarray(shares / shares.sum())


def vignetting(lens: Lens, detector: Detector) -> RenderingEffect:
    """Return the fall of light toward the corners of an ideal lens: the fourth power of the cosine of the field angle.

    Notes
    -----
    The axis meets the middle of the picture. What mounts and lens barrels cut off comes on top and is not here.
    """
    share = _cosine_squared(lens, detector) ** 2

    def act(picture: FloatArray, _: Shot) -> FloatArray:
        picture *= share
        return picture

    return RenderingEffect(name="vignetting", place="light", act=act)


def _cosine_squared(lens: Lens, detector: Detector) -> FloatArray:
    """Squared cosine of each pixel's field angle, shape (H, W)."""
    right, down = (
        (np.arange(count) - (count - 1) / 2.0) * detector.pixel_pitch_m / lens.focal_length_m
        for count in (detector.width, detector.height)
    )
    return np.asarray(1.0 / (1.0 + right[np.newaxis, :] ** 2 + down[:, np.newaxis] ** 2))
