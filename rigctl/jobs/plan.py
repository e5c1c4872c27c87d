"""Planning a session: rig, session and scene file in; what is taken when, and what it can give, out."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

from model.prediction import RegionPrediction
from model.quantities import is_counts
from rigctl.calibrations.noise.noise_file import NoiseParameters, read_noise_file
from rigctl.calibrations.rig_picks import store_doubts
from rigctl.console.json_text import Json
from rigctl.errors import ConfigError
from rigctl.files.light_sections import SunSection
from rigctl.files.rig_file import RigFile, load_rig, placeholder_doubt
from rigctl.files.scene_file import SceneFile, load_scene
from rigctl.files.session_file import MeteringSection, load_session
from rigctl.numbers.utc_time import NS_PER_S
from rigctl.prediction.scene_prediction import ScenePredictor
from rigctl.scene.parameter_table import EXPOSURE
from rigctl.scene.scene_light import SceneLight
from rigctl.session.planning.session_plan import SessionPlan, plan_session
from rigctl.session.session_clock import SessionClock

_MS_PER_S = 1000.0


@dataclass(frozen=True, kw_only=True)
class PlanRequest:
    """A session that is to be planned.

    Attributes
    ----------
    rig, session : Path
        Files.
    at_ns, until_ns : int or None
        When it begins, None is now, and from when on no frame is taken [ns since 1970 UTC].
    scene, noise : Path or None
        Scene file and noise calibration, to predict each round.
    pixels : int or None
        Of a real camera's picture, for the disk.
    """

    rig: Path
    session: Path
    at_ns: int | None = None
    until_ns: int | None = None
    scene: Path | None = None
    noise: Path | None = None
    pixels: int | None = None


@dataclass(frozen=True, kw_only=True)
class RoundPrediction:
    """Prediction of a region in a round at an exposure.

    Attributes
    ----------
    round : int
        Of the schedule.
    exposure_ms : float
        Integration time [ms].
    region : str
        Its name.
    mean_dn : mapping
        Counts above black level by channel [DN].
    saturated_fraction : float
        Largest share of saturated pixels of a channel.
    dolp, dolp_snr : float or None
        Degree of linear polarization and its ratio to its deviation.
    warnings : tuple of str
        Of the model.
    """

    round: int
    exposure_ms: float
    region: str
    mean_dn: dict[str, float]
    saturated_fraction: float
    dolp: float | None
    dolp_snr: float | None
    warnings: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class UnpredictedRound:
    """A round that cannot be predicted, such as one with the sun at the horizon, and why."""

    round: int
    exposure_ms: float = 0.0
    region: str = "all regions"
    problem: str


Prediction = RoundPrediction | UnpredictedRound


@dataclass(frozen=True, kw_only=True, eq=False)
class PlannedSession:
    """A session laid out in time; `predictions` is None without a scene, `doubts` what is doubtful of its rig."""

    plan: SessionPlan
    predictions: tuple[Prediction, ...] | None
    doubts: tuple[str, ...] = ()

    def content(self) -> dict[str, Json]:
        """Return it as JSON holds it."""
        if self.predictions is None:
            return self.plan.content()
        return self.plan.content() | {"predictions": [asdict(row) for row in self.predictions]}


def plan(request: PlanRequest) -> PlannedSession:
    """Return a session laid out in time; with a scene, what each round can give.

    Raises
    ------
    ConfigError, DataError
        A file is wrong, the schedule has no round, or the light of the scene needs a site.
    """
    if request.noise is not None and request.scene is None:
        raise ConfigError("--noise: is for a prediction; give --scene too")
    rig, session = load_rig(request.rig), load_session(request.session)
    now_ns = request.at_ns or SessionClock().utc_ns()
    planned = plan_session(rig, session, now_ns=now_ns, until_ns=request.until_ns, pixels=request.pixels)
    unset = placeholder_doubt(rig)
    doubts = (*(() if unset is None else (unset,)), *store_doubts(rig, request.rig, now_ns=now_ns))
    if request.scene is None:
        return PlannedSession(plan=planned, predictions=None, doubts=doubts)
    scene = load_scene(request.scene)
    noise = None if request.noise is None else read_noise_file(request.noise)
    predictions = tuple(predict_rounds(scene, noise, planned, rig, session.metering))
    return PlannedSession(plan=planned, predictions=predictions, doubts=doubts)


def predict_rounds(
    scene: SceneFile, noise: NoiseParameters | None, planned: SessionPlan, rig: RigFile, metering: MeteringSection
) -> Iterator[Prediction]:
    """Give what each region gives in each round and at each exposure.

    Notes
    -----
    A scene of stated radiances does not know the sun: its numbers are those of every round, and stand once. A metered
    exposure is that at which the brightest region's mean reaches the metering's target.
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
            yield UnpredictedRound(round=number, problem=str(error))
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


def _row(number: int, exposure_ms: float, region: str, prediction: RegionPrediction) -> RoundPrediction:
    quantities = prediction.quantities
    return RoundPrediction(
        round=number,
        exposure_ms=exposure_ms,
        region=region,
        mean_dn={name: values["mean"] for name, values in quantities.items() if is_counts(name)},
        saturated_fraction=float(prediction.channels.saturation_probability.max()),
        dolp=quantities.get("dolp", {}).get("mean"),
        dolp_snr=quantities.get("dolp_snr", {}).get("mean"),
        warnings=tuple(prediction.warnings),
    )
