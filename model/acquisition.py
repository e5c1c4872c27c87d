"""Acquisition sessions: order of frames, errors of DoLP, and the shortest sufficient session."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from enum import Enum
from functools import lru_cache
from itertools import permutations
from math import exp, pi
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.moments import Moments
from model.processing import dolp
from model.processing.detection import rx_p_detection
from model.processing.reconstruction import Design, design
from model.sensor import Sensor, channel_moments

# Order of the frames: the mean place of each angle's frames, and the angle from which each is reached

FloatArray = NDArray[np.float64]

# cycles: in the given order; palindrome: every second cycle backwards; grouped: all frames of an angle together.
Pattern = Literal["cycles", "palindrome", "grouped"]
PATTERNS: tuple[Pattern, ...] = ("cycles", "palindrome", "grouped")

# All orders of up to this many angles are tried: 5040.
_MOST_ORDERED = 7


def mean_places(angles: int, *, cycles: int, pattern: Pattern) -> FloatArray:
    """Return the mean place of each angle's frames in the session, from the middle of the session.

    Linear drift changes the mean counts of an angle by this place times the change per frame. Cycles have the places of
    one cycle; an even number of passes back and forth has places of 0.
    """
    if angles < 1 or cycles < 1:
        raise ValueError(f"angles = {angles}, cycles = {cycles}; allowed is 1 or more of each")
    one_cycle = np.arange(angles, dtype=np.float64) - 0.5 * (angles - 1)
    factor = {"cycles": 1.0, "palindrome": (cycles % 2) / cycles, "grouped": float(cycles)}[pattern]
    return np.asarray(factor * one_cycle)


def mean_moves_rad(angles_rad: ArrayLike, *, cycles: int, pattern: Pattern) -> FloatArray:
    """Return the mean turn of the polarizer before the frames of each angle.

    The way back to the first angle is taken as the same distance, as for a stage that counts from its home.
    """
    angles = np.asarray(angles_rad, dtype=np.float64)
    if angles.size < 1 or cycles < 1:
        raise ValueError(f"angles = {angles.size}, cycles = {cycles}; allowed is 1 or more of each")
    forth = np.diff(angles, prepend=angles[0])
    if pattern == "grouped":
        return forth / cycles
    if pattern == "palindrome":
        back = np.diff(angles[::-1], prepend=angles[-1])[::-1]
        forward, backward = (cycles + 1) // 2, cycles // 2
        return (forward * forth + backward * back) / cycles
    back_to_first = np.zeros_like(angles)
    back_to_first[0] = angles[0] - angles[-1]
    return forth + back_to_first * (cycles - 1) / cycles


def least_drifting_order(angles_rad: ArrayLike) -> FloatArray:
    """Return the order of angles with the least false polarization in a cycle under linear drift.

    Parameters
    ----------
    angles_rad
        Shape (N,), 3 to 7 angles that are equally spaced over 180 deg [rad].

    Raises
    ------
    ValueError
        Too few or too many.

    Notes
    -----
    All orders are tried. If several are equally good, the one that begins with the smallest angles is returned. For
    0, 45, 90, 135 it is 0, 90, 45, 135: the false DoLP is 0.2357 times the change of the light from the first to the
    last frame, instead of 0.4714.

    References
    ----------
    definition: false (S1, S2) / S0 = 2 / N times the sum over the frames of relative change times (cos 2psi, sin 2psi).
    """
    angles = np.sort(np.asarray(angles_rad, dtype=np.float64))
    if not 3 <= angles.size <= _MOST_ORDERED:
        raise ValueError(f"{angles.size} angles; allowed is 3 to {_MOST_ORDERED}")
    orders = np.array(list(permutations(range(angles.size))))
    places = mean_places(angles.size, cycles=1, pattern="cycles")
    false = np.abs(np.exp(2j * angles[orders]) @ places)
    # Rounding should not decide between equals.
    best = int(np.argmax(false <= np.min(false) + 1e-9))
    return np.asarray(angles[orders[best]])


def degrees_text(angles_rad: ArrayLike) -> str:
    """Return angles as people read them: "0 90 45 135"."""
    return " ".join(f"{angle * 180.0 / pi:.4g}" for angle in np.asarray(angles_rad, dtype=np.float64))


# Errors of DoLP of a session against frames, angles, exposure and settling


@dataclass(frozen=True, kw_only=True)
class Session:
    """Frames of a session.

    Attributes
    ----------
    angles_rad
        Of the polarizer, in the order of their first frames [rad]; at least three different ones.
    pattern
        Order of the cycles.
    cycles
        Number of cycles, 1 or more.
    exposure_s
        Of a frame [s], above 0.
    settle_s
        Wait after the polarizer was turned [s], 0 or more.
    overhead_s
        Turning and storing, per frame [s], 0 or more.
    """

    angles_rad: tuple[float, ...]
    pattern: Pattern = "cycles"
    cycles: int = 1
    exposure_s: float
    settle_s: float = 0.0
    overhead_s: float = 0.0

    def __post_init__(self) -> None:
        if self.cycles < 1:
            raise ValueError(f"cycles = {self.cycles}; allowed is 1 or more")
        if not self.exposure_s > 0.0:
            raise ValueError(f"exposure_s = {self.exposure_s} s; allowed is above 0")
        for name in ("settle_s", "overhead_s"):
            if not getattr(self, name) >= 0.0:
                raise ValueError(f"{name} = {getattr(self, name)} s; allowed is 0 or more")

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.angles_rad) * self.cycles

    @property
    def frame_s(self) -> float:
        """Time from frame to frame [s]."""
        return self.exposure_s + self.settle_s + self.overhead_s

    @property
    def duration_s(self) -> float:
        """Time of all frames [s]."""
        return self.frames * self.frame_s


@dataclass(frozen=True, kw_only=True)
class Disturbances:
    """Errors common to all pixels.

    Attributes
    ----------
    drift_per_s
        Relative change of the light in time, taken as linear [1/s].
    settling_time_s
        Time in which the remaining turn of the polarizer falls to 1/e [s]; 0 if it has settled when it reports so.
    """

    drift_per_s: float = 0.0
    settling_time_s: float = 0.0

    def __post_init__(self) -> None:
        if not np.isfinite(self.drift_per_s):
            raise ValueError(f"drift_per_s = {self.drift_per_s} 1/s must be finite")
        if not self.settling_time_s >= 0.0:
            raise ValueError(f"settling_time_s = {self.settling_time_s} s; allowed is 0 or more")


@dataclass(frozen=True, kw_only=True, eq=False)
class CycleLight:
    """Counts behind each angle of one region in one cycle, and their noise.

    Attributes
    ----------
    plan
        Angles and inverse.
    channels_dn
        Mean counts, shape (N,) [DN].
    stokes_dn
        Mean Stokes parameters, shape (3,) [DN].
    noise_cov_dn2
        Covariance of the Stokes parameters of one pixel due to temporal noise in one cycle, shape (3, 3) [DN^2].
    spatial_cov_dn2
        Their covariance over the pixels due to scene and fixed pattern, shape (3, 3) [DN^2].
    saturation_probability
        Largest probability that a pixel is clipped at any angle.
    warnings
        Limits of the model, in words.
    """

    plan: Design
    channels_dn: FloatArray
    stokes_dn: FloatArray
    noise_cov_dn2: FloatArray
    spatial_cov_dn2: FloatArray
    saturation_probability: float
    warnings: tuple[str, ...]

    def cov_dn2(self, cycles: int) -> FloatArray:
        """Return the covariance over the pixels of a mean over cycles, shape (3, 3) [DN^2]."""
        return self.spatial_cov_dn2 + self.noise_cov_dn2 / cycles


@dataclass(frozen=True, kw_only=True)
class DolpBudget:
    """Errors of the DoLP of one region in the mean of all cycles.

    Attributes
    ----------
    dolp
        Of the light.
    sigma
        Standard deviation due to temporal noise; nan if it does not exist (light too weak).
    drift_error, settling_error
        Change of (S1, S2) / S0 due to drifting light and to an unsettled polarizer: an upper limit of the error of
        DoLP, which includes that of the angle of polarization.
    """

    dolp: float
    sigma: float
    drift_error: float
    settling_error: float

    @property
    def total(self) -> float:
        """Noise and systematic errors together: the latter add linearly, and in square to the noise."""
        return float(np.hypot(self.sigma, self.drift_error + self.settling_error))


def cycle_light(
    aperture: Moments, *, sensor: Sensor, angles_rad: tuple[float, ...], extinction_ratio: float = np.inf
) -> CycleLight:
    """Return the light and noise of a region in one cycle.

    Parameters
    ----------
    aperture
        Moments of the Stokes radiance at the aperture over the region [W m-2 sr-1, in band].
    sensor
        With the exposure of a frame.
    angles_rad
        Of the polarizer [rad].
    extinction_ratio
        Of the polarizer, as assumed by the processing.

    Raises
    ------
    ValueError
        Fewer than three angles differ, or an argument is outside its range.

    References
    ----------
    [MK14] eq. (11)-(23).
    """
    plan = design(angles_rad, extinction_ratio)
    channels = channel_moments(aperture, angles_rad=plan.angles_rad, sensor=sensor)
    spatial = channels.scene_cov_dn2 + channels.fixed_pattern_cov_dn2
    return CycleLight(
        plan=plan,
        channels_dn=channels.mean_dn,
        stokes_dn=plan.inverse @ channels.mean_dn,
        noise_cov_dn2=plan.inverse @ np.diag(channels.temporal_var_dn2) @ plan.inverse.T,
        spatial_cov_dn2=plan.inverse @ spatial @ plan.inverse.T,
        saturation_probability=float(np.max(channels.saturation_probability)),
        warnings=(*channels.warnings, *plan.warnings),
    )


def dolp_budget(light: CycleLight, session: Session, disturbances: Disturbances, *, pixels: int = 1) -> DolpBudget:
    """Return the errors of DoLP of a session.

    Parameters
    ----------
    light
        Of one cycle at the angles and the exposure of the session.
    session
        Order, cycles and times.
    disturbances
        Drift and settling.
    pixels
        Number of pixels averaged before DoLP is computed, 1 or more: their temporal noise is independent.

    Raises
    ------
    ValueError
        No pixel, or light of another number of angles than the session has.

    References
    ----------
    [MK14] eq. (24), (25) by the exact distribution of DoLP; drift and settling to first order: definition.
    """
    if pixels < 1:
        raise ValueError(f"pixels = {pixels}; allowed is 1 or more")
    if light.channels_dn.size != len(session.angles_rad):
        raise ValueError(f"light of {light.channels_dn.size} angles, a session of {len(session.angles_rad)}")
    s0, s1, s2 = light.stokes_dn
    return DolpBudget(
        dolp=float(np.hypot(s1, s2) / s0),
        sigma=dolp_sigma(light, cycles=session.cycles, pixels=pixels),
        drift_error=_false_polarization(light, _drift_dn(light, session, disturbances.drift_per_s)),
        settling_error=_false_polarization(light, _settling_dn(light, session, disturbances.settling_time_s)),
    )


@lru_cache(maxsize=8192)
def dolp_sigma(light: CycleLight, *, cycles: int, pixels: int = 1) -> float:
    """Return the standard deviation of DoLP from temporal noise, in the mean of cycles and pixels.

    Results are cached, because a search repeats light and number with other times and orders. From the exact
    distribution: for weak polarization it is 0.655 times the usual first-order NEDoLP. Nan if it does not exist.

    [MK14] eq. (25).
    """
    found = dolp.moments(light.stokes_dn, light.noise_cov_dn2 / (cycles * pixels), tolerance=1e-6)
    return float(found.std)


def _drift_dn(light: CycleLight, session: Session, drift_per_s: float) -> FloatArray:
    """Error of each angle's mean counts from linear drift, about its mean over the session."""
    places = mean_places(len(session.angles_rad), cycles=session.cycles, pattern=session.pattern)
    return np.asarray(drift_per_s * session.frame_s * places * light.channels_dn)


def _settling_dn(light: CycleLight, session: Session, settling_time_s: float) -> FloatArray:
    """Error of each angle's mean counts from the remaining turn."""
    if settling_time_s == 0.0:
        return np.zeros_like(light.channels_dn)
    moves = mean_moves_rad(session.angles_rad, cycles=session.cycles, pattern=session.pattern)
    short_by = -moves * exp(-session.settle_s / settling_time_s)
    _, s1, s2 = light.stokes_dn
    double = 2.0 * light.plan.angles_rad
    # Derivative of the row (1, cos 2 psi, sin 2 psi) / 2 of an ideal polarizer with respect to psi.
    slope = s2 * np.cos(double) - s1 * np.sin(double)
    return np.asarray(slope * short_by)


def _false_polarization(light: CycleLight, error_dn: FloatArray) -> float:
    """Change of (S1, S2) / S0 due to an error of the counts, to first order."""
    s0, s1, s2 = light.stokes_dn
    e0, e1, e2 = light.plan.inverse @ error_dn
    return float(np.hypot(e1 - s1 / s0 * e0, e2 - s2 / s0 * e0) / s0)


# The shortest session that reaches an error of DoLP, or a probability of detection

MOST_CYCLES = 100_000
# Share of clipped pixels above which counts are no longer linear in the light.
SATURATED = 1e-3


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """Goals of a session; None for no goal.

    Attributes
    ----------
    dolp_total
        Largest error of DoLP, noise and systematic errors in square.
    p_detection
        Least probability of detection of a pixel, in (0, 1), at `p_false_alarm`.
    p_false_alarm
        In (0, 1).
    """

    dolp_total: float | None = None
    p_detection: float | None = None
    p_false_alarm: float = 1e-3

    def __post_init__(self) -> None:
        if self.dolp_total is not None and not self.dolp_total > 0.0:
            raise ValueError(f"dolp_total = {self.dolp_total}; allowed is above 0")
        for name in ("p_detection", "p_false_alarm"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < 1.0:
                raise ValueError(f"{name} = {value}; allowed is between 0 and 1")


@dataclass(frozen=True, kw_only=True, eq=False)
class Scheme:
    """A way to take frames except for the number of cycles, and the light of each region in a cycle.

    Attributes
    ----------
    session
        Its cycles are set by the search.
    lights
        Light in one cycle by region.
    """

    session: Session
    lights: dict[str, CycleLight]

    @property
    def saturation_probability(self) -> float:
        """Largest probability that a pixel of any region is clipped."""
        return max(light.saturation_probability for light in self.lights.values())

    def detection(self, pair: tuple[str, str], *, cycles: int, p_false_alarm: float) -> float:
        """Return the probability to detect a pixel of the first region of a pair on the second."""
        target, background = (self.lights[name] for name in pair)
        return detection(target, background, cycles=cycles, p_false_alarm=p_false_alarm)


class Obstacle(Enum):
    """Reason why no number of cycles reaches the goals."""

    SATURATED = "saturated"
    CYCLES = "cycles"


@dataclass(frozen=True, kw_only=True, eq=False)
class Reached:
    """The session of a scheme that reaches the goals in the fewest cycles; or the reason why none does.

    Attributes
    ----------
    session
        With the cycles found; None if no number of them is enough.
    budgets
        Errors of DoLP by region; empty without a session.
    p_detection
        Of the requested pair; None without one.
    obstacle
        The obstacle; None with a session.
    why_not
        The same in words; empty with a session.
    """

    session: Session | None
    budgets: dict[str, DolpBudget]
    p_detection: float | None = None
    obstacle: Obstacle | None = None
    why_not: str = ""


@lru_cache(maxsize=8192)
def detection(target: CycleLight, background: CycleLight, *, cycles: int, p_false_alarm: float) -> float:
    """Return the probability to detect a pixel of one region among those of another in the mean of cycles.

    [MK14] eq. (30).
    """
    found = rx_p_detection(
        p_false_alarm,
        target.stokes_dn,
        target.cov_dn2(cycles),
        background.stokes_dn,
        background.cov_dn2(cycles),
    )
    return float(found)


def fewest_cycles(
    scheme: Scheme,
    wanted: Wanted,
    *,
    disturbances: Disturbances,
    regions: tuple[str, ...],
    pair: tuple[str, str] | None = None,
    pixels: int = 1,
) -> Reached:
    """Return the session of a scheme with the fewest cycles that reaches the goals.

    Parameters
    ----------
    scheme
        Angles, order, exposure and times.
    wanted
        Goals, all of which must be reached.
    disturbances
        Drift and settling.
    regions
        Each of them must reach the error of DoLP.
    pair
        Target and background of the detection.
    pixels
        Number averaged before DoLP is computed, 1 or more.

    Raises
    ------
    ValueError
        A detection is wanted without a pair, or an argument is outside its range.

    Notes
    -----
    Noise falls with every cycle; drift and settling do not, except for passes back and forth, which are taken in pairs.
    So bisection finds the number. Grouped frames, whose drift grows with their number, are refused.
    """
    if scheme.session.pattern == "grouped":
        raise ValueError("fewest_cycles: frames grouped by angle have no cycles to count; take cycles or a palindrome")
    if wanted.p_detection is not None and pair is None:
        raise ValueError("fewest_cycles: p_detection is wanted; state the pair of target and background")
    if scheme.saturation_probability > SATURATED:
        share = scheme.saturation_probability
        why_not = f"saturated: {share:.2g} of the pixels are clipped"
        return Reached(session=None, budgets={}, obstacle=Obstacle.SATURATED, why_not=why_not)
    step = 2 if scheme.session.pattern == "palindrome" else 1

    def at(count: int) -> Reached:
        return _evaluated(scheme, wanted, count * step, disturbances, regions, pair, pixels)

    return _first(at, lambda reached: _is_enough(reached, wanted), MOST_CYCLES // step)


def shortest(found: Iterable[Reached]) -> Reached | None:
    """Return the session that takes the least time; None where there is none."""
    reached = [one for one in found if one.session is not None]
    return min(reached, key=_duration_s) if reached else None


def _duration_s(reached: Reached) -> float:
    return np.inf if reached.session is None else reached.session.duration_s


def _evaluated(
    scheme: Scheme,
    wanted: Wanted,
    cycles: int,
    disturbances: Disturbances,
    regions: tuple[str, ...],
    pair: tuple[str, str] | None,
    pixels: int,
) -> Reached:
    session = replace(scheme.session, cycles=cycles)
    budgets = {name: dolp_budget(scheme.lights[name], session, disturbances, pixels=pixels) for name in regions}
    detected = None
    if pair is not None:
        detected = scheme.detection(pair, cycles=cycles, p_false_alarm=wanted.p_false_alarm)
    return Reached(session=session, budgets=budgets, p_detection=detected)


def _is_enough(reached: Reached, wanted: Wanted) -> bool:
    allowed = np.inf if wanted.dolp_total is None else wanted.dolp_total
    # A nan is not enough.
    if not all(budget.total <= allowed for budget in reached.budgets.values()):
        return False
    if wanted.p_detection is None:
        return True
    return reached.p_detection is not None and reached.p_detection >= wanted.p_detection


def _first(at: Callable[[int], Reached], enough: Callable[[Reached], bool], most: int) -> Reached:
    """Return the first sufficient element of a monotonic sequence; or the last, with the reason."""
    high, found = 1, at(1)
    while not enough(found) and high < most:
        high = min(2 * high, most)
        found = at(high)
    if not enough(found):
        return replace(found, session=None, obstacle=Obstacle.CYCLES, why_not=_why_not(found))
    low = high // 2
    while high - low > 1:
        middle = (low + high) // 2
        tried = at(middle)
        if enough(tried):
            high, found = middle, tried
        else:
            low = middle
    return found


def _why_not(last: Reached) -> str:
    """Describe the errors after the largest number of cycles."""
    parts = [
        f"{name}: noise {budget.sigma:.2g}, drift {budget.drift_error:.2g}, settling {budget.settling_error:.2g}"
        for name, budget in last.budgets.items()
    ]
    if last.p_detection is not None:
        parts.append(f"probability of detection {last.p_detection:.4f} (limited by texture and pattern)")
    return f"not within {MOST_CYCLES} cycles: " + "; ".join(parts)
