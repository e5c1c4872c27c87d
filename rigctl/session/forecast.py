"""Forecasts for a session by the model of a scene: signals of each planned round, and the cycles that reach an error.

`predict_rounds` predicts each region at each exposure under the sun of the round. `with_cycles_for` chooses the number
of cycles that brings the error of DoLP down to a target.
"""

from collections.abc import Iterator
from datetime import UTC, datetime
from math import radians

from model.acquisition import Reached, Session, Wanted, fewest_cycles
from model.prediction import RegionPrediction
from model.quantities import is_counts
from rigctl.base.numbers import NS_PER_S
from rigctl.calibrations.noise import NoiseParameters
from rigctl.console import Json
from rigctl.errors import ConfigError
from rigctl.files.rig_file import RigFile
from rigctl.files.scene_file import SceneFile, SunSection
from rigctl.files.session_file import MeteringSection, SessionFile, Take
from rigctl.prediction.predict import ScenePredictor
from rigctl.prediction.sessions import MORNING, OVERHEAD_S, SceneSessions
from rigctl.scene.light import SceneLight
from rigctl.scene.scene import EXPOSURE
from rigctl.session.plan import SessionPlan

_MS_PER_S = 1000.0


def predict_rounds(
    scene: SceneFile, noise: NoiseParameters | None, planned: SessionPlan, rig: RigFile, metering: MeteringSection
) -> Iterator[dict[str, Json]]:
    """Yield the predicted signal of each region in each round at each exposure.

    A scene of stated radiances does not depend on the sun, so every round has the same numbers. A metered exposure is
    the one at which the mean of the brightest region reaches the target of metering. Counts are above black level, by
    channel [DN]; `saturated_fraction` is that of the worst channel. A round that cannot be predicted, for instance
    because the sun is at the horizon, has a `problem` instead.
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


def with_cycles_for(
    session: SessionFile, scene: SceneFile, noise: NoiseParameters | None, *, target_dolp_sigma: float
) -> tuple[SessionFile, tuple[str, ...]]:
    """Return a session with enough cycles for a target error of DoLP in every region, and the choice in words."""
    try:
        wanted = Wanted(dolp_total=target_dolp_sigma)
        sessions = SceneSessions(scene, noise)
        chosen = [_chosen(take, sessions, session, wanted) if take.kind == "scene" else None for take in session.take]
    except ValueError as error:
        raise ConfigError(f"--target-dolp-sigma: {error}") from error
    if not any(chosen):
        raise ConfigError("--target-dolp-sigma: the session takes no scene frames")
    takes = [
        take if best is None else take.model_copy(update={"cycles": best.cycles})
        for take, best in zip(session.take, chosen, strict=True)
    ]
    lines = tuple(
        f"{best.cycles} cycles of {len(best.angles_rad)} angles at {best.exposure_s * _MS_PER_S:.4g} ms: error of DoLP "
        f"at most {target_dolp_sigma:g}, about {best.duration_s:.0f} s"
        for best in chosen
        if best is not None
    )
    return session.model_copy(update={"take": takes}), lines


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


def _chosen(take: Take, sessions: SceneSessions, session: SessionFile, wanted: Wanted) -> Session:
    """Return the frames of a take with the fewest cycles that reach the target."""
    if take.order == "grouped":
        raise ConfigError("--target-dolp-sigma: order 'grouped' has no cycles to count; take cycles or palindrome")
    angles_rad = tuple(radians(angle) for angle in take.polarizer_angles_deg if angle is not None)
    starts = [
        Session(angles_rad=angles_rad, pattern=take.order, exposure_s=exposure_s * factor, overhead_s=OVERHEAD_S)
        for exposure_s in _take_exposures_s(take, sessions, session)
        for factor in take.exposure_factors
    ]
    found = [
        fewest_cycles(sessions.scheme(start), wanted, disturbances=MORNING, regions=sessions.regions)
        for start in starts
    ]
    reached = [one.session for one in found if one.session is not None]
    if not reached:
        raise ConfigError(f"--target-dolp-sigma: {_why_not(found)}")
    return min(reached, key=lambda one: one.cycles)


def _take_exposures_s(take: Take, sessions: SceneSessions, session: SessionFile) -> list[float]:
    metered = [exposure_s for exposure_s in take.exposures_s if exposure_s is None]
    known = [exposure_s for exposure_s in take.exposures_s if exposure_s is not None]
    return known + ([sessions.filling_exposure_s(share=session.metering.target)] if metered else [])


def _why_not(found: list[Reached]) -> str:
    return "; ".join(dict.fromkeys(one.why_not for one in found))
