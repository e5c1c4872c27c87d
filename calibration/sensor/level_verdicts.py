"""Verdicts on single levels: which are named, why, and what they are left out of."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.estimate import percent_with_error
from calibration.flags import Flag
from calibration.sensor.frame_statistics import LevelStatistics
from calibration.sensor.level_influence import LightInfluence, LightName
from calibration.sensor.level_names import describe_level
from calibration.sensor.outlying_points import PointInfluence

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Deviations on both axes that agree to this many errors, or to a quarter, have one cause.
_ALIKE_SIGMA, _ALIKE_SHARE = 4.0, 0.25
_UNCLEAR = "unclear_level"
_MS_PER_S = 1e3
# Shutters and readouts of usual cameras are this late or early at most [s].
_USUAL_SHUTTER_S = 3e-6


@dataclass(frozen=True, kw_only=True)
class LevelInfluence:
    """One flat beside what all others say of it.

    Attributes
    ----------
    variance_off, variance_std_error : float or None
        Temporal variance off the curve through the others against their means, relative; None where not judged.
    mean_off, mean_std_error : float or None
        Mean off the response of the others to their light, relative.
    gain_shift_errors : float or None
        Change of the gain by leaving the level out, in the gain's standard errors.
    cause : str or None
        Name of the flag that names it; None where it is sound.
    """

    variance_off: float | None = None
    variance_std_error: float | None = None
    mean_off: float | None = None
    mean_std_error: float | None = None
    gain_shift_errors: float | None = None
    cause: str | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class FlatVerdicts:
    """All flats, in their order.

    Attributes
    ----------
    levels : tuple of LevelInfluence
        Each beside the others.
    wrong_noise, wrong_light : (n,) arrays of bool
        Left out of the gain; left out of the response to light and of the quantum efficiency.
    flags : tuple of Flag
        One for each level that is named.
    """

    levels: tuple[LevelInfluence, ...]
    wrong_noise: Mask
    wrong_light: Mask
    flags: tuple[Flag, ...]


def flat_verdicts(
    flats: Sequence[LevelStatistics],
    *,
    judged: Mask,
    lit: Mask,
    noise: PointInfluence | None,
    light: Sequence[LightInfluence],
) -> FlatVerdicts:
    """Return what is wrong with which flat.

    Parameters
    ----------
    flats : sequence of LevelStatistics
        In the order of the curve's points.
    judged, lit : (n,) arrays of bool
        Those that `noise` holds, and those that `light` holds: all of the former and more.
    noise : PointInfluence or None
        Variance against mean.
    light : sequence of LightInfluence
        Mean against exposure and photons.

    Notes
    -----
    Variance against mean needs no light: a level that is off there has another noise. One that is off the light alone
    has a mean that its noise confirms, and what is stated of its light is wrong. Off on both by the same share: mean
    goes with gain, variance with its square, so variance over mean is off as much as mean over light: another gain.
    """
    places = np.flatnonzero(lit).tolist()
    levels = [LevelInfluence() for _ in flats]
    wrong_noise, wrong_light = np.zeros(len(flats), dtype=bool), np.zeros(len(flats), dtype=bool)
    flags = []
    rows_of_noise = np.cumsum(judged) - 1
    for row, index in enumerate(places):
        beside = _Beside(
            level=flats[index],
            noise=noise if judged[index] else None,
            row_of_noise=int(rows_of_noise[index]),
            light=light,
            row=row,
        )
        levels[index] = beside.influence
        wrong_noise[index], wrong_light[index] = beside.is_noise, beside.is_light
        flags += beside.flags
    return FlatVerdicts(levels=tuple(levels), wrong_noise=wrong_noise, wrong_light=wrong_light, flags=tuple(flags))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Beside:
    """One flat on both axes; `noise` is None where that is not judged."""

    level: LevelStatistics
    noise: PointInfluence | None
    row_of_noise: int
    light: Sequence[LightInfluence]
    row: int

    @property
    def worst_light(self) -> LightInfluence | None:
        """The light that a level is off by; where it is off by neither, the one that all follow best."""
        off = [one for one in self.light if one.points.outlying[self.row]]
        return next(iter(off or self.light), None)

    @property
    def by_noise(self) -> tuple[float, float] | None:
        return None if self.noise is None else _relative(self.noise, self.row_of_noise)

    @property
    def off_light(self) -> tuple[float, float] | None:
        worst = self.worst_light
        return None if worst is None else _relative(worst.points, self.row)

    @property
    def is_noise(self) -> bool:
        return self.noise is not None and bool(self.noise.outlying[self.row_of_noise])

    @property
    def is_light(self) -> bool:
        worst = self.worst_light
        return worst is not None and bool(worst.points.outlying[self.row])

    @property
    def influence(self) -> LevelInfluence:
        by_noise, off_light = self.by_noise, self.off_light
        cause = _cause(by_noise if self.is_noise else None, off_light if self.is_light else None)
        return LevelInfluence(
            variance_off=by_noise[0] if by_noise else None,
            variance_std_error=by_noise[1] if by_noise else None,
            mean_off=off_light[0] if off_light else None,
            mean_std_error=off_light[1] if off_light else None,
            cause=_UNCLEAR if cause is None and self.is_unclear and not self.is_shutter else cause,
        )

    @property
    def is_unclear(self) -> bool:
        return self.unclear_light is not None or self.is_unclear_noise

    @property
    def unclear_light(self) -> LightInfluence | None:
        """The light by which the level is off a curve that is as likely as the one that explains it."""
        rivals = ((one, one.points.rival) for one in sorted(self.light, key=lambda one: one.light))
        return next((one for one, rival in rivals if rival is not None and rival.outlying[self.row]), None)

    @property
    def is_unclear_noise(self) -> bool:
        rival = None if self.noise is None else self.noise.rival
        return rival is not None and bool(rival.outlying[self.row_of_noise])

    @property
    def is_shutter(self) -> bool:
        """Whether a fixed time that cameras usually have explains the level."""
        one = self.unclear_light
        if one is None or one.light != "exposure" or one.points.rival is None or self.level.exposure_s is None:
            return False
        late_s = _relative(one.points.rival, self.row)[0] * self.level.exposure_s
        return _has_offset(one.points, one.points.rival) and abs(late_s) < _USUAL_SHUTTER_S

    def unclear(self) -> str:
        """Return what the level is off by on the other curve, and what else it may be."""
        one = self.unclear_light
        if one is not None and one.points.rival is not None:
            off = _relative(one.points.rival, self.row)
            stated = self.level.exposure_s if one.light == "exposure" else self.level.photons
            fixed = _fixed_light(one.light, off[0] * (stated or 0.0))
            instead = _instead(one.points, one.points.rival, fixed)
            what = f"its mean is {percent_with_error(*off)} off the response to the {one.light} of the others"
            return f"{what}, or {instead}"
        if self.noise is None or self.noise.rival is None:
            return ""
        off = _relative(self.noise.rival, self.row_of_noise)
        instead = _instead(self.noise, self.noise.rival)
        return f"its temporal variance is {percent_with_error(*off)} off the curve of the others, or {instead}"

    @property
    def flags(self) -> list[Flag]:
        cause, worst, name = self.influence.cause, self.worst_light, describe_level(self.level)
        if cause == _UNCLEAR:
            what = f"{name}: {self.unclear()}: these frames do not tell which, and it stays in all numbers"
            return [Flag(name=_UNCLEAR, level=name, message=f"{what}: take it again, and more levels beside it")]
        if cause is not None:
            light = None if worst is None else worst.light
            return [_flag(cause, self.level, self.by_noise, self.off_light, light)]
        if self.is_unclear and self.is_shutter:
            what = f"{name}: {self.unclear()}: this level alone tells of it, and it stays in all numbers"
            return [
                Flag(name="exposure_offset", message=f"{what}; so short a time is usual: take more short exposures")
            ]
        return []


def _instead(points: PointInfluence, rival: PointInfluence, fixed: str = "") -> str:
    """Return what explains all levels where none of them is wrong."""
    found = [fixed] if fixed and _has_offset(points, rival) else []
    found += ["this curve bends more than usual"] if points.model.n_bends > rival.model.n_bends else []
    return ", or ".join(found) or "all levels scatter by more than their errors"


def _has_offset(points: PointInfluence, rival: PointInfluence) -> bool:
    """Return whether an offset of all levels is what a curve has and its rival has not."""
    best, other = points.model, rival.model
    if best.is_through_zero:
        return False
    return other.is_through_zero or (best.first_term_std is None and other.first_term_std is not None)


def _fixed_light(light: LightName, more: float) -> str:
    """Return what all levels have more or less of than is stated, if the one that is off by so much is right."""
    if light == "exposure":
        word = "longer" if more > 0.0 else "shorter"
        return f"all exposures are {word} than stated by {_MS_PER_S * abs(more):.2g} ms (a shutter, a readout)"
    word = "more" if more > 0.0 else "fewer"
    return f"all levels have {abs(more):.2g} photons {word} than stated (a shutter, stray light)"


def _relative(points: PointInfluence, row: int) -> tuple[float, float]:
    """Return how far a point is off the others and its error, relative to what the others have there."""
    expected = points.values[row] - points.deviation[row]
    return float(points.deviation[row] / expected), float(points.std_error[row] / abs(expected))


def _cause(noise: tuple[float, float] | None, light: tuple[float, float] | None) -> str | None:
    if noise is None or light is None:
        return "wrong_variance" if noise else "wrong_light" if light else None
    apart, error = abs(noise[0] - light[0]), float(np.hypot(noise[1], light[1]))
    alike = apart < max(_ALIKE_SIGMA * error, _ALIKE_SHARE * abs(light[0]))
    return "another_gain" if alike else "wrong_level"


def _flag(
    cause: str,
    level: LevelStatistics,
    noise: tuple[float, float] | None,
    light: tuple[float, float] | None,
    light_name: str | None,
) -> Flag:
    variance = "" if noise is None else f"{percent_with_error(noise[0], noise[1])}"
    mean = "" if light is None else f"{percent_with_error(light[0], light[1])}"
    messages = {
        "wrong_variance": f"its temporal variance is {variance} off the curve that all others follow against their "
        f"means: {_cause_of_variance(noise)}; it is left out of the gain: take it again",
        "wrong_light": f"its mean is {mean} off the response to the {light_name} that all others follow"
        + ("" if noise is None else f", while its noise fits its mean ({variance})")
        + f": what is stated of its {light_name} is wrong, or the lamp was another then; "
        + (
            "it is brighter than what the numbers are taken from, none of them has it"
            if noise is None
            else "it is left out of linearity and quantum efficiency, and stays in the gain"
        )
        + ": correct what is stated, or take it again",
        "another_gain": f"variance over mean is {variance}, mean over {light_name} {mean} off what all others "
        f"follow, by the same share: it was taken at another gain; it is left out of the gain and of linearity: take "
        f"it again",
        "wrong_level": f"its temporal variance is {variance} off its mean and its mean {mean} off its {light_name}: "
        f"other frames, another gain, or saturation; it is left out of the gain and of linearity: take it again",
    }
    name = describe_level(level)
    return Flag(name=cause, level=name, message=f"{name}: {messages[cause]}")


def _cause_of_variance(noise: tuple[float, float] | None) -> str:
    if noise is not None and noise[0] > 0.0:
        return "the light changed within its frames, or another gain"
    return "frames that repeat or were averaged, compression, another gain, or the onset of saturation"
