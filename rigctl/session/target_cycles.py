"""Cycles that a session takes to bring the error of DoLP in a scene down to a target."""

from math import pi

from model.acquisition import Reached, Session, Wanted, fewest_cycles
from rigctl.calibrations.noise import NoiseParameters
from rigctl.errors import ConfigError
from rigctl.files.scene_file import SceneFile
from rigctl.files.session_file import SessionFile, Take
from rigctl.prediction.sessions import MORNING, OVERHEAD_S, SceneSessions

_MS_PER_S = 1000.0
_RAD_PER_DEG = pi / 180.0


def with_cycles_for(
    session: SessionFile, scene: SceneFile, noise: NoiseParameters | None, *, target_dolp_sigma: float
) -> tuple[SessionFile, tuple[str, ...]]:
    """Return a session with as many cycles as bring the error of DoLP of every region down to a target."""
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


def _chosen(take: Take, sessions: SceneSessions, session: SessionFile, wanted: Wanted) -> Session:
    """Return the frames of a take with the fewest cycles that reach what is wanted."""
    if take.order == "grouped":
        raise ConfigError("--target-dolp-sigma: order 'grouped' has no cycles to count; take cycles or palindrome")
    angles_rad = tuple(angle * _RAD_PER_DEG for angle in take.polarizer_angles_deg if angle is not None)
    starts = [
        Session(angles_rad=angles_rad, pattern=take.order, exposure_s=exposure_s * factor, overhead_s=OVERHEAD_S)
        for exposure_s in _exposures_s(take, sessions, session)
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


def _exposures_s(take: Take, sessions: SceneSessions, session: SessionFile) -> list[float]:
    metered = [exposure_s for exposure_s in take.exposures_s if exposure_s is None]
    known = [exposure_s for exposure_s in take.exposures_s if exposure_s is not None]
    return known + ([sessions.filling_exposure_s(share=session.metering.target)] if metered else [])


def _why_not(found: list[Reached]) -> str:
    return "; ".join(dict.fromkeys(one.why_not for one in found))
