"""Sense, axis, extinction and W of a polarizer in its stage, from the scans of runs."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.polarimeter.analyzer import (
    AnalyzerChannels,
    Extinction,
    analyzer_channels,
    extinction,
    pooled_diattenuation,
)
from calibration.polarimeter.axis import AxisFit, fit_axis
from calibration.polarimeter.data_reduction import DataReduction, linear_states, measured_data_reduction
from calibration.polarimeter.fourier_fit import Harmonic, fit_fourier, residual_harmonics
from rigctl.config import Uncertain
from rigctl.polarimeter.scan_frames import AnalyzerScan, GeneratorScan

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class KnownLight:
    """What is known beforehand.

    Attributes
    ----------
    axis_error_rad : float
        Standard error of the direction of reference or generator [rad].
    dolp : Uncertain or None
        Degree of linear polarization of reference or generator.
    expected_rad, expected_error_rad : float or None, float
        The offset, roughly, and how well [rad].
    """

    axis_error_rad: float = 0.0
    dolp: Uncertain | None = None
    expected_rad: float | None = None
    expected_error_rad: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class PolarizerCalibration:
    """What was found; None is what the scans cannot tell.

    Attributes
    ----------
    axis : AxisFit
        Sense and offset.
    extinction : Extinction or None
        Extinction ratio.
    diattenuation, diattenuation_error : float or None
        Of the polarizer.
    channels : AnalyzerChannels or None
        Each analyzer angle by itself.
    stage_rad : (N,) array or None
        Stage angles of the channels [rad].
    reduction : DataReduction or None
        W, for intensities over twice their mean.
    harmonics : tuple of Harmonic
        What is left of Malus' law; of the scan that shows each best.
    frames : int
        Frames it was made from.
    """

    axis: AxisFit
    extinction: Extinction | None
    diattenuation: float | None
    diattenuation_error: float | None
    channels: AnalyzerChannels | None
    stage_rad: FloatArray | None
    reduction: DataReduction | None
    harmonics: tuple[Harmonic, ...]
    frames: int


def from_references(
    scans: Sequence[AnalyzerScan], references_rad: Sequence[float], known: KnownLight
) -> PolarizerCalibration:
    """Return the calibration by scans of the stage in front of fixed references."""
    fits = [fit_fourier(scan.stage_rad, scan.signal_dn) for scan in scans]
    axis = fit_axis(
        axis_rad=np.array(references_rad),
        stage_rad=np.array([float(fit.phase_rad) for fit in fits]),
        std_error_rad=np.array([float(fit.phase_error_rad()) for fit in fits]),
        common_error_rad=known.axis_error_rad,
        expected_rad=known.expected_rad,
        expected_error_rad=known.expected_error_rad,
    )
    weights = np.array([float(fit.modulation_error()) for fit in fits]) ** -2.0
    modulation = float(weights @ [float(fit.modulation) for fit in fits] / weights.sum())
    value, error = _diattenuation(modulation, float(weights.sum() ** -0.5), known.dolp)
    return PolarizerCalibration(
        axis=axis,
        extinction=None if value is None or error is None else extinction(value, error),
        diattenuation=value,
        diattenuation_error=error,
        channels=None,
        stage_rad=None,
        reduction=None,
        harmonics=_clearest([residual_harmonics(scan.stage_rad, scan.signal_dn) for scan in scans]),
        frames=sum(scan.frames for scan in scans),
    )


def from_generator(scan: GeneratorScan, known: KnownLight) -> PolarizerCalibration:
    """Return the calibration by a generator that turns; one that is not described is taken as perfect."""
    dolp = known.dolp or Uncertain(value=1.0)
    channels = analyzer_channels(scan.generator_rad, scan.signal_dn, generator_dolp=dolp.value)
    axis = fit_axis(
        axis_rad=channels.axis_rad,
        stage_rad=scan.stage_rad,
        std_error_rad=channels.axis_error_rad,
        common_error_rad=known.axis_error_rad,
        expected_rad=known.expected_rad,
        expected_error_rad=known.expected_error_rad,
    )
    pooled, pooled_error = (float(number) for number in pooled_diattenuation(channels))
    value, error = _diattenuation(pooled * dolp.value, pooled_error * dolp.value, dolp)
    return PolarizerCalibration(
        axis=axis,
        extinction=None if value is None or error is None else extinction(value, error),
        diattenuation=value,
        diattenuation_error=error,
        channels=channels,
        stage_rad=scan.stage_rad,
        reduction=_reduction(scan, dolp.value),
        harmonics=_clearest([residual_harmonics(scan.generator_rad, column) for column in scan.signal_dn.T]),
        frames=scan.frames,
    )


def _diattenuation(modulation: float, error: float, dolp: Uncertain | None) -> tuple[float | None, float | None]:
    if dolp is None:
        return None, None
    value = modulation / dolp.value
    return value, float(np.hypot(error / dolp.value, value * dolp.std / dolp.value))


def _reduction(scan: GeneratorScan, dolp: float) -> DataReduction | None:
    if len(scan.stage_rad) < 3:
        return None
    # A perfect analyzer passes half of unpolarized light, so that W gives Stokes parameters of S0 = 1.
    scaled = scan.signal_dn / (2.0 * scan.signal_dn.mean())
    return measured_data_reduction(linear_states(scan.generator_rad, dolp=dolp), scaled.T)


def _clearest(scans: Sequence[tuple[Harmonic, ...]]) -> tuple[Harmonic, ...]:
    best: dict[int, Harmonic] = {}
    for harmonic in (one for scan in scans for one in scan):
        before = best.get(harmonic.order)
        if before is None or harmonic.amplitude * before.std_error > before.amplitude * harmonic.std_error:
            best[harmonic.order] = harmonic
    return tuple(best[order] for order in sorted(best))
