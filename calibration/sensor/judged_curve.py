"""A photon-transfer curve from the levels that are sound, and what is wrong with the others."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.estimate import number_with_error
from calibration.flags import Flag
from calibration.sensor.dark_influence import DarkInfluence, dark_influence
from calibration.sensor.dark_signal import QUANTISATION_LIMIT_DN2, DarkMatch, DarkSignal, mean_sampling_variance
from calibration.sensor.frame_statistics import LevelStatistics
from calibration.sensor.gain_change import GainChange, Step, change_flag, gain_change, is_large, largest_step
from calibration.sensor.level_influence import (
    LightInfluence,
    light_influence,
    mean_variance_dn2,
    noise_influence,
    stated_light,
)
from calibration.sensor.level_names import describe_level
from calibration.sensor.level_verdicts import FlatVerdicts, LevelInfluence, flat_verdicts
from calibration.sensor.light_stability import LightStability, light_stability
from calibration.sensor.photon_transfer import PhotonTransfer, fit_photon_transfer
from calibration.sensor.transfer_points import (
    TransferPoints,
    UsablePoints,
    beyond_range,
    transfer_points,
    usable_points,
)

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class JudgedCurve:
    """The curve of the sound levels.

    Attributes
    ----------
    transfer : PhotonTransfer
        Its fit.
    levels : tuple of LevelInfluence
        Each flat beside the others.
    stability : LightStability
        Of the light from frame to frame.
    flags : tuple of Flag
        One for each level that is named.
    """

    transfer: PhotonTransfer
    levels: tuple[LevelInfluence, ...]
    stability: LightStability
    flags: tuple[Flag, ...]


def sound_darks(darks: Sequence[LevelStatistics]) -> tuple[list[LevelStatistics], tuple[Flag, ...]]:
    """Return the dark levels that go together, and a flag for each that does not."""
    found = dark_influence(darks)
    if found is None:
        return list(darks), ()
    pairs = list(zip(darks, found, strict=True))
    return (
        [dark for dark, one in pairs if not one.outlying],
        tuple(_dark_flag(dark, one) for dark, one in pairs if one.outlying),
    )


def dark_step(darks: Sequence[LevelStatistics]) -> Step | None:
    """Return the largest step of the temporal variance of darks against their exposure, None where that is not known.

    Parameters
    ----------
    darks : sequence of LevelStatistics
        Dark levels.
    """
    known = [dark for dark in darks if dark.exposure_s is not None and dark.temporal_variance_dn2 > 0.0]
    if len(known) < len(darks):
        return None
    known.sort(key=lambda dark: dark.exposure_s or 0.0)
    variance = np.array([dark.temporal_variance_dn2 for dark in known])
    if not known or np.median(variance) < QUANTISATION_LIMIT_DN2:
        return None
    relative = np.array([dark.temporal_std_error_dn2 / dark.temporal_variance_dn2 for dark in known])
    exposures = np.array([dark.exposure_s or 0.0 for dark in known])
    middle = np.full(len(known), float(np.median(variance)))
    design = np.column_stack([np.ones(len(known)), exposures])
    return largest_step(design, variance, np.square(relative * middle), shape=middle)


def _dark_flag(dark: LevelStatistics, found: DarkInfluence) -> Flag:
    name = describe_level(dark)
    cause = "light got in, or the sensor was warmer" if found.mean_off_dn > 0.0 else "it is of another exposure"
    return Flag(
        name="wrong_dark",
        level=name,
        message=f"{name}: its mean is "
        f"{number_with_error(found.mean_off_dn, found.mean_std_error_dn, sign='+')} DN and its temporal "
        f"variance "
        f"{number_with_error(found.variance_off_dn2, found.variance_std_error_dn2, sign='+')} DN^2 "
        f"off what all other darks "
        f"say of its exposure: {cause}, or its frames are others; it is left out: take it again",
    )


def judged_curve(
    flats: Sequence[LevelStatistics],
    darks: Sequence[LevelStatistics],
    dark: DarkSignal,
    match: DarkMatch,
    *,
    ceiling_dn: int,
) -> JudgedCurve:
    """Return the photon-transfer curve through the levels that all others confirm.

    Parameters
    ----------
    flats, darks : sequences of LevelStatistics
        Flats by ascending mean; darks as `dark` was fitted from.
    dark : DarkSignal
        The dark levels.
    match : DarkMatch
        Which darks belong to which flat.
    ceiling_dn : int
        Sample of a saturated pixel [DN].

    Raises
    ------
    RefusedFramesError
        No level can be used.

    Notes
    -----
    A level that is off on an axis is left out of the fit on this axis, and of nothing else. Levels between the range of
    the fit and saturation are no part of any, but their light is judged.
    """
    points = transfer_points(flats, dark, match, ceiling_dn=ceiling_dn)
    full_dn = ceiling_dn - float(dark.means_dn.min())
    usable = usable_points(points, full_signal_dn=full_dn, light=stated_light(flats))
    mask = usable.mask
    stability = light_stability(_chosen(flats, mask), points.signal_dn[mask])
    of_darks = np.square(match.weights) @ mean_sampling_variance(darks)
    own_dn2 = np.where(points.signal_dn > 0.0, mean_variance_dn2(flats, points.signal_dn, stability), 0.0) + of_darks
    bend = beyond_range(points, usable, full_signal_dn=full_dn)
    verdicts, change = _judged(flats, points, own_dn2, bend=bend, mask=mask, by_dark=dark_step(darks))
    transfer = _fit(flats, points, usable, verdicts, own_dn2)
    if change is not None:
        transfer = replace(transfer, relative_gain_error_of_change=change.gain_error)
    return JudgedCurve(
        transfer=transfer,
        levels=_with_gain_shifts(verdicts.levels, transfer),
        stability=stability,
        flags=verdicts.flags,
    )


def _judged(
    flats: Sequence[LevelStatistics],
    points: TransferPoints,
    own_dn2: FloatArray,
    *,
    bend: FloatArray,
    mask: Mask,
    by_dark: Step | None,
) -> tuple[FlatVerdicts, GainChange | None]:
    """Return what is wrong with which flat, and a change of gain or lamp, after which no flat is judged by itself."""
    noise, light, lit = noise_influence(points, mask), _light(flats, points, mask, own_dn2), mask
    change = gain_change(noise, light[0] if light else None, by_dark=by_dark)
    if change is None and np.any(bend > 0.0):
        lit = mask | (bend > 0.0)
        light = _light(flats, points, lit, own_dn2 + np.square(bend * points.signal_dn))
        if is_large(by_dark) and light:
            # Too few levels may be left in the range of the fit behind a change that makes all of them brighter.
            change = gain_change(noise, light[0], by_dark=by_dark)
    if change is None:
        return flat_verdicts(flats, judged=mask, lit=lit, noise=noise, light=light), None
    # What is no smooth curve has no levels that stand off it.
    verdicts = flat_verdicts(flats, judged=mask, lit=mask, noise=None, light=())
    said = change_flag(change, _chosen(flats, lit))
    return replace(verdicts, wrong_light=mask, flags=(said,)), change


def _chosen(flats: Sequence[LevelStatistics], chosen: Mask) -> list[LevelStatistics]:
    return [flats[index] for index in np.flatnonzero(chosen).tolist()]


def _light(
    flats: Sequence[LevelStatistics], points: TransferPoints, chosen: Mask, own_dn2: FloatArray
) -> tuple[LightInfluence, ...]:
    return light_influence(_chosen(flats, chosen), points.signal_dn[chosen], own_dn2[chosen])


def _fit(
    flats: Sequence[LevelStatistics],
    points: TransferPoints,
    usable: UsablePoints,
    verdicts: FlatVerdicts,
    own_dn2: FloatArray,
) -> PhotonTransfer:
    return fit_photon_transfer(
        flats,
        points,
        usable=replace(usable, mask=usable.mask & ~verdicts.wrong_noise),
        mean_variance_dn2=own_dn2,
        wrong_light=verdicts.wrong_light,
    )


def _with_gain_shifts(levels: Sequence[LevelInfluence], transfer: PhotonTransfer) -> tuple[LevelInfluence, ...]:
    """Return the levels with what leaving each out of the gain does, in its standard errors, by the hat matrix."""
    shifts = transfer.gain_shifts / np.sqrt(transfer.fit.covariance[0, 0])
    found = list(levels)
    for row, index in enumerate(np.flatnonzero(transfer.used).tolist()):
        found[index] = replace(found[index], gain_shift_errors=float(shifts[row]))
    return tuple(found)
