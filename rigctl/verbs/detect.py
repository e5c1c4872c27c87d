"""`rigctl detect`: the RX detector on two regions of a run."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Unpack

from cyclopts import Parameter

from rigctl.console import Json, note, solving_shown, warn
from rigctl.errors import ConfigError
from rigctl.verbs.options import (
    FilePath,
    Files,
    Part,
    RegionsPath,
    Result,
    RunOptions,
    RunPath,
    ScenePath,
    Writes,
    regions_of,
    scene_file_of,
)

if TYPE_CHECKING:
    from rigctl.comparison.detect import RxOnRun

_FILES = ("rx.fits", "rx.png", "roc.csv", "roc.png", "detection.json")
_RATE = 1e-3  # of false alarms, for the answer


def detect(
    run: RunPath,
    /,
    *,
    background: str,
    target: str,
    regions: RegionsPath | None = None,
    scene: ScenePath | None = None,
    noise: FilePath | None = None,
    out: Annotated[FilePath | None, Writes(kind="folder", names=_FILES), Parameter(required=True)] = None,
    **frames: Unpack[RunOptions],
) -> "DetectResult":
    """Detect a target against a background by its Stokes parameters, with the RX detector.

    Uses the first cycle of the run. Writes the map of the detection statistic D, the measured ROC of the target's
    pixels with its 95 % band, and the predicted ROC, from the scene file or from the regions' own means and
    covariances.

    Example: rigctl detect runs/panels --background asphalt --target black_panel --out rx
    --regions examples/regions.toml

    Parameters
    ----------
    run : path or Run
        Run folder.
    background : str
        Region that gives mean and covariance of the background.
    target : str
        Region to detect.
    regions : path or sequence of Region
        Regions file.
    scene : path or SceneFile
        Scene file to predict the ROC from; it also has the regions.
    noise : path
        Noise calibration file, for the prediction from a scene.
    out : path
        Folder for map, curves and numbers. Optional in Python.
    **frames
        See `RunOptions`.
    """
    import numpy as np

    from rigctl.comparison import detect as rx_detection
    from rigctl.comparison.predict_run import run_predictor
    from rigctl.measure.frames import CalibrationPaths, calibrations_of_run
    from rigctl.measure.measure import measure, signal_of_cycle
    from rigctl.runs.check import run_to_measure
    from rigctl.scene.scene import scene_of_file

    if (regions is None) == (scene is None):
        raise ConfigError("give --regions FILE, or --scene SCENE.toml to predict from a scene")
    content = None if scene is None else scene_file_of(scene)
    drawn = regions_of(regions if content is None else content.regions)
    record = run_to_measure(Path(run), **frames)
    paths = CalibrationPaths(named={} if noise is None else {"noise": Path(noise)})
    given, predicted = calibrations_of_run(paths, record, ()), None
    measurement = measure(record, regions=drawn, calibrations=given)
    if content is not None:
        with solving_shown():
            predictor = run_predictor(measurement, scene_of_file(content, given.noise))
            predictions = predictor.predictions(predictor.inputs.values)
        predicted = {name: prediction.stokes_dn for name, prediction in predictions.items()}
    stokes = np.einsum("kn,nij->kij", measurement.plan.inverse, signal_of_cycle(measurement, 0))
    found = rx_detection.detect(measurement, stokes, background=background, target=target, predicted=predicted)
    for doubt in given.doubts:
        warn(doubt)
    result = DetectResult(found=found)
    if out is not None:
        note(f"written: {', '.join(result.write(Path(out)))} in {out}", below=True)
    return result


@dataclass(frozen=True, kw_only=True, eq=False)
class DetectResult(Result):
    """RX detection of a target region against a background region."""

    found: "RxOnRun"  #: map, measured and predicted ROC

    def content(self) -> Iterable[Part]:
        """Return the detection at a false alarm rate of 1e-3, the curves at round rates, and what predicts them."""
        from rigctl.report.detection import roc_plot, round_roc_table

        found, at = self.found, int(abs(self.found.p_false_alarm - _RATE).argmin())
        yield (
            f"{found.target} on {found.background}: P_D {found.empirical_p_detection[at]:.4f} (95 %: "
            f"{found.band_low[at]:.4f} to {found.band_high[at]:.4f}), predicted {found.predicted_p_detection[at]:.4f}, "
            f"at a false alarm rate of {found.p_false_alarm[at]:g}"
        )
        yield round_roc_table(found)
        yield f"predicted from {self.found.predicted_from}"
        yield from self.found.warnings
        yield lambda: roc_plot(self.found)

    def as_json(self) -> dict[str, Json]:
        """Return the content of detection.json."""
        from rigctl.report.detection import detection_json

        return detection_json(self.found)

    def output_files(self) -> Files:
        """Return map, curves and numbers."""
        from rigctl.report.detection import detection_files

        return detection_files(self.found)
