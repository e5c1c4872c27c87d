"""Predictions of the rounds of a planned session: what each region gives at each exposure, by the sun of the round."""

from collections.abc import Iterator
from datetime import UTC, datetime

from model.prediction import RegionPrediction
from model.quantities import is_counts
from rigctl.base.numbers import NS_PER_S
from rigctl.calibrations.noise import NoiseParameters
from rigctl.console.json_text import Json
from rigctl.errors import ConfigError
from rigctl.files.rig_file import RigFile
from rigctl.files.scene_file import SceneFile, SunSection
from rigctl.files.session_file import MeteringSection
from rigctl.prediction.predict import ScenePredictor
from rigctl.scene.light import SceneLight
from rigctl.scene.scene import EXPOSURE
from rigctl.session.plan import SessionPlan

_MS_PER_S = 1000.0


def predict_rounds(
    scene: SceneFile, noise: NoiseParameters | None, planned: SessionPlan, rig: RigFile, metering: MeteringSection
) -> Iterator[dict[str, Json]]:
    """Give what each region gives in each round and at each exposure.

    A scene of stated radiances does not know the sun: its numbers are those of every round, and stand once. A metered
    exposure is that at which the brightest region's mean reaches the metering's target. Counts are those above black
    level by channel [DN]; `saturated_fraction` is the largest of a channel. A round that cannot be predicted, such as
    one with the sun at the horizon, has its `problem` instead.
    """
    light = SceneLight()
    for number, time_ns in planned.rounds().items():
        try:
            predictor = ScenePredictor(_lit(scene, rig, time_ns), noise, light=light)
            for exposure_s in _exposures_s(planned, number, predictor, scene, metering):
                found = predictor.predictions({EXPOSURE: exposure_s * _MS_PER_S})
                for name, prediction in found.items():
                    yield _row(number, exposure_s * _MS_PER_S, name, prediction)
        except ConfigError as error:
            yield {"round": number, "exposure_ms": 0.0, "region": "all regions", "problem": str(error)}
        if not scene.has_materials:
            break


def _lit(scene: SceneFile, rig: RigFile, time_ns: int) -> SceneFile:
    if not scene.has_materials:
        return scene
    site = rig.site or scene.site
    if site is None:
        raise ConfigError("--scene: its light depends on the sun: the rig file needs [site]")
    time = datetime.fromtimestamp(time_ns / NS_PER_S, tz=UTC)
    return scene.model_copy(update={"site": site, "sun": SunSection(time=time)})


def _exposures_s(
    planned: SessionPlan, number: int, predictor: ScenePredictor, scene: SceneFile, metering: MeteringSection
) -> list[float]:
    steps = [step for step in planned.steps if step.round == number and step.kind == "scene"]
    known = {step.exposure_s for step in steps if step.exposure_s is not None}
    factors = {step.exposure_factor for step in steps if step.exposure_s is None}
    metered_s = _metered_s(predictor, scene, metering) if factors else 0.0
    return sorted(known | {metered_s * factor for factor in factors})


def _metered_s(predictor: ScenePredictor, scene: SceneFile, metering: MeteringSection) -> float:
    """Return the exposure at which the brightest mean reaches the target: counts are proportional to it."""
    trial_s = metering.first_exposure_ms / _MS_PER_S
    found = predictor.predictions({EXPOSURE: metering.first_exposure_ms})
    brightest_dn = max(float(prediction.channels.mean_dn.max()) for prediction in found.values())
    wanted_s: float = trial_s * metering.target * (2**scene.sensor.bit_depth - 1) / brightest_dn
    return float(min(max(wanted_s, metering.shortest_ms / _MS_PER_S), metering.longest_ms / _MS_PER_S))


def _row(number: int, exposure_ms: float, region: str, prediction: RegionPrediction) -> dict[str, Json]:
    quantities = prediction.quantities
    return {
        "round": number,
        "exposure_ms": exposure_ms,
        "region": region,
        "mean_dn": {name: values["mean"] for name, values in quantities.items() if is_counts(name)},
        "saturated_fraction": float(prediction.channels.saturation_probability.max()),
        "dolp": quantities.get("dolp", {}).get("mean"),
        "dolp_snr": quantities.get("dolp_snr", {}).get("mean"),
        "warnings": list(prediction.warnings),
    }
