"""Results of comparing runs with the model, with all that their reports show."""

from dataclasses import dataclass
from pathlib import Path

from model.effects.names import Effect, EffectPlan
from rigctl.calibrations.noise.noise_file import NoiseParameters
from rigctl.comparison.comparison import Comparison
from rigctl.comparison.numerical_accuracy import NumericalAccuracy
from rigctl.comparison.series import SeriesDrift, SeriesPoint
from rigctl.comparison.trends import Trend
from rigctl.files.choices import ScaleKind
from rigctl.files.regions import Region
from rigctl.measurement.measurement import Measurement
from rigctl.measurement.picked_calibrations import PickedCalibrations
from rigctl.prediction.performance import Performance
from rigctl.storage.bounded_file import sha256_of


@dataclass(frozen=True, kw_only=True)
class UsedFile:
    """A file that a result rests on."""

    path: Path
    sha256: str


def used_file(path: Path) -> UsedFile:
    """Return a file with its hash."""
    return UsedFile(path=path, sha256=sha256_of(path))


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Files and settings that a comparison was made from.

    Attributes
    ----------
    files : mapping
        What it is ("scene", "noise", "manifest") to the file.
    alpha : float
        Family-wise error rate: chance of any false disagreement.
    scale : {"absolute", "panel", "free"}
        What the counts of a prediction were scaled by.
    anonymous : bool
        A report says no serial numbers, ports, site and folders.
    """

    files: dict[str, UsedFile]
    alpha: float
    scale: ScaleKind
    anonymous: bool = False


@dataclass(frozen=True, kw_only=True)
class EffectsTaken:
    """Effects of the model: the decisions at the tolerance that a report shows, and those that a comparison took."""

    plan: EffectPlan
    taken: frozenset[Effect]


@dataclass(frozen=True, kw_only=True, eq=False)
class ComparedRun:
    """A run beside what the model says of it.

    Attributes
    ----------
    comparison : Comparison
        Rows with their decision.
    measurement : Measurement
        What the run showed.
    regions : list of Region
        As they were drawn.
    performance : Performance
        What the predictions are worth for detection.
    provenance : Provenance
        What it was made from.
    noise : mapping or None
        The noise calibration.
    effects : EffectsTaken or None
        None without a scene.
    picked : PickedCalibrations or None
        Which calibrations were picked from the store.
    accuracy : NumericalAccuracy or None
        The numerical settings that it chose; None without a scene.
    """

    comparison: Comparison
    measurement: Measurement
    regions: list[Region]
    performance: Performance
    provenance: Provenance
    noise: NoiseParameters | None = None
    effects: EffectsTaken | None = None
    picked: PickedCalibrations | None = None
    accuracy: NumericalAccuracy | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class ComparedSeries:
    """Many runs beside one scene.

    Attributes
    ----------
    runs, points
        Each run, and its place among the others.
    drifts, trends
        Over all of them.
    alpha : float
        Family-wise error rate: chance of any false disagreement over all runs.
    scene : UsedFile
        The scene file of all.
    """

    runs: tuple[ComparedRun, ...]
    points: tuple[SeriesPoint, ...]
    drifts: tuple[SeriesDrift, ...]
    trends: tuple[Trend, ...]
    alpha: float
    scene: UsedFile

    @property
    def agrees(self) -> bool | None:
        """Whether every run agrees; None where none disagrees and one cannot be judged."""
        found = [point.comparison.agrees for point in self.points]
        if False in found:
            return False
        return None if None in found else True
