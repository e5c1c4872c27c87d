"""A prediction as people and programs read it: numbers of regions, their errors by inputs, laws and counts.

In JSON ``regions.NAME.QUANTITY.STATISTIC`` is a number, in a prediction and in a measurement.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from itertools import cycle
from math import isfinite, nan
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from model.processing.reconstruction import aolp_is_defined
from model.quantities import ORDERED
from rigctl.base.numbers import NO_NUMBER, NOTHING, finite, plus_minus, size, to_digits
from rigctl.report.document import Column, Table, text_columns
from rigctl.report.drawing import (
    LINE_STYLES,
    legend_of_all,
    png,
    say_beneath,
    subplots,
)

if TYPE_CHECKING:
    from model.accuracy.predict import Predicted
    from model.prediction import PairDetection, PolarizationStrength, RegionPrediction
    from rigctl.console import Json
    from rigctl.files.choices import SnrKind
    from rigctl.prediction.predict import Performance, PredictedUncertainty


SCHEMA_VERSION = 1

STATISTICS = {
    "mean": "mean over the region's pixels (of dolp, s1n, s2n and aolp_deg: of the region's mean Stokes vector)",
    "std": "standard deviation over pixels, spatial, of one frame or cycle (s1n, s2n, dolp, aolp_deg: first order)",
    "std_temporal": "standard deviation of a pixel from repeat to repeat",
    "std_spatial_mean": "standard deviation over pixels, spatial, of the mean of all repeats",
    "first_order": "the same to first order, as in [MK14]; shown, not compared",
}

_STATISTICS = ("mean", "std", "std_temporal", "std_spatial_mean")
Statistics = Mapping[str, float]
# Probabilities at which the law of DoLP is stated.
_QUANTILES = ("DoLP 2.5 %", "median", "97.5 %")
# A mean below this share of its deviation is the rounding of a sum that cancels.
_LEAST_SHARE = 1e-9
# The error of a number is the first of these. One below this share of the number does not show in its four digits; of
# means it is shown down to a smaller share. From this size on a number without an error is shown to the unit.
_ERRORS = ("std_error", "std_error_inputs", "numerical_error")
_IN_FOUR_DIGITS, _OF_MEANS, _WHOLE = 5e-4, 1e-6, 1e4
# Pairs of inputs whose errors go together, and the least correlation of them that is shown.
_PAIRS, _WORTH_A_LINE = 6, 0.1
# Of as many inputs as make the uncertainty; the rest is in the JSON.
_SHOWN = 6


def prediction_json(
    predictions: Mapping[str, RegionPrediction], performance: Performance, *, remarks: Iterable[str]
) -> dict[str, Json]:
    """Return predictions and their accuracy as JSON."""
    return {
        "schema_version": SCHEMA_VERSION,
        "statistics": STATISTICS,
        "regions": {name: prediction.quantities for name, prediction in predictions.items()},
        "methods": {
            name: {"dolp": prediction.dolp_method, "dolp_error": finite(prediction.dolp_error)}
            for name, prediction in predictions.items()
        },
        "dolp_law": {name: _strength(strength) for name, strength in performance.strengths.items()},
        "detection": [_pair(pair) for pair in performance.detections],
        "warnings": {name: list(prediction.warnings) for name, prediction in predictions.items()},
        "remarks": list(remarks),
    }


def _strength(found: PolarizationStrength | None) -> dict[str, Json] | None:
    """Return quantiles of a region's DoLP; nothing without light."""
    if found is None:
        return None
    quantiles = {f"{p:g}": float(q) for p, q in zip(found.probabilities, found.quantiles, strict=True)}
    numbers: dict[str, Json] = {"quantiles": quantiles, "nedolp": found.nedolp}
    if found.nedolp is None:
        from rigctl.prediction.predict import NO_NOISE

        numbers["nedolp_reason"] = NO_NOISE
    return numbers | {"unpolarised_mean": finite(found.unpolarised_mean)}


def _pair(pair: PairDetection) -> dict[str, Json]:
    rates = zip(pair.p_false_alarm, pair.p_detection, strict=True)
    return {
        "target": pair.target,
        "background": pair.background,
        "p_detection": {f"{rate:g}": finite(float(found)) for rate, found in rates},
        "auc": finite(pair.auc),
        "warnings": list(pair.warnings),
    }


def quantity_tables(regions: Mapping[str, Mapping[str, Statistics]], *, snr: SnrKind = "exact") -> Iterable[Table[Any]]:
    """Return a table for each region: a row a quantity, a column a statistic.

    `snr` says which DoLP SNR is shown; that to first order has a row of its own.
    """
    columns: tuple[Column[tuple[str, Statistics]], ...] = (
        Column(title="quantity", text=lambda row: row[0], left=True),
        *(Column(title=statistic, text=partial(_with_error, statistic=statistic)) for statistic in _STATISTICS),
    )
    for name, quantities in regions.items():
        yield Table(title=name, columns=columns, rows=tuple(_rows(quantities, snr)))


def _rows(quantities: Mapping[str, Statistics], snr: SnrKind) -> Iterable[tuple[str, Statistics]]:
    for name, statistics in quantities.items():
        if name != "dolp_snr" or snr != "first-order":
            yield name, statistics
        if name == "dolp_snr" and snr != "exact" and "first_order" in statistics:
            yield "dolp_snr (first order)", {"mean": statistics["first_order"]}


def _with_error(row: tuple[str, Statistics], statistic: str) -> str:
    quantity, statistics = row
    if statistic not in statistics:
        return ""
    error = next((statistics[key] for kind in _ERRORS if (key := f"{statistic}_{kind}") in statistics), None)
    value = statistics[statistic]
    if not isfinite(value):
        return NO_NUMBER
    if value == 0.0 or abs(value) < _LEAST_SHARE * statistics.get("std", 0.0):
        return "0"
    interval = statistics.get(f"{statistic}_95_low", nan), statistics.get(f"{statistic}_95_high", nan)
    if error is not None and interval[0] == 0.0:
        return with_error(quantity, value, error, interval)
    if error and error > (_OF_MEANS if statistic == "mean" else _IN_FOUR_DIGITS) * abs(value):
        return with_error(quantity, value, error)
    return f"{value:#.4g}".rstrip(".") if abs(value) < _WHOLE else f"{value:.0f}"


def with_error(quantity: str, value: float, error: float, interval: tuple[float, float] | None = None) -> str:
    """Return a number with its standard error, or below the end of its 95 % interval if that begins at 0.

    An AoLP whose 95 % interval covers all angles is undefined.
    """
    # Errors to either side are not equal then.
    if interval is not None and interval[0] == 0.0:
        return f"< {to_digits(interval[1], error)} (95 %)"
    if quantity == "aolp_deg" and not aolp_is_defined(np.radians(error)):
        return "undefined"
    return plus_minus(value, error)


def strength_table(predictions: Mapping[str, RegionPrediction], performance: Performance) -> Table[tuple[str, ...]]:
    """Return the law of each region's DoLP in a few numbers."""
    rows = []
    for region, prediction in predictions.items():
        found = performance.strengths[region]
        law = (NOTHING,) * len(_QUANTILES) if found is None else tuple(f"{one:.4f}" for one in found.quantiles)
        nedolp = NOTHING if found is None else "not known" if found.nedolp is None else f"{found.nedolp:.4f}"
        rows.append((region, *law, nedolp, prediction.dolp_method, size(prediction.dolp_error)))
    columns = text_columns("region", *_QUANTILES, "NEDoLP", "moments by", "error", left=(0, 5))
    return Table(columns=columns, rows=tuple(rows))


def detection_table(performance: Performance) -> Table[PairDetection]:
    """Return the probability of detection of every pair of regions."""
    from rigctl.prediction.predict import STATED_RATES

    columns: tuple[Column[PairDetection], ...] = (
        Column(title="target", text=lambda pair: pair.target, left=True),
        Column(title="background", text=lambda pair: pair.background, left=True),
        *(Column(title=f"{rate:g}", text=partial(_detected, k=k)) for k, rate in enumerate(STATED_RATES)),
        Column(title="area under ROC", text=lambda pair: _probability(pair.auc)),
    )
    return Table(columns=columns, rows=tuple(performance.detections))


def _detected(pair: PairDetection, k: int) -> str:
    return _probability(pair.p_detection[k])


def _probability(found: float) -> str:
    return NOTHING if np.isnan(found) else f"{found:.4f}"


def with_input_errors(
    predictions: dict[str, RegionPrediction], found: PredictedUncertainty
) -> dict[str, dict[str, dict[str, float]]]:
    """Return regions as JSON has those of a prediction, with a std_error_inputs beside each number."""
    return {
        region: {
            quantity: statistics
            | {f"{name}_std_error_inputs": found.std_errors[region][quantity][name] for name in statistics}
            for quantity, statistics in prediction.quantities.items()
        }
        for region, prediction in predictions.items()
    }


def with_numerical_errors(found: Predicted) -> dict[str, dict[str, dict[str, float]]]:
    """Return regions with the estimated numerical error of each number that has one."""
    return {
        region: {
            quantity: statistics
            | {
                f"{name}_numerical_error": error
                for name in statistics
                if (error := found.error_of(region, quantity, name)) is not None
            }
            for quantity, statistics in prediction.quantities.items()
        }
        for region, prediction in found.result.predictions.items()
    }


def input_effects_json(found: PredictedUncertainty) -> dict[str, Json]:
    """Return which input makes how much of the uncertainty, of the means that a user reads first."""
    effects = {
        region: {quantity: dict(found.ranked(region, quantity)) for quantity in ORDERED if quantity in quantities}
        for region, quantities in found.std_errors.items()
    }
    together: list[Json] = [{"inputs": [one, other], "correlation": value} for one, other, value in found.correlations]
    return {
        "uncertain_inputs": list(found.inputs),
        "input_effects": effects,
        "input_correlations": together,
        "input_remarks": list(found.remarks),
    }


def correlation_lines(found: PredictedUncertainty) -> Iterable[str]:
    """Give the inputs whose errors go together, the closest pairs, a line each."""
    for one, other, value in found.correlations[:_PAIRS]:
        if abs(value) >= _WORTH_A_LINE:
            yield f"errors of {one} and {other} go together: correlation {value:+.2f}; the table has each alone"


def input_effect_tables(found: PredictedUncertainty) -> Iterable[Table[str]]:
    """Return a table for each region: the inputs that move its DoLP most, by one standard uncertainty of each."""
    for region in found.std_errors:
        ranked = found.ranked(region, "dolp")[:_SHOWN]
        if not ranked:
            continue
        columns: tuple[Column[str], ...] = (
            Column(title="input", text=str, left=True),
            *(
                Column(title=title, text=partial(_effect, effects=dict(found.ranked(region, quantity))))
                for title, quantity in (("DoLP", "dolp"), ("s1", "s1n"), ("s2", "s2n"), ("S0 DN", "s0"))
            ),
        )
        yield Table(
            title=f"{region}: change by one standard uncertainty of an input, those first that move DoLP most",
            columns=columns,
            rows=tuple(name for name, _ in ranked),
        )


def _effect(name: str, effects: Mapping[str, float]) -> str:
    return f"{effects[name]:+.2g}" if name in effects else "0"


FloatArray = NDArray[np.float64]
EXACT_SNR = ("dolp_snr", "mean", "DoLP SNR")
FIRST_ORDER_SNR = ("dolp_snr", "first_order", "DoLP SNR (first order)")


def shown_snr(kind: SnrKind) -> tuple[tuple[str, str, str], ...]:
    """Return quantity, statistic and label of the DoLP SNR that tables and plots show."""
    by_kind = {"exact": (EXACT_SNR,), "first-order": (FIRST_ORDER_SNR,), "both": (EXACT_SNR, FIRST_ORDER_SNR)}
    return by_kind[kind]


_POINTS, _SPAN = 400, 5.0


def counts_png(predictions: Mapping[str, RegionPrediction], *, warnings: Sequence[str] = ()) -> bytes:
    """Return mean and deviation of the counts behind each angle, as [MK14] Fig. 7 has them."""
    figure, axes = subplots(1, 2, size=(11.0, 4.4))
    for k, (name, one) in enumerate(predictions.items()):
        counts = {key: value for key, value in one.quantities.items() if key.startswith("dn_")}
        angles = [key.removeprefix("dn_") for key in counts]
        places = np.arange(len(angles)) + 0.8 * (k + 0.5) / len(predictions) - 0.4
        for ax, statistic in zip(axes, ("mean", "std"), strict=True):
            ax.bar(places, [value[statistic] for value in counts.values()], 0.8 / len(predictions), label=name)
            ax.set_xticks(np.arange(len(angles)), angles)
            ax.set_xlabel("angle of the polarizer [deg]")
    axes[0].set_ylabel("mean counts [DN]")
    axes[1].set_ylabel("deviation of the counts over pixels [DN]")
    legend_of_all(figure, axes[0], place="upper")
    say_beneath(figure, warnings)
    return png(figure)


def laws_png(predictions: Mapping[str, RegionPrediction], *, warnings: Sequence[str] = ()) -> bytes:
    """Return the laws of s1, s2 and DoLP of single pixels, as [MK14] Fig. 8b has them, by the exact distributions."""
    from model.prediction import LEAST_S0_DN

    figure, axes = subplots(1, 3, size=(14.0, 4.4))
    for (name, one), style in zip(predictions.items(), cycle(LINE_STYLES)):
        if not one.stokes_dn.mean[0] > LEAST_S0_DN:
            continue
        for ax, (x, density) in zip(axes, laws_of(one), strict=True):
            if x.size > 1:
                ax.plot(x, density, style, label=name)
            else:
                ax.plot(np.repeat(x, 2), (0.0, 1.0), style, label=name, transform=ax.get_xaxis_transform())
    for ax, label in zip(axes, ("s1 = S1/S0", "s2 = S2/S0", "DoLP"), strict=True):
        ax.set_xlabel(f"{label} of a pixel")
        ax.set_ylabel("density")
        ax.locator_params(axis="x", nbins=6)
        ax.set_ylim(bottom=0.0)
    legend_of_all(figure, axes[0], place="upper")
    say_beneath(figure, warnings)
    return png(figure)


def laws_of(one: RegionPrediction) -> tuple[tuple[FloatArray, FloatArray], ...]:
    """Return abscissa and density of s1, s2 and DoLP of a region's pixels; its S0 is above 0.

    A number that does not fluctuate has no density: its abscissa is the one value that it has.
    """
    from model.processing.dolp import pdf
    from model.processing.dolp_studies import normalized_density

    mean, cov = one.stokes_dn.mean, one.stokes_dn.cov

    found = []
    for component, name in ((1, "s1n"), (2, "s2n")):
        value, std = one.quantities[name]["mean"], one.quantities[name]["std"]
        limits = (value - _SPAN * std, value + _SPAN * std)
        density = partial(normalized_density, stokes_mean=mean, stokes_cov=cov, component=component)
        found.append(_law(density, limits, value))
    return (*found, _law(lambda x: pdf(x, mean, cov), _dolp_limits(one), one.quantities["dolp"]["mean"]))


def _law(
    density: Callable[[FloatArray], FloatArray], limits: tuple[float, float], value: float
) -> tuple[FloatArray, FloatArray]:
    x = np.linspace(*limits, _POINTS)
    alone = np.array([value]), np.array([np.inf])
    if not limits[0] < limits[1]:
        return alone
    try:
        return x, density(x)
    except ValueError:
        return alone


def _dolp_limits(one: RegionPrediction) -> tuple[float, float]:
    mean, std = one.quantities["dolp"]["mean"], max(one.quantities["s1n"]["std"], one.quantities["s2n"]["std"])
    return max(mean - _SPAN * std, 0.0), mean + _SPAN * std
