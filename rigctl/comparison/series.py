"""Many runs of one rig compared with one scene, such as an afternoon: residuals against time, drift, trends."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from model.processing.agreement import DriftLine, drift_line
from model.quantities import CIRCULAR, FOLLOWED
from rigctl.comparison.checks import (
    Trend,
    trend,
)
from rigctl.comparison.compare import Comparison
from rigctl.comparison.rows import (
    Row,
    off_prediction,
)
from rigctl.console import Json
from rigctl.errors import DataError
from rigctl.prediction.predict import NumberKey
from rigctl.runs.folder import Run

_S_PER_H = 3600.0
_LEAST_RUNS = 3


@dataclass(frozen=True, kw_only=True)
class SeriesDrift:
    """Drift of the residual of a quantity of a region."""

    region: str
    quantity: str
    line: DriftLine

    @property
    def z(self) -> float:
        """Slope over its standard error."""
        return self.line.slope / self.line.std_error


@dataclass(frozen=True, kw_only=True, eq=False)
class ComparedSeries:
    """Many runs of one rig compared with one scene, in the order in which they were given."""

    comparisons: tuple[Comparison, ...]
    drifts: tuple[SeriesDrift, ...]
    trends: tuple[Trend, ...]
    alpha: float  #: family-wise error rate: chance of any false disagreement over all runs
    scene: dict[str, Json]  #: path and sha256 of the scene file of all

    @property
    def agrees(self) -> bool | None:
        """Whether every run agrees; None where none disagrees and one cannot be judged."""
        verdicts = [comparison.agrees for comparison in self.comparisons]
        if False in verdicts:
            return False
        return None if None in verdicts else True


def require_one_instrument(runs: Sequence[Run]) -> None:
    """Refuse runs that are not of one camera as it was set, one stage, and one axis of the polarizer."""
    first = _instrument(runs[0])
    strangers = []
    for run in runs[1:]:
        own = _instrument(run)
        wrong = [f"{what} {own[what]}, not {first[what]}" for what in first if own[what] != first[what]]
        if wrong:
            strangers.append(f"{run.path}: {', '.join(wrong)}")
    if strangers:
        raise DataError(f"these runs do not belong with {runs[0].path}: " + "; ".join(strangers))


def name_of(comparison: Comparison) -> str:
    """Return the name of the run folder."""
    return comparison.measurement.run.path.resolve().name


def start_of(comparison: Comparison) -> datetime | None:
    """Return the start of the first frame."""
    text = comparison.measurement.grid.records[0][0].start_utc
    return None if text is None else datetime.fromisoformat(text)


def sun_zenith_deg(comparison: Comparison) -> float | None:
    """Return the zenith angle of the sun as the frames recorded it, or else as the prediction took it."""
    frames = comparison.measurement.grid.frames
    elevations = [frame.sun_elevation_deg for frame in frames if frame.sun_elevation_deg is not None]
    if len(elevations) == len(frames):
        return 90.0 - sum(elevations) / len(elevations)
    sun = None if comparison.inputs is None else comparison.inputs.scene.sun
    return None if sun is None else sun.zenith_deg.value


def hours_of(comparisons: Sequence[Comparison]) -> list[float] | None:
    """Return the time of each run from the first [h]; None where a run does not state its time."""
    starts = [start for start in map(start_of, comparisons) if start is not None]
    if len(starts) != len(comparisons):
        return None
    return [(start - min(starts)).total_seconds() / _S_PER_H for start in starts]


def mean_row(comparison: Comparison, region: str, quantity: str) -> Row | None:
    """Return the row of the mean of a quantity, if there is one."""
    key = NumberKey(region, quantity, "mean")
    return next((row for row in comparison.rows if row.key == key), None)


def drifts_of(comparisons: Sequence[Comparison]) -> tuple[SeriesDrift, ...]:
    """Return how residuals drift with time, per hour; nothing with fewer than three runs or without their times.

    Errors are those of the measurement: those of the inputs are common to all runs, and move all residuals alike.
    """
    hours = hours_of(comparisons)
    if hours is None or len(comparisons) < _LEAST_RUNS or np.ptp(hours) == 0.0:
        return ()
    found = []
    for region, quantity, rows in _complete(comparisons):
        residuals = [off_prediction(row, row.measured) for row in rows]
        errors = [row.std_error or 0.0 for row in rows]
        if min(errors) > 0.0:
            found.append(SeriesDrift(region=region, quantity=quantity, line=drift_line(hours, residuals, errors)))
    return tuple(found)


def trends_over_runs(comparisons: Sequence[Comparison]) -> tuple[Trend, ...]:
    """Return whether the order of runs is as predicted, for each region and quantity that has an order."""
    if len(comparisons) < _LEAST_RUNS:
        return ()
    return tuple(
        trend(
            rows,
            over=f"runs of {region}",
            predicted_cov=_joint_cov(comparisons, rows),
            measured_cov=np.diag([(row.std_error or 0.0) ** 2 for row in rows]),
        )
        for region, quantity, rows in _complete(comparisons)
        if quantity not in CIRCULAR
    )


def _complete(comparisons: Sequence[Comparison]) -> Iterable[tuple[str, str, list[Row]]]:
    """Return the quantities that every run has."""
    for region in comparisons[0].measurement.regions:
        for quantity in FOLLOWED:
            rows = [mean_row(comparison, region, quantity) for comparison in comparisons]
            known = [row for row in rows if row is not None]
            if len(known) == len(comparisons):
                yield region, quantity, known


def _joint_cov(comparisons: Sequence[Comparison], rows: Sequence[Row]) -> NDArray[np.float64]:
    """Return the covariance of one prediction over the runs: the same inputs are off in all of them."""
    names = list(dict.fromkeys(name for one in comparisons if one.inputs is not None for name in one.inputs.names))
    effects = np.zeros((len(comparisons), len(names)))
    for k, (comparison, row) in enumerate(zip(comparisons, rows, strict=True)):
        inputs, propagation = comparison.inputs, comparison.propagation
        if inputs is None or propagation is None:
            continue
        place = comparison.rows.index(row)
        for name, effect in zip(inputs.names, propagation.effects[place], strict=True):
            effects[k, names.index(name)] = effect
    return np.asarray(effects @ effects.T)


def _instrument(run: Run) -> dict[str, str]:
    """Return what runs of one series have in common, as it is said where they have not."""
    scene = next((record for record in run.frames if record.kind == "scene"), None)
    if scene is None:
        raise DataError(f"{run.path}: holds no scene frames")
    polarizer = run.session.polarizer
    return {
        "camera": repr((scene.camera_model, scene.camera_serial)),
        "gain [dB]": repr(scene.gain_db),
        "bit depth": repr(scene.bit_depth),
        "picture": repr((scene.width, scene.height)),
        "stage": repr((scene.stage_model, scene.stage_serial)),
        "polarizer sense": repr(polarizer.sense),
        "polarizer offset [deg]": repr(polarizer.offset_deg),
        "extinction ratio": repr(polarizer.extinction_ratio),
    }
