"""Sensor: optics, exposure and detector behind a linear polarizer, and the detector's noise."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from model.stokes import analyzer_row


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
        Standard deviation of the dark signal over pixels [e-], >= 0; 0 if a dark frame is taken off.
    noise_factor
        Kn, >= 0: multiplies the standard deviation of the temporal sensor noise, and nothing of the scene.
    saturation_e
        Full well [e-], > 0, or None if the converter clips first.
    shot_noise, quantisation
        Whether photo-electrons bring shot noise, and whether counts are rounded; False leaves that out of the model.

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
        _require_positive(gain_dn_per_e=self.gain_dn_per_e)
        if self.saturation_e is not None:
            _require_positive(saturation_e=self.saturation_e)
        _require_not_negative(
            read_noise_e=self.read_noise_e,
            dark_current_e_per_s=self.dark_current_e_per_s,
            prnu=self.prnu,
            dsnu_e=self.dsnu_e,
            noise_factor=self.noise_factor,
        )
        if not np.isfinite(self.black_level_dn):
            raise ValueError(f"black_level_dn = {self.black_level_dn} DN is not finite")


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
        Effective wavelength of the band [m], > 0; `model.sensor.electrons` gives it, and the form for a band
        resolved into samples.
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
        Whether chances of clipping are computed and warned of.

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
        _require_positive(
            pixel_pitch_m=self.pixel_pitch_m,
            f_number=self.f_number,
            wavelength_m=self.wavelength_m,
            exposure_s=self.exposure_s,
        )
        _require_fraction(optics_transmittance=self.optics_transmittance, quantum_efficiency=self.quantum_efficiency)
        if self.bit_depth not in range(1, 33):
            raise ValueError(f"bit_depth = {self.bit_depth}; allowed is 1 to 32 bits")
        analyzer_row(0.0, self.tau_parallel, self.tau_perpendicular)
        if not abs(self.field_angle_rad) < 0.5 * np.pi:
            raise ValueError(f"field_angle_rad = {self.field_angle_rad} rad; allowed is below pi/2 in size")
        aperture_factor(self)


def aperture_factor(sensor: Sensor) -> float:
    """Return the squared sine of the half angle of the light cone at a pixel, times cos^4 of the field.

    Parameters
    ----------
    sensor
        Uses `f_number`, `aperture` and `field_angle_rad`.

    Returns
    -------
    float
        Image irradiance is pi times radiance times this, in (0, 1].

    Raises
    ------
    ValueError
        For an unknown form, or the sine condition below f/0.5.

    Notes
    -----
    The two forms differ by (1 + 4 f#^2) / (4 f#^2), 6 % at f/2.

    References
    ----------
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


def _require_positive(**values: float) -> None:
    for name, value in values.items():
        if not (value > 0.0 and np.isfinite(value)):
            raise ValueError(f"{name} = {value}; allowed is finite and above 0")


def _require_not_negative(**values: float) -> None:
    for name, value in values.items():
        if not (value >= 0.0 and np.isfinite(value)):
            raise ValueError(f"{name} = {value}; allowed is finite and at least 0")


def _require_fraction(**values: float) -> None:
    for name, value in values.items():
        if not 0.0 < value <= 1.0:
            raise ValueError(f"{name} = {value}; allowed is above 0 and at most 1")
