"""The functions of the Python interface: files in, the records of the jobs out."""

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import ConfigError
from rigctl.files.choices import Engine, LightPart
from rigctl.files.scene_file import SceneFile
from rigctl.interface.results import (
    Prediction,
    SweepResult,
)
from rigctl.interface.run import maybe_path, none_fits
from rigctl.jobs.predict import PredictRequest, predict_scene, sweep_scene
from rigctl.prediction.sweep_axes import Axis
from rigctl.verbs.options import FilePath

SceneGiven = str | Path | SceneFile


def predict(
    scene: SceneGiven,
    *,
    changes: Mapping[str, float] | None = None,
    noise: FilePath | None = None,
    radiometric: FilePath | None = None,
    calibrations: FilePath | None = None,
    light: LightPart = "total",
    engine: Engine = "own",
    uncertainty: bool = False,
) -> Prediction:
    """Return what the analytical model says of each region of a scene.

    Parameters
    ----------
    scene : path or SceneFile
        Scene file, or what `load_scene` gave.
    changes : mapping or None
        Numbers in the place of those of the file and of the calibrations, by their keys, such as
        ``{"sensor.f_number": 2.1}``; docs/parameters.md lists them.
    noise, radiometric : path or None
        Calibration files, in place of assumed noise, and of optics and efficiency.
    calibrations : path, "none" or None
        Store that calibrations which are not named are picked from, as the commands pick them: the folder
        ``calibrations`` beside the scene file unless given. "none" picks none, ``noise="none"`` none of one kind.
        What was picked, and why, is in `.calibrations` of the result.
    light : {"total", "reflected", "reflected_sun", "reflected_sky", "path"}
        As if only that part of the light came.
    engine : {"own", "sasktran2"}
        What solves the sky.
    uncertainty : bool
        Also what the stated uncertainties of the inputs make of each number.

    Raises
    ------
    ConfigError, DataError
        A file is wrong or does not fit, or there is no such number.
    """
    request = _predict_request(scene, changes, noise, radiometric, calibrations, light, engine)
    found = predict_scene(request, uncertainty=uncertainty)
    _warn_of((*found.doubts, *none_fits(found.picked.choices)))
    return Prediction(**vars(found))


def sweep(
    scene: SceneGiven,
    key: str,
    values: Sequence[float] | NDArray[np.float64],
    *,
    changes: Mapping[str, float] | None = None,
    noise: FilePath | None = None,
    radiometric: FilePath | None = None,
    calibrations: FilePath | None = None,
    light: LightPart = "total",
    engine: Engine = "own",
    out: FilePath | None = None,
) -> SweepResult:
    """Return what the model says of a scene at each value of one of its numbers.

    Parameters
    ----------
    scene : path or SceneFile
        Scene file, or what `load_scene` gave.
    key : str
        Which number, such as "sun.zenith_deg".
    values : sequence of float
        In the unit that the key ends in.
    changes, noise, radiometric, calibrations, light, engine
        As in `predict`.
    out : path or None
        Folder for sweep.csv, sweep.json and sweep.png.

    Raises
    ------
    ConfigError, DataError
        A file is wrong or does not fit, there is no such number, or a value is outside its range.
    """
    at = np.atleast_1d(np.asarray(values, dtype=np.float64))
    if at.ndim != 1 or not len(at) or not np.all(np.isfinite(at)):
        raise ConfigError("values: wanted is a list of one number or more, all of them finite")
    request = _predict_request(scene, changes, noise, radiometric, calibrations, light, engine)
    found = sweep_scene(request, (Axis(key=key, values=at),), out=maybe_path(out))
    _warn_of((*found.doubts, *none_fits(found.picked.choices)))
    return SweepResult(**vars(found))


def _predict_request(
    scene: SceneGiven,
    changes: Mapping[str, float] | None,
    noise: FilePath | None,
    radiometric: FilePath | None,
    calibrations: FilePath | None,
    light: LightPart,
    engine: Engine,
) -> PredictRequest:
    return PredictRequest(
        scene=_scene(scene),
        noise=maybe_path(noise),
        radiometric=maybe_path(radiometric),
        light=light,
        engine=engine,
        changes=dict(changes or {}),
        store=maybe_path(calibrations),
        picks=True,
    )


def _scene(given: SceneGiven) -> Path | SceneFile:
    return Path(given) if isinstance(given, str) else given


def _warn_of(doubts: Sequence[str]) -> None:
    for doubt in doubts:
        warnings.warn(doubt, stacklevel=3)
