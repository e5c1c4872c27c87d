"""The RX detector from files: a run with regions, and a scene file where the prediction is to come from one."""

from pathlib import Path

import numpy as np

from model.moments import Moments
from rigctl.calibrations.noise.noise_file import read_fitting_noise
from rigctl.comparison.comparison import predict_run
from rigctl.detection.rx_run import RxOnRun, detect
from rigctl.errors import ConfigError
from rigctl.files.regions import Region, load_regions
from rigctl.files.scene_file import load_scene
from rigctl.measurement.measurement import measure, signal_of_cycle
from rigctl.runs.run_folder import read_run
from rigctl.terminal import warn


def read_detection(
    run_path: Path,
    *,
    background: str,
    target: str,
    regions_path: Path | None,
    scene_path: Path | None,
    noise_path: Path | None,
) -> RxOnRun:
    """Return what the RX detector does with two regions of a run.

    Parameters
    ----------
    run_path : Path
        Run folder.
    background, target : str
        Regions of the regions file or the scene file.
    regions_path, scene_path, noise_path : Path or None
        A regions file or a scene file; the latter predicts, with the noise calibration where there is one.

    Raises
    ------
    ConfigError, DataError
        A file is wrong, a region is not there, or the run cannot give the detector what it needs.
    """
    if (regions_path is None) == (scene_path is None):
        raise ConfigError("give --regions FILE, or --scene SCENE.toml to predict from a scene")
    scene = None if scene_path is None else load_scene(scene_path)
    regions: list[Region] = list(scene.regions) if scene is not None else []
    if regions_path is not None:
        regions = load_regions(regions_path)
    run = read_run(run_path)
    noise, doubts = (None, ()) if noise_path is None else read_fitting_noise(noise_path, run)
    for doubt in doubts:
        warn(doubt)
    measurement = measure(run, regions=regions, noise=noise)
    predicted: dict[str, Moments] | None = None
    if scene is not None:
        predicted = {name: p.stokes_dn for name, p in predict_run(measurement, scene=scene, noise=noise).items()}
    signal = signal_of_cycle(measurement, 0)
    stokes = np.einsum("kn,nij->kij", measurement.plan.inverse, signal)
    return detect(measurement, stokes, background=background, target=target, predicted=predicted)
