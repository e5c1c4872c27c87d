"""Error of DoLP against the time of a session.

`SceneSessions` gives the light of each region in one cycle of frames, at given angles and exposure.
`acquisition_tradeoff` tries angle sets, orders, exposures and waits, and finds the shortest session that reaches the
goals.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from math import degrees

import numpy as np

from model.acquisition import (
    PATTERNS,
    SATURATED,
    CycleLight,
    Disturbances,
    DolpBudget,
    Obstacle,
    Pattern,
    Reached,
    Scheme,
    Session,
    Wanted,
    cycle_light,
    dolp_budget,
    fewest_cycles,
    least_drifting_order,
    shortest,
)
from model.moments import Moments
from model.processing.reconstruction import equispaced_rad
from model.sensor import Sensor
from rigctl.calibrations.noise import NoiseParameters
from rigctl.errors import ConfigError, as_config_error
from rigctl.files.scene_file import SceneFile
from rigctl.scene.light import SceneLight, build_scenario
from rigctl.scene.scene import scene_of_file

# Share of the largest count for the brightest counts.
_FILLING = 0.8


class SceneSessions:
    """Schemes of a scene: light of its regions in one cycle at given angles and exposure."""

    def __init__(self, scene: SceneFile, noise: NoiseParameters | None, *, light: SceneLight | None = None) -> None:
        self._scene = scene_of_file(scene, noise)
        scenario = build_scenario(self._scene, light=light)
        self._sensor: Sensor = scenario.sensor
        self._apertures: dict[str, Moments] = {region.name: region.aperture_moments() for region in scenario.regions}
        self._lights: dict[tuple[tuple[float, ...], float], dict[str, CycleLight]] = {}

    @property
    def regions(self) -> tuple[str, ...]:
        """Names of the regions."""
        return tuple(self._apertures)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Assumptions on scene and sensor."""
        return self._scene.remarks

    def scheme(self, session: Session) -> Scheme:
        """Return the light of each region in a cycle of a session."""
        key = (session.angles_rad, session.exposure_s)
        if key not in self._lights:
            with as_config_error(f"scene {self._scene.name}"):
                self._lights[key] = self._seen(session)
        return Scheme(session=session, lights=self._lights[key])

    def filling_exposure_s(self, *, share: float = _FILLING) -> float:
        """Return the exposure at which the brightest region's mean behind any angle is a share of full scale [s]."""
        trial = Session(angles_rad=tuple(equispaced_rad(8)), exposure_s=self._sensor.exposure_s)
        brightest_dn = max(float(light.channels_dn.max()) for light in self.scheme(trial).lights.values())
        full_scale_dn = float(2**self._sensor.bit_depth - 1)
        return share * full_scale_dn / brightest_dn * self._sensor.exposure_s

    def _seen(self, session: Session) -> dict[str, CycleLight]:
        sensor = replace(self._sensor, exposure_s=session.exposure_s)
        ratio = self._scene.sensor.extinction_ratio.value
        return {
            name: cycle_light(aperture, sensor=sensor, angles_rad=session.angles_rad, extinction_ratio=ratio)
            for name, aperture in self._apertures.items()
        }


# Time to turn the polarizer and store the frame, as in `rigctl plan` [s].
OVERHEAD_S = 0.42
# Drift of 1 % per minute, as under a clear sky in the morning.
DRIFT_PER_S = 0.01 / 60.0
NOTHING_WANTED = Wanted()
MORNING = Disturbances(drift_per_s=DRIFT_PER_S)
_SHORTER = (1.0, 0.5, 0.25, 0.125)
# Waits for the polarizer to settle, in settling times.
_SETTLE_TIMES = (0.0, 2.0, 4.0, 6.0, 8.0)
_CURVE_CYCLES = (1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024)


@dataclass(frozen=True, kw_only=True)
class TradeoffRequest:
    """A question to the sessions of a scene."""

    wanted: Wanted = NOTHING_WANTED  #: Goals; none by default.
    region: str | None = None  #: Regions with a goal for DoLP; None for every region.
    pair: tuple[str, str] | None = None  #: Target and background of the detection.
    pixels: int = 1  #: Number of pixels averaged before DoLP is computed.
    disturbances: Disturbances = MORNING  #: Drift and settling.
    overhead_s: float = OVERHEAD_S  #: Turning and storing, per frame [s].
    #: Exposures to try [s]; by default the exposure that fills the sensor, and shorter exposures.
    exposures_s: tuple[float, ...] | None = None


@dataclass(frozen=True, kw_only=True)
class SessionPoint:
    """A session and what it gives."""

    session: Session  #: Which.
    budgets: dict[str, DolpBudget]  #: Errors of DoLP by region.
    p_detection: float | None  #: Of the requested pair.

    @property
    def worst(self) -> DolpBudget:
        """The errors of the region with the largest error."""
        return max(self.budgets.values(), key=lambda budget: budget.total)


@dataclass(frozen=True, kw_only=True, eq=False)
class AcquisitionTradeoff:
    """Sessions of a scene with their results, and the shortest."""

    scene: str  #: Its name.
    request: TradeoffRequest  #: What was asked.
    regions: tuple[str, ...]  #: Whose DoLP counted.
    #: Every way to take frames, at its best exposure and settling, with increasing numbers of cycles.
    points: tuple[SessionPoint, ...]
    #: Start and result of every way; empty without goals.
    reached: tuple[tuple[Session, Reached], ...]
    best: Reached | None  #: The shortest of them.
    remarks: tuple[str, ...]  #: What is assumed.


def acquisition_tradeoff(
    scene: SceneFile, noise: NoiseParameters | None, request: TradeoffRequest, *, light: SceneLight | None = None
) -> AcquisitionTradeoff:
    """Return the results of sessions against time, and the shortest that reaches the goals.

    It tries the angles of the file, and 3, 4, 5 and 6 equally spaced ones in the order least affected by drift; cycles,
    passes back and forth, and grouped frames; exposures that fill the sensor and shorter ones; and waits for the
    polarizer if it settles slowly.
    """
    sessions = SceneSessions(scene, noise, light=light)
    regions = _regions(sessions, request)
    tried = tuple(_tried(scene, sessions, request))
    reached = _reached(sessions, tried, request, regions)
    best = shortest(one for _, one in reached)
    chosen = [_best_way(sessions, way, request, regions) for way in _ways(tried)]
    points = tuple(
        _point(sessions, replace(session, cycles=cycles), request, regions)
        for session in chosen
        for cycles in _CURVE_CYCLES
    )
    return AcquisitionTradeoff(
        scene=scene.name,
        request=request,
        regions=regions,
        points=points,
        reached=reached,
        best=best,
        remarks=sessions.remarks,
    )


def _regions(sessions: SceneSessions, request: TradeoffRequest) -> tuple[str, ...]:
    named = (() if request.region is None else (request.region,)) + (request.pair or ())
    unknown = [name for name in named if name not in sessions.regions]
    if unknown:
        raise ConfigError(f"no region {', '.join(unknown)}; the scene has {', '.join(sessions.regions)}")
    if request.pair is not None and request.pair[0] == request.pair[1]:
        raise ConfigError(f"target and background are both {request.pair[0]}; name two regions")
    if request.wanted.p_detection is not None and request.pair is None:
        raise ConfigError("the goal of a probability of detection needs target and background")
    return sessions.regions if request.region is None else (request.region,)


def _tried(scene: SceneFile, sessions: SceneSessions, request: TradeoffRequest) -> Iterator[Session]:
    """Yield every way to take frames, with one cycle."""
    for angles_rad in _angle_sets(scene):
        for pattern in PATTERNS:
            for exposure_s in _exposures_s(scene, sessions, request):
                for settle_s in _settle_s(request.disturbances):
                    yield Session(
                        angles_rad=angles_rad,
                        pattern=pattern,
                        exposure_s=exposure_s,
                        settle_s=settle_s,
                        overhead_s=request.overhead_s,
                    )


def _angle_sets(scene: SceneFile) -> tuple[tuple[float, ...], ...]:
    stated = tuple(float(angle) for angle in np.deg2rad(scene.acquisition.angles_deg))
    ascending = tuple(float(angle) for angle in equispaced_rad(4))
    ordered = [tuple(float(a) for a in least_drifting_order(equispaced_rad(count))) for count in (3, 4, 5, 6)]
    kept: dict[tuple[float, ...], tuple[float, ...]] = {}
    for angles in (stated, ascending, *ordered):
        kept.setdefault(tuple(round(degrees(angle), 6) for angle in angles), angles)
    return tuple(kept.values())


def _exposures_s(scene: SceneFile, sessions: SceneSessions, request: TradeoffRequest) -> tuple[float, ...]:
    if request.exposures_s is not None:
        return request.exposures_s
    filling_s = sessions.filling_exposure_s()
    return tuple(sorted({filling_s * factor for factor in _SHORTER} | {scene.acquisition.exposure_ms / 1000.0}))


def _settle_s(disturbances: Disturbances) -> tuple[float, ...]:
    if disturbances.settling_time_s == 0.0:
        return (0.0,)
    return tuple(disturbances.settling_time_s * times for times in _SETTLE_TIMES)


def _reached(
    sessions: SceneSessions, tried: tuple[Session, ...], request: TradeoffRequest, regions: tuple[str, ...]
) -> tuple[tuple[Session, Reached], ...]:
    """Return the shortest session of each angle set and pattern, or the reason why no session qualifies."""
    if request.wanted.dolp_total is None and request.wanted.p_detection is None:
        return ()
    found = []
    for way in _ways(session for session in tried if session.pattern != "grouped"):
        each = [
            fewest_cycles(
                sessions.scheme(session),
                request.wanted,
                disturbances=request.disturbances,
                regions=regions,
                pair=request.pair,
                pixels=request.pixels,
            )
            for session in way
        ]
        # If none reaches the goals, the one of the longest exposure is the most informative.
        unsaturated = [one for one in each if one.obstacle is not Obstacle.SATURATED] or each
        found.append((way[0], shortest(each) or unsaturated[-1]))
    return tuple(found)


def _ways(tried: Iterable[Session]) -> list[list[Session]]:
    """Return the sessions of each angle set and pattern together."""
    ways: dict[tuple[tuple[float, ...], Pattern], list[Session]] = {}
    for session in tried:
        ways.setdefault((session.angles_rad, session.pattern), []).append(session)
    return list(ways.values())


def _best_way(
    sessions: SceneSessions, way: list[Session], request: TradeoffRequest, regions: tuple[str, ...]
) -> Session:
    """Return the exposure and settling whose error, from one and two cycles, falls fastest in time."""
    usable = [session for session in way if sessions.scheme(session).saturation_probability <= SATURATED]
    if not usable:
        raise ConfigError("every tried exposure saturates; give shorter ones")

    def cost(session: Session) -> float:
        worst = _point(sessions, replace(session, cycles=2), request, regions).worst
        return float(worst.total**2 * session.frame_s) if np.isfinite(worst.total) else np.inf

    return min(usable, key=cost)


def _point(
    sessions: SceneSessions, session: Session, request: TradeoffRequest, regions: tuple[str, ...]
) -> SessionPoint:
    scheme = sessions.scheme(session)
    budgets = {
        name: dolp_budget(scheme.lights[name], session, request.disturbances, pixels=request.pixels) for name in regions
    }
    detected = None
    if request.pair is not None:
        detected = scheme.detection(request.pair, cycles=session.cycles, p_false_alarm=request.wanted.p_false_alarm)
    return SessionPoint(session=session, budgets=budgets, p_detection=detected)
