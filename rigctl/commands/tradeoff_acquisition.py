"""``rigctl tradeoff --acquisition``, and how many cycles ``rigctl acquire --target-dolp-sigma`` takes."""

import json
from math import pi
from pathlib import Path

from model.acquisition.session_design import Disturbances, Session
from model.acquisition.session_search import Reached, Wanted, fewest_cycles
from rigctl.calibrations.noise.noise_file import NoiseParameters
from rigctl.comparison.acquisition_tradeoff import (
    MORNING,
    OVERHEAD_S,
    TradeoffRequest,
    acquisition_tradeoff,
)
from rigctl.comparison.scene_sessions import SceneSessions
from rigctl.durable_file import write_durably
from rigctl.errors import ConfigError
from rigctl.files.scene_file import SceneFile
from rigctl.files.session_file import SessionFile, Take
from rigctl.reports.tables.acquisition_tables import (
    assumptions,
    curve_table,
    proposal,
    reached_table,
    reasons,
    tradeoff_csv,
    tradeoff_json,
)
from rigctl.terminal import print_json, progress, results

_MS_PER_S = 1000.0
_PERCENT_A_MINUTE = 0.01 / 60.0
_RAD_PER_DEG = pi / 180.0


def show_acquisition_tradeoff(
    scene: SceneFile,
    noise: NoiseParameters | None,
    *,
    target_dolp_sigma: float | None = None,
    p_detection: float | None = None,
    p_false_alarm: float = 1e-3,
    region: str | None = None,
    pair: str | None = None,
    pixels: int = 1,
    drift_percent_per_min: float = 1.0,
    settling_time_ms: float = 0.0,
    overhead_ms: float = OVERHEAD_S * _MS_PER_S,
    out: Path | None = None,
    as_json: bool = False,
) -> None:
    """Print what sessions of a scene give for their time; with a target, the shortest that reaches it.

    Parameters
    ----------
    scene, noise
        Scene file, and a noise calibration or None.
    target_dolp_sigma
        Largest error of DoLP: noise, with drift and settling in square to it.
    p_detection, p_false_alarm
        Least probability of detection of a pixel of `pair`, at which false alarm.
    region
        Whose DoLP counts; every region if None.
    pair
        Target and background, "TARGET,BACKGROUND".
    pixels
        How many are averaged before DoLP is taken.
    drift_percent_per_min, settling_time_ms, overhead_ms
        Of light, polarizer and frame.
    out
        Folder for acquisition.csv, acquisition.json and acquisition.png.
    as_json
        Whether to answer in JSON.

    Raises
    ------
    ConfigError
        An option is outside its range, or the scene has no such region.
    """
    try:
        request = TradeoffRequest(
            wanted=Wanted(dolp_total=target_dolp_sigma, p_detection=p_detection, p_false_alarm=p_false_alarm),
            region=region,
            pair=_pair(pair),
            pixels=pixels,
            disturbances=Disturbances(
                drift_per_s=drift_percent_per_min * _PERCENT_A_MINUTE, settling_time_s=settling_time_ms / _MS_PER_S
            ),
            overhead_s=overhead_ms / _MS_PER_S,
        )
        found = acquisition_tradeoff(scene, noise, request)
    except ValueError as error:
        raise ConfigError(f"--acquisition: {error}") from error
    if out is not None:
        from rigctl.reports.figures.acquisition_figure import (
            tradeoff_picture,  # half a second, wanted for a picture only
        )

        out.mkdir(parents=True, exist_ok=True)
        write_durably(out / "acquisition.csv", tradeoff_csv(found))
        write_durably(out / "acquisition.json", (json.dumps(tradeoff_json(found), allow_nan=False) + "\n").encode())
        write_durably(out / "acquisition.png", tradeoff_picture(found))
    if as_json:
        print_json(tradeoff_json(found))
        return
    for line in assumptions(found):
        results().print(line, markup=False)
    results().print(curve_table(found))
    if found.reached:
        results().print(reached_table(found))
        text = proposal(found)
        results().print("nothing that was tried reaches it" if text is None else text, markup=False)
    for line in (*reasons(found), *found.remarks):
        progress().print(line, markup=False)
    if out is not None:
        progress().print(f"acquisition.csv, acquisition.json and acquisition.png in {out}", markup=False)


def with_cycles_for(
    session: SessionFile, scene: SceneFile, noise: NoiseParameters | None, *, target_dolp_sigma: float
) -> tuple[SessionFile, tuple[str, ...]]:
    """Return a session with as many cycles as bring the error of DoLP of every region down to a target.

    Parameters
    ----------
    session
        Its angles, order and exposures stay; of several exposures, the one that needs fewest cycles decides.
    scene, noise
        What it will look at, and with which noise; None: as the scene file assumes it.
    target_dolp_sigma
        Largest error of DoLP of a pixel from the mean of a round, above 0: noise, with light that drifts by 1 % a
        minute in square to it.

    Returns
    -------
    session : SessionFile
        With its scene frames' cycles set.
    lines : tuple of str
        What was chosen, in words.

    Raises
    ------
    ConfigError
        No number of cycles reaches it, or it cannot be predicted.
    """
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


def _pair(text: str | None) -> tuple[str, str] | None:
    if text is None:
        return None
    names = [name.strip() for name in text.split(",")]
    if len(names) != 2 or not all(names):
        raise ConfigError(f"--pair: is {text!r}, must be TARGET,BACKGROUND")
    return names[0], names[1]
