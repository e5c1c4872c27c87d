"""Remarks beside the rows of a comparison: overruled, assumed, not tested."""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigctl.base.numbers import wrapped

if TYPE_CHECKING:
    from model.prediction import RegionPrediction
    from rigctl.comparison.scale import Scale
    from rigctl.measure.measure import Measurement
    from rigctl.scene.scene import Inputs, Scene

FloatArray = NDArray[np.float64]

# A stage that lands this near to an angle was sent there [deg].
_LANDING_DEG = 1.0
# What no simulated run says anything about.
NOT_OF_SIMULATION = (
    (
        "the scene part of the model against nature: a simulated scene whose truth was computed by the model, or "
        "stated in a file, agrees with it because both have one source"
    ),
    "any real device: stage, camera and light are simulated, with assumed numbers",
)


def overruled(scene: "Scene", measurement: "Measurement", exposure_s: float) -> Iterable[str]:
    """Return what the run says otherwise than the scene file, and what it does not say."""
    if abs(scene.acquisition.exposure_ms / 1000 - exposure_s) > 1e-6 * exposure_s:
        yield (
            f"exposure: {exposure_s * 1000:g} ms of the run, not {scene.acquisition.exposure_ms:g} ms of the scene file"
        )
    if scene.acquisition.cycles != measurement.grid.cycles:
        yield f"cycles: {measurement.grid.cycles} of the run, not {scene.acquisition.cycles} of the scene file"
    light = measurement.run.session.simulated_light
    yield from () if light is None else light.remarks
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
    apart = wrapped(stated_deg - read_deg, turn=180.0)
    return bool(np.all(np.abs(apart) < _LANDING_DEG))


def model_warnings(predictions: Mapping[str, "RegionPrediction"]) -> Iterable[str]:
    """Return where the model is void or poor, by region."""
    for name, prediction in predictions.items():
        for warning in prediction.warnings:
            yield f"{name}: {warning}"


def not_tested(measurement: "Measurement", scene: "Scene", scale: "Scale", uncertain: "Inputs") -> tuple[str, ...]:
    """Return what a comparison with a scene says nothing about."""
    given = [region.name for region in scene.regions if region.material is None]
    found = []
    if len(given) == len(scene.regions):
        found.append(
            "the radiance of the scene: the model was given it, it did not compute it from surface, sun and sky"
        )
    elif given:
        found.append(f"the radiance of {', '.join(given)}: the model was given it")
    light = measurement.run.session.simulated_light
    found.extend(() if light is None else light.caution)
    if measurement.run.session.origin == "simulated":
        found.extend(NOT_OF_SIMULATION)
    if scale.kind == "free":
        found.append("the scale of the counts: it was fitted to S0 of this run")
    if not uncertain.names:
        found.append(
            "whether the numbers of the scene file are right within what is known of them: none has an uncertainty, "
            "write { value = ..., std = ... } or { range = [..., ...] }"
        )
    if measurement.run.session.cell_deg is not None:
        found.append(
            "deviations of Stokes parameters and DoLP over the pixels: behind polarizers on the pixels each angle has "
            "pixels of its own, and what their texture has in common is not known"
        )
    if measurement.grid.cycles < 2:
        found.append("temporal noise: there is one cycle only")
    return tuple(found)
