"""Errors of DoLP of a session against frames, angles, exposure and settling."""

from dataclasses import dataclass
from functools import lru_cache
from math import exp

import numpy as np
from numpy.typing import NDArray

from model.acquisition.frame_order import Pattern, mean_moves_rad, mean_places
from model.moments import Moments
from model.processing import dolp
from model.processing.reconstruction import Design, design
from model.sensor.channels import channel_moments
from model.sensor.sensor import Sensor

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Session:
    """Frames of a session.

    Attributes
    ----------
    angles_rad
        Of the polarizer, in the order in which they are first taken [rad]; three that differ, or more.
    pattern
        How cycles follow one another.
    cycles
        How many times all angles are gone through, 1 or more.
    exposure_s
        Of a frame [s], above 0.
    settle_s
        Wait after the polarizer was turned [s], 0 or more.
    overhead_s
        Turning and storing, each frame [s], 0 or more.
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
    """Errors common to all pixels, which more of them do not average out.

    Attributes
    ----------
    drift_per_s
        Relative change of the light in time, taken as linear [1/s].
    settling_time_s
        Time in which what is left of a turn of the polarizer falls to 1/e [s]; 0 if it stands when it says so.
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
        Covariance of the Stokes parameters of one pixel by temporal noise in one cycle, shape (3, 3) [DN^2].
    spatial_cov_dn2
        Their covariance over the pixels by scene and fixed pattern, shape (3, 3) [DN^2].
    saturation_probability
        Largest chance that a pixel is clipped behind any angle.
    warnings
        Where the model is void or poor, in words.
    """

    plan: Design
    channels_dn: FloatArray
    stokes_dn: FloatArray
    noise_cov_dn2: FloatArray
    spatial_cov_dn2: FloatArray
    saturation_probability: float
    warnings: tuple[str, ...]

    def cov_dn2(self, cycles: int) -> FloatArray:
        """Return the covariance over the pixels of the mean of so many cycles, shape (3, 3) [DN^2]."""
        return self.spatial_cov_dn2 + self.noise_cov_dn2 / cycles


@dataclass(frozen=True, kw_only=True)
class DolpBudget:
    """Errors of the DoLP of one region that is taken from the mean of all cycles.

    Attributes
    ----------
    dolp
        Of the light.
    sigma
        Standard deviation by temporal noise; not a number where it does not exist (light too weak).
    drift_error, settling_error
        Change of (S1, S2) / S0 by drifting light and by a polarizer that has not settled: no error of DoLP is larger,
        and that of the angle of polarization is in it too.
    """

    dolp: float
    sigma: float
    drift_error: float
    settling_error: float

    @property
    def total(self) -> float:
        """Noise and systematic errors together: the latter add in the worst case, and in square to the noise."""
        return float(np.hypot(self.sigma, self.drift_error + self.settling_error))


def cycle_light(
    aperture: Moments, *, sensor: Sensor, angles_rad: tuple[float, ...], extinction_ratio: float = np.inf
) -> CycleLight:
    """Return what one cycle shows of a region.

    Parameters
    ----------
    aperture
        Moments of the Stokes radiance at the aperture over the region [W m-2 sr-1, in band].
    sensor
        With the exposure of a frame.
    angles_rad
        Of the polarizer [rad].
    extinction_ratio
        Of the polarizer, as the processing takes it to be.

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
    """Return the errors of DoLP that a session leaves.

    Parameters
    ----------
    light
        Of one cycle at the angles and the exposure of the session.
    session
        Order, cycles and times.
    disturbances
        Drift and settling.
    pixels
        How many pixels are averaged before DoLP is taken, 1 or more: their temporal noise is independent.

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
    """Return the standard deviation that temporal noise gives DoLP from the mean of cycles and pixels.

    Parameters
    ----------
    light
        Of one cycle.
    cycles, pixels
        How many of each are averaged, 1 or more.

    Notes
    -----
    What was computed is kept: a search asks for the same light and number again, with other times and orders.
    By the exact distribution, not the first order: for weak polarization it is 0.655 times the usual NEDoLP, not it.
    Not a number where no standard deviation exists.

    References
    ----------
    [MK14] eq. (25).
    """
    found = dolp.moments(light.stokes_dn, light.noise_cov_dn2 / (cycles * pixels), tolerance=1e-6)
    return float(found.std)


def _drift_dn(light: CycleLight, session: Session, drift_per_s: float) -> FloatArray:
    """Error of each angle's mean counts by light that changes linearly, about its mean over the session."""
    places = mean_places(len(session.angles_rad), cycles=session.cycles, pattern=session.pattern)
    return np.asarray(drift_per_s * session.frame_s * places * light.channels_dn)


def _settling_dn(light: CycleLight, session: Session, settling_time_s: float) -> FloatArray:
    """Error of each angle's mean counts by what is left of the turn into it."""
    if settling_time_s == 0.0:
        return np.zeros_like(light.channels_dn)
    moves = mean_moves_rad(session.angles_rad, cycles=session.cycles, pattern=session.pattern)
    short_by = -moves * exp(-session.settle_s / settling_time_s)
    _, s1, s2 = light.stokes_dn
    double = 2.0 * light.plan.angles_rad
    # Derivative of the row (1, cos 2 psi, sin 2 psi) / 2 of an ideal polarizer by psi.
    slope = s2 * np.cos(double) - s1 * np.sin(double)
    return np.asarray(slope * short_by)


def _false_polarization(light: CycleLight, error_dn: FloatArray) -> float:
    """Change of (S1, S2) / S0 by an error of the counts, to first order."""
    s0, s1, s2 = light.stokes_dn
    e0, e1, e2 = light.plan.inverse @ error_dn
    return float(np.hypot(e1 - s1 / s0 * e0, e2 - s2 / s0 * e0) / s0)
