"""Model beside measurement without a scene: a run's own means and texture through the noise model and the DoLP law."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.prediction import RegionPrediction, predict_region
from model.processing.agreement import propagate_inputs
from model.processing.law_check import check_dolp_law
from model.sensor import ChannelMoments, SensorNoise, temporal_variance_dn2
from rigctl.comparison.comparison import Comparison
from rigctl.comparison.diagnosis import diagnose
from rigctl.comparison.rows import Row, decide, pair, scored
from rigctl.errors import DataError
from rigctl.measurement.measurement import Measurement
from rigctl.measurement.region_numbers import MeasuredRegion

FloatArray = NDArray[np.float64]

# What a temporal deviation rests on, in the order of the vector that is varied.
_TEMPORAL_INPUTS = ("gain_dn_per_e", "read_noise_e", "dark_current_e_per_s")

NOT_TESTED = (
    "means, texture and deviations over a region's pixels: the prediction was made from them (rows without verdict)",
    "the scene: no radiance was predicted",
)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Noise:
    """A calibration as the closed loop uses it."""

    values: FloatArray
    cov: FloatArray
    remarks: tuple[str, ...]


def compare_closed_loop(measurement: Measurement, *, noise: dict[str, Any] | None, alpha: float) -> Comparison:
    """Return what each region's own channel means and texture predict beside what its pixels show.

    Parameters
    ----------
    measurement : Measurement
        With one region at least.
    noise : dict or None
        A noise calibration as its file holds it: it predicts the temporal deviations. Without it only the law of
        DoLP is tested.
    alpha : float
        Chance of any false disagreement.

    Raises
    ------
    DataError
        A calibration is given and cannot predict, or the exposure is not known.
    """
    calibrated = None if noise is None else _temporal_noise(noise)
    rows: list[Row] = []
    remarks: list[str] = [] if calibrated is None else list(calibrated.remarks)
    predictions: dict[str, RegionPrediction] = {}
    for name, region in measurement.regions.items():
        loop = _RegionLoop(name, region, measurement, calibrated)
        predictions[name] = loop.prediction
        rows += loop.rows()
        remarks += loop.remarks()
    decided = decide(tuple(rows), alpha=alpha)
    return Comparison(
        kind="closed loop",
        alpha=alpha,
        rows=decided,
        diagnosis=diagnose(decided),
        predictions=predictions,
        remarks=tuple(remarks),
        not_tested=NOT_TESTED + (("temporal noise: no noise calibration was given",) if calibrated is None else ()),
    )


class _RegionLoop:
    """One region's own moments, and what follows from them."""

    def __init__(self, name: str, region: MeasuredRegion, measurement: Measurement, noise: _Noise | None) -> None:
        self._name, self._region, self._measurement, self._noise = name, region, measurement, noise
        self._cycles = measurement.grid.cycles
        if noise is None:
            # Nothing says what is noise and what is texture: the spread of one cycle holds both.
            temporal, self._texture = np.zeros_like(region.channels_mean.mean), region.spatial_cov_frame
            self._texture_pixels = region.stokes_pixels
        else:
            temporal = self._temporal(noise.values)
            self._texture = region.spatial_cov_mean - np.diag(temporal) / self._cycles
            self._texture_pixels = region.stokes_pixels_mean
        self._added = self._stokes_cov(np.diag(temporal)) * (1.0 - 1.0 / self._cycles)
        self.prediction = self._predicted(temporal)

    def rows(self) -> list[Row]:
        """Return the region's rows: tests with scores, the rest without."""
        paired = list(pair(self._name, self.prediction.quantities, self._region.quantities))
        return [*self._temporal_rows(paired), *self._law_rows(), *self._fitted_rows(paired)]

    def remarks(self) -> list[str]:
        """Return why a region has no test of its DoLP, if so."""
        if "dolp_pixels" not in self._region.quantities:
            return [f"{self._name}: some pixels have no light, so their DoLP was not compared"]
        return [f"{self._name}: {warning}" for warning in self.prediction.warnings]

    def _temporal(self, values: FloatArray) -> FloatArray:
        """Return the temporal variance of each channel [unit^2] for values of the calibration."""
        grid = self._measurement.grid
        gain, read_noise, dark_current = values.tolist()
        exposures = grid.exposures_s
        if exposures is None:
            raise DataError(f"{self._measurement.run.path}: its exposure is not known: the noise cannot be predicted")
        noise = SensorNoise(
            gain_dn_per_e=gain, read_noise_e=read_noise, dark_current_e_per_s=dark_current, black_level_dn=0.0
        )
        signal_dn = self._region.channels_mean.mean / grid.to_unit
        variance = temporal_variance_dn2(signal_dn, noise=noise, exposure_s=exposures)
        return np.asarray(variance * grid.to_unit**2)

    def _stokes_cov(self, channel_cov: FloatArray) -> FloatArray:
        inverse = self._measurement.plan.inverse
        return np.asarray(inverse @ channel_cov @ inverse.T)

    def _predicted(self, temporal: FloatArray) -> RegionPrediction:
        channels = ChannelMoments(
            mean_dn=self._region.channels_mean.mean,
            dark_signal_dn=0.0,
            scene_cov_dn2=self._texture,
            temporal_var_dn2=temporal,
            fixed_pattern_cov_dn2=np.zeros_like(self._texture),
            saturation_probability=np.zeros_like(temporal),
            warnings=(),
        )
        grid = self._measurement.grid
        return predict_region(
            channels, plan=self._measurement.plan, channel_names=grid.channel_names, cycles=self._cycles
        )

    def _temporal_rows(self, paired: list[Row]) -> Iterable[Row]:
        if self._noise is None:
            return
        rows = [row for row in paired if row.statistic == "std_temporal"]
        errors = _errors(self._noise, lambda values: self._temporal_deviations(values, rows))
        for row, error in zip(rows, errors, strict=True):
            yield scored(row, float(error))

    def _temporal_deviations(self, values: FloatArray, rows: list[Row]) -> FloatArray:
        variances = np.diag(self._temporal(values))
        deviations = dict(zip(self._measurement.grid.channel_names, np.sqrt(np.diag(variances)), strict=True))
        stokes = np.sqrt(np.diag(self._stokes_cov(variances)))
        deviations |= dict(zip(("s0", "s1", "s2"), stokes, strict=True))
        return np.array([deviations[row.quantity] for row in rows])

    def _law_rows(self) -> Iterable[Row]:
        if not self._law_rows_exist():
            return
        inflation = self._region.pixels / self._region.independent_pixels
        checks = check_dolp_law(self._region.stokes_pixels, self._texture_pixels, self._added)
        places = {"mean": ("dolp_pixels", "mean"), "std": ("dolp_pixels", "std"), "snr": ("dolp_snr", "mean")}
        for name, check in checks.items():
            quantity, statistic = places[name]
            row = Row(
                region=self._name,
                quantity=quantity,
                statistic=statistic,
                predicted=check.predicted,
                measured=check.measured,
                std_error=check.std_error * float(np.sqrt(inflation)),
            )
            yield scored(row, 0.0)

    def _law_rows_exist(self) -> bool:
        return "dolp_pixels" in self._region.quantities and "dolp_pixels" in self.prediction.quantities

    def _fitted_rows(self, paired: list[Row]) -> Iterable[Row]:
        tested_by_law = {("dolp_pixels", "mean"), ("dolp_pixels", "std"), ("dolp_snr", "mean")}
        for row in paired:
            tested = row.statistic == "std_temporal" and self._noise is not None
            if not tested and (row.quantity, row.statistic) not in tested_by_law:
                yield replace(row, std_error_inputs=None)


def _errors(noise: _Noise, function: Callable[[FloatArray], FloatArray]) -> FloatArray:
    cov = propagate_inputs(function, noise.values, noise.cov, least=(0.0, 0.0, 0.0))
    return np.asarray(np.sqrt(np.diag(cov)))


def _temporal_noise(noise: dict[str, Any]) -> _Noise:
    missing = [name for name in ("gain_dn_per_e", "read_noise_e") if noise[name] is None]
    if missing:
        raise DataError(f"the noise calibration has no {' and no '.join(missing)}: it cannot predict a deviation")
    remarks = []
    values = [noise[name]["value"] if noise[name] is not None else 0.0 for name in _TEMPORAL_INPUTS]
    if noise["dark_current_e_per_s"] is None:
        remarks.append("dark current: not calibrated, taken as 0")
    elif values[2] < 0.0:
        remarks.append(f"dark current: the calibration's {values[2]:.3g} e-/s is below 0 by its error; 0 is used")
        values[2] = 0.0
    joint = {name: k for k, name in enumerate(noise["covariance"]["names"])}
    matrix = np.asarray(noise["covariance"]["matrix"], dtype=np.float64)
    cov = np.zeros((3, 3))
    for i, one in enumerate(_TEMPORAL_INPUTS):
        for j, other in enumerate(_TEMPORAL_INPUTS):
            if one in joint and other in joint:
                cov[i, j] = matrix[joint[one], joint[other]]
    return _Noise(values=np.array(values, dtype=np.float64), cov=cov, remarks=tuple(remarks))
