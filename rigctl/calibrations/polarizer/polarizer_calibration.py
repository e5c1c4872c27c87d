"""Sense, axis, extinction and W of a polarizer in its stage, from the scans of runs."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.polarimeter.analyzer import (
    AnalyzerChannels,
    AxisCandidate,
    AxisFit,
    DataReduction,
    Extinction,
    FourierFit,
    Harmonic,
    analyzer_channels,
    extinction,
    fit_axis,
    fit_fourier,
    harmonics_are_told_apart,
    linear_states,
    measured_data_reduction,
    pooled_diattenuation,
    residual_harmonics,
)
from rigctl.calibrations.checked_values import Measured
from rigctl.calibrations.polarizer.scan_frames import AnalyzerScan, GeneratorScan
from rigctl.errors import DataError
from rigctl.files.config import Uncertain

FloatArray = NDArray[np.float64]

# What is not so many of its own errors above 0 is not there.
_SEEN_SIGMAS = 5.0


@dataclass(frozen=True, kw_only=True)
class KnownLight:
    """Light of a scan, as far as it is known beforehand.

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
class ScanCurve:
    """Light against the angle of what turned, and the law fitted to it.

    Attributes
    ----------
    label : str
        What stood still, such as "stage at 45.0 deg".
    angle_rad, signal_dn : (K,) arrays
        Points of the scan.
    fit : FourierFit
        Malus' law.
    harmonics : tuple of Harmonic
        What the law leaves.
    """

    label: str
    angle_rad: FloatArray
    signal_dn: FloatArray
    fit: FourierFit
    harmonics: tuple[Harmonic, ...]

    @classmethod
    def of(cls, label: str, angle_rad: FloatArray, signal_dn: FloatArray) -> "ScanCurve":
        """Return the curve of a scan.

        Raises
        ------
        DataError
            It has no light, or its light does not change with the angle.
        """
        fit = fit_fourier(angle_rad, signal_dn)
        if float(fit.terms[0]) < _SEEN_SIGMAS * float(fit.mean_error()):
            raise DataError(f"{label}: there is no light above the dark level: check dark frames and region")
        if float(fit.modulation) < _SEEN_SIGMAS * float(fit.modulation_error()):
            raise DataError(
                f"{label}: the light changes with the angle by no more than noise ({float(fit.modulation):.2%} +- "
                f"{float(fit.modulation_error()):.2%}): is the polarizer, and what polarizes the light, in its place?"
            )
        return cls(
            label=label,
            angle_rad=angle_rad,
            signal_dn=signal_dn,
            fit=fit,
            harmonics=residual_harmonics(angle_rad, signal_dn),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class PolarizerCalibration:
    """A polarizer in its stage; None is what the scans cannot tell.

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
    curves : tuple of ScanCurve
        The scans.
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
    curves: tuple[ScanCurve, ...]
    frames: int

    @property
    def offset_deg(self) -> Measured[float]:
        """Polarizer angle where the stage stands at 0, of the sense that fits better [deg]."""
        return candidate_offset_deg(self.axis.best)

    @property
    def harmonics_told_apart(self) -> bool:
        """The scans go far enough round to tell the harmonics apart."""
        return all(harmonics_are_told_apart(curve.angle_rad) for curve in self.curves)


def candidate_offset_deg(candidate: AxisCandidate) -> Measured[float]:
    """Return the offset of a sense [deg]."""
    value, error = np.degrees([candidate.offset_rad, candidate.std_error_rad]).tolist()
    return Measured(value=value, std_error=error)


def from_references(
    scans: Sequence[AnalyzerScan], references_rad: Sequence[float], known: KnownLight
) -> PolarizerCalibration:
    """Return the calibration by scans of the stage in front of fixed references."""
    curves = tuple(
        ScanCurve.of(f"reference at {np.degrees(reference):.1f} deg", scan.stage_rad, scan.signal_dn)
        for scan, reference in zip(scans, references_rad, strict=True)
    )
    fits = [curve.fit for curve in curves]
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
        harmonics=_clearest(curves),
        curves=curves,
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
    curves = tuple(
        ScanCurve.of(f"stage at {np.degrees(stage):.1f} deg", scan.generator_rad, column)
        for stage, column in zip(scan.stage_rad.tolist(), scan.signal_dn.T, strict=True)
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
        harmonics=_clearest(curves),
        curves=curves,
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


def _clearest(curves: Sequence[ScanCurve]) -> tuple[Harmonic, ...]:
    best: dict[int, Harmonic] = {}
    for harmonic in (one for curve in curves for one in curve.harmonics):
        before = best.get(harmonic.order)
        if before is None or harmonic.amplitude * before.std_error > before.amplitude * harmonic.std_error:
            best[harmonic.order] = harmonic
    return tuple(best[order] for order in sorted(best))
