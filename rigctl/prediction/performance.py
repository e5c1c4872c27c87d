"""Performance of predictions: the distribution of each region's DoLP, and RX detection between regions."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from model.prediction import PairDetection, PolarizationStrength, RegionPrediction

# Probabilities of false alarm that people ask for. A measured ROC has a point at each that its pixels reach.
FALSE_ALARM_RATES = (1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
# Those for which a prediction states the probability of detection, and those of a sweep.
STATED_RATES, SWEPT_RATES = FALSE_ALARM_RATES[1:4], FALSE_ALARM_RATES[1:]

# Why NEDoLP is not known.
NO_NOISE = "no noise calibration was given: temporal noise is not told from texture"


@dataclass(frozen=True, kw_only=True, eq=False)
class Performance:
    """Polarization and detection by the model, of single pixels of one cycle.

    Attributes
    ----------
    strengths : mapping
        Region to the distribution of its DoLP in a few numbers; None where there is no light.
    detections : tuple of PairDetection
        Every ordered pair of regions, at `STATED_RATES`.
    """

    strengths: dict[str, "PolarizationStrength | None"]
    detections: tuple["PairDetection", ...]


def performance_of(predictions: Mapping[str, "RegionPrediction"]) -> Performance:
    """Return the distribution of DoLP of every region, and the detection of each on every other."""
    from model.prediction import pair_detections

    return Performance(
        strengths={name: _strength(prediction) for name, prediction in predictions.items()},
        detections=pair_detections(predictions, STATED_RATES),
    )


def _strength(prediction: "RegionPrediction") -> "PolarizationStrength | None":
    from model.prediction import LEAST_S0_DN, polarization_strength

    if not prediction.stokes_dn.mean[0] > LEAST_S0_DN:
        return None
    try:
        return polarization_strength(prediction)
    except ArithmeticError:
        # Quantiles of a law that no quadrature follows; the region's other numbers stand.
        return None
