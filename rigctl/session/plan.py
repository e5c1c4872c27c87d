"""The plan of a session: its steps in order, the times of its rounds, the sun, and the time and disk that it needs.

It also warns of a costly order of angles, in which unpolarized light that changes looks polarized, and of too few axes
for a DoLP.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import lru_cache
from itertools import pairwise

import numpy as np

from model.processing.reconstruction import design, reconstruct
from rigctl.base.numbers import NS_PER_S, unix_ns, utc_text
from rigctl.console import Json
from rigctl.errors import ConfigError
from rigctl.files.choices import FrameKind
from rigctl.files.place import SiteSection
from rigctl.files.rig_file import RigFile
from rigctl.files.session_file import DarkSection, ScheduleSection, SessionFile, Take
from rigctl.scene.sun import sun_position

# A FITS header of one frame and its line in the manifest [bytes].
BYTES_BESIDE_PIXELS = 5760 + 1024
SUN_ANGLES = ("sun_zenith_deg", "sun_azimuth_deg", "phi_deg")
# Times of a move, of storing a frame and of homing, for the estimate only [s]: an ELL14 turns 45 deg in 0.2 s and
# answers in 0.1 s; a frame of 1 MB is on the disk in 0.02 s.
_MOVE_S, _STORE_S, _HOME_S = 0.4, 0.02, 2.0
# Assumed exposure before a metered one is known [s].
_METERED_S = 0.01
# Number of polarizers in a mosaic cell; then the largest distance of a calibrated axis from the nominal one.
_PLACES = 4
_HALF_TURN_DEG, _EIGHTH_DEG, _MEANT_DEG, _AXIS_DECIMALS = 180.0, 45.0, 5.0, 3
# Between two exact positions the sun is interpolated along the chord. In a minute it moves by at most 0.0044 rad, and
# the chord differs from the arc by at most 0.0044^2 / 8 = 2.4e-6 rad (0.14 millidegrees).
_NODE_NS, _NODES_KEPT = 60 * NS_PER_S, 4096
# Step of the search for crossings of an elevation: the sun does not cross it twice within one.
_SCAN_NS, _CROSSING_TOLERANCE_NS = 600 * NS_PER_S, NS_PER_S // 10
_NS_PER_MIN, _NS_PER_H = 60 * NS_PER_S, 3600 * NS_PER_S
_MOST_ROUNDS, _MOST_STEPS = 100_000, 1_000_000
_LEAST_ANGLES = 3
_DRIFT_PER_S = 0.01 / 60.0
# Four frames may wait for the disk, so a fast stretch shorter than twice this does no harm.
_STRETCH = 8
# Time of the fastest stage between two angles; time to read out and send 782 x 582 pixels at 1 Gbit/s.
_SHORTEST_MOVE_S, _FAST_CAMERA_S = 0.2, 0.007


@dataclass(frozen=True, kw_only=True)
class Step:
    """One frame that is to be taken."""

    sequence: int = 0  #: Its place in the session, from 0.
    kind: FrameKind
    cycle: int  #: Number of the pass through the angles, from 0, counted on through the rounds of a schedule.
    polarizer_angle_deg: float | None  #: Target of the polarizer's axis; None leaves it where it is.
    exposure_s: float | None  #: Integration time [s]; None is the exposure that was metered in this round.
    exposure_factor: float = 1.0  #: Factor on a metered exposure.
    round: int = 0  #: Round of the schedule, from 0.
    due_ns: int | None = None  #: When its round begins [ns since 1970 UTC]; None is at once.
    ends_cycle: bool = False  #: It is the last frame of a cycle, whose angles can then be compared.
    #: For a camera with polarizers on its pixels: place of the frame's pixels in the cell, from 0. Consecutive steps of
    #: parts 0 to 3 are one exposure.
    part: int | None = None

    @property
    def begins_exposure(self) -> bool:
        """True except for parts 1 to 3 of a cell, which are of the same exposure as part 0."""
        return not self.part


@dataclass(frozen=True, kw_only=True)
class SunAngles:
    """Direction of the sun: azimuth clockwise from north in [0, 360), elevation without refraction [deg]."""

    azimuth_deg: float
    elevation_deg: float

    @property
    def zenith_deg(self) -> float:
        """Angle from the vertical [deg]."""
        return 90.0 - self.elevation_deg


class SunTrack:
    """The sun above one site."""

    def __init__(self, site: SiteSection) -> None:
        self.site = site
        self._node: Callable[[int], tuple[float, float, float]] = lru_cache(maxsize=_NODES_KEPT)(self._exact)

    def at(self, utc_ns: int) -> SunAngles:
        """Return the direction of the sun at a time since 1970 (UTC) [ns]."""
        number, rest_ns = divmod(utc_ns, _NODE_NS)
        before, after = self._node(number), self._node(number + 1)
        share = rest_ns / _NODE_NS
        east, north, up = (a + share * (b - a) for a, b in zip(before, after, strict=True))
        return SunAngles(
            azimuth_deg=math.degrees(math.atan2(east, north)) % 360.0,
            elevation_deg=math.degrees(math.atan2(up, math.hypot(east, north))),
        )

    def crossings_ns(self, zenith_deg: float, *, start_ns: int, end_ns: int) -> Iterator[int]:
        """Yield each time between two others at which the sun's zenith angle passes a value, in either direction."""
        for left in range(start_ns, end_ns, _SCAN_NS):
            right = min(left + _SCAN_NS, end_ns)
            if self._is_below(zenith_deg, left) != self._is_below(zenith_deg, right):
                yield self._bisect(zenith_deg, left, right)

    def _bisect(self, zenith_deg: float, left: int, right: int) -> int:
        state = self._is_below(zenith_deg, left)
        while right - left > _CROSSING_TOLERANCE_NS:
            middle = (left + right) // 2
            left, right = (middle, right) if self._is_below(zenith_deg, middle) == state else (left, middle)
        return right

    def _is_below(self, zenith_deg: float, utc_ns: int) -> bool:
        return self.at(utc_ns).zenith_deg < zenith_deg

    def _exact(self, number: int) -> tuple[float, float, float]:
        found = sun_position(datetime.fromtimestamp(number * _NODE_NS // NS_PER_S, tz=UTC), self.site.place)
        level = math.sin(found.zenith_rad)
        return level * math.sin(found.azimuth_rad), level * math.cos(found.azimuth_rad), math.cos(found.zenith_rad)


@dataclass(frozen=True, kw_only=True, eq=False)
class SessionPlan:
    """A session laid out in time."""

    steps: tuple[Step, ...]
    times_ns: tuple[int, ...]  #: Estimated time of each step [ns since 1970 UTC].
    start_ns: int
    sun: SunTrack | None  #: None if the rig file states no site.
    camera_azimuth_deg: float | None  #: Azimuth of the camera as seen from the target.
    disk_bytes: int | None  #: Size of the frames on the disk; None if the size of a frame is not known.
    remarks: tuple[str, ...]  #: Doubts about the plan.

    def rounds(self) -> dict[int, int]:
        """Return the time of the first step of each round [ns since 1970 UTC]."""
        begin: dict[int, int] = {}
        for step, time_ns in zip(self.steps, self.times_ns, strict=True):
            begin.setdefault(step.round, time_ns)
        return begin

    @property
    def duration_s(self) -> float:
        """Time from the beginning until the last frame is taken [s]."""
        return (self.times_ns[-1] - self.start_ns) / NS_PER_S

    @property
    def false_dolp(self) -> float | None:
        """DoLP that unpolarized light shows in a round if it grows by 1 % a minute."""
        return false_dolp([step for step in self.steps if step.round == self.steps[0].round])

    def planned_rounds(self) -> list[dict[str, Json]]:
        """Return the beginning of each round with the sun's position."""
        return [{"round": number, **self._moment(time_ns)} for number, time_ns in self.rounds().items()]

    def planned_steps(self) -> list[dict[str, Json]]:
        """Return the estimated time of each frame with the sun's position; an exposure of None is metered."""
        return [
            {
                "sequence": step.sequence,
                "round": step.round,
                **self._moment(time_ns),
                "kind": step.kind,
                "cycle": step.cycle,
                "angle_deg": step.polarizer_angle_deg,
                "exposure_ms": None if step.exposure_s is None else step.exposure_s * 1000.0,
            }
            for step, time_ns in zip(self.steps, self.times_ns, strict=True)
        ]

    def content(self) -> dict[str, Json]:
        """Return the plan for JSON."""
        return {
            "start_utc": utc_text(self.start_ns),
            "end_utc": utc_text(self.times_ns[-1]),
            "duration_s": self.duration_s,
            "disk_bytes": self.disk_bytes,
            "false_dolp_per_percent_a_minute": self.false_dolp,
            "rounds": self.planned_rounds(),
            "steps": self.planned_steps(),
            "remarks": list(self.remarks),
        }

    def _moment(self, time_ns: int) -> dict[str, Json]:
        """Return a time with the angles of the sun as far as they are known. phi is its azimuth minus the camera's."""
        if self.sun is None:
            return {"utc": utc_text(time_ns)}
        sun, camera_deg = self.sun.at(time_ns), self.camera_azimuth_deg
        angles: dict[str, Json] = {"sun_zenith_deg": sun.zenith_deg, "sun_azimuth_deg": sun.azimuth_deg}
        if camera_deg is not None:
            # In (-180, 180]; at 180 the camera looks towards the sun.
            angles["phi_deg"] = 180.0 - (180.0 - (sun.azimuth_deg - camera_deg)) % 360.0
        return {"utc": utc_text(time_ns), **angles}


def plan_session(
    rig: RigFile, session: SessionFile, *, now_ns: int, until_ns: int | None = None, pixels: int | None = None
) -> SessionPlan:
    """Return a session laid out in time."""
    rounds = round_times_ns(session, rig.site, now_ns=now_ns, until_ns=until_ns)
    steps = plan_steps(session, rounds, cell_deg=rig.cell_deg)
    times = step_times_ns(steps, start_ns=now_ns)
    if until_ns is not None:
        steps = tuple(step for step, time in zip(steps, times, strict=True) if time < until_ns) or steps[:1]
        times = times[: len(steps)]
    geometry = rig.geometry
    azimuth = None if geometry is None or geometry.camera_azimuth_deg is None else geometry.camera_azimuth_deg.value
    return SessionPlan(
        steps=steps,
        times_ns=times,
        start_ns=now_ns,
        sun=None if rig.site is None else SunTrack(rig.site),
        camera_azimuth_deg=azimuth,
        disk_bytes=estimate(steps, rig, pixels=pixels)[1],
        remarks=tuple(_remarks(rig, session, steps, times)),
    )


def round_times_ns(
    session: SessionFile, site: SiteSection | None, *, now_ns: int, until_ns: int | None = None
) -> tuple[int | None, ...]:
    """Return when each round is due, in ascending order [ns since 1970 UTC]; a single None without a schedule."""
    schedule = session.schedule
    if schedule is None:
        return (None,)
    if schedule.needs_sun and site is None:
        raise ConfigError("the schedule asks for the sun: the rig file needs [site] with latitude_deg, longitude_deg")
    start_ns = now_ns if schedule.start is None else unix_ns(schedule.start)
    end_ns = start_ns + round(schedule.duration_h * _NS_PER_H) if schedule.end is None else unix_ns(schedule.end)
    end_ns = end_ns if until_ns is None else min(end_ns, until_ns)
    sun = None if site is None else SunTrack(site)
    candidates = set(_candidates(schedule, sun, start_ns, end_ns))
    times = sorted(time for time in candidates if _is_in_window(schedule, sun, time))
    if not times:
        raise ConfigError("schedule: there is no round between its start and its end; look at `rigctl plan`")
    return tuple(times)


def plan_steps(
    session: SessionFile,
    round_times_ns: Sequence[int | None] = (None,),
    *,
    cell_deg: tuple[float, ...] | None = None,
) -> tuple[Step, ...]:
    """Return the frames of a session in the order of time."""
    takes = session.take if cell_deg is None else [_take_of_cell(take, cell_deg) for take in session.take]
    _require_few(takes, session.darks, rounds=len(round_times_ns))
    frames = [
        (number, due_ns, frame)
        for number, due_ns in enumerate(round_times_ns)
        for take in takes
        if number % take.every_rounds == 0
        for frame in _frames_of(take, _darks_of(session, number), first_cycle=number // take.every_rounds * take.cycles)
    ]
    if cell_deg is not None:
        targets_deg = tuple(map(nominal_deg, cell_deg))
        frames = [(number, due_ns, part) for number, due_ns, frame in frames for part in _parts(frame, targets_deg)]
    return tuple(
        replace(frame, sequence=sequence, round=number, due_ns=due_ns)
        for sequence, (number, due_ns, frame) in enumerate(frames)
    )


def exposures_of(steps: Sequence[Step]) -> Iterator[tuple[Step, ...]]:
    """Yield the steps of each exposure: one, or the four parts of a cell."""
    begins = [place for place, step in enumerate(steps) if step.begins_exposure]
    for begin, end in pairwise([*begins, len(steps)]):
        yield tuple(steps[begin:end])


def nominal_deg(axis_deg: float) -> float:
    """Return the multiple of 45 deg nearest to a calibrated axis, in [0, 180), or the axis itself if none is near."""
    nominal = round(axis_deg / _EIGHTH_DEG) * _EIGHTH_DEG
    return nominal % _HALF_TURN_DEG if abs(axis_deg - nominal) <= _MEANT_DEG else axis_deg


def estimate(steps: tuple[Step, ...], rig: RigFile, *, pixels: int | None = None) -> tuple[float, int | None]:
    """Return the time [s] and the disk space [bytes] of steps; None if the size of a frame is not known.

    The time is that of exposures, moves and storing, without the work of a person at the rig.
    """
    moves = sum(
        1
        for before, step in zip((None, *steps), steps, strict=False)
        if _turns(step, None if before is None else before.polarizer_angle_deg)
    )
    exposed_s = sum(planned_exposure_s(step) for step in steps if step.begins_exposure)
    duration_s = (0.0 if rig.stage is None else _HOME_S) + moves * _MOVE_S + exposed_s + len(steps) * _STORE_S
    if pixels is None and rig.simulation is not None:
        pixels = rig.simulation.camera.width * rig.simulation.camera.height
    if pixels is None:
        return duration_s, None
    of_frame = pixels // _PLACES if rig.camera.mosaic_deg is not None and rig.camera.interpolation == "none" else pixels
    return duration_s, len(steps) * (2 * of_frame + BYTES_BESIDE_PIXELS)


def planned_exposure_s(step: Step) -> float:
    """Return the exposure of a step [s]; an assumed one if it is metered later."""
    return _METERED_S * step.exposure_factor if step.exposure_s is None else step.exposure_s


def step_times_ns(steps: Sequence[Step], *, start_ns: int) -> tuple[int, ...]:
    """Return the estimated time of each step [ns since 1970 UTC]; no round begins before it is due."""
    times: list[int] = []
    turned = any(step.part is None for step in steps)
    free_ns = start_ns + (round(_HOME_S * NS_PER_S) if turned else 0)
    angle: float | None = None
    for step in steps:
        if not step.begins_exposure:
            times.append(times[-1])
            free_ns += round(_STORE_S * NS_PER_S)
            continue
        begin_ns = free_ns if step.due_ns is None else max(free_ns, step.due_ns)
        if _turns(step, angle):
            begin_ns, angle = begin_ns + round(_MOVE_S * NS_PER_S), step.polarizer_angle_deg
        times.append(begin_ns)
        free_ns = begin_ns + round((planned_exposure_s(step) + _STORE_S) * NS_PER_S)
    return tuple(times)


def demand_of(
    rig: RigFile, session: SessionFile, *, pixels: int, now_ns: int, camera_s: float | None = None
) -> tuple[int, float, int]:
    """Return the disk speed and space that a session needs if it begins now.

    These are the bytes of one frame, the mean time from frame to frame in the fastest stretch of eight frames [s], and
    the bytes of all frames.
    """
    plan = plan_session(rig, session, now_ns=now_ns, pixels=pixels)
    total = plan.disk_bytes or 0
    beside_s = _FAST_CAMERA_S if camera_s is None else camera_s
    return total // len(plan.steps), _fastest_period_s(plan.steps, beside_s), total


def false_dolp(steps: Sequence[Step]) -> float | None:
    """Return the DoLP that unpolarized light shows if it grows by 1 % a minute; None with fewer than three angles.

    It is reconstructed from the intensities (1 + drift * mean time of an angle) / 2.
    """
    times: dict[float, list[float]] = defaultdict(list)
    for step, time_ns in zip(steps, step_times_ns(steps, start_ns=0), strict=True):
        if step.kind == "scene" and step.polarizer_angle_deg is not None:
            times[step.polarizer_angle_deg % 180.0].append(time_ns / NS_PER_S)
    if len(times) < _LEAST_ANGLES:
        return None
    angles_deg = sorted(times)
    mean_s = np.array([np.mean(times[angle]) for angle in angles_deg])
    intensity = 0.5 * (1.0 + _DRIFT_PER_S * (mean_s - mean_s.mean()))
    s0, s1, s2 = reconstruct(design(np.deg2rad(angles_deg)), intensity)
    return float(np.hypot(s1, s2) / s0)


def grouping_cost(session: SessionFile) -> str | None:
    """Return a warning of false DoLP by drift if frames are grouped by angle; None if they are not."""
    grouped = [take for take in session.take if take.order == "grouped"]
    if not grouped:
        return None
    cost, instead = (
        false_dolp(plan_steps(session.model_copy(update={"take": takes, "darks": None})))
        for takes in (grouped, [take.model_copy(update={"order": "cycles"}) for take in grouped])
    )
    text = "order 'grouped': all frames of an angle come together, so that drift looks like polarization"
    if cost is None or instead is None:
        return text
    drift = "light that drifts by 1 % a minute shows a false DoLP"
    return f"{text}: {drift} of {cost:.2g}; in cycles it would be {instead:.2g}"


def missing_axes(steps: Sequence[Step]) -> str | None:
    """Return a warning if a session has too few axes for a DoLP; None if it has enough or takes no scene frames."""
    targets = [step.polarizer_angle_deg for step in steps if step.kind == "scene"]
    axes = {round(target % 180.0, _AXIS_DECIMALS) % 180.0 for target in targets if target is not None}
    if not axes or len(axes) >= _LEAST_ANGLES:
        return None
    return (
        f"scene frames have {len(axes)} polarizer axes ({', '.join(f'{axis:g}' for axis in sorted(axes))} deg; angles "
        f"180 deg apart are one): DoLP and AoLP need {_LEAST_ANGLES}, better 0, 90, 45, 135"
    )


def _require_few(takes: Sequence[Take], darks: DarkSection | None, *, rounds: int) -> None:
    """Refuse more steps than memory holds, before any is made."""
    steps = 0
    for take in takes:
        exposures = len(take.exposures_s) * len(take.exposure_factors)
        frames = (len(take.polarizer_angles_deg) + 1) * take.cycles
        if darks is not None and take.kind == "scene":
            frames += darks.frames * (2 + take.cycles // darks.every_cycles)
        steps += rounds * exposures * frames
    if steps > _MOST_STEPS:
        raise ConfigError(
            f"take: rounds, cycles, angles and exposures make up to {steps} frames, allowed are {_MOST_STEPS}: take "
            "several sessions"
        )


def _take_of_cell(take: Take, cell_deg: tuple[float, ...]) -> Take:
    """Return a take of a camera with polarizers on its pixels: one exposure has all angles."""
    axes = {round(nominal_deg(axis), _AXIS_DECIMALS) for axis in cell_deg}
    asked = {round(nominal_deg(angle % _HALF_TURN_DEG), _AXIS_DECIMALS) for angle in take.angles_deg or ()}
    if take.angles_deg is not None and asked != axes:
        known = ", ".join(f"{axis:g}" for axis in cell_deg)
        raise ConfigError(
            f"angles_deg of a take: the camera's pixels stand behind {known} deg, all of them in each exposure; leave "
            "angles_deg out"
        )
    if take.closing_repeat:
        raise ConfigError("closing_repeat: all angles are of one exposure here, so that no drift comes between them")
    # One exposure per cycle; its angle is replaced by those of the cell.
    return take.model_copy(update={"angles_deg": [0.0], "order": "cycles"})


def _parts(frame: Step, targets_deg: tuple[float, ...]) -> Iterator[Step]:
    """Yield the frames of an exposure, one for each place of a cell."""
    last = len(targets_deg) - 1
    for part, target_deg in enumerate(targets_deg):
        yield replace(frame, polarizer_angle_deg=target_deg, part=part, ends_cycle=frame.ends_cycle and part == last)


def _darks_of(session: SessionFile, number: int) -> DarkSection | None:
    darks = session.darks
    return None if darks is None or number % darks.every_rounds else darks


def _frames_of(take: Take, darks: DarkSection | None, *, first_cycle: int) -> Iterator[Step]:
    for exposure_s in take.exposures_s:
        if take.order == "grouped":
            yield from _dark_frames(take, darks, exposure_s, 0)
            yield from _grouped_frames(take, exposure_s, first_cycle)
        else:
            for cycle in range(take.cycles):
                yield from _dark_frames(take, darks, exposure_s, cycle)
                yield from _cycle_frames(take, exposure_s, first_cycle + cycle)
        yield from _dark_frames(take, darks, exposure_s, 0)


def _dark_frames(take: Take, darks: DarkSection | None, exposure_s: float | None, cycle: int) -> Iterator[Step]:
    if darks is None or take.kind != "scene" or cycle % darks.every_cycles:
        return
    for factor in take.exposure_factors:
        for frame in range(darks.frames):
            yield _planned("dark", frame, None, exposure_s, factor)


def _cycle_frames(take: Take, exposure_s: float | None, cycle: int) -> Iterator[Step]:
    angles = take.polarizer_angles_deg
    if take.order == "palindrome" and cycle % 2:
        angles = angles[::-1]
    if take.closing_repeat:
        angles = (*angles, angles[0])
    last = (len(angles) - 1, len(take.exposure_factors) - 1)
    for place, angle in enumerate(angles):
        for k, factor in enumerate(take.exposure_factors):
            ends_cycle = (place, k) == last and take.kind == "scene"
            yield _planned(take.kind, cycle, angle, exposure_s, factor, ends_cycle=ends_cycle)


def _grouped_frames(take: Take, exposure_s: float | None, first_cycle: int) -> Iterator[Step]:
    for angle in take.polarizer_angles_deg:
        for cycle in range(take.cycles):
            for factor in take.exposure_factors:
                yield _planned(take.kind, first_cycle + cycle, angle, exposure_s, factor)


def _planned(
    kind: FrameKind,
    cycle: int,
    angle: float | None,
    exposure_s: float | None,
    factor: float,
    *,
    ends_cycle: bool = False,
) -> Step:
    return Step(
        kind=kind,
        cycle=cycle,
        polarizer_angle_deg=angle,
        exposure_s=None if exposure_s is None else exposure_s * factor,
        exposure_factor=factor,
        ends_cycle=ends_cycle,
    )


def _turns(step: Step, angle_deg: float | None) -> bool:
    """Return whether the stage turns for a step; a mosaic camera needs no stage."""
    return step.part is None and step.polarizer_angle_deg not in (None, angle_deg)


def _candidates(schedule: ScheduleSection, sun: SunTrack | None, start_ns: int, end_ns: int) -> Iterator[int]:
    for time in schedule.times or ():
        if start_ns <= unix_ns(time) < end_ns:
            yield unix_ns(time)
    if schedule.every_min is not None:
        step_ns = round(schedule.every_min * _NS_PER_MIN)
        if (end_ns - start_ns) / step_ns > _MOST_ROUNDS:
            raise ConfigError(f"schedule.every_min: makes more than {_MOST_ROUNDS} rounds")
        yield from range(start_ns, end_ns, step_ns)
    for zenith_deg in schedule.zenith_passes_deg or ():
        if sun is not None:
            yield from sun.crossings_ns(zenith_deg, start_ns=start_ns, end_ns=end_ns)


def _is_in_window(schedule: ScheduleSection, sun: SunTrack | None, time_ns: int) -> bool:
    below, above = schedule.while_zenith_below_deg, schedule.while_zenith_above_deg
    if sun is None or (below is None and above is None):
        return True
    zenith_deg = sun.at(time_ns).zenith_deg
    return (below is None or zenith_deg < below) and (above is None or zenith_deg > above)


def _remarks(rig: RigFile, session: SessionFile, steps: tuple[Step, ...], times: tuple[int, ...]) -> list[str]:
    found = []
    if rig.site is None:
        found.append("the rig file has no [site]: no sun angles")
    elif rig.geometry is None or rig.geometry.camera_azimuth_deg is None:
        found.append("the rig file has no camera_azimuth_deg in [geometry]: no azimuth of the sun against the camera")
    grouping = grouping_cost(session) if rig.cell_deg is None else None
    found += [doubt for doubt in (grouping, missing_axes(steps)) if doubt is not None]
    if any(step.exposure_s is None for step in steps):
        found.append("metered exposures are taken for 10 ms here")
    limit_ns = math.inf if session.schedule is None else session.schedule.late_min * _NS_PER_MIN
    late = {s.round for s, t in zip(steps, times, strict=True) if s.due_ns is not None and t - s.due_ns > limit_ns}
    if late:
        rounds = ", ".join(map(str, sorted(late)))
        found.append(f"rounds {rounds}: a round before takes so long that these begin too late and may be left out")
    return found


def _fastest_period_s(steps: Sequence[Step], camera_s: float) -> float:
    periods_s = [
        camera_s + planned_exposure_s(step) + (_SHORTEST_MOVE_S if _is_turned(before, step) else 0.0)
        if step.begins_exposure
        else 0.0
        for before, step in zip((None, *steps), steps, strict=False)
    ]
    length = min(_STRETCH, len(periods_s))
    stretches = (periods_s[start : start + length] for start in range(len(periods_s) - length + 1))
    return min(sum(stretch) for stretch in stretches) / length


def _is_turned(before: Step | None, step: Step) -> bool:
    return before is not None and _turns(step, before.polarizer_angle_deg)
