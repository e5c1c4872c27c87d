"""Model beside measurement without a scene: a run's own means and texture through noise model and DoLP law."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from model.prediction import RegionPrediction, predict_region
from model.processing.agreement import propagate_inputs
from model.processing.samples import Sample, check_dolp_distribution, deviation
from model.sensor import ChannelMoments
from rigctl.calibrations.noise.noise_file import NoiseParameters
from rigctl.comparison.comparison import Comparison
from rigctl.comparison.diagnosis import diagnose
from rigctl.comparison.rows import Row, decide, measured_with_ratios, pair, scored, with_ratios
from rigctl.comparison.uncertainty_budget import run_budget
from rigctl.measurement.measurement import Measurement
from rigctl.measurement.region_numbers import MeasuredRegion
from rigctl.measurement.temporal_noise import TemporalNoise, temporal_noise, temporal_variance

FloatArray = NDArray[np.float64]

NOT_TESTED = (
    "means, and where one half of the pixels does not predict the other, deviations: rows without a verdict",
    "the scene: no radiance was predicted",
)

# Both sides come from the same pixels: where their difference is known so much better than either, they are one number.
_BESIDE_ITSELF = 0.1
_ONE_NUMBER = "so far above the noise that the law gives back what it was made from: a number would stand beside itself"


def compare_closed_loop(measurement: Measurement, *, noise: NoiseParameters | None, alpha: float) -> Comparison:
    """Return what each region's own channel means and texture predict beside what its pixels show.

    Parameters
    ----------
    measurement : Measurement
        With one region at least.
    noise : NoiseParameters or None
        A noise calibration: it predicts the temporal deviations. Without it only the law of
        DoLP is tested.
    alpha : float
        Family-wise error rate: chance of any false disagreement.

    Raises
    ------
    DataError
        A calibration is given and cannot predict, or the exposure is not known.
    """
    calibrated = None if noise is None else temporal_noise(noise)
    rows: list[Row] = []
    remarks: list[str] = [] if calibrated is None else list(calibrated.remarks)
    predictions: dict[str, RegionPrediction] = {}
    unjudged: dict[str, str] = {}
    same: dict[str, list[str]] = {}
    for name, region in measurement.regions.items():
        try:
            loop = _RegionLoop(name, region, measurement, calibrated)
            own, said = loop.rows(), loop.remarks()
        except (ValueError, ArithmeticError) as error:
            unjudged[name] = f"its numbers cannot be predicted: {error}"
            continue
        predictions[name] = loop.prediction
        rows += own
        remarks += said
        same.setdefault(loop.beside_themselves(), []).append(name)
    decided, light = decide(tuple(rows), alpha=alpha), measurement.run.session.simulated_light
    return Comparison(
        kind="closed loop",
        measurement=measurement,
        alpha=alpha,
        rows=decided,
        diagnosis=diagnose(decided, is_of_law=True),
        predictions=predictions,
        unjudged=unjudged,
        budgets=run_budget(
            predictions, measurement, gain_dn_per_e=None if calibrated is None else float(calibrated.values[0])
        ),
        remarks=tuple(remarks),
        not_tested=(
            *NOT_TESTED,
            *(f"{', '.join(regions)}: {numbers}: {_ONE_NUMBER}" for numbers, regions in same.items() if numbers),
            *(("temporal noise: no noise calibration was given",) if calibrated is None else ()),
            *(() if light is None else light.caution),
        ),
    )


class _RegionLoop:
    """One region's own moments, and what follows from them."""

    def __init__(
        self, name: str, region: MeasuredRegion, measurement: Measurement, noise: TemporalNoise | None
    ) -> None:
        self._name, self._region, self._measurement, self._noise = name, region, measurement, noise
        self._cycles = measurement.grid.cycles
        if noise is None:
            # Nothing says what is noise and what is texture: the spread of one cycle holds both.
            temporal, self._texture = np.zeros_like(region.channels_mean.mean), np.cov(region.channel_pixels)
            self._texture_pixels = region.stokes_pixels
        else:
            temporal = self._temporal(noise.values)
            self._texture = np.cov(region.channel_pixels_mean) - np.diag(temporal) / self._cycles
            self._texture_pixels = region.stokes_pixels_mean
        # What the noise of one cycle adds to the spread of the mean of all.
        self._added_to_channels = np.diag(temporal) * (1.0 - 1.0 / self._cycles)
        self._added = self._stokes_cov(self._added_to_channels)
        self.prediction = with_ratios({name: self._predicted(temporal)})[name]

    def rows(self) -> list[Row]:
        """Return the region's rows: tests with scores, the rest without."""
        paired = list(pair(self._name, self.prediction.quantities, measured_with_ratios(self._region)))
        tests = [*self._temporal_rows(paired), *self._half_rows(), *self._law_rows]
        tested = {(row.quantity, row.statistic) for row in tests}
        fitted = [row for row in paired if (row.quantity, row.statistic) not in tested]
        return [*tests, *(replace(row, std_error_inputs=None) for row in fitted)]

    def remarks(self) -> list[str]:
        """Return why a region has no test of its DoLP, if so."""
        if "dolp_pixels" not in self._region.quantities:
            return [f"{self._name}: some pixels have no light, so their DoLP was not compared"]
        return [f"{self._name}: {warning}" for warning in self.prediction.warnings]

    def beside_themselves(self) -> str:
        """Return which numbers of the law stand beside themselves; empty where none does."""
        return ", ".join(f"{row.quantity} {row.statistic}" for row in self._law_rows if row.z is None)

    def _temporal(self, values: FloatArray) -> FloatArray:
        return temporal_variance(self._measurement, self._region, values)

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

    @cached_property
    def _law_rows(self) -> tuple[Row, ...]:
        return tuple(self._rows_of_law()) if self._law_rows_exist() else ()

    def _rows_of_law(self) -> Iterable[Row]:
        inflation = self._region.pixels / self._region.independent_pixels
        checks = check_dolp_distribution(self._region.stokes_pixels, self._texture_pixels, self._added)
        places = {"mean": ("dolp_pixels", "mean"), "std": ("dolp_pixels", "std"), "snr": ("dolp_snr", "mean")}
        for name, check in checks.items():
            quantity, statistic = places[name]
            error = check.std_error * float(np.sqrt(inflation))
            row = Row(
                region=self._name,
                quantity=quantity,
                statistic=statistic,
                predicted=check.predicted,
                measured=check.measured,
                std_error=error,
            )
            own = self._region.quantities.get(quantity, {}).get(statistic)
            yield row if own is None or error < _BESIDE_ITSELF * own.std_error else scored(row, 0.0)

    def _law_rows_exist(self) -> bool:
        # Pixels that are all alike have no law.
        is_spread = bool(np.all(np.ptp(self._region.stokes_pixels, axis=1) > 0.0))
        return is_spread and all(
            "dolp_pixels" in found for found in (self._region.quantities, self.prediction.quantities)
        )

    def _half_rows(self) -> Iterable[Row]:
        """Return the spread over pixels: texture and noise of one half of the pixels predict it for the other half."""
        if self._noise is None:
            return
        region, names = self._region, self._measurement.grid.channel_names
        groups = (
            (names, region.channel_pixels, region.channel_pixels_mean, self._added_to_channels),
            (("s0", "s1", "s2"), region.stokes_pixels, region.stokes_pixels_mean, self._added),
        )
        for quantities, frame, mean, added in groups:
            for k, quantity in enumerate(quantities):
                source = deviation(mean[k, region.first_half])
                yield self._half_row(quantity, "std", source, float(added[k, k]), frame[k])
                yield self._half_row(quantity, "std_spatial_mean", source, 0.0, mean[k])

    def _half_row(self, quantity: str, statistic: str, source: Sample, added: float, pixels: FloatArray) -> Row:
        inflation = float(np.sqrt(self._region.pixels / self._region.independent_pixels))
        predicted = float(np.sqrt(source.value**2 + added))
        measured = deviation(pixels[~self._region.first_half])
        row = Row(
            region=self._name,
            quantity=quantity,
            statistic=statistic,
            predicted=predicted,
            measured=measured.value,
            std_error=measured.std_error * inflation,
        )
        return scored(row, source.value / predicted * source.std_error * inflation if predicted > 0.0 else 0.0)


def _errors(noise: TemporalNoise, function: Callable[[FloatArray], FloatArray]) -> FloatArray:
    cov = propagate_inputs(function, noise.values, noise.cov, least=(0.0, 0.0, 0.0))
    return np.asarray(np.sqrt(np.diag(cov)))
