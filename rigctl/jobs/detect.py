"""Detecting a target in a run by its polarization: the RX detector on two of its regions."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from model.moments import Moments
from rigctl.calibrations.noise.noise_file import read_fitting_noise
from rigctl.comparison.run_prediction import run_predictor
from rigctl.comparison.rx_detection import RxOnRun, detect
from rigctl.console.exclusion_option import are_exclusions_ignored
from rigctl.errors import ConfigError
from rigctl.files.regions import Region, load_regions
from rigctl.files.rig_file import unset_polarizer
from rigctl.files.scene_file import SceneFile, load_scene
from rigctl.measurement.measurement import measure, signal_of_cycle
from rigctl.reports.outputs.measurement_files import write_detection
from rigctl.runs.wholeness import used_run


@dataclass(frozen=True, kw_only=True)
class DetectRequest:
    """Which target, on which background, and what predicts them.

    Attributes
    ----------
    background, target : str
        Regions of the regions file or the scene file.
    regions, scene : Path or None
        A regions file or a scene file; the latter predicts.
    noise : Path or None
        Noise calibration, for a scene.
    """

    background: str
    target: str
    regions: Path | None = None
    scene: Path | None = None
    noise: Path | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Detection:
    """RX detection of one region of a run on another.

    Attributes
    ----------
    found : RxOnRun
        Map, measured and predicted ROC.
    doubts : tuple of str
        About the calibration.
    files : tuple of str
        Names of those that were written.
    """

    found: RxOnRun
    doubts: tuple[str, ...]
    files: tuple[str, ...] = ()


def detect_target(run_path: Path, request: DetectRequest, *, out: Path | None = None) -> Detection:
    """Return what the RX detector does with two regions of a run.

    Parameters
    ----------
    run_path : Path
        Run folder.
    request : DetectRequest
        Which regions.
    out : Path or None
        Folder for map, curves and numbers.

    Raises
    ------
    ConfigError, DataError
        A file is wrong, a region is not there, or the run cannot give the detector what it needs.
    """
    if (request.regions is None) == (request.scene is None):
        raise ConfigError("give --regions FILE, or --scene SCENE.toml to predict from a scene")
    scene = None if request.scene is None else load_scene(request.scene)
    regions = _regions(scene, request.regions)
    run = used_run(run_path, ignore_exclusions=are_exclusions_ignored())
    noise, doubts = (None, ()) if request.noise is None else read_fitting_noise(request.noise, run)
    measurement = measure(run, regions=regions, noise=noise)
    predicted: dict[str, Moments] | None = None
    if scene is not None:
        predictor = run_predictor(measurement, scene=scene, noise=noise)
        predictions = predictor.predictions(predictor.inputs.values)
        predicted = {name: prediction.stokes_dn for name, prediction in predictions.items()}
    stokes = np.einsum("kn,nij->kij", measurement.plan.inverse, signal_of_cycle(measurement, 0))
    names = {"background": request.background, "target": request.target}
    found = detect(measurement, stokes, **names, predicted=predicted)
    files = () if out is None else write_detection(found, out, **names)
    unset = unset_polarizer(run.path, placeholder=run.session.polarizer.placeholder)
    return Detection(found=found, doubts=(*unset, *doubts), files=files)


def _regions(scene: SceneFile | None, regions: Path | None) -> list[Region]:
    if regions is not None:
        return load_regions(regions)
    return [] if scene is None else list(scene.regions)
