"""Model beside measurement, row by row, with a decision over all rows."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.prediction import RegionPrediction, predict
from model.processing.agreement import propagate_inputs
from model.scenario import Readout
from rigctl.comparison.diagnosis import Diagnosis, diagnose
from rigctl.comparison.rows import Row, decide, off_prediction, pair, scored
from rigctl.comparison.run_geometry import scene_of_run
from rigctl.comparison.scene_inputs import Inputs, build_scenario, gather
from rigctl.comparison.scene_light import SceneLight
from rigctl.errors import ConfigError, DataError
from rigctl.files.scene_file import SceneFile
from rigctl.measurement.measurement import Measurement

FloatArray = NDArray[np.float64]

# A stage that lands this near to an angle was sent there [deg].
_LANDING_DEG = 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """A run set beside what the model says of it.

    Attributes
    ----------
    kind : str
        "scene": predicted from a scene file. "closed loop": predicted from the run's own means and texture.
    alpha : float
        Chance that any row is called a disagreement where all agree.
    rows : tuple of Row
        All of them.
    diagnosis : Diagnosis
        Where the disagreements point.
    predictions : dict
        Region to what the model says, for the figures.
    remarks : tuple of str
        What was assumed, overruled or left out.
    not_tested : tuple of str
        What this comparison says nothing about.
    """

    kind: str
    alpha: float
    rows: tuple[Row, ...]
    diagnosis: Diagnosis
    predictions: dict[str, RegionPrediction]
    remarks: tuple[str, ...]
    not_tested: tuple[str, ...]

    @property
    def agrees(self) -> bool:
        """Whether no row disagrees."""
        return not self.disagreements

    @property
    def disagreements(self) -> tuple[Row, ...]:
        """The rows that disagree."""
        return tuple(row for row in self.rows if row.agrees is False)


def compare_with_scene(
    measurement: Measurement, *, scene: SceneFile, noise: dict[str, Any] | None, alpha: float
) -> Comparison:
    """Return what a scene file predicts for a run beside what the run shows.

    Parameters
    ----------
    measurement : Measurement
        With the regions of the scene file.
    scene : SceneFile
        What the model is told. Angles, cycles and exposure are the run's own.
    noise : dict or None
        A noise calibration as its file holds it.
    alpha : float
        Chance of any false disagreement.

    Raises
    ------
    DataError
        The run cannot be predicted: exposures differ or are not known.
    """
    stated, (scene, moved) = scene, _scene_of_run(scene, measurement)
    inputs = gather(scene, noise)
    exposure_s = _one_exposure_s(measurement)
    light = SceneLight()
    predicted = partial(_predicted, measurement, scene, light, inputs.names)
    predictions = predicted(inputs.values)
    rows = tuple(_paired(predictions, measurement))
    errors = _input_errors(rows, inputs, predicted)
    decided = decide(tuple(scored(row, error) for row, error in zip(rows, errors, strict=True)), alpha=alpha)
    return Comparison(
        kind="scene",
        alpha=alpha,
        rows=decided,
        diagnosis=diagnose(decided),
        predictions=predictions,
        remarks=(
            *inputs.remarks,
            *_overruled(stated, measurement, exposure_s),
            *moved,
            *light.remarks(scene, inputs.named),
            *_made_of(scene, light, inputs),
            *_model_warnings(predictions),
        ),
        not_tested=_not_tested(measurement, scene),
    )


def predict_run(
    measurement: Measurement, *, scene: SceneFile, noise: dict[str, Any] | None
) -> dict[str, RegionPrediction]:
    """Return what a scene file predicts for the angles, cycles and exposure of a run.

    Raises
    ------
    DataError
        Exposures differ or are not known.
    """
    scene, _ = _scene_of_run(scene, measurement)
    inputs = gather(scene, noise)
    return _predicted(measurement, scene, SceneLight(), inputs.names, inputs.values)


def _predicted(
    measurement: Measurement, scene: SceneFile, light: SceneLight, names: tuple[str, ...], values: FloatArray
) -> dict[str, RegionPrediction]:
    named = dict(zip(names, values.tolist(), strict=True))
    exposure_s = _one_exposure_s(measurement)
    return predict(build_scenario(scene, named, readout=_run_readout(measurement), exposure_s=exposure_s, light=light))


def _scene_of_run(scene: SceneFile, measurement: Measurement) -> tuple[SceneFile, tuple[str, ...]]:
    frames = [record for cycle in measurement.grid.records for record in cycle]
    return scene_of_run(scene, measurement.run, frames)


def _made_of(scene: SceneFile, light: SceneLight, inputs: Inputs) -> Iterable[str]:
    """Return what the light of each region given by its material is made of, in words."""
    for region in scene.regions:
        if region.material is not None:
            found = light.region(scene, region, inputs.named)
            sun, sky, path, total = (
                found.mean(part)[0] for part in ("reflected_sun", "reflected_sky", "path", "total")
            )
            yield (
                f"{region.name}: {sun / total:.1%} of S0 is reflected sun, {sky / total:.1%} reflected sky, "
                f"{path / total:.1%} path"
            )


def _paired(predictions: Mapping[str, RegionPrediction], measurement: Measurement) -> Iterable[Row]:
    for region, prediction in predictions.items():
        if region not in measurement.regions:
            raise ConfigError(f"region {region} of the scene file was not measured")
        yield from pair(region, prediction.quantities, measurement.regions[region].quantities)


def _input_errors(rows: tuple[Row, ...], inputs: Inputs, predicted: Any) -> FloatArray:
    """Return for each row the standard error of its prediction."""
    uncertain = np.flatnonzero(np.diag(inputs.cov) > 0.0)

    def at(some: FloatArray) -> FloatArray:
        values = inputs.values.copy()
        values[uncertain] = some
        quantities = {name: region.quantities for name, region in predicted(values).items()}
        found = [quantities[row.region][row.quantity][row.statistic] for row in rows]
        return np.array([off_prediction(row, value) for value, row in zip(found, rows, strict=True)])

    cov = propagate_inputs(
        at,
        inputs.values[uncertain],
        inputs.cov[np.ix_(uncertain, uncertain)],
        least=tuple(inputs.least[uncertain]),
    )
    return np.sqrt(np.diag(cov))


def _one_exposure_s(measurement: Measurement) -> float:
    exposures = measurement.grid.exposures_s
    if exposures is None:
        raise DataError(f"{measurement.run.path}: its exposure is not known, and a scene cannot be predicted without")
    if not measurement.grid.is_one_exposure:
        raise DataError(f"{measurement.run.path}: its angles have different exposures; a scene needs one for all")
    return float(exposures[0])


def _run_readout(measurement: Measurement) -> Readout:
    grid = measurement.grid
    return Readout(
        angles_rad=grid.polarizer_angles_rad,
        channel_names=grid.channel_names,
        cycles=grid.cycles,
        extinction_ratio=measurement.extinction_ratio,
    )


def _overruled(scene: SceneFile, measurement: Measurement, exposure_s: float) -> Iterable[str]:
    if abs(scene.acquisition.exposure_ms / 1000 - exposure_s) > 1e-6 * exposure_s:
        yield (
            f"exposure: {exposure_s * 1000:g} ms of the run, not {scene.acquisition.exposure_ms:g} ms of the scene file"
        )
    if scene.acquisition.cycles != measurement.grid.cycles:
        yield f"cycles: {measurement.grid.cycles} of the run, not {scene.acquisition.cycles} of the scene file"
    stated_deg = np.sort(np.mod(scene.acquisition.angles_deg, 180.0))
    read_deg = np.rad2deg(measurement.grid.polarizer_angles_rad)
    if not _same_angles(stated_deg, read_deg):
        run, file = (", ".join(f"{angle:.4g}" for angle in angles) for angles in (read_deg, stated_deg))
        yield f"angles: {run} deg of the run, not {file} deg of the scene file"
    if np.isfinite(measurement.extinction_ratio):
        return
    yield "the processing takes the polarizer as ideal: the run states no extinction ratio"


def _same_angles(stated_deg: FloatArray, read_deg: FloatArray) -> bool:
    """Whether axes are the same ones, as near as a stage lands."""
    if stated_deg.size != read_deg.size:
        return False
    apart = np.mod(stated_deg - read_deg + 90.0, 180.0) - 90.0
    return bool(np.all(np.abs(apart) < _LANDING_DEG))


def _model_warnings(predictions: Mapping[str, RegionPrediction]) -> Iterable[str]:
    for name, prediction in predictions.items():
        for warning in prediction.warnings:
            yield f"{name}: {warning}"


def _not_tested(measurement: Measurement, scene: SceneFile) -> tuple[str, ...]:
    given = [region.name for region in scene.regions if region.material is None]
    found = []
    if len(given) == len(scene.regions):
        found.append(
            "the radiance of the scene: the model was given it, it did not compute it from surface, sun and sky"
        )
    elif given:
        found.append(f"the radiance of {', '.join(given)}: the model was given it")
    if measurement.run.session.get("origin") == "simulated":
        found.append("any real device: stage, camera and light are simulated, with assumed numbers")
    if measurement.grid.cycles < 2:
        found.append("temporal noise: there is one cycle only")
    return tuple(found)
