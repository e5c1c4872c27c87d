"""Trading accuracy against time: of the computation, and of the session that is taken of a scene."""

from collections.abc import Callable, Sequence
from pathlib import Path

from model.accuracy.plan import optical_depth
from model.accuracy.predict import DEEPEST
from rigctl.calibrations.noise.noise_file import read_noise_file
from rigctl.errors import ConfigError, as_config_error
from rigctl.files.scene_file import load_scene
from rigctl.prediction.accuracy_curves import Curves, accuracy_curves, steps
from rigctl.prediction.acquisition_tradeoff import AcquisitionTradeoff, TradeoffRequest, acquisition_tradeoff
from rigctl.prediction.scene_prediction import ScenePredictor
from rigctl.reports.outputs.prediction_files import write_accuracy_tradeoff, write_acquisition_tradeoff
from rigctl.scene.scene_light import SceneLight

# Told what is being done, in words, the steps done, and how many there are.
Progress = Callable[[str, int, int], None]


def trade_accuracy(
    scene: Path,
    tolerances: Sequence[float],
    *,
    noise: Path | None = None,
    also: Sequence[str] = (),
    out: Path | None = None,
    progress: Progress | None = None,
) -> Curves:
    """Return error against time of each numerical setting and of the whole chain, measured here and now.

    Parameters
    ----------
    scene : Path
        Scene file.
    tolerances : sequence of float
        To be shown, 1e-5 to 0.1; small ones take longest.
    noise : Path or None
        Noise calibration, in place of the assumed noise.
    also : sequence of str
        Own choices to show beside the paper's, such as "tiles_per_side=3,rule=midpoint".
    out : Path or None
        Folder for tradeoff.csv, tradeoff.json, tradeoff.png and digits.png.
    progress : callable or None
        Told of every step.

    Raises
    ------
    ConfigError, DataError
        A file is wrong, or a tolerance is outside its range.
    """
    predictor = ScenePredictor(load_scene(scene), None if noise is None else read_noise_file(noise), light=SceneLight())
    with as_config_error(f"scene {predictor.scene.name}"):
        _require_shallow(predictor)
        curves = _curves(predictor, tolerances, also, progress)
    if out is not None:
        write_accuracy_tradeoff(curves, out)
    return curves


def _require_shallow(predictor: ScenePredictor) -> None:
    depth = optical_depth(predictor.lit_scene())
    if depth > DEEPEST:
        raise ConfigError(
            f"scene {predictor.scene.name}: its optical depth is {depth:.3g}, allowed for a trade-off is {DEEPEST:g}: "
            "the reference for deeper air takes minutes. rigctl predict --tolerance says what coarse settings keep"
        )


def _curves(
    predictor: ScenePredictor, tolerances: Sequence[float], also: Sequence[str], progress: Progress | None
) -> Curves:
    for done, step in enumerate(accuracy_curves(predictor, tolerances, also=also)):
        if isinstance(step, Curves):
            return step
        if progress is not None:
            progress(step, done, steps(tolerances))
    raise RuntimeError("the curves ended without a result")


def trade_acquisition(
    scene: Path, request: TradeoffRequest, *, noise: Path | None = None, out: Path | None = None
) -> AcquisitionTradeoff:
    """Return what sessions of a scene give for their time, and the shortest that reaches what is wanted.

    Parameters
    ----------
    scene : Path
        Scene file.
    request : TradeoffRequest
        What is asked of the sessions.
    noise : Path or None
        Noise calibration, in place of the assumed noise.
    out : Path or None
        Folder for acquisition.csv, acquisition.json and acquisition.png.

    Raises
    ------
    ConfigError, DataError
        A file is wrong, a number is outside its range, or the scene has no such region.
    """
    noise_file = None if noise is None else read_noise_file(noise)
    try:
        found = acquisition_tradeoff(load_scene(scene), noise_file, request)
    except ValueError as error:
        raise ConfigError(f"--acquisition: {error}") from error
    if out is not None:
        write_acquisition_tradeoff(found, out)
    return found
