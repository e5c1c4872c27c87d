"""The sensor behind a polarizer: from Stokes radiance at the aperture to mean and covariance of the counts.

`Sensor` is lens, exposure and detector, `SensorNoise` the detector's noise from a photon-transfer calibration, and
`Imperfections` the errors of a session: scattered angles, shifted pictures, drifting light. `channel_moments` takes the
moments of the radiance through all of them. The law of the rounded counts is in `model.counts`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.counts import ROUNDING_VAR_DN2, rounded_moments
from model.moments import Moments
from model.numerics import ndtr
from model.stokes import analyzer_row

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class SensorNoise:
    """Noise figures of a sensor, as a photon-transfer calibration gives them.

    Parameters
    ----------
    gain_dn_per_e
        Counts per electron, > 0 (the K of EMVA 1288; the reciprocal of a manual's "electrons per count").
    read_noise_e
        Standard deviation of the read noise [e-], >= 0, without quantisation.
    dark_current_e_per_s
        Dark current [e-/s], >= 0.
    black_level_dn
        Count without light or dark current [DN].
    prnu
        Photo-response non-uniformity, standard deviation relative to the mean, >= 0.
    dsnu_e
        Standard deviation of the dark signal over pixels [e-], >= 0; 0 if a dark frame is subtracted.
    noise_factor
        Kn, >= 0: multiplies the standard deviation of the temporal sensor noise, but not that of the scene.
    saturation_e
        Full well [e-], > 0, or None if the converter clips first.
    shot_noise, quantisation
        Whether the model includes shot noise of photo-electrons, and rounding of counts.

    Raises
    ------
    ValueError
        If a value is outside its range.

    References
    ----------
    [MK14] eq. (19), (32).
    """

    gain_dn_per_e: float
    read_noise_e: float
    dark_current_e_per_s: float
    black_level_dn: float
    prnu: float = 0.0
    dsnu_e: float = 0.0
    noise_factor: float = 1.0
    saturation_e: float | None = None
    shot_noise: bool = True
    quantisation: bool = True

    def __post_init__(self) -> None:
        _require("above 0", lambda value: value > 0.0, gain_dn_per_e=self.gain_dn_per_e)
        if self.saturation_e is not None:
            _require("above 0", lambda value: value > 0.0, saturation_e=self.saturation_e)
        _require(
            "at least 0",
            lambda value: value >= 0.0,
            read_noise_e=self.read_noise_e,
            dark_current_e_per_s=self.dark_current_e_per_s,
            prnu=self.prnu,
            dsnu_e=self.dsnu_e,
            noise_factor=self.noise_factor,
        )
        _require("any number", lambda _: True, black_level_dn=self.black_level_dn)


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """Optics, exposure and detector behind a linear polarizer.

    Parameters
    ----------
    pixel_pitch_m
        Side of a square pixel [m], > 0.
    f_number
        Focal length over aperture diameter, > 0 (at least 0.5 with the sine condition).
    optics_transmittance
        Transmittance of lens and filter in the band, without the polarizer, in (0, 1].
    quantum_efficiency
        Electrons per photon in the band, in (0, 1].
    wavelength_m
        Effective wavelength of the band [m], > 0; `effective_wavelength_m` gives it.
    exposure_s
        Exposure time of a frame [s], > 0.
    bit_depth
        Bits of a count, 1 to 32; the largest count is 2**bit_depth - 1.
    tau_parallel, tau_perpendicular
        Power transmittance of the polarizer along and across its axis,
        0 <= tau_perpendicular <= tau_parallel <= 1.
    noise
        Noise parameters.
    aperture
        "thin-lens": solid angle factor sin^2 = 1 / (1 + 4 f#^2), the form of [MK14];
        "sine": 1 / (4 f#^2), a lens that meets the sine condition.
    field_angle_rad
        Angle of the chief ray from the axis [rad], |angle| < pi/2; irradiance falls as its cos^4.
    saturates
        True computes the probabilities of clipping and warns of them.

    Raises
    ------
    ValueError
        If a value is outside its range.

    References
    ----------
    [MK14] eq. (14), (17).
    """

    pixel_pitch_m: float
    f_number: float
    optics_transmittance: float
    quantum_efficiency: float
    wavelength_m: float
    exposure_s: float
    bit_depth: int
    tau_parallel: float
    tau_perpendicular: float
    noise: SensorNoise
    aperture: Literal["thin-lens", "sine"] = "thin-lens"
    field_angle_rad: float = 0.0
    saturates: bool = True

    def __post_init__(self) -> None:
        _require(
            "above 0",
            lambda value: value > 0.0,
            pixel_pitch_m=self.pixel_pitch_m,
            f_number=self.f_number,
            wavelength_m=self.wavelength_m,
            exposure_s=self.exposure_s,
        )
        _require(
            "above 0 and at most 1",
            lambda value: 0.0 < value <= 1.0,
            optics_transmittance=self.optics_transmittance,
            quantum_efficiency=self.quantum_efficiency,
        )
        if self.bit_depth not in range(1, 33):
            raise ValueError(f"bit_depth = {self.bit_depth}; allowed is 1 to 32 bits")
        analyzer_row(0.0, self.tau_parallel, self.tau_perpendicular)
        if not abs(self.field_angle_rad) < 0.5 * np.pi:
            raise ValueError(f"field_angle_rad = {self.field_angle_rad} rad; allowed is below pi/2 in size")
        aperture_factor(self)


def aperture_factor(sensor: Sensor) -> float:
    """Return the squared sine of the half angle of the light cone at a pixel, times cos^4 of the field.

    The two forms differ by (1 + 4 f#^2) / (4 f#^2), 6 % at f/2.

    [MK14] eq. (17) for the thin lens; definition.
    """
    vignetting = float(np.cos(sensor.field_angle_rad)) ** 4
    if sensor.aperture == "thin-lens":
        return vignetting / (1.0 + 4.0 * sensor.f_number**2)
    if sensor.aperture != "sine":
        raise ValueError(f'aperture = {sensor.aperture!r}; allowed is "thin-lens" or "sine"')
    if sensor.f_number < 0.5:
        raise ValueError(f"f_number = {sensor.f_number}; with the sine condition at least 0.5 is allowed")
    return vignetting / (4.0 * sensor.f_number**2)


def _require(allowed: str, is_allowed: Callable[[float], bool], **values: float) -> None:
    for name, value in values.items():
        if not (np.isfinite(value) and is_allowed(value)):
            raise ValueError(f"{name} = {value}; allowed is finite and {allowed}")


# Exact by the definition of the units.
_PLANCK_J_S, _LIGHT_M_PER_S = 6.62607015e-34, 299_792_458.0


def electrons_per_radiance(sensor: Sensor) -> float:
    """Return the photo-electrons of a pixel and frame per unit of band radiance behind the polarizer.

    Differs from [MK14]: eq. (17) as printed lacks pi. With one effective wavelength the relative error is
    lambda_used / lambda_effective - 1, see `effective_wavelength_m`.

    [MK14] eq. (17).
    """
    energy = np.pi * aperture_factor(sensor) * sensor.pixel_pitch_m**2 * sensor.exposure_s
    efficiency = sensor.optics_transmittance * sensor.quantum_efficiency
    return float(energy / (_PLANCK_J_S * _LIGHT_M_PER_S)) * efficiency * sensor.wavelength_m


def counts_per_radiance(sensor: Sensor) -> float:
    """Return the counts of a pixel and frame behind the polarizer per unit of unpolarized band radiance.

    Parameters
    ----------
    sensor
        Optics, exposure, polarizer, quantum efficiency and gain.

    Returns
    -------
    float
        [DN per W m-2 sr-1], > 0: the mean over polarizer angles, without black level and dark signal.

    References
    ----------
    [MK14] eq. (11), (17), (19).
    """
    transmitted = 0.5 * (sensor.tau_parallel + sensor.tau_perpendicular)
    return sensor.noise.gain_dn_per_e * electrons_per_radiance(sensor) * transmitted


def effective_wavelength_m(wavelength_m: ArrayLike, weight: ArrayLike) -> float:
    """Return the wavelength that makes the band form of the electron equation exact.

    Parameters
    ----------
    wavelength_m
        Samples [m], shape (K,), K >= 2, increasing.
    weight
        Spectral radiance times transmittance, quantum efficiency and response at the samples, shape (K,),
        >= 0.

    Returns
    -------
    float
        int w lambda dlambda / int w dlambda [m], by the trapezoidal rule.

    Raises
    ------
    ValueError
        If the samples do not increase, or no weight is positive.
    """
    wavelength = np.asarray(wavelength_m, dtype=np.float64)
    if wavelength.ndim != 1 or wavelength.size < 2 or np.any(np.diff(wavelength) <= 0.0) or wavelength[0] <= 0:
        raise ValueError("wavelength_m must be two or more increasing samples above 0 m")
    steps = np.diff(wavelength)
    reach = 0.5 * (np.append(0.0, steps) + np.append(steps, 0.0))
    weights = np.asarray(weight, dtype=np.float64) * reach
    total = float(np.sum(weights))
    if np.any(weights < 0.0) or not total > 0.0:
        raise ValueError("weight must be >= 0 everywhere and > 0 somewhere")
    return float(np.sum(weights * wavelength)) / total


@dataclass(frozen=True, kw_only=True)
class Imperfections:
    """Errors that a session adds to a scene; none by default.

    Parameters
    ----------
    polarizer_angle_std_rad
        Standard deviation of the polarizer's true angle about the recorded one, normal and independent from frame to
        frame [rad], 0 to 0.5.
    misregistration_pixels
        Standard deviation of the shift of the picture from frame to frame along each axis, normal and independent
        [pixels], >= 0.
    texture_correlation_pixels
        Distance at which the correlation of the texture has fallen to exp(-1/2) [pixels], > 0.
    drift
        Change of the light from the first frame of a cycle to the last, linear in time, over its mean; -1 to 1.
    drift_order
        Place of each angle's frame in the cycle, from 0; empty: in the order of the angles.
    surround_albedo
        Of the near surroundings if it differs from that of the mean ground, 0 to 1; or None.
    off_axis_falloff
        Whether light falls off as cos^4 over a region's part of the field, as without a flat field.

    Raises
    ------
    ValueError
        If a value is outside its range.
    """

    polarizer_angle_std_rad: float = 0.0
    misregistration_pixels: float = 0.0
    texture_correlation_pixels: float = 1.0
    drift: float = 0.0
    drift_order: tuple[int, ...] = ()
    surround_albedo: float | None = None
    off_axis_falloff: bool = False

    def __post_init__(self) -> None:
        _require("0 to 0.5 rad", lambda x: 0.0 <= x <= 0.5, polarizer_angle_std_rad=self.polarizer_angle_std_rad)
        _require("0 to 1e6", lambda x: 0.0 <= x <= 1e6, misregistration_pixels=self.misregistration_pixels)
        _require("1e-6 to 1e6", lambda x: 1e-6 <= x <= 1e6, texture_correlation_pixels=self.texture_correlation_pixels)
        _require("-1 to 1", lambda x: -1.0 <= x <= 1.0, drift=self.drift)
        if self.surround_albedo is not None:
            _require("0 to 1", lambda x: 0.0 <= x <= 1.0, surround_albedo=self.surround_albedo)

    @property
    def kept_polarization(self) -> float:
        """Factor exp(-2 s^2) of the mean of cos 2 psi for angles that scatter by s."""
        return float(np.exp(-2.0 * self.polarizer_angle_std_rad**2))

    @property
    def kept_correlation(self) -> float:
        """Correlation of texture between two independently shifted frames.

        The texture's autocorrelation is exp(-r^2 / 2 l^2); the difference of two shifts of deviation d has 2 d^2 along
        each axis, and the mean of the autocorrelation over it is 1 / (1 + 2 d^2 / l^2).
        """
        ratio = self.misregistration_pixels / self.texture_correlation_pixels
        return 1.0 / (1.0 + 2.0 * ratio**2)

    def analyzed(self, rows: FloatArray) -> FloatArray:
        """Return the rows of an analyzer, shape (N, 3), with drift and scatter of the angles."""
        factors = self.light_factors(len(rows))[:, None] if self.drift else 1.0
        kept = np.array([1.0, self.kept_polarization, self.kept_polarization])
        return np.asarray(rows * kept * factors)

    def light_factors(self, frames: int) -> FloatArray:
        """Return the light of each angle's frame over the mean of the cycle, shape (N,).

        Raises
        ------
        ValueError
            The order does not fit the number of frames.
        """
        order = self.drift_order or tuple(range(frames))
        if sorted(order) != list(range(frames)):
            raise ValueError(f"drift_order = {order}; allowed is each of 0 to {frames - 1} once")
        return drifting_light(self.drift, order)


def drifting_light(drift: float, order: ArrayLike) -> FloatArray:
    """Return the light of each frame over its mean under a linear drift in the cycle.

    Parameters
    ----------
    drift
        Relative change from the first frame of a cycle to the last, above -2 and below 2.
    order
        Place of each angle's frame in the cycle, from 0, shape (N,), N >= 2.
    """
    places = np.asarray(order, dtype=np.float64)
    return np.asarray(1.0 + drift * (places / (places.size - 1) - 0.5))


def angle_variance(second_moment: FloatArray, *, angles_rad: FloatArray, std_rad: float) -> FloatArray:
    """Return the variance of S1 cos 2 psi + S2 sin 2 psi for psi normal about each angle.

    With u the value at the mean angle, w that 45 deg on, and q = exp(-8 s^2):
    u^2 (1 - sqrt q)^2 / 2 + w^2 (1 - q) / 2. For small s it is (2 s w)^2.

    Definition: moments of cos and sin of a normal angle.
    """
    # expm1 keeps the digits of a small scatter.
    lost, crossed = -np.expm1(-4.0 * std_rad**2), -np.expm1(-8.0 * std_rad**2)
    cosine, sine = np.cos(2.0 * angles_rad), np.sin(2.0 * angles_rad)
    at, across = np.stack([cosine, sine], axis=-1), np.stack([-sine, cosine], axis=-1)
    polarised = second_moment[..., 1:, 1:]
    u2, w2 = (np.einsum("ni,...ij,nj->...n", rows, polarised, rows) for rows in (at, across))
    return np.asarray(0.5 * u2 * lost**2 + 0.5 * w2 * crossed)


PERFECT = Imperfections()


def temporal_variance_dn2(signal_dn: ArrayLike, *, noise: SensorNoise, exposure_s: ArrayLike) -> FloatArray:
    """Return the variance of a pixel's counts from frame to frame of a constant scene.

    Parameters
    ----------
    signal_dn
        Mean signal without black level and dark signal, any shape [DN].
    noise
        Noise parameters.
    exposure_s
        Exposure time, broadcast against the signal [s].

    Returns
    -------
    ndarray
        Kn^2 (shot noise of light and dark electrons + read noise + 1/12) [DN^2].

    Notes
    -----
    Differs from [MK14]: the signal in eq. (19) excludes the black level and includes dark electrons.

    References
    ----------
    [MK14] eq. (19), (32).
    """
    variance = unquantised_variance_dn2(signal_dn, noise=noise, exposure_s=exposure_s)
    rounding = ROUNDING_VAR_DN2 if noise.quantisation else 0.0
    return np.asarray(noise.noise_factor**2 * (variance + rounding))


def unquantised_variance_dn2(signal_dn: ArrayLike, *, noise: SensorNoise, exposure_s: ArrayLike) -> FloatArray:
    """Return the temporal variance before rounding and without the noise factor [DN^2].

    [MK14] eq. (19).
    """
    gain = noise.gain_dn_per_e
    dark_dn = gain * noise.dark_current_e_per_s * np.asarray(exposure_s, dtype=np.float64)
    light_dn = np.asarray(signal_dn, dtype=np.float64) * (1.0 if noise.shot_noise else 0.0)
    return np.asarray(gain * (light_dn + dark_dn) + (gain * noise.read_noise_e) ** 2)


def saturation_probability(
    sensor: Sensor, level: FloatArray, unquantised_var: FloatArray, spatial_cov: FloatArray
) -> FloatArray:
    """Return the larger probability of clipping, in the converter or in the pixel's well.

    Definition; counts are taken as normal.
    """
    noise = sensor.noise
    spatial = np.diagonal(spatial_cov, axis1=-2, axis2=-1)
    top = 2.0**sensor.bit_depth - 0.5 - noise.black_level_dn
    clipped = _exceedance(level, top, unquantised_var + spatial)
    if noise.saturation_e is None:
        return clipped
    well = noise.gain_dn_per_e * noise.saturation_e
    in_well = unquantised_var - (noise.gain_dn_per_e * noise.read_noise_e) ** 2 + spatial
    return np.maximum(clipped, _exceedance(level, well, in_well))


def _exceedance(mean: FloatArray, limit: float, var: FloatArray) -> FloatArray:
    sigma = np.sqrt(np.maximum(var, 0.0))
    certain = (mean > limit).astype(np.float64)
    return np.where(sigma > 0.0, ndtr((mean - limit) / np.where(sigma > 0.0, sigma, 1.0)), certain)


# Noise below which rounding is not dithered: its mean is off by exp(-2 pi^2 sigma^2) / pi, here 0.05 counts.
_DITHER_LIMIT_DN = 0.3
# Probability of clipping above which the linear model fails.
_SATURATION_LIMIT = 1e-3


@dataclass(frozen=True, kw_only=True)
class ChannelMoments:
    """Moments of the counts behind each polarizer angle, per pixel.

    Parameters
    ----------
    mean_dn
        Mean signal without black level and dark signal, shape (..., N) [DN].
    dark_signal_dn
        Subtracted dark signal: gain times dark electrons [DN].
    scene_cov_dn2
        Covariance from the scene, shape (..., N, N) [DN^2].
    temporal_var_dn2
        Variance from frame to frame of a constant scene, shape (..., N), independent between frames [DN^2].
    fixed_pattern_cov_dn2
        Covariance over pixels from PRNU and DSNU, shape (..., N, N) [DN^2].
    saturation_probability
        Probability that a pixel of the region is clipped, shape (..., N).
    warnings
        Limits of the Gaussian linear model, in words.
    """

    mean_dn: FloatArray
    dark_signal_dn: float
    scene_cov_dn2: FloatArray
    temporal_var_dn2: FloatArray
    fixed_pattern_cov_dn2: FloatArray
    saturation_probability: FloatArray
    warnings: tuple[str, ...]


def channel_moments(
    aperture: Moments,
    *,
    angles_rad: ArrayLike,
    sensor: Sensor,
    flat_fielded: bool = False,
    imperfections: Imperfections = PERFECT,
    smooth_cov: FloatArray | None = None,
) -> ChannelMoments:
    """Return mean and covariance of the counts behind a polarizer at each angle.

    The law of total covariance is exact here, since the variance of counts is linear in the light: the scene
    adds its own covariance and the temporal variance is taken at the mean.

    Scatter s of the angles weakens the mean of the polarised part by exp(-2 s^2) and adds a variance from frame to
    frame, common to all pixels of a frame, to the temporal variance. Shifts lower the covariance of the texture between
    frames but not its variances.

    Differs from [MK14]: eq. (19) is taken with the black level off and dark electrons in. PRNU and DSNU, which [MK14]
    does not have, are fully correlated between angles, because in division of time the same pixel serves every angle:
    prnu^2 (s s' + Sigma_scene) + (gain dsnu)^2 1 1'. A PRNU pattern does not change DoLP to first order; a DSNU pattern
    acts like an error of S0.

    [MK14] eq. (11)-(20), (32).
    """
    angles = np.atleast_1d(np.asarray(angles_rad, dtype=np.float64))
    rows = imperfections.analyzed(analyzer_row(angles, sensor.tau_parallel, sensor.tau_perpendicular))
    to_dn = sensor.noise.gain_dn_per_e * electrons_per_radiance(sensor) * rows
    signal = np.einsum("ij,...j->...i", to_dn, aperture.mean)
    signal = _without_negative_rounding(signal, aperture.mean[..., :1] * to_dn[:, 0])
    scene = _scene_covariance(aperture.cov, smooth_cov, to_dn, imperfections)
    dark = sensor.noise.gain_dn_per_e * sensor.noise.dark_current_e_per_s * sensor.exposure_s
    unquantised = unquantised_variance_dn2(signal, noise=sensor.noise, exposure_s=sensor.exposure_s)
    pattern = _fixed_pattern(signal, scene, sensor.noise, flat_fielded=flat_fielded)
    temporal = temporal_variance_dn2(signal, noise=sensor.noise, exposure_s=sensor.exposure_s)
    if sensor.noise.quantisation:
        level = sensor.noise.black_level_dn + dark + signal
        photons = unquantised - (sensor.noise.gain_dn_per_e * sensor.noise.read_noise_e) ** 2
        third = sensor.noise.gain_dn_per_e * photons
        temporal, scene, pattern = _rounded(level, unquantised, third, temporal, scene, pattern)
    temporal = temporal + _angle_variance_dn2(aperture, sensor, angles, imperfections)
    clipped = np.zeros_like(signal)
    if sensor.saturates:
        clipped = saturation_probability(sensor, signal + dark, unquantised, scene + pattern)
    return ChannelMoments(
        mean_dn=signal,
        dark_signal_dn=dark,
        scene_cov_dn2=scene,
        temporal_var_dn2=temporal,
        fixed_pattern_cov_dn2=pattern,
        saturation_probability=clipped,
        warnings=_warnings(angles, np.sqrt(unquantised) if sensor.noise.quantisation else None, clipped),
    )


# Variance that dithers rounding, to 1e-12 of it.
_DITHERED_DN2 = 1.5


def _rounded(
    level: FloatArray,
    unquantised: FloatArray,
    third: FloatArray,
    temporal: FloatArray,
    scene: FloatArray,
    pattern: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return variance from frame to frame and covariances over the pixels of rounded counts.

    The mean stays that of the signal, like measured means (`model.counts.estimate_signal`).
    """
    spread = np.diagonal(scene + pattern, axis1=-2, axis2=-1)
    if np.all(unquantised + spread > _DITHERED_DN2):
        return temporal, scene, pattern
    own = rounded_moments(level, unquantised, spread, third)[1]
    whole = rounded_moments(level, unquantised + spread, 0.0, third)[1]
    kept = np.sqrt(np.where(spread > 0.0, np.maximum(whole - own, 0.0) / np.where(spread > 0.0, spread, 1.0), 1.0))
    factor = kept[..., :, None] * kept[..., None, :]
    return temporal + own - unquantised - ROUNDING_VAR_DN2, scene * factor, pattern * factor


def _scene_covariance(
    cov: FloatArray, smooth_cov: FloatArray | None, to_dn: FloatArray, imperfections: Imperfections
) -> FloatArray:
    whole = to_dn @ cov @ to_dn.T
    if imperfections.misregistration_pixels == 0.0:
        return np.asarray(whole)
    smooth = np.zeros_like(whole) if smooth_cov is None else to_dn @ smooth_cov @ to_dn.T
    sharp, kept = whole - smooth, imperfections.kept_correlation
    own = np.eye(to_dn.shape[0])
    return np.asarray(smooth + sharp * (kept + (1.0 - kept) * own))


def _angle_variance_dn2(
    aperture: Moments, sensor: Sensor, angles_rad: FloatArray, imperfections: Imperfections
) -> FloatArray | float:
    if imperfections.polarizer_angle_std_rad == 0.0:
        return 0.0
    second = aperture.cov + aperture.mean[..., :, None] * aperture.mean[..., None, :]
    found = angle_variance(second, angles_rad=angles_rad, std_rad=imperfections.polarizer_angle_std_rad)
    half = 0.5 * (sensor.tau_parallel - sensor.tau_perpendicular)
    to_dn = sensor.noise.gain_dn_per_e * electrons_per_radiance(sensor) * half
    return np.asarray((to_dn * imperfections.light_factors(angles_rad.size)) ** 2 * found)


def _without_negative_rounding(signal: FloatArray, scale: FloatArray) -> FloatArray:
    """Set values to zero that are negative by rounding (light across an ideal polarizer); refuse others."""
    bound = 1e-12 * np.abs(scale)
    if np.any(signal < -bound):
        raise ValueError(
            f"aperture has a mean that gives negative light behind the polarizer ({np.min(signal):.3g} DN); "
            "allowed is DoLP <= 1 and S0 >= 0"
        )
    return np.where(signal < 0.0, 0.0, signal)


def _fixed_pattern(signal: FloatArray, scene: FloatArray, noise: SensorNoise, *, flat_fielded: bool) -> FloatArray:
    prnu = 0.0 if flat_fielded else noise.prnu
    # The response of a pixel also multiplies its texture, hence the scene's covariance.
    response = prnu**2 * (signal[..., :, None] * signal[..., None, :] + scene)
    return np.asarray(response + (noise.gain_dn_per_e * noise.dsnu_e) ** 2)


def _warnings(angles_rad: FloatArray, sigma_dn: FloatArray | None, clipped: FloatArray) -> tuple[str, ...]:
    found = []
    if sigma_dn is not None and np.any(sigma_dn < _DITHER_LIMIT_DN):
        where = _channels(angles_rad, sigma_dn < _DITHER_LIMIT_DN)
        found.append(
            f"noise before rounding is {np.min(sigma_dn):.3g} counts at {where}, below {_DITHER_LIMIT_DN}: rounding is "
            "not dithered and the Gaussian model does not hold"
        )
    if np.any(clipped > _SATURATION_LIMIT):
        where = _channels(angles_rad, clipped > _SATURATION_LIMIT)
        found.append(
            f"the probability of saturation is {np.max(clipped):.3g} at {where}, above {_SATURATION_LIMIT:g}: the "
            "linear model does not hold"
        )
    return tuple(found)


def _channels(angles_rad: FloatArray, affected: NDArray[np.bool_]) -> str:
    any_pixel = affected.reshape(-1, angles_rad.size).any(axis=0)
    return ", ".join(f"{angle:.4g}" for angle in np.rad2deg(angles_rad[any_pixel])) + " deg"
